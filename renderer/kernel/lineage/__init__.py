"""Older algorithms and alternative sampling strategies, for comparison with the path tracer, which does not depend on them.

whitted.py    Whitted's ray tracing (1980)
ao.py         ambient occlusion
strategy.py   alternatives to the default light sampling: other MIS heuristics, one strategy alone, deliberate errors
mixture.py    directions sampled from a mixture of the BSDF and directions towards marked objects
path.py       a path tracer that follows one path at a time, with a strategy of strategy.py or mixture.py
"""
