"""What is rendered next, by whom, and what comes back: the engine's thread and its parts.

Each folder builds on those above it:
    fleet/        the workers: what they report, how fast they are, what work suits them
    faults/       whose fault an error is
    jobs/         jobs that are being rendered, their frames, and whose turn it is
    incoming/     what workers send back, validated and merged into the film
    handing_out/  batches on their way to the workers: start with scheduler.py
    trust/        batches that two workers have rendered, compared
    errands/      other work for workers: scenes, frames of shots, denoising, motion vectors
    forecasts/    when jobs will be ready
The engine
    engine.py     the thread, and what it does in each step; start here
    lifecycle.py  a job from the database to the scheduler and out again
    taking_up.py  jobs are taken up in steps, a little in each round
    waiting.py    jobs that wait for other jobs
    answers.py    acts on what workers send back
    changes.py    what was changed in the database since the last step
    records.py    everything the engine reads from and writes to the database
    snapshot.py   the immutable view of the engine that other threads read
"""
