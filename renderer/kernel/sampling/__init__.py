"""Sampling: random number generators, warps from the unit square with their densities, pixel filters."""
