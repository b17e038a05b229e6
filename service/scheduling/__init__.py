"""Scheduling: the engine's thread, which dispatches work to the workers and merges their results.

Each folder depends only on those above it:
    fleet/        the workers: their reports, speeds and capabilities
    faults/       attribution of errors to jobs, workers or services
    jobs/         active jobs, their frames, and fair sharing between them
    incoming/     results from workers, validated and merged into the film
    dispatching/  batches sent to the workers: start with scheduler.py
    trust/        comparison of batches that two workers have rendered
    artifacts/    other work for workers: scenes, frames of shots, denoising, motion vectors
    forecasts/    expected completion times of jobs
The engine:
    engine.py     the thread and the steps of its loop; start here
    lifecycle.py  loads, starts, changes and ends jobs
    loading.py    loads jobs into the engine in steps, a few in each round
    waiting.py    jobs that depend on other jobs
    answers.py    handles the messages from workers
    changes.py    database changes since the last step
    records.py    the engine's database operations
    snapshot.py   the immutable view of the engine that other threads read
"""
