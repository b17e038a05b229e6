"""Evaluates nodes on images, such as ramps, curves, mixes and sums, texel by texel, as Blender does.

The nodes between a surface and its images are evaluated once, in linear light, and exported as one image with the same mapping as
its inputs. Nodes that combine images with different mappings, or that depend on the position, are not supported.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from . import images
from .color_nodes import BLENDS, MATH, hsv, rgb
from .model import TextureUse
from .nodes import Blend, Product, SocketInGroups, Source, SquareRoot, constant_value, source_of

__all__ = ["Bump", "Painted", "Painter"]

F32 = npt.NDArray[np.float32]
STEPS = 4096  # samples of a ramp or a curve
LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
MOST_NODES = 200
PLAIN = (0.0, 0.0), 0.0, (1.0, 1.0)  # offset, rotation and scale of an untransformed texture


class Bump(NamedTuple):
    """The parameters of a Bump node. strength: 0 to 1; distance: the displacement for a height of 1."""

    strength: float
    distance: float


class Painted:
    """An image computed from nodes, which replaces a bpy.types.Image. pixels: (h, w, 4) linear, rows from the top."""

    is_float, is_dirty, source = True, False, "PAINTED"

    def __init__(self, name: str, pixels: F32) -> None:
        self.name, self.texels = name, pixels

    def scale_down(self) -> float:
        """Divides the values by their maximum if it exceeds 1; returns the divisor."""
        most = max(float(self.texels[..., :3].max(initial=0.0)), 1.0)
        self.texels[..., :3] /= most
        return most


@dataclass
class _Plane:
    """The value of an evaluated socket. values: constant (3,) or (1,), or texels (h, w, 3) or (h, w, 1).

    use: the texels' mapping; None for constants.
    """

    values: F32
    use: TextureUse | None = None


class _UnknownError(Exception):
    """Raised for a node that is not supported."""


class Painter:
    """Evaluates the nodes of one material to images.

    use_of: returns the mapping of an image or pattern node; None if the node is not mapped by UVs.
    """

    def __init__(self, name: str, use_of: Callable[[Source], TextureUse | None]) -> None:
        self._name, self._use_of = name, use_of
        self._left = MOST_NODES

    def paint(self, socket: Any, what: str) -> tuple[Painted, TextureUse] | list[float] | None:
        """Evaluates a socket: returns an image and its mapping, or a constant colour; None if a node is not supported.

        what: the last part of the image's name.
        """
        self._left = MOST_NODES
        try:
            found = self._plane(socket)
        except _UnknownError:
            return None
        values = np.nan_to_num(found.values.astype(np.float32), posinf=1e9, neginf=-1e9)
        if found.use is None:
            return [float(c) for c in np.broadcast_to(values, (3,))]
        texels = np.ones((*values.shape[:2], 4), np.float32)
        texels[..., :3] = values
        return Painted(f"{self._name} {what}", texels), found.use

    def bumps(self, socket: Any, bump: Bump, length: Callable[[Any], tuple[float, float] | None]) -> tuple[Painted, Any] | None:
        """Returns the normal map for a socket that provides heights, and its mapping; None if the socket is no image or not
        supported.

        length: returns the surface's length across and up an image for its mapping, in the unit of the heights; None if unknown.
        """
        self._left = MOST_NODES
        try:
            found = self._number(socket)
        except _UnknownError:
            return None
        size = None if found.use is None else length(found.use)
        if size is None:
            return None
        texels = np.ones((*found.values.shape[:2], 4), np.float32)
        texels[..., :3] = 0.5 + 0.5 * _slopes(found.values[..., 0], size, bump)
        return Painted(f"{self._name} bumps", texels), found.use

    def _plane(self, socket: Any) -> _Plane:
        self._left -= 1
        if socket is None or self._left < 0:
            raise _UnknownError
        if isinstance(socket, Blend):
            return self._blend_planes(socket.share, socket.first, socket.second, "MIX")
        if isinstance(socket, Product):
            return self._combine_planes(lambda a, b: a * b, self._plane(socket.first), self._number(socket.second))
        if isinstance(socket, SquareRoot):
            return self._combine_planes(lambda c: np.sqrt(np.maximum(c, 0)), self._plane(socket.of))
        plain = constant_value(socket)
        if plain is not None:
            return _Plane(np.atleast_1d(np.array(plain, np.float32)))
        source, _ = source_of(socket)
        if source is None:
            raise _UnknownError
        return self._evaluate(source)

    def _evaluate(self, source: Source) -> _Plane:
        kind = source.node.type
        make = {
            "TEX_IMAGE": self._image,
            "TEX_ENVIRONMENT": self._image,
            "MIX": self._mix,
            "MIX_RGB": self._mix,
            "MATH": self._math,
            "VALTORGB": self._ramp,
            "CURVE_RGB": self._curves,
            "HUE_SAT": self._hue,
            "BRIGHTCONTRAST": self._contrast,
            "GAMMA": self._gamma,
            "INVERT": self._invert,
            "RGBTOBW": self._grey,
            "SEPARATE_COLOR": self._separate,
            "SEPRGB": self._separate,
            "COMBINE_COLOR": self._combine,
            "COMBRGB": self._combine,
            "MAP_RANGE": self._map_range,
            "CLAMP": self._clamp,
            "TEX_CHECKER": self._checker,
        }.get(kind)
        if make is None:
            raise _UnknownError
        return make(source)

    def _number(self, socket: SocketInGroups | None) -> _Plane:
        """Evaluates a socket as a number; a colour is converted to its luminance, as in Blender."""
        found = self._plane(socket)
        if found.values.shape[-1] == 3:
            found = _Plane(found.values @ LUMINANCE[:, None], found.use)
        return found

    def _combine_planes(self, make: Callable[..., Any], *planes: _Plane) -> _Plane:
        """Returns make(values of the planes), with each plane resampled to the largest size.

        Raises _UnknownError if their mappings differ.
        """
        uses = [plane.use for plane in planes if plane.use is not None]
        if any(use != uses[0] for use in uses):
            raise _UnknownError
        sizes = [plane.values.shape[:2] for plane in planes if plane.use is not None]
        if sizes:
            size = max(sizes)
            planes = tuple(plane if plane.use is None else _Plane(_scaled(plane.values, size), plane.use) for plane in planes)
        with np.errstate(all="ignore"):
            return _Plane(np.asarray(make(*(plane.values for plane in planes)), np.float32), uses[0] if uses else None)

    def _image(self, source: Source) -> _Plane:
        image = source.node.image
        use = None if image is None else self._use_of(source)
        found = None if use is None else images.pixels(image)
        if found is None:
            raise _UnknownError
        if source.output.name == "Alpha":
            return _Plane(found[..., 3:], use)
        linear = images.from_srgb(found[..., :3]) if images.encoding_of(image, False) == "from" else found[..., :3]
        return _Plane(linear.astype(np.float32), use)

    def _mix(self, source: Source) -> _Plane:
        node = source.node
        if node.type == "MIX_RGB":
            share, first, second = source.input_at(0), source.input_at(1), source.input_at(2)
        elif node.data_type == "RGBA":
            share, first, second = source.input_at(0), source.input_at(6), source.input_at(7)
        elif node.data_type == "FLOAT":
            return self._blend_planes(source.input_at(0), source.input_at(2), source.input_at(3), "MIX", bool(node.clamp_factor))
        else:
            raise _UnknownError
        found = self._blend_planes(share, first, second, node.blend_type, getattr(node, "clamp_factor", True))
        is_clamped = getattr(node, "clamp_result", False) or getattr(node, "use_clamp", False)
        return _Plane(np.clip(found.values, 0, 1), found.use) if is_clamped else found

    def _blend_planes(self, share: Any, first: Any, second: Any, blend_mode: str, clamped: bool = True) -> _Plane:
        if blend_mode not in BLENDS:
            raise _UnknownError
        blend = BLENDS[blend_mode]

        def mix(t: F32, a: F32, b: F32) -> F32:
            return blend(np.clip(t, 0, 1) if clamped else t, a, b)

        return self._combine_planes(mix, self._number(share), self._plane(first), self._plane(second))

    def _math(self, source: Source) -> _Plane:
        make = MATH.get(source.node.operation)
        if make is None:
            raise _UnknownError
        count = make.__code__.co_argcount
        found = self._combine_planes(make, *(self._number(source.input_at(i)) for i in range(count)))
        return _Plane(np.clip(found.values, 0, 1), found.use) if source.node.use_clamp else found

    def _ramp(self, source: Source) -> _Plane:
        ramp, channels = source.node.color_ramp, slice(3, 4) if source.output.name == "Alpha" else slice(0, 3)
        table = np.array([list(ramp.evaluate(i / (STEPS - 1))) for i in range(STEPS)], np.float32)[:, channels]
        return self._combine_planes(lambda x: table[_step(x[..., 0])], self._number(source.input_at(0)))

    def _curves(self, source: Source) -> _Plane:
        mapping = source.node.mapping
        mapping.initialize()
        if any(each.points[0].location[0] < 0 for each in mapping.curves):
            raise _UnknownError
        steps = [i / (STEPS - 1) for i in range(STEPS)]
        whole, *of_channels = ([mapping.evaluate(curve, x) for x in steps] for curve in (mapping.curves[3], *mapping.curves[:3]))
        first = np.array(whole, np.float32)
        tables = [np.array(each, np.float32) for each in of_channels]

        def apply_curves(t: F32, c: F32) -> F32:
            c = np.broadcast_to(c, (*c.shape[:-1], 3))
            curved = np.stack([table[_step(first[_step(c[..., k])])] for k, table in enumerate(tables)], axis=-1)
            return c + np.clip(t, 0, 1) * (curved - c)

        return self._combine_planes(apply_curves, self._number(source.input_at(0)), self._plane(source.input_at(1)))

    def _hue(self, source: Source) -> _Plane:
        def shift_hue(h: F32, s: F32, v: F32, t: F32, c: F32) -> F32:
            found = hsv(np.broadcast_to(c, (*c.shape[:-1], 3)))
            turned = (found[..., :1] + h + 0.5) % 1.0
            changed = rgb(np.concatenate([turned, np.clip(found[..., 1:2] * s, 0, 1), found[..., 2:] * v], axis=-1))
            return c + t * (np.maximum(changed, 0) - c)

        names = ("Hue", "Saturation", "Value")
        numbers = [self._number(source.input(name)) for name in names]
        return self._combine_planes(
            shift_hue, *numbers, self._number(source.input("Fac", "Factor")), self._plane(source.input("Color"))
        )

    def _contrast(self, source: Source) -> _Plane:
        def adjust_contrast(c: F32, bright: F32, contrast: F32) -> F32:
            return np.maximum((1 + contrast) * c + (bright - 0.5 * contrast), 0)

        bright = self._number(source.input("Bright", "Brightness"))
        return self._combine_planes(
            adjust_contrast, self._plane(source.input("Color")), bright, self._number(source.input("Contrast"))
        )

    def _gamma(self, source: Source) -> _Plane:
        def apply_gamma(c: F32, gamma: F32) -> F32:
            return np.where(c > 0, np.power(np.maximum(c, 1e-12), gamma), c)

        return self._combine_planes(apply_gamma, self._plane(source.input("Color")), self._number(source.input("Gamma")))

    def _invert(self, source: Source) -> _Plane:
        share, color = self._number(source.input("Fac", "Factor")), self._plane(source.input("Color"))
        return self._combine_planes(lambda t, c: c + t * (1 - 2 * c), share, color)

    def _grey(self, source: Source) -> _Plane:
        return self._number(source.input_at(0))

    def _separate(self, source: Source) -> _Plane:
        mode = getattr(source.node, "mode", "RGB")
        names = {"Red": 0, "Green": 1, "Blue": 2, "R": 0, "G": 1, "B": 2}
        channel = names.get(source.output.name)
        if channel is None or mode not in ("RGB", "HSV"):
            raise _UnknownError

        def select_channel(c: F32) -> F32:
            c = np.broadcast_to(c, (*c.shape[:-1], 3))
            return (hsv(c) if mode == "HSV" else c)[..., channel : channel + 1]

        return self._combine_planes(select_channel, self._plane(source.input_at(0)))

    def _combine(self, source: Source) -> _Plane:
        mode = getattr(source.node, "mode", "RGB")
        if mode not in ("RGB", "HSV"):
            raise _UnknownError

        def join_channels(*channels: F32) -> F32:
            whole = np.concatenate(np.broadcast_arrays(*channels), axis=-1)
            return rgb(whole) if mode == "HSV" else whole

        return self._combine_planes(join_channels, *(self._number(source.input_at(i)) for i in range(3)))

    def _map_range(self, source: Source) -> _Plane:
        node = source.node
        if getattr(node, "data_type", "FLOAT") != "FLOAT" or node.interpolation_type not in ("LINEAR", "SMOOTHSTEP"):
            raise _UnknownError
        is_smooth, is_clamped = node.interpolation_type == "SMOOTHSTEP", node.clamp

        def map_range(x: F32, a: F32, b: F32, low: F32, high: F32) -> F32:
            t = np.where(b != a, (x - a) / np.where(b != a, b - a, 1), 0)
            t = np.clip(t, 0, 1) if is_clamped or is_smooth else t
            return low + (t * t * (3 - 2 * t) if is_smooth else t) * (high - low)

        return self._combine_planes(map_range, *(self._number(source.input_at(i)) for i in range(5)))

    def _clamp(self, source: Source) -> _Plane:
        is_range = getattr(source.node, "clamp_type", "MINMAX") == "RANGE"

        def clamp(x: F32, low: F32, high: F32) -> F32:
            least, most = (np.minimum(low, high), np.maximum(low, high)) if is_range else (low, high)
            return np.minimum(np.maximum(x, least), most)

        return self._combine_planes(clamp, *(self._number(source.input_at(i)) for i in range(3)))

    def _checker(self, source: Source) -> _Plane:
        """Evaluates a Checker Texture in the UV plane (z = 0): an image of 2 x 2 squares, repeated according to the scale."""
        use = self._use_of(source)
        scale = constant_value(source.input("Scale"))
        if use is None or not scale or isinstance(scale, list) or (use.offset, use.rotation, use.scale) != PLAIN:
            raise _UnknownError
        # A texture of 2 x 2 squares is repeated scale / 2 times; v points downwards in glTF.
        lies = TextureUse("", use.uv_set, ("repeat", "repeat"), True, (0.0, -0.5 * scale % 1.0), 0.0, (scale / 2, scale / 2))
        first, second = self._plane(source.input("Color1")), self._plane(source.input("Color2"))
        if first.use is not None or second.use is not None:
            raise _UnknownError
        is_first = np.array([[True, False], [False, True]])[..., None]  # rows from the top: the lower left square is the second
        colors = [np.broadcast_to(each.values, (3,)) for each in (first, second)]
        if source.output.name != "Color":
            return _Plane(is_first.astype(np.float32), lies)
        return _Plane(np.where(is_first, *colors).astype(np.float32), lies)


def _slopes(height: F32, size: tuple[float, float], bump: Bump) -> F32:
    """Returns the unit normals (h, w, 3) of a height map in tangent space, whose second axis points up the image.

    size: length of the surface across and up the image.
    """
    rows, columns = height.shape
    across = (np.roll(height, -1, 1) - np.roll(height, 1, 1)) / 2 * (columns / size[0])
    up = (np.roll(height, 1, 0) - np.roll(height, -1, 0)) / 2 * (rows / size[1])
    flat = np.array([0.0, 0.0, 1.0], np.float32)
    turned = np.stack([-bump.distance * across, -bump.distance * up, np.ones_like(height)], axis=-1)
    turned /= np.linalg.norm(turned, axis=-1, keepdims=True)
    mixed = flat + bump.strength * (turned - flat)
    return mixed / np.maximum(np.linalg.norm(mixed, axis=-1, keepdims=True), 1e-6)


def _step(x: F32) -> npt.NDArray[np.int64]:
    return np.clip(np.nan_to_num(x) * (STEPS - 1) + 0.5, 0, STEPS - 1).astype(np.int64)


def _scaled(values: F32, size: tuple[int, int]) -> F32:
    """Returns the values resampled to another size by nearest neighbours."""
    if values.shape[:2] == size:
        return values
    rows, columns = (np.arange(n) * values.shape[i] // n for i, n in enumerate(size))
    return values[rows][:, columns]
