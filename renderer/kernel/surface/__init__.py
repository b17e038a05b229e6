"""From a hit to a point with a normal, a frame to shade in, texture coordinates and a place to leave from."""
