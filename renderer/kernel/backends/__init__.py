"""Backends: where paths are kept, and in what order the steps of renderer/kernel/steps are taken.

cpu/     many paths at once, eight to a step: renders frames
cuda/    one path at a time in each thread of a graphics card
scalar/  one path at a time: comparisons and tests
"""
