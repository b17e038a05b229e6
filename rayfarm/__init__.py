"""The command line, the one-command local farm, and Rayfarm in a Python program.

cli.py          the program `rayfarm`: one file a command under commands/
options.py      the options that commands share
scene_files.py  which files belong to a scene that a person names
output_files.py pictures on their way to a disk
client.py       the Python client of a farm's service
library/        render() of files, dicts and arrays, here or on a farm; the notebook's widget
movie.py        frames as a film
shot.py         frames that a farm renders
answers.py      what it answers, as dataclasses
local/          a whole farm on this machine: Redis, service and worker as supervised processes
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rayfarm.answers import BadSample, Camera, Frame, Job, Scene, Shot, Worker
    from rayfarm.client import Client, ClientError
    from rayfarm.library.here import SceneWarning
    from rayfarm.library.image import Image
    from rayfarm.library.render import progressive, render
    from rayfarm.library.shown import show
    from renderer.errors import RayfarmError

__all__ = [
    "BadSample",
    "Camera",
    "Client",
    "ClientError",
    "Frame",
    "Image",
    "Job",
    "RayfarmError",
    "Scene",
    "SceneWarning",
    "Shot",
    "Worker",
    "progressive",
    "render",
    "show",
]

# Loaded when they are asked for: a command that only talks to a farm has no use for numpy, one without a farm none for HTTP, and
# neither is to be interrupted by Ctrl-C before it can answer to it.
_LATER = {
    **dict.fromkeys(("BadSample", "Camera", "Frame", "Job", "Scene", "Shot", "Worker"), "rayfarm.answers"),
    **dict.fromkeys(("Client", "ClientError"), "rayfarm.client"),
    **dict.fromkeys(("progressive", "render"), "rayfarm.library.render"),
    "Image": "rayfarm.library.image",
    "RayfarmError": "renderer.errors",
    "SceneWarning": "rayfarm.library.here",
    "show": "rayfarm.library.shown",
}


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module 'rayfarm' has no attribute {name!r}")
    import importlib

    return getattr(importlib.import_module(_LATER[name]), name)
