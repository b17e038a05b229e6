"""Other forms of a finished data set, made from its folder: COCO, transforms.json and WebDataset; those of packages beside it."""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rayfarm.datasets.bop import write_bop
from rayfarm.datasets.folder import Description, Views, view_name
from rayfarm.datasets.hdf5 import write_hdf5
from rayfarm.datasets.parquet import write_parquet
from rayfarm.output_files import write
from renderer.lens_distortion import COEFFICIENTS, LensDistortion

__all__ = ["SINK_WRITERS"]

_SHARD = 1000  # views a shard
_CAMERA_MODELS = {"brown": "OPENCV", "fisheye": "OPENCV_FISHEYE"}


def write_transforms(folder: Path, description: Description, views: Views) -> None:
    """Writes transforms.json as NeRF, Instant-NGP and nerfstudio read it: camera to world, in OpenGL's convention.

    Of the model brown it has k1 to k3, p1 and p2, which nerfstudio's cameras/camera_utils.py reads as OpenCV does.
    """
    import math

    lens = LensDistortion.parse(description.get("distortion"))
    k, width, height = description["intrinsics"], description["width"], description["height"]
    document = {
        "camera_model": "PINHOLE" if lens is None else _CAMERA_MODELS[lens.model],
        "camera_angle_x": 2 * math.atan(width / 2 / k[0][0]),
        "fl_x": k[0][0],
        "fl_y": k[1][1],
        "cx": k[0][2],
        "cy": k[1][2],
        "w": width,
        "h": height,
        **({} if lens is None else dict(zip(COEFFICIENTS[lens.model][:5], lens.coefficients, strict=False))),
        "frames": [
            {
                "file_path": view["files"]["color"]["path"],
                **({"depth_file_path": view["files"]["depth"]["path"]} if "depth" in view["files"] else {}),
                "transform_matrix": view["camera_to_world_opengl"],
            }
            for view in views
            if "color" in view["files"]
        ],
    }
    write(folder / "transforms.json", json.dumps(document, indent=1).encode())


def write_coco(folder: Path, description: Description, views: Views) -> None:
    """Writes coco.json: a picture a view, and an annotation for each body of which a pixel is visible.

    Besides COCO's fields an annotation has `instance`, `occlusion`, `amodal_bbox`, and with masks `amodal_segmentation`.
    """
    annotations: list[dict[str, Any]] = []
    for view in views:
        if "boxes" not in view["files"]:
            continue
        for body in json.loads((folder / view["files"]["boxes"]["path"]).read_text()):
            if not body["area"]:
                continue
            found = {
                "id": len(annotations) + 1,
                "image_id": view["view"] + 1,
                "category_id": body["category"],
                "bbox": body["box"],
                "area": body["area"],
                "iscrowd": 0,
                "instance": body["instance"],
                "occlusion": body["occlusion"],
                "amodal_bbox": body["amodal_box"],
            }
            if "mask" in body:
                found |= {"segmentation": body["mask"], "amodal_segmentation": body["amodal_mask"]}
            annotations.append(found)
    images = [
        {
            "id": view["view"] + 1,
            "file_name": view["files"].get("color", {"path": f"{view_name(view['view'])}.png"})["path"],
            "width": description["width"],
            "height": description["height"],
        }
        for view in views
    ]
    categories = [{"id": n, "name": name, "supercategory": ""} for n, name in enumerate(description["categories"], 1)]
    document = {
        "info": {"description": description["scene"], "version": description["version"]},
        "licenses": [],
        "images": images,
        "annotations": annotations,
        "categories": categories,
    }
    write(folder / "coco.json", json.dumps(document).encode())


def write_webdataset(folder: Path, description: Description, views: Views) -> None:
    """Writes shards/000000.tar and further ones of 1,000 views each: files KEY.OUTPUT.SUFFIX, and KEY.json with the cameras.

    Equal data sets have equal shards.
    """
    (folder / "shards").mkdir(exist_ok=True)
    camera = {name: description[name] for name in ("intrinsics", "distortion") if name in description}
    for shard, first in enumerate(range(0, len(views), _SHARD)):
        out = io.BytesIO()
        with tarfile.open(fileobj=out, mode="w", format=tarfile.USTAR_FORMAT) as tar:
            for view in views[first : first + _SHARD]:
                key = view_name(view["view"])
                for output, file in sorted(view["files"].items()):
                    suffix = file["path"].rpartition(".")[2]
                    _add(tar, f"{key}.{output}.{suffix}", (folder / file["path"]).read_bytes())
                _add(tar, f"{key}.json", json.dumps({**view, **camera}).encode())
        write(folder / "shards" / f"{view_name(shard)}.tar", out.getvalue())


def _add(tar: tarfile.TarFile, name: str, data: bytes) -> None:
    entry = tarfile.TarInfo(name)
    entry.size = len(data)
    tar.addfile(entry, io.BytesIO(data))


SINK_WRITERS: dict[str, Callable[[Path, Description, Views], None]] = {
    "transforms": write_transforms,
    "coco": write_coco,
    "webdataset": write_webdataset,
    "hdf5": write_hdf5,
    "bop": write_bop,
    "parquet": write_parquet,
}
