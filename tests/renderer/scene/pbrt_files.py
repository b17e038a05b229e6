"""Builds pbrt-v4 scene files for tests."""

HEAD = """# a comment with a "quote" and a ]
Film "rgb" "integer xresolution" 48 "integer yresolution" [ 32 ]
Sampler "zsobol" "integer pixelsamples" 16
Integrator "path" "integer maxdepth" [4]
PixelFilter "box"
LookAt 0.6 1.2 3.6  0 0 0  0 1 0
Camera "perspective" "float fov" [36.87]
WorldBegin
"""
BALL = 'Shape "sphere"'
SQUARE = (
    'Shape "trianglemesh" "integer indices" [0 1 2 0 2 3] "point3 P" [-1 -1 0 1 -1 0 1 1 0 -1 1 0] "point2 uv" [0 0 1 0 1 1 0 1]'
)


def world(inside, head=HEAD):
    """Returns the text of a pbrt file with the statements `inside` in its world block, and the statements `head` before it."""
    return head + inside + "\n"
