"""The Celery application: prepares scenes and renders batches.

contract.py  what the service and a worker say to each other (no numba: the service imports it)
app.py       the Celery application of a worker process
tasks.py     prepare and render_batch
cache.py     scenes and compiled scenes by hash, fetched over HTTP or mapped from the service's own files
heartbeat.py what a worker reports of itself
"""
