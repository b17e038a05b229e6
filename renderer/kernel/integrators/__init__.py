"""How light is followed: path tracing, Whitted, ambient occlusion, and what only comparisons need."""
