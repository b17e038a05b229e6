"""The log of a worker.

logs.py            set up the log
log_tail.py        the end of the log, for the service
task_context.py    the ids of the task in progress
batch_warnings.py  a batch's warnings, and how long its steps took
"""
