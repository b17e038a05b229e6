"""FBX animation stacks as clips, and the elements that each of them animates."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from renderer.scene.animation import Clip, Moment
from renderer.scene.animation.moment import ALL_CLIPS
from renderer.scene.readers.fbx import layout
from renderer.scene.readers.fbx.library import FbxScene, each, is_set, is_visible, pointed, struct_at, text, value_at
from renderer.scene.readers.name_lookup import number_of

__all__ = ["Stacks"]

_ROUNDING = 1e-9  # relative range of a curve's values that rounding can cause


class Stacks:
    """The animation stacks of an FBX scene, offered as clips that can be selected."""

    def __init__(self, opened: FbxScene, name: str) -> None:
        self._opened, self._file = opened, name
        scene = opened.scene
        # Stacks that animate nothing come last: files of Mixamo and 3ds Max begin with one; Blender skips it too.
        stacks = pointed(scene.stacks, layout.AnimStack)
        self._stacks = (
            sorted(stacks, key=lambda stack: next(_animated_element_ids(int(stack.anim)), None) is None)
            if len(stacks) > 1
            else stacks
        )
        self.clips = [Clip(text(s.name) or f"animation {i}", s.begin, s.end) for i, s in enumerate(self._stacks)]

    def selected_animation(self, moment: Moment) -> int | None:
        """Returns the address, in ufbx's memory, of the animation to evaluate for a moment; None for a file without animations.

        Raises SceneError if the moment's clip does not exist.
        """
        names = [clip.name for clip in self.clips]
        if moment.clip == ALL_CLIPS and ALL_CLIPS not in names and len(names) > 1:
            return self._combine_layers(self._stacks)
        chosen = self._stacks[:1]
        if moment.clip is not None and (moment.clip != ALL_CLIPS or ALL_CLIPS in names):
            chosen = [self._stacks[number_of("clip", names, moment.clip, self._file)]]
        if self._opened.nodes_with_ignored_rotation or any(len(_active_layers(stack)) < stack.layers.count for stack in chosen):
            return self._combine_layers(chosen)
        return int(chosen[0].anim) if chosen else None

    def _combine_layers(self, stacks: list[Any]) -> int:
        layers = [layer for stack in stacks for layer in _active_layers(stack)]
        return self._opened.combined_animation([int(layer.typed_id) for layer in layers], self._file)

    def animated_visibility(self, anim: int, evaluated: FbxScene, seconds: float) -> dict[int, bool]:
        """Returns the visibility, by node id, of those nodes whose visibility an animation layer sets.

        The topmost layer that has a weight above 0 and a curve for the node determines the value. Maya too evaluates booleans in
        override mode whatever the layer's mode (Autodesk, "Animation layer modes"), while ufbx adds and mixes the layers' values.
        """
        layers = pointed(layout.Anim.from_address(anim).layers, layout.AnimLayer)
        weights = {layer.element_id: layer.weight for layer in pointed(evaluated.scene.layers, layout.AnimLayer)}
        still = {node.element_id: is_visible(node) for node in pointed(self._opened.scene.nodes, layout.Node)}
        found: dict[int, bool] = {}
        for layer in layers:
            for each_property in each(layer.properties, layout.AnimProp):
                if text(each_property.name) != "Visibility":
                    continue
                value = struct_at(layout.AnimValue, each_property.value)
                element = struct_at(layout.Element, each_property.element)
                if value is None or element is None or element.element_id not in still:
                    continue
                found.setdefault(element.element_id, still[element.element_id])
                curve = value.curves[0]
                if curve and weights.get(layer.element_id, layer.weight) > 0:
                    found[element.element_id] = int(value_at(curve, seconds)) != 0
        return found

    def animated_elements(self, anim: int | None) -> set[int]:
        """Returns the ids of the elements with a property that changes over time."""
        return set(_animated_element_ids(anim))


def _active_layers(stack: Any) -> list[Any]:
    """Returns the layers of a stack that are evaluated: those set to solo or, if there are none, all that are not muted."""
    layers = pointed(stack.layers, layout.AnimLayer)
    return [layer for layer in layers if is_set(layer, b"Solo")] or [layer for layer in layers if not is_set(layer, b"Mute")]


def _animated_element_ids(anim: int | None) -> Iterator[int]:
    played = struct_at(layout.Anim, anim)
    for layer in pointed(played.layers, layout.AnimLayer) if played else []:
        for each_property in each(layer.properties, layout.AnimProp):
            value = struct_at(layout.AnimValue, each_property.value)
            element = struct_at(layout.Element, each_property.element)
            if value is not None and element is not None and _is_animated(value):
                yield element.element_id


def _is_animated(value: Any) -> bool:
    for address in value.curves:
        curve = struct_at(layout.AnimCurve, address)
        if curve is not None and curve.most - curve.least > _ROUNDING * max(1.0, abs(curve.most)):
            return True
    return False
