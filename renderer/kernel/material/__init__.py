"""Materials: the scene's table of parameters, texture lookups, normal maps, and dispatch to the BSDF models."""
