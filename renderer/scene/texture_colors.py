"""Colour spaces of textures, converted to the renderer's linear Rec.709 by an OpenColorIO config.

Names are those of the scene's own config, otherwise of the built-in studio config. That config has a fixed version, so a scene's
pixels follow from its files alone, and not from a machine's settings. The package opencolorio is optional.
"""

from __future__ import annotations

import difflib
import functools
import hashlib
import importlib
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import PurePosixPath
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.formats import COLOR_CONFIG
from renderer.image.ocio import BUILTIN, WORKING_SPACE
from renderer.image.tonemap import decode_srgb, encode_srgb
from renderer.scene.files import SceneFiles
from renderer.sentences import Sentence

__all__ = ["LINEAR", "SRGB", "TextureColors", "common_space"]

Pixels = npt.NDArray[Any]
F32 = npt.NDArray[np.float32]

SRGB, LINEAR = "srgb", "linear"  # what is stored without conversion: sRGB-encoded Rec.709, and linear Rec.709 or data

# Names with one meaning in all programs. They need neither a config nor opencolorio.
_COMMON = {
    SRGB: {
        *("srgb", "srgb_texture", "srgb_tx", "srgb_rec709_scene", "srgb_rec709", "srgb - texture", "srgb - display"),
        *("srgb_display", "utility - srgb - texture", "input - generic - srgb - texture", "srgb encoded rec.709 (srgb)"),
    },
    LINEAR: {
        *("linear", "lin_rec709", "lin_rec709_srgb", "lin_rec709_scene", "lin_srgb", "linear rec.709 (srgb)", "linear rec.709"),
        *("linear bt.709", "scene-linear rec.709-srgb", "utility - linear - srgb", "utility - linear - rec.709"),
        *("raw", "none", "data", "identity", "utility - raw", "non-color", "non-colour data"),
    },
}
_EXACT = 2e-5  # greatest difference of linear values below which a space is one of SRGB and LINEAR
_NOTICED = -1e-3  # colours less negative than this lie outside Rec.709 by rounding alone
_NAMES = 12  # known names that a warning lists
_BAND = 1 << 20  # pixels that are converted at a time


def common_space(name: str) -> str | None:
    """Returns SRGB or LINEAR for a name that means the same in all programs; None for others."""
    lower = name.strip().lower()
    return next((stored for stored, names in _COMMON.items() if lower in names), None)


