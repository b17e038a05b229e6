"""The AOVs (arbitrary output variables) of a frame: the images besides colour, such as depth and normals.

Each is declared once, by an entry of the table at the module's end. The film contains all of them except motion, which is a
separate pass (renderer/vectors.py). Channels have the names used by Blender and Cycles, so that compositors recognise them.
"""

from __future__ import annotations

import colorsys
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer import film
from renderer.cryptomatte import channel_names
from renderer.errors import SettingsError
from renderer.film import Sums
from renderer.sentences import Sentence
from renderer.settings import LIGHT_PATHS, PATH

__all__ = [
    "ALPHA",
    "AOVS",
    "CRYPTOMATTE",
    "LIGHTS",
    "MOTION",
    "NAMES",
    "PATHS",
    "channels",
    "described",
    "is_light",
    "is_matte",
    "is_path",
    "layers",
    "parse_names",
    "planes",
    "size",
    "span",
    "values",
    "visible",
]

F32 = npt.NDArray[np.float32]
Span = tuple[F32 | np.float32, F32 | np.float32] | None

MOTION = "motion"
ALPHA = "alpha"  # only of films with a transparent background
LIGHTS = "lights"  # all light groups; the AOV of one is LIGHT and its name
LIGHT = "light:"
PATHS = "paths"  # all light paths; the AOV of one is PATH and its name (LIGHT_PATHS)
CRYPTOMATTE = "cryptomatte"  # asked for; the AOV is this, a colon, and the number of ids per pixel (renderer/cryptomatte.py)
MATTE = f"{CRYPTOMATTE}:"

# Colours of a heat map: black body, starting with blue so that small values differ from 0.
_HEAT = np.array([(0, 0, 0), (50, 25, 120), (190, 45, 100), (250, 140, 35), (255, 250, 195)], np.float32) / 255
_GOLDEN = 0.6180339887498949  # fraction of the hue circle between consecutive numbers; avoids similar hues


class _Aov(NamedTuple):
    """The declaration of an AOV.

    channels: names in an EXR. numbers: names of a pixel's values on the page. shown: returns a plane of the AOV as colours 0 ...
    1, given the ends of its display range. planes: the film's planes (renderer/film.py) from which it is computed. mean: whether
    those planes are sums, which must be divided by the number of samples. span: returns the display range of a whole plane, or
    None if it needs none.
    """

    label: str
    help: str
    channels: tuple[str, ...]
    numbers: tuple[str, ...]
    shown: Callable[[F32, Any, Any], npt.NDArray[Any]]
    planes: tuple[slice | int, ...] = ()
    mean: bool = True
    span: Callable[[F32], Span] = lambda plane: None


def parse_names(
    names: Iterable[str], groups: Sequence[str] | None = (), ranks: int = 0, is_transparent: bool = False
) -> list[str]:
    """Returns the AOVs in a list of names.

    `all` stands for all AOVs of the film, `lights` for its light groups, `paths` for its light paths.

    groups: the names of the film's planes by light (RenderSettings.light_planes). None while they are unknown: names of light
    groups and paths, `lights`, `paths`, `all`, `cryptomatte` and `alpha` are kept, and the result has to be parsed again. ranks:
    RenderSettings.cryptomatte. is_transparent: RenderSettings.is_transparent. Raises SettingsError for an unknown name.
    """
    wanted = list(names)
    for name in wanted:
        if name == ALPHA:
            if groups is not None and not is_transparent:
                raise SettingsError(
                    Sentence(
                        "aov-without-alpha",
                        "aov {name}: the picture has an opaque background; set background to transparent when it is rendered",
                        name=name,
                    ),
                    field="aov",
                )
            continue
        if name == CRYPTOMATTE or is_matte(name):
            if groups is not None and (not ranks or is_matte(name)):
                raise SettingsError(
                    Sentence(
                        "aov-without-cryptomatte",
                        "aov {name}: the picture has no mattes; set cryptomatte, for instance to 6, when it is rendered",
                        name=name,
                    ),
                    field="aov",
                )
            continue
        if is_path(name) or name == PATHS:
            if groups is not None and not any(map(is_path, groups)):
                raise SettingsError(
                    Sentence(
                        "aov-without-light-paths",
                        "aov {name}: the picture has no light paths; set light_paths to on when it is rendered",
                        name=name,
                    ),
                    field="aov",
                )
            if is_path(name) and name.removeprefix(PATH) not in LIGHT_PATHS:
                raise SettingsError(
                    Sentence(
                        "aov-light-path-unknown",
                        "aov {name}: there is no such light path; there are {paths}",
                        name=name,
                        paths=[*LIGHT_PATHS],
                    ),
                    field="aov",
                )
            continue
        if is_light(name) or name == LIGHTS:
            lights = None if groups is None else [group for group in groups if not is_path(group)]
            if lights is not None and (not lights or (is_light(name) and name.removeprefix(LIGHT) not in lights)):
                raise _unknown_group_error(name, lights)
        elif name not in (*NAMES, "all"):
            raise SettingsError(
                Sentence(
                    "aov-unknown",
                    "aov {name} is not known; known are {names}, or all (but motion)",
                    name=repr(name),
                    names=[*NAMES, ALPHA, LIGHTS, PATHS, CRYPTOMATTE],
                ),
                field="aov",
            )
    of_groups = [f"{LIGHT}{group}" for group in groups or () if not is_path(group)]
    of_paths = [*filter(is_path, groups or ())]
    mattes = [f"{MATTE}{ranks}"] if ranks else []
    if "all" in wanted:
        alpha = [ALPHA] if is_transparent else []
        return [*AOVS, *({MOTION} & {*wanted}), *((*alpha, *of_groups, *of_paths, *mattes) if groups is not None else ("all",))]
    if groups is None:
        return wanted
    expanded = {LIGHTS: of_groups, PATHS: of_paths, CRYPTOMATTE: mattes}
    return list(dict.fromkeys(each for name in wanted for each in expanded.get(name, [name])))


