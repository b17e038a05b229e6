"""MaterialX nodes between a surface and its textures."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from renderer.scene.description import UvTransform
from renderer.scene.readers.usd.inputs import Follow, Following, Input
from renderer.scene.readers.usd.textures import Taken, composed, transform_2d
from renderer.scene.textures import UNMOVED

__all__ = ["follow_coordinates", "follow_node"]


def follow_node(network: Following, shader: Any, kind: str, output: str, srgb: bool, depth: int, follow: Follow) -> Input:
    """What a node that is no surface gives."""
    node = kind[3:].split("_")[0]
    if node in ("image", "tiledimage", "UsdUVTexture"):
        return _image(network, shader, node, output, srgb, depth, follow)
    if node in ("normalmap", "convert", "dot"):
        name = "in1" if node == "dot" and not shader.GetInput("in") else "in"
        return follow(shader.GetInput(name), False if node == "normalmap" else srgb, depth + 1)
    if node == "constant":
        return follow(shader.GetInput("value"), srgb, depth + 1)
    if node in ("geompropvalue", "UsdPrimvarReader"):
        name = follow(shader.GetInput("geomprop" if node == "geompropvalue" else "varname"), False, depth + 1).value
        return Input(None, None, str(name) if name else None)
    if node == "geomcolor":
        return Input(None, None, "displayColor")
    if node == "multiply":
        one, other = (follow(shader.GetInput(name), srgb, depth + 1) for name in ("in1", "in2"))
        found = _multiplied(one, other)
        if found is not None:
            return found
    if node in ("extract", "separate2", "separate3", "separate4"):
        return _channel(follow(shader.GetInput("in"), srgb, depth + 1), shader, node, output, depth, follow)
    network.notes.add("Nodes of MaterialX of these kinds are not known here, and left out", kind)
    return Input()


def _image(network: Following, shader: Any, node: str, output: str, srgb: bool, depth: int, follow: Follow) -> Input:
    file = shader.GetInput("file")
    found = file.GetValueProducingAttributes() if file else []
    if not found:
        return follow(shader.GetInput("default"), srgb, depth + 1)
    space = found[0].GetColorSpace() if found[0].HasColorSpace() else ""
    encoded = ("srgb" in space.lower() and "lin" not in space.lower()) if space else srgb
    image = network.images.find(found[0], f"Material {network.user}", encoded, network.time)
    if image is None:
        return Input()
    uv_set, transform = network.coordinates(shader.GetInput("st" if node == "UsdUVTexture" else "texcoord"), depth + 1)
    if node == "tiledimage":
        tiling = follow(shader.GetInput("uvtiling"), False, depth + 1).value or (1.0, 1.0)
        transform = composed(transform, transform_2d((float(tiling[0]), float(tiling[1])), 0.0, (0.0, 0.0)))
    modes = [follow(shader.GetInput(name), False, depth + 1).value for name in ("uaddressmode", "vaddressmode")]
    wraps = (str(modes[0] or "periodic"), str(modes[1] or "periodic"))
    texture = network.images.texture(image[0], wraps, uv_set, composed(transform, image[1]), network.user)
    if texture is None:
        return Input()
    return Input(None, Taken(texture, output if output in ("r", "g", "b", "a") else "rgb"))


def _multiplied(one: Input, other: Input) -> Input | None:
    if one.taken is None and other.taken is not None:
        one, other = other, one
    if other.value is None:
        return None
    factor = other.color((1.0, 1.0, 1.0))
    if one.taken is not None:
        (r, g, b, a), (x, y, z) = one.taken.scale, factor
        return Input(None, replace(one.taken, scale=(r * x, g * y, b * z, a)))
    if one.value is None:
        return None
    if isinstance(one.value, float) and isinstance(other.value, float):
        return Input(one.value * other.value)
    return Input(tuple(p * q for p, q in zip(one.color((1.0, 1.0, 1.0)), factor, strict=True)))


def _channel(given: Input, shader: Any, node: str, output: str, depth: int, follow: Follow) -> Input:
    if node == "extract":
        index = int(follow(shader.GetInput("index"), False, depth + 1).number(0.0))
    else:
        index = {"outr": 0, "outg": 1, "outb": 2, "outa": 3, "outx": 0, "outy": 1, "outz": 2, "outw": 3}.get(output, 0)
    if given.taken is not None:
        return Input(None, replace(given.taken, channel="rgba"[min(max(index, 0), 3)]))
    return Input(given.color((0.0, 0.0, 0.0))[min(max(index, 0), 2)])


def follow_coordinates(shader: Any, kind: str, time: Any) -> tuple[str | None, UvTransform, Any]:
    """(the primvar that texture coordinates are, what they go through, the input that leads further)."""
    node = kind[3:].split("_")[0]

    def said(name: str, default: Any) -> Any:
        given = shader.GetInput(name)
        value = given.Get(time) if given else None
        return default if value is None else value

    if node == "texcoord":
        return "st", UNMOVED, None
    if node in ("geompropvalue", "UsdPrimvarReader"):
        return str(said("geomprop" if node == "geompropvalue" else "varname", "st")), UNMOVED, None
    if node == "place2d":
        pivot, scale, offset = (said(name, d) for name, d in (("pivot", (0, 0)), ("scale", (1, 1)), ("offset", (0, 0))))
        inverse = tuple(1 / float(s) if s else 1.0 for s in scale)
        degrees = -float(said("rotate", 0.0))
        # Moved by the pivot, scaled by the inverse, turned, moved back: MaterialX's order SRT.
        cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        x, y = -float(pivot[0]) * inverse[0], -float(pivot[1]) * inverse[1]
        moved = (
            cosine * x - sine * y - float(offset[0]) + float(pivot[0]),
            sine * x + cosine * y - float(offset[1]) + float(pivot[1]),
        )
        return None, transform_2d((inverse[0], inverse[1]), degrees, moved), shader.GetInput("texcoord")
    if node == "UsdTransform2d":
        scale, moved = said("scale", (1, 1)), said("translation", (0, 0))
        own = transform_2d((float(scale[0]), float(scale[1])), float(said("rotation", 0.0)), (float(moved[0]), float(moved[1])))
        return None, own, shader.GetInput("in")
    return "st", UNMOVED, None
