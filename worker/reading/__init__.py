"""Jobs of confined processes (renderer/confine/), which read untrusted files for a worker's slots.

They access neither the service nor Redis. Parameters common to all jobs: `folder` is the path of the scene's files as bytes,
`base_folder` that of compiled scenes, `out` an output folder, `result` an output file, `link` the connection to the slot. The
module of the same name in the package worker.work runs the job for a slot.

kernels.py       kernels that the launcher loads, so that readers share them
scene_folder.py  compiled scenes that the slot has linked into the reader's folder
prepare.py       a scene: compiled, with a summary
thumbnail.py     a compiled scene's thumbnail
frames.py        frames of a shot
relight.py       a scene's environment
vectors.py       motion vectors
environments.py  an environment's thumbnail
denoise.py       a denoised frame
"""
