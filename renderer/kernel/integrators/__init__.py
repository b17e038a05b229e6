"""One path at a time: the path tracer with all that comparisons ask for, Whitted, ambient occlusion; and what the pool shares."""
