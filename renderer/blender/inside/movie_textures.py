"""Replaces movies and image sequences, which the glTF exporter omits, by the image of the current frame."""

from __future__ import annotations

import contextlib
import re
from pathlib import Path
from typing import Any

from .sentences import Sentence

__all__ = ["replace_movies_by_stills"]

NUMBER = re.compile(r"(\d+)(?=\D*$)")


def replace_movies_by_stills(bpy: Any, materials: list[Any], notes: list[str]) -> None:
    """Replaces the image sequences in the materials' nodes by still images."""
    made: dict[Any, Any] = {}
    told = set()
    for node in [each for material in materials for each in _nodes(material.node_tree if material.use_nodes else None, set())]:
        image = node.image if node.type == "TEX_IMAGE" else None
        if image is None or image.source not in ("SEQUENCE", "MOVIE"):
            continue
        told.add(image.name)
        number = _image_number(bpy.context.scene, node.image_user)
        key = image.name, number
        if key not in made:
            made[key] = _image_of_number(bpy, image, number)
        if made[key] is not None:
            node.image = made[key]
    for name in sorted(told):
        lost = all(still is None for (owner, _), still in made.items() if owner == name)
        notes.append(
            Sentence("blend-movie-left-out", "Image {image}: this movie or sequence is left out; bake it to images", image=name)
            if lost
            else Sentence(
                "blend-movie-first-frame", "Image {image}: this movie or sequence is shown as at the first frame", image=name
            )
        )


def _nodes(tree: Any, visited: set[str]) -> list[Any]:
    if tree is None or tree.name in visited:
        return []
    visited.add(tree.name)
    below = [each for node in tree.nodes if node.type == "GROUP" for each in _nodes(node.node_tree, visited)]
    return [*tree.nodes, *below]


def _image_number(scene: Any, user: Any) -> int:
    """Returns the number of the image, in an image sequence, that is shown at the current frame."""
    last = max(user.frame_duration, 1)
    at = scene.frame_current - user.frame_start + 1
    at = (at - 1) % last + 1 if user.use_cyclic else min(max(at, 1), last)
    return int(at + user.frame_offset)


def _image_of_number(bpy: Any, image: Any, number: int) -> Any:
    """Returns the image with this number of a sequence; None if the image's file is missing, or if `image` is a movie."""
    if image.source == "MOVIE":
        return None
    path = Path(bpy.path.abspath(image.filepath))
    numbered = path.with_name(NUMBER.sub(lambda found: str(number).zfill(len(found[1])), path.name))
    for each in (numbered, path):
        if each.is_file():
            with contextlib.suppress(RuntimeError):
                found = bpy.data.images.load(str(each))
                found.colorspace_settings.name = image.colorspace_settings.name
                found.alpha_mode = image.alpha_mode
                return found
    return None
