"""The command line, the local farm that one command starts, and the Python library.

commands/            one file per command of the program `rayfarm`, which cli.py assembles
datasets/            dataset(): many views of a scene with exact annotation
library/             render() of files, dicts and arrays, here or on a farm; the notebook's widget
local/               a whole farm on this machine: Redis, service and worker as supervised processes
watch/               watching a job in the terminal
doctor/              checks of an installation
Talking to a farm
    client.py            the Python client; responses.py has its return types, as dataclasses
    login.py             which farm a command uses, and its token
    joining.py           shared code of `rayfarm worker` and `rayfarm site`, which join a farm
    shot.py              frames that a farm renders
Rendering without a farm
    reading.py           a scene read and compiled in a confined process; reader_jobs.py is the code of that process
    reading_files.py     single files read in such a process, and its limits
    preload.py           modules and kernels that that process loads in advance
    stage.py             a scene over time, compiled again only if more than a camera moved
    rendering.py         a scene read, compiled and rendered
    frame.py             one frame to its files
    sequence.py          frames in sequence; movie.py makes a movie of them, temporal_denoise.py denoises them
    replay.py            one path of one pixel, traced again
Options and files
    options.py           the options that commands share
    declared_options.py  options made from the declared settings
    picture.py           the options that describe a picture
    log_format.py        the option of commands that start processes
    named_files.py       the files that a program uploads, by their names in the scene
    scene_files.py       which files belong to a scene on the command line
    output_files.py      writing pictures to disk
The machine
    console.py           standard output and error
    machine.py           cores, signals, the screen
    blender.py           Blender for a worker on this machine
    errors.py            errors and exit codes
"""

from typing import TYPE_CHECKING, Any

from rayfarm.responses import ShownInNotebooks

if TYPE_CHECKING:
    from rayfarm.client import Client, ClientError
    from rayfarm.datasets.cameras import Cameras
    from rayfarm.datasets.create import Dataset, dataset
    from rayfarm.library.image import Image
    from rayfarm.library.local_render import SceneWarning
    from rayfarm.library.notebook_widget import show
    from rayfarm.library.render import progressive, render
    from rayfarm.responses import BadSample, Camera, Frame, Job, Scene, Shot, Worker
    from renderer.errors import RayfarmError

__all__ = [
    "BadSample",
    "Camera",
    "Cameras",
    "Client",
    "ClientError",
    "Dataset",
    "Frame",
    "Image",
    "Job",
    "RayfarmError",
    "Scene",
    "SceneWarning",
    "Shot",
    "Worker",
    "dataset",
    "progressive",
    "render",
    "show",
]

# Loaded on demand: a command that only talks to a farm does not need numpy, nor one without a farm HTTP, and
# Ctrl-C during these imports cannot be handled yet.
_LATER = {
    **dict.fromkeys(("BadSample", "Camera", "Frame", "Job", "Scene", "Shot", "Worker"), "rayfarm.responses"),
    **dict.fromkeys(("Client", "ClientError"), "rayfarm.client"),
    **dict.fromkeys(("progressive", "render"), "rayfarm.library.render"),
    **dict.fromkeys(("Dataset", "dataset"), "rayfarm.datasets.create"),
    "Cameras": "rayfarm.datasets.cameras",
    "Image": "rayfarm.library.image",
    "RayfarmError": "renderer.errors",
    "SceneWarning": "rayfarm.library.local_render",
    "show": "rayfarm.library.notebook_widget",
}


def _widget_of(answer: Any, farm: Any) -> Any:
    """Returns the notebook widget that shows an answer of the farm (a Job or Scene); None if anywidget is not installed."""
    from rayfarm.library.notebook_widget import has_widgets, show

    return show(answer, farm=farm) if has_widgets() else None


ShownInNotebooks.widget_of = staticmethod(_widget_of)


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module 'rayfarm' has no attribute {name!r}")
    import importlib

    return getattr(importlib.import_module(_LATER[name]), name)
