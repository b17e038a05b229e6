"""Intel's Open Image Denoise: less noise in a picture, guided by the albedo and the normals that were rendered with it.

Optional: the package pyoidn brings the library along. A denoised picture is a guess, so it stands beside the raw one.
"""

from __future__ import annotations

import importlib.util
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.errors import SettingsError

__all__ = ["Clean", "cleaned", "denoise", "for_a_glance", "is_available"]

F32 = npt.NDArray[np.float32]
_RANGE = np.float32(1e6)  # beyond half precision's range nothing is gained; infinities would spread


def is_available() -> bool:
    """Whether the package is installed. Opens no library: a parent may ask before it forks."""
    return importlib.util.find_spec("pyoidn") is not None


class Clean(NamedTuple):
    """A picture without most of its noise, and the guides that were cleaned for it: (h, w, 3) float32 each."""

    color: F32
    albedo: F32
    normal: F32


def denoise(color: F32, albedo: F32, normal: F32, threads: int | None = None) -> F32:
    """The picture alone of `cleaned`."""
    return cleaned(color, albedo, normal, threads).color


def for_a_glance(color: F32, albedo: F32, normal: F32) -> F32:
    """A small picture of few samples without most of its noise, on one thread: the guides are taken as they are, noise and all,
    which leaves edges less sharp than `cleaned` does and takes a third of the time.

    The picture itself where Open Image Denoise is not installed or fails.
    """
    try:
        return _cleaned(color, albedo, normal, 1, guides_first=False).color
    except SettingsError:
        return color


def cleaned(color: F32, albedo: F32, normal: F32, threads: int | None = None) -> Clean:
    """The picture without most of its noise, scene-linear; the inputs stay as they are.

    color: scene-linear radiance. albedo 0 ... 1 and normal -1 ... 1: of the first hits, with their own noise (of lens blur,
    edges, textures). They are denoised first, each by itself, and then taken as clean (`cleanAux`): that keeps the edges of
    textures and shapes that a filter of colour alone would smear. threads: None for all cores.
    Raises SettingsError where Open Image Denoise is not installed or fails.
    """
    return _cleaned(color, albedo, normal, threads or 0, guides_first=True)


def _cleaned(color: F32, albedo: F32, normal: F32, threads: int, *, guides_first: bool) -> Clean:
    try:
        import pyoidn
    except (ImportError, OSError) as error:
        raise SettingsError(f"Open Image Denoise cannot be loaded ({error}). Install it: pip install 'pyoidn>=2.5,<3'") from error
    with pyoidn.Device(pyoidn.OIDN_DEVICE_TYPE_CPU) as device:
        device.set_int("numThreads", threads)
        device.set_bool("setAffinity", False)  # pinned threads would fight with those who render
        device.commit()

        def run(output: F32, images: dict[str, F32], **options: bool) -> F32:
            with pyoidn.Filter(device, pyoidn.OIDN_FILTER_TYPE_RT) as filter:
                for name, image in {**images, "output": output}.items():
                    filter.set_image(name, image, pyoidn.OIDN_FORMAT_FLOAT3)
                for name, value in options.items():
                    filter.set_bool(name, value)
                filter.commit()
                filter.execute()
            if fault := device.get_error():
                raise SettingsError(f"Open Image Denoise failed: {fault}")
            return output

        guides = {}
        for name, image in (("albedo", albedo), ("normal", normal)):
            guide = np.ascontiguousarray(image, np.float32)
            guides[name] = run(np.empty_like(guide), {name: guide}) if guides_first else guide
        noisy = np.clip(np.ascontiguousarray(color, np.float32), 0, _RANGE)
        return Clean(run(np.empty_like(noisy), {"color": noisy, **guides}, hdr=True, cleanAux=guides_first), **guides)
