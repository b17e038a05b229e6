"""The Celery application: prepares scenes, renders batches and denoises frames.

Each folder builds on those above it:
    protocol/     what service, site and worker say to each other: start with contract.py
    machine/      the machine, and a worker's processes on it
    telemetry/    the log, and traces
    exchange/     blobs, kernels and results between service and worker
    site/         sums added up among machines before they travel
    process/      what every process of a worker knows; terms, turns
    reading/      jobs of the confined process that reads untrusted files
    work/         what the tasks do
    tasks.py      the tasks
    heartbeat.py  reports the worker, and watches its event loop
    joining.py    joins the farm while the kernels are compiled
    leaving.py    reports what is still in hand while the worker ends
    app.py        the Celery application, and what happens around its forks
    __main__.py   from a worker's first line to its last
"""
