"""What the service, a site and a worker say to each other. No numba: the service imports these.

contract.py       tasks, queues, keys and results; start here
joint.py          batches of a tile that a machine's slots render together
view_parts.py     pieces of views that somebody is looking at
explained.py      pixels that somebody wants explained
site.py           what the machines of a site say to its reducer
terms.py          what a worker is asked for at run time, and what it offers; hours.py: when it works
vitals.py         a machine's memory and load, and the end of its log
lifeline.py       tells a dead worker from a slow one
broker.py         Celery's settings for both ends of the queue
sums.py           a batch's sums as bytes
result_bytes.py   a result as bytes
blends.py         scenes that need Blender to be opened
reproduce.py      the command that renders a failed batch again, without a farm
"""