def is_matte(name: str) -> bool:
    """Returns True if an AOV is Cryptomatte's layers."""
    return name.startswith(MATTE)


def is_light(name: str) -> bool:
    """Returns True if an AOV is the light of one group."""
    return name.startswith(LIGHT)


def is_path(name: str) -> bool:
    """Returns True if an AOV, or a film's plane by light, is the light of one kind of path."""
    return name.startswith(PATH)


def _is_by_light(name: str) -> bool:
    return is_light(name) or is_path(name)


def _unknown_group_error(name: str, groups: Sequence[str]) -> SettingsError:
    if not groups:
        return SettingsError(
            Sentence(
                "aov-without-light-groups",
                "aov {name}: the picture has no light groups; name some in light_groups when it is rendered",
                name=name,
            ),
            field="aov",
        )
    return SettingsError(
        Sentence(
            "aov-light-group-unknown",
            "aov {name}: the picture has no such light group; it has {groups}",
            name=name,
            groups=[*groups],
        ),
        field="aov",
    )


def described() -> list[dict[str, Any]]:
    """Returns the AOVs of the film in the form that the page needs: name, label, help and the names of a pixel's values."""
    return [
        {"name": name, "label": _ALL[name].label, "help": _ALL[name].help, "values": list(_ALL[name].numbers)} for name in AOVS
    ]


def planes(name: str, groups: Sequence[str] = ()) -> tuple[int, ...]:
    """Returns the planes of the film from which an AOV, or `color`, is computed. groups: the names of its light groups."""
    if name == "color":
        return _channel_numbers(film.COLOR, film.SAMPLES)
    if _is_by_light(name):
        of_group = film.group_planes(groups.index(name.removeprefix(LIGHT)))
        return (*range(of_group.start, of_group.stop), film.SAMPLES)
    if is_matte(name):
        return (film.SAMPLES,)
    if name == ALPHA:
        first = film.alpha_plane(len(groups))
        return (*range(first, first + film.ALPHA_PLANES), film.SAMPLES)
    aov = _ALL[name]
    return _channel_numbers(*aov.planes, film.SAMPLES) if aov.mean else _channel_numbers(*aov.planes)


def _channel_numbers(*channels: slice | int) -> tuple[int, ...]:
    return tuple(i for each in channels for i in (range(film.CHANNELS)[each] if isinstance(each, slice) else (each,)))


def size(name: str) -> int:
    """Returns the number of values per pixel of an AOV, or of `color`."""
    return 3 if name == "color" else len(channels(name))


