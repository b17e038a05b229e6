"""Values of eight lanes for code that is written once for one path and for eight.

Contains operators for formulas on float32 or f32x8, gathers and scatters of table rows, and calls of scalar functions lane by
lane.
"""
