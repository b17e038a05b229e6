"""Materials: parameter rows, texture lookups, normal maps, and dispatch to the BSDF models."""
