"""Participating media: nesting of media along a path, free flights, phase functions, and subsurface scattering."""
