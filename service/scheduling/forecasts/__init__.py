"""When jobs will be ready.

forecast.py       when a job is expected to finish
deadlines.py      whether that is in time
"""