class TextureColors:
    """The colour spaces of one scene's textures.

    files: the scene's. warn: takes warnings. A fault of the config, or a missing package, is one warning, and textures then have
    the encoding that they have without names.
    """

    def __init__(self, files: SceneFiles, warn: Callable[[str], None]) -> None:
        self._files, self._warn = files, warn
        self._named: str | None = None
        self._missing = ""  # the config that the scene names, if it is not among the files
        self._opened = False
        self._config: Any = None
        self._encodings: dict[str, str | None] = {}
        self._processors: dict[str, Any] = {}

    def choose(self, reference: str, beside: str) -> None:
        """Sets the config that a scene names: `cg`, `studio`, `ocio://NAME`, or a file. beside: the scene file that names it.

        If the file is missing, names are those of the studio config; a warning says so when the first of them is looked up.
        """
        is_built_in = reference in BUILTIN or reference.startswith("ocio://")
        self._named = reference if is_built_in else self._files.find(reference, beside)
        self._missing = "" if self._named is not None else reference

    @property
    def own(self) -> str | None:
        """The scene's own config: the one that it names, otherwise COLOR_CONFIG; None if it has neither."""
        if self._named is None and not self._missing and self._files.has(COLOR_CONFIG):
            self._named = COLOR_CONFIG
        return self._named

    def encoding(self, file: str, srgb: bool, space: str = "") -> str:
        """Returns SRGB, LINEAR, or the colour space from which a texture is to be converted.

        file: the texture's. srgb: whether it is sRGB-encoded unless a colour space is given. space: the name, alias or role of a
        colour space; if empty, a colour texture has that of the own config's file rules, and other textures are data. An unknown
        name is a warning, and counts as none.
        """
        usual = SRGB if srgb else LINEAR
        if not space:
            return (self._of_rules(file) or usual) if srgb and self.own is not None else usual
        common = common_space(space)
        if self.own is None and common is not None:
            return common
        found = self._resolved(space)
        if found is not None or common is not None:
            return found or common or usual
        if self._open() is not None:
            known = self._known_names()
            near = difflib.get_close_matches(space.lower(), {each.lower() for each in known}, _NAMES // 2, 0.5)
            shown = [each for each in known if each.lower() in near] or known[:_NAMES]
            self._warn(
                Sentence(
                    "texture-space-unknown",
                    "{file}: the OCIO config {config} has no colour space {space}: read as {encoding}; known are {known}",
                    file=file,
                    space=repr(space[:80]),
                    config=self._title,
                    encoding="sRGB" if srgb else "lin_rec709",
                    known=shown,
                )
            )
        return usual

    def convert(self, pixels: Pixels, space: str, file: str) -> Pixels:
        """Returns pixels converted from a colour space to Rec.709, as pixels of an `Image` with `srgb`; alpha stays.

        pixels: (h, w, 3 or 4), of uint8, uint16 or float32. The result is sRGB-encoded uint16 for integers within 0..1, else
        linear float32. Negative values, colours outside Rec.709, become 0, with a warning. space: from `encoding`.
        """
        if space in (SRGB, LINEAR):
            return pixels
        is_integer = np.issubdtype(pixels.dtype, np.integer)
        scale = np.float32(np.iinfo(pixels.dtype).max) if is_integer else np.float32(1)
        values = np.ascontiguousarray(pixels, np.float32) / scale
        step = max(1, _BAND // max(values.shape[1], 1))
        outside = 0
        for top in range(0, len(values), step):
            rgb = self.linear(values[top : top + step, :, :3], space)
            outside += int((rgb.min(axis=-1) < _NOTICED).sum())
            values[top : top + step, :, :3] = np.maximum(rgb, 0)
        if outside:
            self._warn(
                Sentence(
                    "texture-outside-gamut",
                    "{file}: {percent} % of its texels have colours outside Rec.709, which are clipped to it",
                    file=file,
                    percent=f"{max(100 * outside / (values.shape[0] * values.shape[1]), 0.1):.1f}",
                )
            )
        if not is_integer or values[..., :3].max(initial=0) > 1:
            return values
        values[..., :3] = encode_srgb(values[..., :3])
        return np.rint(values * 65535).astype(np.uint16)

    def linear(self, rgb: npt.NDArray[np.floating], space: str) -> F32:
        """Returns colours (..., 3) of a colour space as linear Rec.709, which may be negative. space: from `encoding`."""
        if space in (SRGB, LINEAR):
            return np.asarray(decode_srgb(np.maximum(rgb, 0)) if space == SRGB else rgb, np.float32)
        values = np.array(rgb, np.float32, order="C")
        if values.size:
            self._processors[space].applyRGB(values.reshape(-1, 3))
        return np.nan_to_num(values, nan=0.0)

    @property
    def _title(self) -> str:
        return self.own or "studio"

    def _open(self) -> Any:
        """Returns the config; None, with a warning, if it cannot be read or opencolorio is not installed."""
        if not self._opened:
            self._opened = True
            if self._missing:
                self._warn(
                    Sentence(
                        "texture-config-missing",
                        "The OCIO config {name} is not among the files; add it. Colour spaces of textures are those of the "
                        "built-in studio config until then.",
                        name=self._missing[:120],
                    )
                )
            try:
                self._config = self._read_config()
            except SceneError as error:
                self._warn(Sentence("texture-config-unusable", "Colour spaces of textures are ignored: {error}.", error=error))
        return self._config

    def _read_config(self) -> Any:
        if find_spec("PyOpenColorIO") is None:
            raise SceneError(
                Sentence(
                    "texture-colors-not-installed",
                    'they need the package opencolorio; pip install "rayfarm[ocio]"',
                )
            )
        ocio = importlib.import_module("PyOpenColorIO")
        ocio.SetLoggingLevel(ocio.LOGGING_LEVEL_NONE)
        ocio.ClearAllCaches()  # of LUTs by path: those of another scene in this process may have the same
        self._ocio = ocio
        source = self._title
        try:
            if source in BUILTIN or source.startswith("ocio://"):
                return _built_in(BUILTIN.get(source, source))
            self._proxy = _proxy_class(ocio)(self._files, source)
            config = ocio.Config.CreateFromConfigIOProxy(self._proxy)
            config.validate()
        except (ocio.Exception, ocio.ExceptionMissingFile, SceneError, UnicodeDecodeError) as error:
            raise self._fault(error) from None
        return config

    def _fault(self, error: Exception) -> SceneError:
        return SceneError(
            Sentence(
                "texture-config-unreadable",
                "the OCIO config {name} cannot be used ({error})",
                name=self._title,
                error=" ".join(str(error).split())[:300],
            )
        )

    def _known_names(self) -> list[str]:
        config = self._config
        roles = [role for role, _ in config.getRoles()]
        names = [str(each.getName()) for each in config.getColorSpaces()]
        return [*names, *roles, *(str(alias) for each in config.getColorSpaces() for alias in each.getAliases())]

    def _of_rules(self, file: str) -> str | None:
        """Returns the encoding of a colour texture by the config's file rules; None if only the default rule applies."""
        config = self._open()
        if config is None or config.filepathOnlyMatchesDefaultRule(file):
            return None
        return self._resolved(str(config.getColorSpaceFromFilepath(file)[0]))

    def _resolved(self, name: str) -> str | None:
        """Returns the encoding for the name, alias or role of a colour space; None if there is none, or no way from it."""
        if name not in self._encodings:
            self._encodings[name] = self._found(name)
        return self._encodings[name]

    def _found(self, name: str) -> str | None:
        config = self._open()
        space = config.getColorSpace(name.strip()) if config is not None else None
        if space is None:
            return None
        if space.isData():
            return LINEAR
        own = str(space.getName())
        try:
            processor = self._ocio.Config.GetProcessorToBuiltinColorSpace(config, own, WORKING_SPACE)
            self._processors[own] = processor.getOptimizedCPUProcessor(self._ocio.OPTIMIZATION_LOSSLESS)
        except (self._ocio.Exception, self._ocio.ExceptionMissingFile, SceneError) as error:
            self._warn(
                Sentence("texture-config-unusable", "Colour spaces of textures are ignored: {error}.", error=self._fault(error))
            )
            return SRGB
        return self._stored(own) or own

    def _stored(self, space: str) -> str | None:
        """Returns SRGB or LINEAR if a colour space equals it, as measured on a grid of colours; else None."""
        axis = np.linspace(0, 1, 18, dtype=np.float32)
        colors = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
        found = self.linear(colors, space)
        return next((each for each in (SRGB, LINEAR) if np.abs(found - self.linear(colors, each)).max() < _EXACT), None)


@functools.cache
def _built_in(name: str) -> Any:
    return importlib.import_module("PyOpenColorIO").Config.CreateFromFile(name)


def _proxy_class(ocio: Any) -> type:
    """Returns a class by which OpenColorIO reads a config and its LUTs from the scene's files, and from nowhere else."""

    class SceneConfig(ocio.PyConfigIOProxy):
        def __init__(self, files: SceneFiles, config: str) -> None:
            super().__init__()
            self._files, self._config = files, config

        def getConfigData(self) -> str:  # noqa: N802
            return self._files.read(self._config).decode()

        def getLutData(self, path: str) -> Any:  # noqa: N802
            return ocio.vector_of_uint8_t(self._read(path))

        def getFastLutFileHash(self, path: str) -> str:  # noqa: N802
            return hashlib.sha256(self._read(path)).hexdigest()

        def _read(self, path: str) -> bytes:
            name = self._files.find(path, self._config) or PurePosixPath(path).name
            data = self._files.read(name)
            if not data:  # OpenColorIO would open the path itself
                raise SceneError(Sentence("texture-lut-empty", "{name} is empty; add the file again", name=name[:200]))
            return data

    return SceneConfig
