"""Active jobs in the engine's memory.

active_job.py      an active job
active_frame.py    a frame of a job: its plan and its noise
agenda.py          selects the next frame
frame_queue.py     the frames by priority, updated as they change
plan.py            selects the next tile of a frame and its number of samples
totals.py          sums over all frames of a job
frame_progress.py  progress of each frame
shares.py          fair sharing between jobs of one priority
job_changes.py     changes of a job by a user
shot_changes.py    changes of a shot's frames by a user
costs.py           expected time of a sample in each tile
measurements.py    the measured cost and noise of a job's scene
noise_budget.py    limit on the processor time for noise estimates
history.py         a job's noise over time, and its events
job_log.py         a job's log, as a text file
tile_log.py        the latest batches of each tile
film_snapshots.py  snapshots of a still image at 1, 2, 4, 8 ... samples per pixel
frame_bytes.py     storage used by a shot's compiled frames
lazy_heap.py       a priority queue with changing priorities
batch_failures.py  failures and losses of a batch
reproduce.py       the command line that reproduces an error
traces.py          tracing spans of jobs and scenes
"""
