"""What moves: values over time, and which moment of a scene is meant.

Readers evaluate what their files animate while they read, and give the description of that one moment.

moment.py         a frame, how many of them are a second, and which clip is shown
clips.py          what a person is told of a file's animations
curves.py         keys and what lies between them
orbit.py          a camera that goes around
shutter.py        from when to when a frame's shutter is open
"""

from renderer.scene.animation.clips import Clip
from renderer.scene.animation.curves import Curve, smooth
from renderer.scene.animation.moment import DEFAULT_FPS, Moment
from renderer.scene.animation.shutter import BETWEEN, SHUTTER, Shutter

__all__ = ["BETWEEN", "DEFAULT_FPS", "SHUTTER", "Clip", "Curve", "Moment", "Shutter", "smooth"]
