"""The worker, a Celery application: prepares scenes, renders batches and denoises frames.

Each folder builds on those above it:
    machine/              the machine, and a worker's processes on it
    telemetry/            the log
    exchange/             blobs, kernels and results between service and worker
    site/                 addition of the results of several machines at one location
    process/              state shared by all processes of a worker, its usage limits, and the order of its queues
    reading/              jobs of the confined process that reads untrusted files
    work/                 implementations of the tasks
    tasks.py              the Celery tasks
    heartbeat.py          reports the worker to the service, and restarts a worker that hangs
    joining.py            joins the farm while the kernel is loaded
    shutdown_reporter.py  reports work in progress while the worker shuts down
    app.py                the Celery application, and its hooks around forks
    __main__.py           the worker's main function
    standby.py            like __main__.py, but imports first and reads its options from a line of stdin
    healthy.py            health check of a worker's container
"""
