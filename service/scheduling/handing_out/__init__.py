"""Batches on their way to the workers, from the choice of a job to the lease that is kept until its result is back.

scheduler.py      fills the window of outstanding batches
line_up.py        which jobs a kind of worker may render, by priority
together.py       several batches in one message
sites.py          batches for the machines of a site
pace.py           how long batches are, and how many may be out
dispatch.py       sends through Celery, and looks into its queues
leases.py         what is handed out and not back yet
held.py           which batches workers say they have in hand
missing.py        which leases are lost, and which are only late
"""
