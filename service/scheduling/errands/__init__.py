"""Other work for workers than batches.

errands.py        all of them together
preparing.py      scenes
moments.py        frames of shots
unfit.py          machines that cannot prepare a scene or a frame
aside.py          what readers ask for of a frame; the base of the next three
denoising.py      denoised frames
vectors.py        motion vectors
environments.py   thumbnails of uploaded environments
"""
