"""The workers: what they report, how fast they are, what work suits them.

workers.py        the workers that report themselves
reports.py        checks what workers report of themselves
speeds.py         how fast they were during the last hour
needs.py          what a job requires of its workers
"""
