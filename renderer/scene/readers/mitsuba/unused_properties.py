"""Notes the properties of plugins, and the child objects, that were never read."""

from __future__ import annotations

from collections.abc import Iterator

from renderer.scene.readers.mitsuba.document import Element
from renderer.sentences import Sentence

__all__ = ["unused_notes"]

# Properties without effect on the image, or with their own note, by kind of object.
_IGNORED_PROPERTIES: dict[str, set[str]] = {
    "integrator": {"rr_depth", "samples_per_pass", "block_size", "timeout", "strict_normals", "max_depth", "hide_emitters"}
    | {"emitter_samples", "bsdf_samples", "shading_samples", "luminaire_samples", "aovs"},
    "scene": set(),
    "sensor": {"far_clip", "near_clip", "focus_distance", "fov", "fov_axis", "focal_length", "shutter_open", "shutter_close"},
    "film": {"component_format", "file_format", "sample_border", "compensate", "banner", "high_quality_edges", "attach_log"},
    "sampler": {"seed", "jitter", "scramble", "dimension"},  # choice of samples only
    "rfilter": set(),
    "bsdf": {"sample_visible", "main_specular_sampling_rate", "clearcoat_sampling_rate"}
    | {"diffuse_reflectance_sampling_rate", "diff_refl_sampling_rate", "spec_refl_sampling_rate", "spec_trans_sampling_rate"},
    "emitter": {"sampling_weight", "to_world"},
    "shape": {"silhouette_sampling_weight", "to_world", "flip_tex_coords", "face_normals"},
    "texture": {"accel", "format"},
    "medium": {"sample_emitters", "has_spectral_extinction", "method", "strategy"}
    | {"scale", "sigma_a", "sigma_s", "sigma_t", "albedo"},  # any two determine the others
    "phase": set(),
}
_UNREAD = {  # codes of objects that are left out as a whole
    *("light-type-unsupported", "shape-type-unsupported", "mitsuba-sensor-type-unsupported"),
    *("mitsuba-medium-type-unsupported", "mitsuba-phase-type-unsupported"),
}
_RENDERED_TAGS = ("shape", "emitter", "sensor", "integrator")  # rendered children of a scene; others only if referenced


def unused_notes(scene: Element, sentences: list[str]) -> Iterator[str]:
    """Yields a sentence for each property or object of the scene that was never read.

    sentences: warnings issued before; objects that one of them is about are skipped.
    """
    noted = [each for each in sentences if isinstance(each, Sentence) and "what" in each.params]
    said = {str(each.params["what"]) for each in noted if each.startswith(str(each.params["what"]))}
    unread = {str(each.params["what"]) for each in noted if each.code in _UNREAD}
    seen: set[int] = set()
    stack = [scene]
    while stack:
        element = stack.pop()
        if id(element) in seen:
            continue
        seen.add(id(element))
        if element.description in unread:
            stack += [child for child in element.children if child.tag not in ("texture", "emitter")]
            continue
        for name in element.values:
            if name not in element.used and name and _affects_image(element, name):
                yield (
                    Sentence(
                        "mitsuba-property-of-type-ignored",
                        "The property {name} of <{tag} type={type}> is ignored",
                        name=name,
                        tag=element.tag,
                        type=repr(element.type),
                    )
                    if element.type
                    else Sentence(
                        "mitsuba-property-ignored", "The property {name} of <{tag}> is ignored", name=name, tag=element.tag
                    )
                )
        for child in element.children:
            if child.tag == "volume":
                continue  # reported by its medium
            is_named = element.tag == "scene" and (child.type == "shapegroup" or (child.id and child.tag not in _RENDERED_TAGS))
            if child.used or child.description in said:
                stack.append(child)
            elif not is_named:
                owner = f"{element.tag} type={element.type!r}" if element.type else element.tag
                yield Sentence(
                    "mitsuba-object-ignored",
                    "<{tag} type={type}> in <{owner}> is ignored",
                    tag=child.tag,
                    type=repr(child.type),
                    owner=owner,
                )


def _affects_image(element: Element, name: str) -> bool:
    """Returns True if a property can affect the image."""
    return element.tag in _IGNORED_PROPERTIES and name not in _IGNORED_PROPERTIES[element.tag]
