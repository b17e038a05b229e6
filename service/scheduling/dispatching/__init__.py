"""Dispatching batches: from the choice of a job to the lease, which lasts until the result arrives.

scheduler.py     fills the window of outstanding batches
batch_outcomes.py  ends leases: results, failures, returns, losses
job_queue.py     the jobs that workers of one kind may render, by priority
batch_groups.py  several batches in one message
sites.py         batches for the machines of a site
cards.py         messages for workers with graphics cards
pacing.py        duration of batches, and number of outstanding ones
dispatcher.py    the interface through which work is sent to queues; celery_dispatcher.py implements it
leases.py        outstanding work
held_batches.py  the batches that workers currently report
lost_batches.py  lost and late leases
"""
