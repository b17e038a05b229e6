"""Writes an HDF5 file with all outputs of a view, with the names and values of BlenderProc's write_hdf5."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from rayfarm.datasets.folder import Description, Views, read_plane
from rayfarm.output_files import write

__all__ = ["write_hdf5"]

Array = npt.NDArray[Any]


def _ids(plane: Array) -> Array:
    return plane.astype(np.uint16 if plane.max(initial=0) < 1 << 16 else np.uint32)


def _unchanged(plane: Array) -> Array:
    return plane


# BlenderProc's names and values; outputs that it does not have keep theirs. Its normals are (n + 1) / 2, in camera space.
_DATASETS: dict[str, tuple[str, Callable[[Array], Array]]] = {
    "instance": ("instance_segmaps", _ids),
    "category": ("category_id_segmaps", _ids),
    "normal_camera": ("normals", lambda plane: ((plane + 1) / 2).astype(np.float32)),
    "flow_forward": ("forward_flow", _unchanged),
    "flow_backward": ("backward_flow", _unchanged),
}


def write_hdf5(folder: Path, description: Description, views: Views) -> None:
    """Writes hdf5/0.hdf5 and further ones, a file a view. Needs h5py.

    colors, depth, distance, normals, instance_segmaps, category_id_segmaps, forward_flow and backward_flow as BlenderProc has
    them, instance_attribute_maps and campose as JSON texts; other outputs by their names here.
    """
    import h5py

    (folder / "hdf5").mkdir(exist_ok=True)
    for view in views:
        out = io.BytesIO()
        with h5py.File(out, "w") as file:
            for output, entry in sorted(view["files"].items()):
                path = folder / entry["path"]
                if output == "color":
                    _add(file, "colors", _pixels(path))
                elif output == "boxes":
                    _add_text(file, "instance_attribute_maps", _attributes(json.loads(path.read_text()), description))
                else:
                    name, convert = _DATASETS.get(output, (output, _unchanged))
                    _add(file, name, convert(read_plane(path)))
            camera: dict[str, Any] = {"cam2world_matrix": view["camera_to_world_opengl"], "cam_K": description["intrinsics"]}
            if "distortion" in description:
                camera["distortion"] = description["distortion"]
            _add_text(file, "campose", [camera])
        write(folder / "hdf5" / f"{view['view']}.hdf5", out.getvalue())


def _add(file: Any, name: str, values: Array) -> None:
    file.create_dataset(name, data=values, compression="gzip", track_times=False)


def _add_text(file: Any, name: str, value: Any) -> None:
    file.create_dataset(name, data=np.bytes_(json.dumps(value)), track_times=False)


def _pixels(path: Path) -> Array:
    """Returns a picture's pixels (h, w, 3): uint8, or float32 of an EXR file."""
    from renderer.image.read import read

    return read(path.read_bytes(), path.name)[..., :3]


def _attributes(bodies: list[dict[str, Any]], description: Description) -> list[dict[str, Any]]:
    return [
        {
            "idx": body["instance"],
            "name": body["name"],
            "category_id": body["category"],
            "category_name": description["categories"][body["category"] - 1],
        }
        for body in bodies
    ]
