"""Eight-lane values: operators for formulas that accept float32 or f32x8, gathers and scatters of rows, and calls per lane."""