def channels(name: str) -> tuple[str, ...]:
    """Returns the names of an AOV's channels in an EXR; of light groups as Blender names them."""
    if is_light(name):
        return tuple(f"Combined_{name.removeprefix(LIGHT)}.{channel}" for channel in "RGB")
    if is_path(name):
        return tuple(f"{_PATH_LAYERS[name.removeprefix(PATH)]}.{channel}" for channel in "RGB")
    if is_matte(name):
        return channel_names(int(name.removeprefix(MATTE)))
    return _declaration(name).channels


def values(sums: Sums, film_exponent: int, name: str, groups: Sequence[str] = ()) -> F32:
    """Returns the values of an AOV of the film: (h, w, 3) float32 for albedo, normal, position and light groups, else (h, w).

    albedo: 0 ... 1. normal, position, depth: in world space. object, material: 1 + the number, 0 where nothing is hit. samples:
    the number of samples in the film. alpha: 0 ... 1. error: the standard error of the pixel's luminance (film.error). groups:
    the names of the film's light groups.
    """
    if _is_by_light(name):
        return film.mean(sums, film_exponent, film.group_planes(groups.index(name.removeprefix(LIGHT))))
    if name == "error":
        return film.error(sums, film_exponent)
    if name == ALPHA:
        return film.alpha(sums, film_exponent, len(groups))
    (plane,) = _ALL[name].planes
    return film.mean(sums, film_exponent, plane) if _ALL[name].mean else sums[plane].astype(np.float32)


def layers(pictures: dict[str, F32]) -> dict[str, F32]:
    """Converts a dict of AOV name -> values to a dict of EXR channel name -> (h, w) plane."""
    found = {}
    for name, plane in pictures.items():
        for i, channel in enumerate(channels(name)):
            found[channel] = plane if plane.ndim == 2 else plane[..., i]
    return found


def span(name: str, plane: F32) -> Span:
    """Returns an AOV's display range, from its whole plane, so that parts of the plane shown separately have matching colours.

    Positions and depths: minimum and maximum. Samples: 0 and the maximum. Error: 0 and the 99th percentile. None for AOVs that
    need no range.
    """
    return None if _is_by_light(name) else _declaration(name).span(plane)


def visible(name: str, plane: F32, between: Span = None) -> npt.NDArray[np.uint8]:
    """Returns an AOV as a displayable image, (h, w, 3) uint8.

    albedo: as colour. normal: from -1 ... 1. position, depth: over their range, near points bright and nothing black. object,
    material: in one constant colour per number. samples, error: as heat maps. alpha: 0 black, 1 white. motion: the offset to the
    next frame around grey, red to the right, green upwards. between: `span` of the whole plane, if `plane` is a part of it.
    """
    low, high = between or span(name, plane) or (np.float32(0), np.float32(1))
    shown = _encoded if _is_by_light(name) else _declaration(name).shown
    return (np.clip(np.nan_to_num(shown(plane, low, high)), 0, 1) * 255 + 0.5).astype(np.uint8)


def _span_of_position(plane: F32) -> Span:
    return plane.min(axis=(0, 1)), plane.max(axis=(0, 1))


def _span_of_depth(plane: F32) -> Span:
    hit = plane > 0
    return (np.float32(plane[hit].min()), np.float32(plane[hit].max())) if hit.any() else (np.float32(0), np.float32(1))


def _span_of_motion(plane: F32) -> Span:
    return np.float32(0), np.abs(plane).max(initial=np.float32(0))


def _span_of_samples(plane: F32) -> Span:
    finite = plane[np.isfinite(plane)]
    return np.float32(0), np.float32(finite.max() if finite.size else 0.0)


def _span_of_error(plane: F32) -> Span:
    finite = plane[np.isfinite(plane)]
    return np.float32(0), np.float32(np.percentile(finite, 99) if finite.size else 0.0)


def _encoded(plane: F32, low: Any, high: Any) -> npt.NDArray[Any]:
    from renderer.image.tonemap import encode_srgb

    return encode_srgb(np.clip(plane, 0, 1))


def _signed(plane: F32, low: Any, high: Any) -> npt.NDArray[Any]:
    return plane * 0.5 + 0.5


def _normalized(plane: F32, low: Any, high: Any) -> npt.NDArray[Any]:
    return np.asarray((plane - low) / np.maximum(high - low, 1e-30), np.float32)


def _greys(plane: F32, low: Any, high: Any) -> npt.NDArray[Any]:
    return np.repeat(plane[..., None], 3, axis=2)


