"""Work for workers other than batches.

errands.py        facade of all of them
preparing.py      scenes
moments.py        frames of shots
unfit.py          machines that cannot prepare a scene or a frame
aside.py          results made on request; the base of the next three
denoising.py      denoised frames
vectors.py        motion vectors
environments.py   thumbnails of uploaded environments
"""
