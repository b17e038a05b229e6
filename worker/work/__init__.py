"""Implementations of a worker's tasks, one module per task.

slot.py               the state of a busy slot, for the worker's report
deaths.py             how often a task has killed its process
render.py             a batch
slot_card.py          batches for a graphics card
card_self_test.py     tests a card before its first batch, and each kernel before its first use on the card
joint_render.py       a batch shared among slots
viewport.py           parts of views
view_card.py          the same on a graphics card
prepare.py            a scene
thumbnail.py          a prepared scene's thumbnail
frames.py             frames of a shot
relight.py            a scene under another environment
derived_artifacts.py  the tasks with results on demand: denoising, motion vectors, path guides, environments
denoise.py            a denoised frame
vectors.py            motion vectors
path_guides.py        a frame's path guide: trained, stored and read
environments.py       an uploaded environment's thumbnail
explain.py            the paths of a pixel
files.py              a scene's files in a folder
scenes.py             compiled scenes: fetched, mapped, stored
open_scenes.py        those that a slot keeps mapped; the next batch's, mapped while it renders
reader.py             runs a job on untrusted files in a confined process (worker/reading/), with its own folder
"""
