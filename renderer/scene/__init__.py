"""Where a scene is read: files -> description -> compiled scene.

description.py  what every reader gives: meshes, spheres, materials, textures, lights, cameras
readers/        one file a format
compile.py      description -> the flat arrays that the kernel reads, with BVH and light tables
compiled.py     those arrays, and the one file that keeps them
"""
