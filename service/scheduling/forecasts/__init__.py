"""Expected completion times of jobs.

forecast.py   the expected completion time of a job
deadlines.py  whether a job is late
"""
