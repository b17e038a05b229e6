"""Image files and tone curves. Plain numpy: the service uses this package without the kernel.

tonemap.py      scene-linear radiance -> display values: exposure, tone curves, sRGB
ocio.py         views of an OpenColorIO config, in place of a tone curve
encode.py       an image -> png, jpg, avif, jxl, exr or hdr bytes
hdr_still.py    AVIF and JPEG XL of high dynamic range
gain_map.py     JPEG with a gain map (Ultra HDR)
read.py         the bytes of any texture or HDR image -> pixels, with size limits
kinds.py        detects the format of an image from its bytes
channels.py     finds the colour channels of an image by their names
unread.py       notes on colour metadata of a file that is ignored
openimageio.py  decodes floats, 16 bits, layers and compressed blocks with OpenImageIO
darkness.py     detects images that look black on a screen
rgbe9995.py     radiance in 4 bytes a pixel, the format of the live view
"""
