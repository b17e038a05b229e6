"""Denoises images with Intel's Open Image Denoise, guided by the albedo and normals rendered with them.

Optional: the package pyoidn contains the library. A denoised image is an estimate, so the original is always stored too.
$RAYFARM_DENOISER selects the device: cpu (the default) or cuda, the first NVIDIA card, whose result differs in the last digits.
"""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import logging
import os
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.errors import SettingsError
from renderer.library_messages import library_message
from renderer.sentences import Sentence

__all__ = [
    "DEVICE_VARIABLE",
    "DenoisedPicture",
    "denoise",
    "denoise_fast",
    "denoise_preview",
    "denoise_with_guides",
    "is_available",
]

DEVICE_VARIABLE = "RAYFARM_DENOISER"
F32 = npt.NDArray[np.float32]
_RANGE = np.float32(1e6)  # clamps radiance to half precision's range; infinities would spread
_log = logging.getLogger(__name__)


def is_available() -> bool:
    """Returns True if the package pyoidn is installed. Loads no library, so it is safe before a fork."""
    return importlib.util.find_spec("pyoidn") is not None


class DenoisedPicture(NamedTuple):
    """A denoised image and its denoised guides, albedo and normal: (h, w, 3) float32 each."""

    color: F32
    albedo: F32
    normal: F32


def denoise(color: F32, albedo: F32, normal: F32, threads: int | None = None) -> F32:
    """Returns a denoised image, without its denoised guides; see `denoise_with_guides`."""
    return denoise_with_guides(color, albedo, normal, threads).color


def denoise_fast(
    color: F32,
    albedo: F32,
    normal: F32,
    threads: int | None = None,
    *,
    has_clean_guides: bool = False,
    is_rough: bool = False,
) -> F32:
    """Returns a denoised image in a sixth of the time of `denoise`: the guides are not denoised first, so edges are less sharp.

    has_clean_guides: whether to treat the guides as free of noise, as those of 4 samples per pixel nearly are. The image is then
    as smooth as that of `denoise`, in a third of its time; guides of one or two samples fray the edges. is_rough: at the
    library's quality `fast`: in half of the time, with an error that is a tenth larger. threads: None for all cores. Raises
    SettingsError if Open Image Denoise is not installed or fails.
    """
    return _denoise(
        color, albedo, normal, threads or 0, guides_first=False, has_clean_guides=has_clean_guides, is_rough=is_rough
    ).color


def denoise_preview(color: F32, albedo: F32, normal: F32) -> F32:
    """Returns a denoised preview of a small image of few samples, computed in one thread.

    Returns the image unchanged if Open Image Denoise is not installed or fails. See `denoise_fast`.
    """
    try:
        return denoise_fast(color, albedo, normal, 1)
    except SettingsError:
        return color


def denoise_with_guides(color: F32, albedo: F32, normal: F32, threads: int | None = None) -> DenoisedPicture:
    """Returns the denoised image, scene-linear, and its denoised guides; does not modify the inputs.

    color: scene-linear radiance. albedo 0 ... 1 and normal -1 ... 1: of the first hits, with noise from lens blur, edges and
    textures. They are denoised first, each separately, and then passed as clean (`cleanAux`): that preserves edges of textures
    and shapes that a filter of colour alone would blur. threads: None for all cores. Raises SettingsError if Open Image Denoise
    is not installed or fails.
    """
    return _denoise(color, albedo, normal, threads or 0, guides_first=True)


def _denoise(
    color: F32,
    albedo: F32,
    normal: F32,
    threads: int,
    *,
    guides_first: bool,
    has_clean_guides: bool = False,
    is_rough: bool = False,
) -> DenoisedPicture:
    filtering = {"guides_first": guides_first, "has_clean_guides": has_clean_guides or guides_first, "is_rough": is_rough}
    try:
        import pyoidn
    except (ImportError, OSError) as error:
        raise SettingsError(
            Sentence(
                "denoiser-not-loadable",
                "Open Image Denoise cannot be loaded ({error}). Install it: pip install 'pyoidn>=2.5,<3'",
                error=library_message(error),
            )
        ) from error
    if _wants_card():
        try:
            return _denoise_on(pyoidn, pyoidn.OIDN_DEVICE_TYPE_CUDA, color, albedo, normal, threads, **filtering)
        except SettingsError as error:
            _warn_once(f"{error}. The processor denoises in the card's place")
    return _denoise_on(pyoidn, pyoidn.OIDN_DEVICE_TYPE_CPU, color, albedo, normal, threads, **filtering)


def _wants_card() -> bool:
    """Returns True if $RAYFARM_DENOISER requests an NVIDIA card. Raises SettingsError if its value is unknown."""
    named = os.environ.get(DEVICE_VARIABLE) or "cpu"
    if named not in ("cpu", "cuda"):
        raise SettingsError(
            Sentence("denoiser-device-unknown", "{variable} is {value}; give cpu or cuda", variable=DEVICE_VARIABLE, value=named)
        )
    return named == "cuda"


@functools.cache
def _warn_once(sentence: str) -> None:
    _log.warning("%s", sentence)


def _denoise_on(
    pyoidn: Any,
    kind: int,
    color: F32,
    albedo: F32,
    normal: F32,
    threads: int,
    *,
    guides_first: bool,
    has_clean_guides: bool,
    is_rough: bool,
) -> DenoisedPicture:
    """Denoises on a device of a kind, one of the library's. Raises SettingsError if it fails or there is no such device."""
    with contextlib.ExitStack() as ends:
        device = pyoidn.Device(kind)
        _check(device)
        ends.callback(device.release)
        if kind == pyoidn.OIDN_DEVICE_TYPE_CPU:
            device.set_int("numThreads", threads)
            device.set_bool("setAffinity", False)  # pinned threads would compete with rendering threads
        device.commit()
        _check(device)

        def buffer_of(image: F32) -> Any:
            buffer = ends.enter_context(pyoidn.Buffer(device, image.nbytes))
            _check(device)
            buffer.write(0, image.nbytes, image)
            return buffer

        def run(output: F32, images: dict[str, F32], **options: bool) -> F32:
            height, width, _ = output.shape
            buffers = {name: buffer_of(image) for name, image in {**images, "output": output}.items()}
            with pyoidn.Filter(device, pyoidn.OIDN_FILTER_TYPE_RT) as filter:
                for name, buffer in buffers.items():
                    filter.set_image(name, buffer, pyoidn.OIDN_FORMAT_FLOAT3, width, height)
                for name, value in options.items():
                    filter.set_bool(name, value)
                if is_rough:
                    filter.set_int("quality", pyoidn.OIDN_QUALITY_FAST)
                filter.commit()
                filter.execute()
            _check(device)
            buffers["output"].read(0, output.nbytes, output)
            _check(device)
            for buffer in buffers.values():
                buffer.release()
            return output

        guides = {}
        for name, image in (("albedo", albedo), ("normal", normal)):
            guide = np.ascontiguousarray(image, np.float32)
            guides[name] = run(np.empty_like(guide), {name: guide}) if guides_first else guide
        noisy = np.clip(np.ascontiguousarray(color, np.float32), 0, _RANGE)
        return DenoisedPicture(
            run(np.empty_like(noisy), {"color": noisy, **guides}, hdr=True, cleanAux=has_clean_guides), **guides
        )


def _check(device: Any) -> None:
    """Raises SettingsError if the device has failed."""
    if fault := device.get_error():
        raise SettingsError(Sentence("denoiser-failed", "Open Image Denoise failed: {fault}", fault=fault))
