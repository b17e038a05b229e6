"""Work for workers other than rendering batches.

artifacts.py          facade of all of them
scene_preparation.py  preparation of scenes
frame_preparation.py  preparation of frames of shots
lost_preparations.py  preparations that were lost with their worker
unfit_machines.py     machines that cannot prepare a scene or a frame
artifact_task.py      artifacts: files made on request; the base of the next four
denoising.py          denoised frames
previews.py           denoised previews of frames that are being rendered
vectors.py            motion vectors
environments.py       thumbnails of uploaded environment images
"""
