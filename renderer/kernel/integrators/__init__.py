"""Integrators that follow one path at a time, for comparisons and replays, and functions shared with the pool."""
