"""Older algorithms and alternative strategies, for comparison with the path tracer, which does not depend on them.

whitted   Whitted's ray tracing         ao        ambient occlusion
strategy  strategies to find light, heuristics, and deliberate errors      mixture   sampling of guide targets
path      the path tracer that follows one path at a time, with these strategies
"""
