"""What is rendered next, by whom, and what comes back: the engine's thread and its parts.

The engine
    engine.py         the thread, and what it does in each step; start here
    bulkhead.py       keeps one job's faults from the others
    changes.py        what was changed in the database since the last step
    records.py        everything the engine reads from and writes to the database
    snapshot.py       the immutable view of the engine that other threads read
Jobs and frames
    lifecycle.py      a job from the database to the scheduler and out again
    active_job.py     a job that is being rendered
    active_frame.py   a frame of it: its plan, its noise
    agenda.py         which frame is next
    turns.py          the frames in that order, kept up as they change
    plan.py           which tile of a frame is next, and how many samples of it
    totals.py         sums over all frames of a job
    waiting.py        jobs that wait for other jobs
    wishes.py         what a person may change in a job
    shot_wishes.py    the same for a shot's frames
    history.py        how a job's noise fell over time, and what happened on the way
    job_log.py        a job's log, as a text file
    tile_log.py       who rendered which samples of each tile lately
    film_snapshots.py keeps what a still looked like at 1, 2, 4, 8 ... samples
    frame_bytes.py    how much room a shot's compiled frames take
    reproduce.py      the command that shows an error again
Handing out
    scheduler.py      fills the window of outstanding batches
    line_up.py        which jobs a kind of worker may render, by priority
    shares.py         whose turn it is among jobs of one priority
    needs.py          what a job requires of its workers
    together.py       several batches in one message
    sites.py          batches for the machines of a site
    pace.py           how long batches are, and how many may be out
    dispatch.py       sends through Celery, and looks into its queues
    workers.py        the workers that report themselves
    reports.py        checks what workers report of themselves
    speeds.py         how fast they were during the last hour
    leases.py         what is handed out and not back yet
    held.py           which batches workers say they have in hand
    missing.py        which leases are lost, and which are only late
Taking in
    results.py        reads the stream of answers
    messages.py       validates what workers say
    answers.py        acts on it
    merging.py        batches into the film
    looks.py          how much time estimating noise may take
    measured.py       what a job has learned about its scene's cost and noise
Trust
    suspicion.py      workers that fail where others do not
    trust.py          compares batches that two workers have rendered
    votes.py          decides who is right
Other work for workers
    preparing.py      scenes
    moments.py        frames of shots
    aside.py          what readers ask for of a frame; the base of the next three
    denoising.py      denoised frames
    vectors.py        motion vectors
    environments.py   thumbnails of uploaded environments
When it will be ready
    forecast.py       when a job is expected to finish
    deadlines.py      whether that is in time
    traces.py         spans of jobs and scenes
"""
