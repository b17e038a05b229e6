"""The jobs that are being rendered, as the engine holds them in memory.

active_job.py     a job that is being rendered
active_frame.py   a frame of it: its plan, its noise
agenda.py         which frame is next
frame_queue.py          the frames in that order, kept up as they change
plan.py           which tile of a frame is next, and how many samples of it
totals.py         sums over all frames of a job
shares.py         whose turn it is among jobs of one priority
job_changes.py    changes of a job by a person
shot_changes.py   changes of a shot's frames
measurements.py       what a job has learned about its scene's cost and noise
noise_budget.py          how much time estimating noise may take
history.py        how a job's noise fell over time, and what happened on the way
job_log.py        a job's log, as a text file
tile_log.py       who rendered which samples of each tile lately
film_snapshots.py keeps what a still looked like at 1, 2, 4, 8 ... samples
frame_bytes.py    how much room a shot's compiled frames take
reproduce.py      the command that shows an error again
traces.py         spans of jobs and scenes
"""
