"""The Celery application: prepares scenes, renders batches and denoises frames.

What the service and a worker say to each other (no numba: the service imports these)
    contract.py       tasks, queues, keys and results; start here
    joint.py          batches of a tile that a machine's slots render together
    view_parts.py     pieces of views that somebody is looking at
    explained.py      pixels that somebody wants explained
    site.py           what the machines of a site say to its reducer
    terms.py          what a worker is asked for at run time, and what it offers
    vitals.py         a machine's memory and load, and the end of its log
    lifeline.py       tells a dead worker from a slow one
    broker.py         Celery's settings for both ends of the queue
    sums.py           a batch's sums as bytes
    result_bytes.py   a result as bytes
    blends.py         scenes that need Blender to be opened
    reproduce.py      the command that renders a failed batch again, without a farm
A worker's process
    __main__.py       from its first line to its last
    joining.py        joins the farm while the kernels are compiled
    app.py            the Celery application, and what happens around its forks
    context.py        what every process of a worker knows
    heartbeat.py      reports the worker, and watches its event loop
    leaving.py        reports what is still in hand while the worker ends
    keeping.py        keeps to the terms it was asked for
    hours.py          when a worker works
    presence.py       whether somebody is using the machine
    turns.py          from which queue it takes next
    queue_reading.py  reads the queue, and skips what is no message
    process.py        children that die with their parent
    family.py         all processes of this worker
    status.py         what each slot is doing, in shared memory
Tasks
    tasks.py          all of them; each one's work is in a module of its own
    asides.py         the tasks that make something for a reader: denoising, motion vectors, environments
    slot.py           a slot at work, as the worker reports it
    deaths.py         how often a task has killed its process
    render.py         a batch
    jointly.py        a batch shared among slots; pieces.py is the folder they share, adding.py adds up their sums
    viewport.py       pieces of views
    prepare.py        a scene
    frames.py         frames of a shot
    relight.py        a scene under another light
    denoise.py        a denoised frame
    vectors.py        motion vectors
    environments.py   an uploaded environment's thumbnail
    explain.py        the paths of a pixel
    bounded.py        runs work on untrusted files in a child with limits; standing.py keeps such a child for more
Files and kernels
    link.py           HTTP to the service
    foreign.py        the sentence about an answer that comes from no farm
    trust.py          which certificate to trust
    redis_tls.py      the same for Redis
    cache.py          blobs by hash on this machine
    files.py          a scene's files in a folder
    scenes.py         compiled scenes: fetched, mapped, stored
    kernels.py        kernels: fetched from the farm, and handed in
    ready.py          a kernel made ready
    results.py        the way back: events and sums on the stream
    errors.py         what can go wrong, by whose trouble it is
    patience.py       trying again where it is the worker's own
A site
    reducer.py        adds up what a site's machines have rendered
    site_sums.py      the sums it holds, on disk
    site_link.py      a worker's way to it
    timed.py          reads from a socket with a time limit
Logs and traces
    logs.py           set up the log
    log_lines.py      log lines as JSON
    log_tail.py       the end of the log, for the service
    told.py           what a task is about
    overheard.py      a batch's warnings, and how long its steps took
    tracing.py        OpenTelemetry spans
    trace_sender.py   the process that sends them
"""
