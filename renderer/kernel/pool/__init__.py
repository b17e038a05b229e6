"""The path tracer for frames: a pool of paths in rows, and stages that process eight paths at a time.

A stage processes a list of row numbers (lists.py). The grouping of rows does not affect a sample, whose random numbers depend
only on its pixel and its sample number. trace.py is the driver.
"""
