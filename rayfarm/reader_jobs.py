"""Functions that run in the confined process that reads scenes, started by rayfarm/reading.py.

Imports no modules of command-line options or the console.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from rayfarm.stage import OpenScene
from renderer.confine.reader import Link, error_message
from renderer.errors import RayfarmError, SceneError
from renderer.image.read import read as read_image
from renderer.scene.animation import Moment, Shutter
from renderer.scene.compile import compile_scene, summarise
from renderer.scene.compiled_parts import Saver
from renderer.scene.files import SceneFiles
from renderer.scene.load import Shot, read
from renderer.variation import Variation

__all__ = ["describe_scene", "explain_differences", "picture", "serve_requests", "usd_names", "usd_render_settings"]

IDLE_S = 86400.0  # long: if the caller ends, so does this process


def serve_requests(
    folder: bytes, main: bytes, inside: bytes | None, out: bytes, options: dict[str, Any], link: Link
) -> dict[str, Any]:
    """Compiles a scene at each requested time of its animation, and writes it to `out` as a manifest and its parts.

    folder: of the scene's files. main: the scene file's name in it. inside: a folder above it that references may lead to; None
    for none. options: of `Shot` and of `OpenScene`. link: receives the requests, and sends the answers. An error at one time is
    sent as `failed`; further requests remain possible.
    """
    variant, up, floor, vary = (options.pop(name) for name in ("variant", "up", "floor", "vary"))
    variation = None if vary is None else Variation.parse(vary)
    environment = None if inside is None else os.fsdecode(inside)
    shot = Shot(Path(os.fsdecode(folder)), os.fsdecode(main), environment, variant, up, floor, variation)
    stage = OpenScene(shot, **options)
    saver, written = Saver(Path(os.fsdecode(out))), None
    for request in link.requests(IDLE_S):
        moment = Moment(**request["moment"])
        try:
            if request["which"] == "between":
                compiled, summary = stage.between_neighbours(moment, Shutter(**request["shutter"]))
            else:
                compiled, summary = stage.scene_at(moment, lambda step: link.send({"step": step}))
        except RayfarmError as error:
            link.send({"failed": error_message(error)})
            continue
        found: dict[str, Any] = {"summary": summary}
        if compiled is not written:
            manifest = saver.save(compiled, stage.part_offsets)
            saver.prune(manifest)
            found["manifest"], written = manifest.name, compiled
        link.send(found)
    return {}


def describe_scene(folder: bytes, main: bytes, link: Link) -> dict[str, Any]:
    """Returns the summary of a scene at its start, and its name."""
    link.send({"step": "reading"})
    shot = Shot(Path(os.fsdecode(folder)), os.fsdecode(main))
    description = shot.scene_at(Moment(shot.start))
    link.send({"step": "building"})
    return {"name": description.name, "main": os.fsdecode(main), **summarise(description, compile_scene(description))}


def explain_differences(folder: bytes, main: bytes, other: str, link: Link) -> dict[str, Any]:
    """Returns why another renderer's picture of a scene differs, as `sentences`. other: the renderer's name."""
    from rayfarm.known_differences import known_differences

    return {"sentences": known_differences(read(Path(os.fsdecode(folder)), os.fsdecode(main)), other)}


def picture(image: bytes, name: str, pixels: bytes, link: Link) -> dict[str, Any]:
    """Decodes an image file and writes its pixels to the file `pixels`; returns their `shape` and `dtype`."""
    found = np.ascontiguousarray(read_image(Path(os.fsdecode(image)).read_bytes(), name))
    found.tofile(os.fsdecode(pixels))
    return {"shape": list(found.shape), "dtype": found.dtype.str}


def usd_names(layer: bytes, link: Link) -> dict[str, Any]:
    """Returns the names of the files that a USD layer refers to, as `names`; empty without USD, or if the layer is damaged."""
    try:
        from pxr import Sdf, Tf, UsdUtils
    except ImportError:
        return {"names": []}
    try:
        found = UsdUtils.ExtractExternalReferences(os.fsdecode(layer))
        color_config = Sdf.Layer.OpenAsAnonymous(os.fsdecode(layer), True).colorConfiguration.path
    except Tf.ErrorException:
        return {"names": []}
    return {"names": [str(name) for names in (*found, [color_config]) for name in names if name]}


def usd_render_settings(folder: bytes, main: bytes, first: int | None, count: int, step: int, link: Link) -> dict[str, Any]:
    """Returns the render settings of a USD file, as `describe_render_settings` does. Raises SceneError without USD."""
    try:
        from renderer.scene.readers.usd.render_settings import describe_render_settings
    except ImportError:
        raise SceneError("USD files are read by the package usd-core: pip install usd-core") from None
    return describe_render_settings(SceneFiles(Path(os.fsdecode(folder))), os.fsdecode(main), first, count, step)
