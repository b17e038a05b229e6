"""The Celery application: prepares scenes, renders batches and denoises frames.

contract.py   what the service and a worker say to each other (no numba: the service imports it)
__main__.py   a worker process from its first line to its last
joining.py    asks the service to let it in, while the kernels are compiled
app.py        the Celery application of a worker, and what happens around its forks
tasks.py      the three tasks
prepare.py    prepare: from untrusted files to a compiled scene, a thumbnail and a summary
bounded.py    runs that in a child with bounds on memory and time
render.py     render_batch: maps the compiled scene, renders, packs the sums
denoise.py    denoise: from a film's means to a picture without noise
reproduce.py  the command that shows a failure again, without a farm
results.py    the way back: events and sums on the stream
link.py       HTTP to the service: manifests, and blobs both ways
foreign.py    the sentence about what answers there and is no service
errors.py     what goes wrong, by whose trouble it is: the worker's own, or the scene's
patience.py   trying again where it is the worker's own
cache.py      blobs by hash, fetched once, or mapped from the service's own files
heartbeat.py  what a worker reports of itself, and the watchdog on its event loop
status.py     what each slot does now, in shared memory
logs.py       the log, a line for each thing that happens
process.py    no process is left behind
"""
