"""Handing out batches, from the choice of a job to the lease that lasts until the result arrives.

scheduler.py      fills the window of outstanding batches
line_up.py        the jobs that a kind of workers may render, by priority
together.py       several batches in one message
sites.py          batches for the machines of a site
pace.py           length of batches, and number of outstanding ones
dispatch.py       sends through Celery and inspects its queues
leases.py         outstanding work
held.py           the batches that workers report to hold
missing.py        lost and late leases
"""
