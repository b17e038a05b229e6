"""Picture files and tone curves. Plain numpy: the service uses all of this without the kernel.

tonemap.py   scene-linear radiance -> what a screen shows: exposure, tone curves, sRGB
encode.py    a picture -> png, jpg, exr or hdr bytes
read.py      the bytes of any texture or HDR image -> pixels, within bounds
kinds.py       the format of an image, by its bytes
channels.py    which channels of an image are its colours, by their names
unread.py      notes of what a file says of its colours that is not taken over
openimageio.py floats, 16 bits, layers and compressed blocks, by OpenImageIO
rgbe9995.py  radiance in 4 bytes a pixel, as the live view gets it
"""
