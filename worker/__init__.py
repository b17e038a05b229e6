"""The worker, a Celery application: prepares scenes, renders batches and denoises frames.

Each folder builds on those above it:
    machine/      the machine, and a worker's processes on it
    telemetry/    the log
    exchange/     blobs, kernels and results between service and worker
    site/         sums of several machines, added at the site
    process/      state shared by every process of a worker; terms, turns
    reading/      jobs of the confined process that reads untrusted files
    work/         implementations of the tasks
    tasks.py      the tasks
    heartbeat.py  reports the worker, and watches its event loop
    joining.py    joins the farm while the kernels are compiled
    leaving.py    reports work in progress while the worker shuts down
    app.py        the Celery application, and its hooks around forks
    __main__.py   the worker's main function
    standby.py    like __main__.py, but imports first and reads its options from a line of stdin
"""
