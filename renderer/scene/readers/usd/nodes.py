"""Evaluates MaterialX nodes between a surface shader and its textures."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from renderer.scene.description import UvTransform
from renderer.scene.readers.usd.arithmetic import calculated, calculates, combined
from renderer.scene.readers.usd.inputs import Follow, Input, NetworkContext
from renderer.scene.readers.usd.textures import TextureInput, color_space, composed_transform, transform_2d
from renderer.scene.texture_colors import SRGB, common_space
from renderer.scene.textures import IDENTITY_UV_TRANSFORM
from renderer.sentences import Sentence

__all__ = ["follow_coordinates", "follow_node"]

_CHANNELS = {"r": 0, "g": 1, "b": 2, "a": 3, "x": 0, "y": 1, "z": 2, "w": 3}


def follow_node(network: NetworkContext, shader: Any, kind: str, output: str, srgb: bool, depth: int, follow: Follow) -> Input:
    """Evaluates a MaterialX node between the surface shader and its textures; returns the node's output.

    Unsupported nodes are skipped with a note.
    """
    node = kind[3:].split("_")[0]

    def read_input(name: str, encoded: bool = srgb) -> Input:
        return follow(shader.GetInput(name), encoded, depth + 1)

    if node in ("image", "tiledimage", "UsdUVTexture"):
        return _image(network, shader, kind, output, srgb, depth, follow)
    if node == "normalmap":
        return _scale_normal_map(read_input("in", False), read_input("scale", False))
    if node in ("convert", "dot"):
        return read_input("in1" if node == "dot" and not shader.GetInput("in") else "in")
    if node == "constant":
        return read_input("value")
    if node in ("geompropvalue", "UsdPrimvarReader", "geomcolor"):
        named, fallback = ("geomprop", "default") if node == "geompropvalue" else ("varname", "fallback")
        name = "displayColor" if node == "geomcolor" else read_input(named).value
        missing = read_input(fallback).value
        return network.primvar(str(name) if name else None, 0.0 if missing is None else missing)
    if node in ("extract", "separate2", "separate3", "separate4", "swizzle"):
        return _channel(read_input("in"), _selected_channels(node, output, read_input))
    if node in ("combine2", "combine3", "combine4"):
        return _combined(network, kind, [read_input(f"in{k + 1}") for k in range(int(node[-1]))])
    found = calculated(kind, network.images.shelf, read_input)
    if found is not None:
        return found
    first = next(
        (
            one
            for name in ("in", "bg", "in1", "fg", "in2")
            if (one := read_input(name)).taken is not None or one.value is not None
        ),
        Input(),
    )
    if first.taken is None:
        note = Sentence(
            "usd-materialx-nodes-left-out",
            "Unsupported MaterialX nodes on images are left out",
        )
    elif calculates(kind):
        note = Sentence(
            "usd-materialx-placements-merged",
            "MaterialX nodes that combine images with different placements are skipped: one image is shown unchanged",
        )
    else:
        note = Sentence(
            "usd-materialx-nodes-passed-over",
            "Unsupported MaterialX nodes are skipped: their input image is used unchanged",
        )
    network.notes.add(note, kind)
    return first if first.taken is not None else Input()


def _scale_normal_map(given: Input, scale: Input) -> Input:
    """Returns a normal map with its strength stored as scale and bias, as in UsdUVTexture."""
    if given.taken is None or scale.value is None:
        return given
    x, y, _ = (*scale.color((1.0, 1.0, 1.0))[:2], 1.0) if isinstance(scale.value, float) else (*tuple(scale.value)[:2], 1.0)
    if x == y == 1:
        return given
    return Input(None, replace(given.taken, scale=(2 * x, 2 * y, 2.0, 1.0), bias=(-x, -y, -1.0, 0.0)))


def _image(network: NetworkContext, shader: Any, kind: str, output: str, srgb: bool, depth: int, follow: Follow) -> Input:
    node = kind[3:].split("_")[0]
    file = shader.GetInput("file")
    found: list[Any] = file.GetValueProducingAttributes() if file else []
    missing = follow(shader.GetInput("fallback" if node == "UsdUVTexture" else "default"), srgb, depth + 1)
    if not found:
        return missing
    space = color_space(found[0])
    if node == "UsdUVTexture" and not space:
        space = str(follow(shader.GetInput("sourceColorSpace"), False, depth + 1).value or "").replace("auto", "")
    is_color = node == "UsdUVTexture" or "color" in kind  # scalars and vectors are linear
    user = Sentence("label-material", "Material {name}", name=network.user)
    if not is_color:
        srgb, space = common_space(space) == SRGB, ""
    image = network.images.find(found[0], user, srgb, network.time, space=space)
    if image is None:
        return missing
    is_preview = node == "UsdUVTexture"
    uv_set, transform = network.coordinates(shader.GetInput("st" if is_preview else "texcoord"), depth + 1)
    if node == "tiledimage":
        (u, v), (x, y) = (
            _number_pair(follow(shader.GetInput(name), False, depth + 1), d) for name, d in (("uvtiling", 1.0), ("uvoffset", 0.0))
        )
        transform = composed_transform(transform, transform_2d((u, v), 0.0, (-x, -y)))
    names = ("wrapS", "wrapT") if is_preview else ("uaddressmode", "vaddressmode")
    modes = [follow(shader.GetInput(name), False, depth + 1).value for name in names]
    wraps = (str(modes[0] or "periodic"), str(modes[1] or "periodic"))
    if "constant" in wraps:
        network.notes.add(
            Sentence("usd-texture-wrap-clamped", "Textures that end at their image's edge go on there as at that edge"),
            network.user,
        )
        wraps = (wraps[0].replace("constant", "clamp"), wraps[1].replace("constant", "clamp"))
    texture = network.images.texture(image[0], wraps, uv_set, composed_transform(transform, image[1]), network.user)
    if texture is None:
        return Input()
    taken = TextureInput(texture, output if output in ("r", "g", "b", "a") else "r" if kind.endswith("_float") else "rgb")
    if is_preview:
        scale, bias = (follow(shader.GetInput(name), False, depth + 1).value for name in ("scale", "bias"))
        taken = replace(taken, scale=_four(scale, taken.scale), bias=_four(bias, taken.bias))
    return Input(None, taken)


def _number_pair(given: Input, default: float) -> tuple[float, float]:
    value = given.value
    if value is None:
        return default, default
    return (float(value), float(value)) if isinstance(value, (int, float)) else (float(value[0]), float(value[1]))


def _four(value: Any, default: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    found = () if value is None else tuple(float(v) for v in value)
    return (found[0], found[1], found[2], found[3]) if len(found) == 4 else default


def _selected_channels(node: str, output: str, channels: Any) -> str:
    """Returns the letters of the channels that an extract, separate or swizzle node selects."""
    if node == "swizzle":
        return str(channels("channels").value or "r")
    if node == "extract":
        return "rgba"[min(max(int(channels("index").number(0.0)), 0), 3)]
    return output[-1] if output[-1:] in _CHANNELS else "r"


def _channel(given: Input, letters: str) -> Input:
    which = [_CHANNELS.get(letter, 0) for letter in letters] or [0]
    if which[:3] == [0, 1, 2]:
        return given
    if given.taken is not None:
        own = given.taken.channel
        return given if own != "rgb" else Input(None, replace(given.taken, channel="rgba"[which[0]]))
    values = given.color((0.0, 0.0, 0.0))
    found = tuple(values[min(k, 2)] for k in which)
    return Input(found[0] if len(found) == 1 else found)


def _combined(network: NetworkContext, kind: str, found: list[Input]) -> Input:
    result = combined(kind, network.images.shelf, found)
    if result is None:
        network.notes.add(
            Sentence(
                "usd-materialx-placements-unmixable",
                "MaterialX nodes that combine images with different placements are left out",
            ),
            kind,
        )
        return Input()
    return result


def follow_coordinates(
    network: NetworkContext, shader: Any, kind: str, depth: int, follow: Follow
) -> tuple[str | None, UvTransform, Any]:
    """Evaluates a node of texture coordinates.

    Returns (UV primvar, UV transform, input to follow next); the first and last may be None.
    """
    node = kind[3:].split("_")[0]

    def value(name: str) -> Any:
        return follow(shader.GetInput(name), False, depth + 1).value

    def pair_input(name: str, default: float) -> tuple[float, float]:
        return _number_pair(follow(shader.GetInput(name), False, depth + 1), default)

    if node == "texcoord":
        index = int(value("index") or 0)
        return f"st{index}" if index else "st", IDENTITY_UV_TRANSFORM, None
    if node in ("geompropvalue", "UsdPrimvarReader"):
        return str(value("geomprop" if node == "geompropvalue" else "varname") or "st"), IDENTITY_UV_TRANSFORM, None
    if node == "place2d":
        pivot, scale, offset = (pair_input(name, d) for name, d in (("pivot", 0.0), ("scale", 1.0), ("offset", 0.0)))
        # Subtract the pivot; inverse scale, clockwise rotation, translation (SRT) or the reverse order; add the pivot.
        scaled = transform_2d((1 / (scale[0] or 1.0), 1 / (scale[1] or 1.0)), 0.0, (0.0, 0.0))
        turned = transform_2d((1.0, 1.0), -float(value("rotate") or 0.0), (0.0, 0.0))
        moved = transform_2d((1.0, 1.0), 0.0, (-offset[0], -offset[1]))
        whole = transform_2d((1.0, 1.0), 0.0, (-pivot[0], -pivot[1]))
        for step in (moved, turned, scaled) if int(value("operationorder") or 0) == 1 else (scaled, turned, moved):
            whole = composed_transform(whole, step)
        return None, composed_transform(whole, transform_2d((1.0, 1.0), 0.0, pivot)), shader.GetInput("texcoord")
    if node == "UsdTransform2d":
        own = transform_2d(pair_input("scale", 1.0), float(value("rotation") or 0.0), pair_input("translation", 0.0))
        return None, own, shader.GetInput("in")
    if node == "rotate2d":
        return None, transform_2d((1.0, 1.0), -float(value("amount") or 0.0), (0.0, 0.0)), shader.GetInput("in")
    if node in ("multiply", "divide", "add", "subtract"):
        x, y = pair_input("in2", 1.0 if node in ("multiply", "divide") else 0.0)
        own = {
            "multiply": lambda: transform_2d((x, y), 0.0, (0.0, 0.0)),
            "divide": lambda: transform_2d((1 / (x or 1.0), 1 / (y or 1.0)), 0.0, (0.0, 0.0)),
            "add": lambda: transform_2d((1.0, 1.0), 0.0, (x, y)),
            "subtract": lambda: transform_2d((1.0, 1.0), 0.0, (-x, -y)),
        }[node]()
        return None, own, shader.GetInput("in1")
    network.notes.add(Sentence("usd-materialx-placement-nodes-ignored", "Unsupported MaterialX nodes do not move textures"), kind)
    further = shader.GetInput("in")
    return (None, IDENTITY_UV_TRANSFORM, further) if further else ("st", IDENTITY_UV_TRANSFORM, None)
