"""Animation: values over time, and the time of a frame.

Readers evaluate animations while they read, and return the description at one moment.

moment.py         a frame number, the frame rate, and the selected clip
clips.py          the summary of a file's animations
curves.py         keys and interpolation
orbit.py          a turntable camera
shutter.py        the interval while a frame's shutter is open
"""

from renderer.scene.animation.clips import Clip
from renderer.scene.animation.curves import Curve, smooth
from renderer.scene.animation.moment import DEFAULT_FPS, Moment
from renderer.scene.animation.shutter import BETWEEN, SHUTTER, Shutter

__all__ = ["BETWEEN", "DEFAULT_FPS", "SHUTTER", "Clip", "Curve", "Moment", "Shutter", "smooth"]