def _depth_shades(plane: F32, low: Any, high: Any) -> npt.NDArray[Any]:
    near = 1 - 0.9 * (plane - low) / max(high - low, 1e-30)
    return np.repeat(np.where(plane > 0, near, 0)[..., None], 3, axis=2)


def _motion_colors(plane: F32, low: Any, high: Any) -> npt.NDArray[Any]:
    way = np.concatenate([-plane[..., 2:], np.zeros_like(plane[..., :1])], axis=2)
    return np.asarray(0.5 + 0.5 * way / max(float(high), 1e-30), np.float32)


def _palette(plane: F32, low: Any, high: Any) -> F32:
    """Returns a colour for each object or material number in the plane, the same in every image; black for 0."""
    ids = plane.astype(np.int64)
    found, where = np.unique(ids, return_inverse=True)
    colors = [colorsys.hsv_to_rgb(i * _GOLDEN % 1, 0.45 + 0.3 * (i % 2), 0.95 - 0.25 * (i // 2 % 2)) for i in found.tolist()]
    table = np.array(colors, np.float32)
    table[found == 0] = 0
    return table[where.reshape(ids.shape)]


def _heat(plane: F32, low: Any, high: Any) -> F32:
    level = np.where(np.isfinite(plane), plane, high).astype(np.float32) / np.float32(max(float(high), 1e-30))
    at = np.clip(level, 0, 1) * (len(_HEAT) - 1)
    return np.stack([np.interp(at, np.arange(len(_HEAT)), _HEAT[:, i]) for i in range(3)], axis=-1).astype(np.float32)


def _declaration(name: str) -> _Aov:
    return _ALPHA if name == ALPHA else _ALL[name]


_PATH_LAYERS = dict(  # of an EXR, as Blender names them
    zip(
        LIGHT_PATHS,
        ("Emit", "Env", "DiffDir", "DiffInd", "GlossDir", "GlossInd", "TransDir", "TransInd", "VolumeDir", "VolumeInd"),
        strict=True,
    )
)
_XYZ = ("X", "Y", "Z")
_ALL = {
    "albedo": _Aov(
        "Albedo",
        "Reflectance of the first surface",
        ("Denoising Albedo.R", "Denoising Albedo.G", "Denoising Albedo.B"),
        ("R", "G", "B"),
        _encoded,
        (film.ALBEDO,),
    ),
    "normal": _Aov(
        "Normal",
        "Shading normal of the first surface in world space",
        ("Normal.X", "Normal.Y", "Normal.Z"),
        _XYZ,
        _signed,
        (film.NORMAL,),
    ),
    "depth": _Aov(
        "Depth",
        "Distance from the eye to the first surface",
        ("Depth.Z",),
        ("Distance",),
        _depth_shades,
        (film.DEPTH,),
        span=_span_of_depth,
    ),
    "position": _Aov(
        "Position",
        "World position of the first surface",
        ("Position.X", "Position.Y", "Position.Z"),
        _XYZ,
        _normalized,
        (film.POSITION,),
        span=_span_of_position,
    ),
    "object": _Aov("Object id", "A colour for every object", ("IndexOB.X",), ("Object",), _palette, (film.OBJECT,), mean=False),
    "material": _Aov(
        "Material id", "A colour for every material", ("IndexMA.X",), ("Material",), _palette, (film.MATERIAL,), mean=False
    ),
    "samples": _Aov(
        "Sample count",
        "Heat map: where the farm spent its samples",
        ("Debug Sample Count.X",),
        ("Samples",),
        _heat,
        (film.SAMPLES,),
        mean=False,
        span=_span_of_samples,
    ),
    "error": _Aov(
        "Error",
        "Heat map: how noisy each pixel still is",
        ("Standard Error.X",),  # not in Cycles
        ("Error",),
        _heat,
        (film.COLOR, film.COLOR_HALF, film.SAMPLES, film.SAMPLES_HALF),
        mean=False,
        span=_span_of_error,
    ),
    MOTION: _Aov(
        "Motion",
        "",
        ("Vector.X", "Vector.Y", "Vector.Z", "Vector.W"),
        ("X", "Y", "Z", "W"),
        _motion_colors,
        span=_span_of_motion,
    ),
}
_ALPHA = _Aov("Alpha", "How much of the pixel is covered", ("A",), ("Alpha",), _greys)
NAMES = tuple(_ALL)
AOVS = tuple(name for name in NAMES if name != MOTION)  # without the separate motion pass
