"""Eight-lane values: operators for formulas that take float32 or f32x8, gathers and scatters of rows, and per-lane calls."""
