"""Eight-lane values: operators for formulas on float32 or f32x8, gathers and scatters of table rows, and calls per lane."""
