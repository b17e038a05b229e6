"""Expected completion times of jobs, and whether jobs are late.

forecast.py   the expected completion time of a job
deadlines.py  whether a job is late
"""
