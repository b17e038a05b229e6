"""Picture files and tone curves. Plain numpy: the service uses all of this without the kernel.

tonemap.py   scene-linear radiance -> what a screen shows: exposure, tone curves, sRGB
encode.py    a picture -> png, jpg, exr or hdr bytes
read.py      the bytes of any texture or HDR image -> pixels, within bounds
rgbe9995.py  radiance in 4 bytes a pixel, as the live view gets it
"""
