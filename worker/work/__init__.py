"""What a worker's tasks do, a module each.

slot.py           a slot at work, as the worker reports it
deaths.py         how often a task has killed its process
render.py         a batch
jointly.py        a batch shared among slots
viewport.py       pieces of views
prepare.py        a scene
frames.py         frames of a shot
relight.py        a scene under another light
asides.py         the tasks that make something for a reader: denoising, motion vectors, environments
denoise.py        a denoised frame
vectors.py        motion vectors
environments.py   an uploaded environment's thumbnail
explain.py        the paths of a pixel
files.py          a scene's files in a folder
scenes.py         compiled scenes: fetched, mapped, stored
reader.py         runs a job on untrusted files in a confined process (worker/reading/), with a room of its own
"""
