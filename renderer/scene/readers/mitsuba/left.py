"""What of a scene nobody asked for: properties of plugins that are read, and objects within them."""

from __future__ import annotations

from collections.abc import Iterator

from renderer.scene.readers.mitsuba.document import Element

__all__ = ["left_over"]

# Properties that change no picture here, or that a note of their own speaks of, by the kind of object.
_IDLE = {
    "integrator": {"rr_depth", "samples_per_pass", "block_size", "timeout", "strict_normals", "max_depth", "hide_emitters"}
    | {"emitter_samples", "bsdf_samples", "shading_samples", "luminaire_samples", "aovs"},
    "sensor": {"far_clip", "near_clip", "focus_distance", "aperture_radius", "fov", "fov_axis", "shutter_open", "shutter_close"},
    "bsdf": {"sample_visible", "eta", "k", "ext_eta", "distribution", "main_specular_sampling_rate", "clearcoat_sampling_rate"}
    | {"diffuse_reflectance_sampling_rate", "diff_refl_sampling_rate", "spec_refl_sampling_rate", "spec_trans_sampling_rate"},
    "emitter": {"sampling_weight", "to_world"},
    "shape": {"silhouette_sampling_weight", "to_world", "flip_tex_coords", "face_normals", "flip_normals"},
    "texture": {"accel", "format"},
    "medium": {"sample_emitters", "has_spectral_extinction", "method", "strategy"}
    | {"scale", "sigma_a", "sigma_s", "sigma_t", "albedo"},  # of which two say all
    "phase": set(),
}
_NOTED_WHOLE = {"sunsky", "sky", "sun", "timed_sunsky"}


def left_over(scene: Element, sentences: list[str]) -> Iterator[str]:
    """A sentence for each, again where there are more. sentences: what is said already."""
    said = tuple({sentence.partition(":")[0] for sentence in sentences})
    unread = tuple(each.partition(" is no")[0] for each in said if " is no" in each)
    seen: set[int] = set()
    stack = [scene]
    while stack:
        element = stack.pop()
        if id(element) in seen:
            continue
        seen.add(id(element))
        if element.what in unread:
            stack += [child for child in element.children if child.tag not in ("texture", "emitter")]
            continue
        for name in element.values:
            if name not in element.used and name and _counts(element, name):
                yield f"{name} of {element.tag}s of the type {element.type} is not taken over"
        for child in element.children:
            if child.tag == "volume":
                continue  # of a medium, which names it
            if child.tag in ("texture", "emitter") and not child.used and not any(each.startswith(child.what) for each in said):
                yield f"The {child.tag} ({child.type}) of a {element.tag} ({element.type}) is not taken over"
            else:
                stack.append(child)


def _counts(element: Element, name: str) -> bool:
    """Whether a picture may differ by it: of plugins of which nothing was asked, a note says that they are left out."""
    return bool(element.used) and element.type not in _NOTED_WHOLE and element.tag in _IDLE and name not in _IDLE[element.tag]
