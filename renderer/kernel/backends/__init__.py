"""Backends: they store paths, and execute the steps of renderer/kernel/steps in a certain order.

cpu/     many paths at once, eight per step: renders frames
cuda/    one path at a time in each thread of a graphics card
scalar/  one path at a time: for comparisons and tests
"""
