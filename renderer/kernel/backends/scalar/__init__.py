"""The path tracer that follows one path at a time, for comparisons and tests."""
