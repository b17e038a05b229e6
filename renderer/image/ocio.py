"""Views of an OpenColorIO config as tone curves: scene-linear Rec.709 radiance -> encoded values of a display.

A view is named `ocio:VIEW` (of the config's default display) or `ocio:DISPLAY/VIEW`, with `/LOOK` appended for a look of the
config; `ocio` is the default view. The package opencolorio is optional (`rayfarm[ocio]`), and
imported here and in renderer/scene/texture_colors.py.
"""

from __future__ import annotations

import functools
import os
import threading
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.errors import SettingsError
from renderer.image.tonemap import CURVES, Curve
from renderer.sentences import Sentence

__all__ = ["BUILTIN", "LUT_SIZE", "ColorConfig", "View", "ViewTransform", "curve_of", "is_installed", "is_view", "open_config"]

F32 = npt.NDArray[np.float32]

# Named with their version, so that a name means the same picture in every release of the library.
BUILTIN = {
    "cg": "ocio://cg-config-v4.0.0_aces-v2.0_ocio-v2.5",
    "studio": "ocio://studio-config-v4.0.0_aces-v2.0_ocio-v2.5",
}
PQ = {"Rec.2100-PQ - Display", "rec2100_pq_display", "pq_rec2020_display"}  # names of the display space
PREFIX = "ocio"  # of the names of views
LARGEST = np.float32(65504)  # of half floats, which the transforms are made for
WORKING_SPACE = "lin_rec709_srgb"  # the renderer's, as OpenColorIO's built-in configs call it

# The baked table has LUT_SIZE points an axis, at x with log2(1 + 255 x) / 16 = 0 ... 1. One lies at x = 1, where many views clip;
# above it there are two to a stop, up to 257.
LUT_SIZE = 65
LUT_SCALE, LUT_STOPS = 255.0, 16.0


@dataclass(frozen=True)
class View:
    """A view of a display. name: of the tone curve. is_default: whether the display is the config's default."""

    name: str
    display: str
    view: str
    is_default: bool


class ViewTransform:
    """The transform of one view.

    view: without its look. key: identifies the transform and its config, for caches. is_pq: whether its values are the PQ signal
    of BT.2100.
    """

    def __init__(self, view: View, key: str, is_pq: bool, processor: Any) -> None:
        self.view, self.key, self.is_pq = view, key, is_pq
        self._processor = processor

    def encode(self, rgb: F32) -> F32:
        """Returns display-encoded values, usually 0..1, of scene-linear Rec.709, (..., 3) float32, not negative."""
        values = np.minimum(rgb, LARGEST).astype(np.float32, order="C")
        flat = values.reshape(-1, 3)
        if flat.size:
            self._processor.applyRGB(flat)  # in place, without the interpreter's lock
        return values

    def lut(self) -> npt.NDArray[np.uint32]:
        """Returns the view as a 3D table, (LUT_SIZE,) * 3 uint32, indexed by blue, green, red.

        A word has encoded red in its lowest 10 bits, then green, then blue. The points of an axis are at
        x = (2 ** (16 i / (LUT_SIZE - 1)) - 1) / 255. Interpolated in tetrahedra, ACES 2.0 SDR differs from `encode` by 0.1 of an
        8-bit step on average and 0.4 at the 99th percentile, for radiance up to 32; a few colours at the edge of the display's
        gamut differ by up to 15.
        """
        x = (np.exp2(np.linspace(0, LUT_STOPS, LUT_SIZE)) - 1) / LUT_SCALE
        blue, green, red = np.meshgrid(x, x, x, indexing="ij")
        encoded = np.clip(self.encode(np.stack([red, green, blue], axis=-1).astype(np.float32)), 0, 1)
        words: npt.NDArray[np.uint32] = np.rint(encoded * 1023).astype(np.uint32)
        return np.bitwise_or.reduce(words << np.array([0, 10, 20], np.uint32), axis=-1)


