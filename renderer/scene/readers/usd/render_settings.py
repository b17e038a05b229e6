"""Describes the UsdRender prims of a stage: render settings, products and vars."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pxr import Usd, UsdRender

from renderer.scene.files import SceneFiles
from renderer.scene.readers.usd.layers import Stage, as_scene_errors, muted, open_stage
from renderer.scene.readers.usd.metadata import rate_of
from renderer.scene.readers.usd.notes import Notes
from renderer.scene.readers.usd.sources import Sources

__all__ = ["describe_render_settings", "time_range"]


def time_range(stage: Stage) -> tuple[float, float] | None:
    """Returns the stage's first and last time code: the authored range, else that of its samples; None if nothing moves."""
    if (span := stage.span) is None:
        return None
    root = stage.stage
    start, end = (root.GetStartTimeCode(), root.GetEndTimeCode()) if root.HasAuthoredTimeCodeRange() else span
    return (start, end) if np.isfinite([start, end]).all() and start <= end else span


def describe_render_settings(files: SceneFiles, main: str, first: int | None, count: int, step: int) -> dict[str, Any]:
    """Returns the render settings of a USD file, in plain values.

    first, count, step: the time codes at which the products' names are read; first None: the start of the stage. The result:
    `default` (path of the stage's own settings, or None), `start` (time code, None for a still), `codes_per_second`, `fps`,
    `codes`, and `settings` by path: `camera`, `resolution`, `products`, and the names of `unused` attributes that have other
    values than the default. A product has `path`, `type`, `names` (one a time code), `camera`, `resolution`, `vars` and
    `unused`; a var has `path`, `source` and `kind`. Raises SceneError.
    """
    with as_scene_errors(main), muted():
        found, _ = open_stage(Sources(files), main, None)
        stage, notes = found.stage, Notes()
        span = time_range(found)
        start = span[0] if span else stage.GetStartTimeCode() if stage.HasAuthoredTimeCodeRange() else None
        begin = first if first is not None else math.ceil(start) if start is not None and math.isfinite(start) else 1
        codes = [begin + step * i for i in range(count)]
        fps = rate_of(stage, "framesPerSecond", notes)
        default = stage.GetMetadata("renderSettingsPrimPath")
        prims = [prim for prim in stage.Traverse() if prim.IsA(UsdRender.Settings)]
        return {
            "default": str(default) if default else None,
            "start": span[0] if span else None,
            "codes_per_second": rate_of(stage, "timeCodesPerSecond", notes),
            "fps": fps if 1e-3 <= fps <= 1e4 else 24.0,
            "codes": codes,
            "settings": {str(prim.GetPath()): _settings(stage, prim, codes) for prim in prims},
        }


def _settings(stage: Any, prim: Any, codes: list[int]) -> dict[str, Any]:
    products = []
    for path in UsdRender.Settings(prim).GetProductsRel().GetForwardedTargets():
        product = UsdRender.Product(stage.GetPrimAtPath(path))
        if not product:
            continue
        name = product.GetProductNameAttr()
        products.append(
            {
                **_common(product),
                "path": str(path),
                "type": str(product.GetProductTypeAttr().Get() or "raster"),
                "names": [str(name.Get(Usd.TimeCode(code)) or "") for code in codes],
                "vars": [
                    {
                        "path": str(target),
                        "source": str(var.GetSourceNameAttr().Get() or ""),
                        "kind": str(var.GetSourceTypeAttr().Get() or "raw"),
                    }
                    for target in product.GetOrderedVarsRel().GetForwardedTargets()
                    if (var := UsdRender.Var(stage.GetPrimAtPath(target)))
                ],
            }
        )
    return {**_common(UsdRender.Settings(prim)), "products": products}


def _common(base: Any) -> dict[str, Any]:
    """Returns what settings and products have alike: UsdRenderSettingsBase. Values that are not authored are None."""
    resolution = base.GetResolutionAttr()
    size = resolution.Get() if resolution.HasAuthoredValue() else None
    window, aspect = base.GetDataWindowNDCAttr().Get(), base.GetPixelAspectRatioAttr().Get()
    unused = {
        "pixelAspectRatio": aspect is not None and abs(aspect - 1) > 1e-6,
        "dataWindowNDC": window is not None and tuple(window) != (0.0, 0.0, 1.0, 1.0),
        "disableDepthOfField": bool(base.GetDisableDepthOfFieldAttr().Get()),
        "disableMotionBlur": bool(base.GetDisableMotionBlurAttr().Get()),
    }
    cameras = base.GetCameraRel().GetForwardedTargets()
    return {
        "camera": str(cameras[0]) if cameras else None,
        "resolution": None if size is None else [int(size[0]), int(size[1])],
        "unused": [name for name, is_set in unused.items() if is_set],
    }
