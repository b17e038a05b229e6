"""The path tracer for frames: a pool of paths in rows, and stages that process eight paths at a time.

A stage reads the state of eight rows as named tuples, executes a step of renderer/kernel/steps, and writes the tuples back. It
processes a list of row numbers (lists.py). The grouping of rows does not affect a sample, whose random numbers depend only on its
pixel and its sample number. The layout of a row is declared in rows.py. render.py is the driver.
"""