class ColorConfig:
    """An OpenColorIO config: its displays, views and looks.

    source: a path, a built-in config as `ocio://NAME`, or a name of BUILTIN. Raises SettingsError if opencolorio is not installed
    or the config cannot be read.
    """

    def __init__(self, source: str) -> None:
        if not is_installed():
            raise SettingsError(
                Sentence("ocio-not-installed", 'OCIO views need the package opencolorio: pip install "rayfarm[ocio]"')
            )
        import PyOpenColorIO as ocio  # noqa: N813 -- the name its own documentation uses

        ocio.SetLoggingLevel(ocio.LOGGING_LEVEL_NONE)
        self.source = source
        self._ocio = ocio
        try:
            self._config = ocio.Config.CreateFromFile(BUILTIN.get(source, source))
            self._config.validate()
            self.key = str(self._config.getCacheID())
        except (ocio.Exception, ocio.ExceptionMissingFile) as error:
            raise SettingsError(
                Sentence(
                    "ocio-config-unreadable",
                    "the OCIO config {source} cannot be read: {error}",
                    source=repr(source),
                    error=_one_line(error),
                )
            ) from error
        self.default_display = str(self._config.getDefaultDisplay())
        self.looks = tuple(str(look.getName()) for look in self._config.getLooks())
        self.views = tuple(
            View(f"ocio:{display}/{view}", display, view, display == self.default_display)
            for display in self._config.getDisplays()
            for view in self._config.getViews(display)
        )
        self._known: dict[str, ViewTransform] = {}
        self._lock = threading.Lock()

    def find(self, name: str) -> ViewTransform:
        """Returns the view of this name. Raises SettingsError if the config has none such, or no way to it from Rec.709."""
        with self._lock:
            if name not in self._known:
                self._known[name] = self._make(name)
            return self._known[name]

    def _make(self, name: str) -> ViewTransform:
        ocio = self._ocio
        view, look = self._parts(name)
        try:
            steps = ocio.Config.GetProcessorFromBuiltinColorSpace(
                WORKING_SPACE, self._config, "scene_linear"
            ).createGroupTransform()
        except ocio.Exception as error:
            raise SettingsError(
                Sentence(
                    "ocio-config-without-interchange",
                    "the OCIO config {source} does not relate its colours to Rec.709: add the role aces_interchange ({error})",
                    source=repr(self.source),
                    error=_one_line(error),
                )
            ) from error
        if look:
            steps.appendTransform(ocio.LookTransform(src="scene_linear", dst="scene_linear", looks=look))
        steps.appendTransform(ocio.DisplayViewTransform(src="scene_linear", display=view.display, view=view.view))
        try:
            processor = self._config.getProcessor(steps)
            return ViewTransform(view, f"{name} {self.key}", self._is_pq(view), processor.getDefaultCPUProcessor())
        except (ocio.Exception, ocio.ExceptionMissingFile) as error:
            raise SettingsError(
                Sentence(
                    "ocio-view-failed",
                    "the OCIO view {name} cannot be used: {error}",
                    name=repr(name),
                    error=_one_line(error),
                )
            ) from error

    def _is_pq(self, view: View) -> bool:
        space = self._config.getDisplayViewColorSpaceName(view.display, view.view)
        found = self._config.getColorSpace(view.display if space == "<USE_DISPLAY_NAME>" else space)
        return found is not None and not PQ.isdisjoint([found.getName(), *found.getAliases()])

    def _parts(self, name: str) -> tuple[View, str]:
        """Returns the view and the look ("" for none) of a name. Names may contain slashes, so the known ones are compared."""
        prefix, _, rest = name.partition(":")
        if prefix == PREFIX and not rest:
            first = str(self._config.getDefaultView(self.default_display))
            return next(each for each in self.views if each.is_default and each.view == first), ""
        for look in ("", *self.looks) if prefix == PREFIX else ():
            if not rest.endswith(f"/{look}" if look else ""):
                continue
            place = rest.removesuffix(f"/{look}") if look else rest
            for each in self.views:
                if place == f"{each.display}/{each.view}" or (each.is_default and place == each.view):
                    return each, look
        raise SettingsError(
            Sentence(
                "ocio-view-unknown",
                "{name} is no view of the OCIO config {source}; `rayfarm ocio` and GET /api/info list its views",
                name=repr(name[:200]),
                source=repr(self.source),
            )
        )


def is_installed() -> bool:
    """Returns whether the package opencolorio is installed."""
    return find_spec("PyOpenColorIO") is not None


def is_view(name: str) -> bool:
    """Returns whether a tone curve's name is one of a view, known or not."""
    return name.partition(":")[0] == PREFIX


def open_config(source: str = "") -> ColorConfig:
    """Returns the config; each is opened once per process.

    source: as of ColorConfig; empty: that of the environment, RAYFARM_OCIO or OCIO, otherwise cg. Raises SettingsError as
    ColorConfig does.
    """
    return _opened(source or os.environ.get("RAYFARM_OCIO") or os.environ.get("OCIO") or "cg")


_opened = functools.cache(ColorConfig)


def curve_of(name: str, source: str = "") -> Curve:
    """Returns the tone curve of a name of tonemap.CURVES, or of a view. source: as of `open_config`. Raises SettingsError."""
    if is_view(name):
        return open_config(source).find(name)
    if name not in CURVES:
        raise SettingsError(
            Sentence(
                "tone-curve-unknown", "tone curve is {curve}; known are {curves}", curve=repr(name), curves=[*CURVES, "ocio"]
            )
        )
    return name


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:300]
