"""The folders of BOP, the benchmark for poses of objects, in its scene-wise form.

https://github.com/thodan/bop_toolkit/blob/master/docs/bop_datasets_format.md
"""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from rayfarm.datasets.folder import Description, Views, read_plane, view_name
from rayfarm.output_files import write
from renderer.errors import SettingsError

__all__ = ["write_bop"]

F64 = npt.NDArray[np.float64]

_MM = 1000.0  # millimetres a scene unit, which is taken for a metre
_STEPS = (0.1, 1.0, 10.0, 100.0, 1000.0)  # of depth, in millimetres
_MOST = (1 << 16) - 1


def write_bop(folder: Path, description: Description, views: Views) -> None:
    """Writes bop/camera.json and bop/train/000000: scene_camera.json, scene_gt.json, scene_gt_info.json, rgb, depth and masks.

    Lengths are in millimetres, with a scene unit taken for a metre; pixel positions are OpenCV's, with the first pixel's centre
    at (0, 0). obj_id is the object's number in dataset.json. An object's model space is that of its mesh if it moves or is stored
    once for several copies, else world space; its scale belongs to the model. Raises SettingsError for a sheared object.
    """
    scene = folder / "bop" / "train" / "000000"
    for name in ("rgb", "depth", "mask", "mask_visib"):
        (scene / name).mkdir(parents=True, exist_ok=True)
    intrinsics = np.array(description["intrinsics"]) - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
    step = _depth_step(folder, views)
    cameras, poses, infos = dict[str, Any](), dict[str, Any](), dict[str, Any]()
    for view in views:
        key, files = str(view["view"]), view["files"]
        to_camera = np.array(view["world_to_camera_opencv"])
        bodies = [body for body in json.loads((folder / files["boxes"]["path"]).read_text()) if body["area"]]
        cameras[key] = {"cam_K": _flat(intrinsics), "depth_scale": step} | _rigid("w2c", to_camera)
        poses[key] = [_rigid("m2c", to_camera @ _unscaled(body)) | {"obj_id": body["object"]} for body in bodies]
        depth = read_plane(folder / files["depth"]["path"]) if "depth" in files else None
        infos[key] = [_info(body, depth) for body in bodies]
        for n, body in enumerate(bodies):
            for name, mask in (("mask", body["amodal_mask"]), ("mask_visib", body["mask"])):
                write(scene / name / f"{view_name(view['view'])}_{n:06}.png", _png(_mask(mask).astype(np.uint8) * 255))
        if depth is not None:
            values = np.where(np.isfinite(depth), np.rint(np.where(np.isfinite(depth), depth, 0) * (_MM / step)), 0)
            write(scene / "depth" / f"{view_name(view['view'])}.png", _png(np.minimum(values, _MOST).astype(np.uint16)))
        if "color" in files:
            path = folder / files["color"]["path"]
            write(scene / "rgb" / f"{view_name(view['view'])}{path.suffix}", path.read_bytes())
    for name, value in (("scene_camera", cameras), ("scene_gt", poses), ("scene_gt_info", infos)):
        write(scene / f"{name}.json", json.dumps(value).encode())
    k = intrinsics
    camera = {"fx": k[0, 0], "fy": k[1, 1], "cx": k[0, 2], "cy": k[1, 2], "depth_scale": step}
    camera |= {"width": description["width"], "height": description["height"]}
    write(folder / "bop" / "camera.json", json.dumps(camera, indent=1).encode())


def _depth_step(folder: Path, views: Views) -> float:
    """Returns the finest step, in millimetres, with which 16 bits hold the depth of all views."""
    most = 0.0
    for view in views:
        if "depth" in view["files"]:
            depth = read_plane(folder / view["files"]["depth"]["path"])
            most = max(most, float(depth[np.isfinite(depth)].max(initial=0.0)))
    return next((step for step in _STEPS if most * _MM / step <= _MOST), _STEPS[-1])


def _unscaled(body: dict[str, Any]) -> F64:
    """Returns the rigid pose (4, 4) of a body, without the scale of its model."""
    pose: F64 = np.array(body["pose"])
    scale = np.linalg.norm(pose[:3, :3], axis=0)
    rotation = pose[:3, :3] / scale
    if np.linalg.det(rotation) < 0:
        rotation[:, 0] *= -1  # a mirrored model
    if np.abs(rotation.T @ rotation - np.eye(3)).max() > 1e-4:
        raise SettingsError(f"the sink bop needs rigid poses; {body['name']} is sheared")
    pose[:3, :3] = rotation
    return pose


def _rigid(name: str, pose: F64) -> dict[str, list[float]]:
    return {f"cam_R_{name}": _flat(pose[:3, :3]), f"cam_t_{name}": _flat(pose[:3, 3] * _MM)}


def _info(body: dict[str, Any], depth: npt.NDArray[Any] | None) -> dict[str, Any]:
    count = body["amodal_area"]
    valid = count if depth is None else int((np.isfinite(depth) & _mask(body["amodal_mask"])).sum())
    return {
        "bbox_obj": body["amodal_box"],
        "bbox_visib": body["box"],
        "px_count_all": count,
        "px_count_valid": valid,
        "px_count_visib": body["area"],
        "visib_fract": body["area"] / count,
    }


def _mask(lengths: dict[str, Any]) -> npt.NDArray[np.bool_]:
    """Returns the mask (h, w) of COCO's run lengths."""
    height, width = lengths["size"]
    values = np.arange(len(lengths["counts"])) % 2 == 1
    return np.repeat(values, lengths["counts"]).reshape(width, height).T


def _png(pixels: npt.NDArray[Any]) -> bytes:
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(pixels).save(out, "png")
    return out.getvalue()


def _flat(values: F64) -> list[float]:
    return [float(each) for each in values.reshape(-1)]
