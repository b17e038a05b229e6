"""Arnold shaders in USD, as written by Maya, Houdini and 3ds Max under outputs:arnold:surface.

Arnold's standard_surface has the inputs of MaterialX's standard_surface; Arnold has its own texture nodes.
Source: Arnold's documentation of standard_surface, image, normal_map and uv_transform.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from renderer.scene.readers.usd.inputs import Follow, Input, NetworkContext
from renderer.scene.readers.usd.textures import TextureInput, composed_transform, transform_2d
from renderer.sentences import Sentence

__all__ = ["PREFIX", "STANDARD", "follow_arnold"]

PREFIX = "arnold:"
STANDARD = "arnold:standard_surface"
_WRAPS = {"periodic": "repeat", "black": "black", "clamp": "clamp", "mirror": "mirror"}


def follow_arnold(network: NetworkContext, shader: Any, kind: str, output: str, srgb: bool, depth: int, follow: Follow) -> Input:
    """Returns the output of an Arnold node other than a surface shader; an empty input, with a note, if the node is unknown."""
    node = kind.removeprefix(PREFIX)

    def constant_input(name: str, default: Any) -> Any:
        value = follow(shader.GetInput(name), False, depth + 1).value
        return default if value is None else value

    if node == "normal_map":
        return follow(shader.GetInput("input"), False, depth + 1)
    if node != "image":
        network.notes.add(Sentence("usd-arnold-nodes-unknown", "Unknown Arnold nodes are left out"), node)
        return Input()
    file = shader.GetInput("filename")
    found: list[Any] = file.GetValueProducingAttributes() if file else []
    if not found:
        return Input()
    space = str(constant_input("color_space", "auto"))
    user = Sentence("label-material", "Material {name}", name=network.user)
    image = network.images.find(found[0], user, srgb, network.time, space="" if space.lower() == "auto" else space)
    if image is None:
        return Input()
    uv_set = network.uv_set(str(constant_input("uvset", "")) or "st")
    scale, offset = (
        (float(constant_input(f"s{name}", d)), float(constant_input(f"t{name}", d)))
        for name, d in (("scale", 1.0), ("offset", 0.0))
    )
    transform = composed_transform(transform_2d(scale, 0.0, offset), image[1])
    wraps = [_WRAPS.get(str(constant_input(f"{axis}wrap", "periodic")), "repeat") for axis in "st"]
    texture = network.images.texture(image[0], (wraps[0], wraps[1]), uv_set, transform, network.user)
    if texture is None:
        return Input()
    tint = Input(constant_input("multiply", (1.0, 1.0, 1.0))).color((1.0, 1.0, 1.0))
    taken = TextureInput(texture, output if output in ("r", "g", "b", "a") else "rgb")
    return Input(None, replace(taken, scale=(*tint, 1.0)))
