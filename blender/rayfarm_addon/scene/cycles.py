"""Warns about Cycles settings that Rayfarm does not support, for the add-on and for .blend files.

The tables follow Blender's panels. They contain neither settings without effect on the picture (devices, threads, BVH, path
guiding, sample distribution) nor supported ones (size, border, frame rate, shutter and its position, rolling shutter, bounces of
each kind, subdivision, overrides, indirect-only objects).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from ..farm.protocol.sentences import Sentence, first_items

__all__ = [
    "Flags",
    "depths_of",
    "rolling_shutter_of",
    "takes_time",
    "warn_of_material",
    "warn_of_passes",
    "warn_of_region",
    "warn_of_settings",
    "warn_of_volumes",
]

Warn = Callable[[str], None]
ENGINES = ("CYCLES", "RAYFARM")  # other engines ignore Cycles' settings
MIN_RELEVANT_BOUNCES = 4  # Cycles' default number of bounces: further ones add little light
MOST_DEPTH = 1024
LEAST_READOUT = 0.001  # of the farm's rolling_shutter
USUAL_CLAMP = 10.0
USUAL_WIDTH = 1.5
TOLERANCE = 1e-3
MOST_NAMES = 5


class _CheckedSetting(NamedTuple):
    """A Cycles setting, and the condition on its value for a warning to the user.

    differs: returns True if the value needs a warning. sentence: returns the warning for a value.
    """

    owner: str
    name: str
    differs: Callable[[Any], bool]
    sentence: Callable[[Any], str]


def _greater_than(limit: float) -> Callable[[Any], bool]:
    return lambda value: value > limit + TOLERANCE


def _less_than(limit: float) -> Callable[[Any], bool]:
    return lambda value: value < limit


def _is_off(value: Any) -> bool:
    return not value


def _other_than(*usual: Any) -> Callable[[Any], bool]:
    return lambda value: value not in usual


ROWS = (
    # Light Paths
    _CheckedSetting(
        "cycles",
        "transparent_max_bounces",
        _less_than(1),
        lambda value: Sentence(
            "cycles-transparent-bounces", "Light passes one transparent surface, {value} in Blender", value=value
        ),
    ),
    _CheckedSetting(
        "cycles",
        "sample_clamp_direct",
        _greater_than(0.0),
        lambda value: Sentence("cycles-clamp-direct", "Direct light is not clamped at {value}", value=f"{value:g}"),
    ),
    _CheckedSetting(
        "cycles",
        "blur_glossy",
        _greater_than(1.0),
        lambda value: Sentence(
            "cycles-filter-glossy", "Caustics are sharp, not blurred (Filter Glossy is {value} in Blender)", value=f"{value:g}"
        ),
    ),
    _CheckedSetting(
        "cycles",
        "caustics_reflective",
        _is_off,
        lambda _: Sentence(
            "cycles-reflective-caustics", "Mirrors cast light on their surroundings (reflective caustics are off in Blender)"
        ),
    ),
    _CheckedSetting(
        "cycles",
        "caustics_refractive",
        _is_off,
        lambda _: Sentence("cycles-refractive-caustics", "Light passes through glass (refractive caustics are off in Blender)"),
    ),
    _CheckedSetting(
        "cycles",
        "use_fast_gi",
        bool,
        lambda _: Sentence("cycles-fast-gi", "Indirect light is traced, not approximated (Fast GI)"),
    ),
    # Film
    _CheckedSetting(
        "cycles",
        "film_exposure",
        lambda value: abs(value - 1) > TOLERANCE,
        lambda value: Sentence(
            "cycles-film-exposure",
            "The film's exposure of {value} is ignored; set the exposure in the viewer (Color Management)",
            value=f"{value:g}",
        ),
    ),
    # Output
    _CheckedSetting(
        "render",
        "use_multiview",
        bool,
        lambda _: Sentence("cycles-stereoscopy", "Stereoscopy: one picture is rendered, for one eye"),
    ),
    # View Layer
    _CheckedSetting(
        "layer",
        "use_sky",
        _is_off,
        lambda _: Sentence("cycles-layer-world", "The world is visible, though the view layer excludes it (Environment)"),
    ),
    _CheckedSetting(
        "layer",
        "use_solid",
        _is_off,
        lambda _: Sentence("cycles-layer-surfaces", "Surfaces are visible, though the view layer excludes them"),
    ),
    _CheckedSetting(
        "layer",
        "use_strand",
        _is_off,
        lambda _: Sentence("cycles-layer-hair", "Hair is visible, though the view layer excludes it"),
    ),
)
TRANSPARENT = (
    _CheckedSetting(
        "cycles",
        "film_transparent_glass",
        bool,
        lambda _: Sentence("cycles-transparent-glass", "Glass covers the transparent background (Transparent Glass)"),
    ),
)
SIMPLIFIED = (
    _CheckedSetting(
        "cycles",
        "texture_limit_render",
        _other_than("OFF"),
        lambda value: Sentence(
            "cycles-texture-limit", "Images keep their size, without the limit of {value} texels", value=value
        ),
    ),
    _CheckedSetting(
        "cycles",
        "use_camera_cull",
        bool,
        lambda _: Sentence("cycles-camera-culling", "Objects outside the camera's view are not left out (Camera Culling)"),
    ),
    _CheckedSetting(
        "cycles",
        "use_distance_cull",
        bool,
        lambda _: Sentence("cycles-distance-culling", "Distant objects are not left out (Distance Culling)"),
    ),
)

# Flags of objects: name, the unsupported value, and the end of the warning.
OF_MOVING = (
    ("use_motion_blur", False, Sentence("cycles-motion-blur-on", "blurred as it moves, unlike in Blender")),
    ("use_deform_motion", False, Sentence("cycles-deform-blur-on", "blurred as it deforms, unlike in Blender")),
)
DICED = (
    "use_adaptive_subdivision",
    True,
    Sentence("cycles-adaptive-subdivision", "subdivided by its modifier's levels, not adaptively"),
)

# Supported passes; Combined is the picture.
PASSES = ("combined", "z", "position", "normal", "object_index", "material_index", "grease_pencil")


def takes_time(scene: Any, layer: Any) -> bool:
    """Returns True if the shutter is open for longer than an instant, so that the image has motion blur."""
    return bool(scene.render.use_motion_blur and getattr(layer, "use_motion_blur", True))


def rolling_shutter_of(scene: Any) -> float:
    """Returns the part of the shutter's time in which rows are read out, from the top; 0 without a rolling shutter."""
    cycles = getattr(scene, "cycles", None) if scene.render.engine in ENGINES else None
    if cycles is None or getattr(cycles, "rolling_shutter_type", "NONE") == "NONE":
        return 0.0
    share = round(1.0 - float(cycles.rolling_shutter_duration), 6)
    return share if share >= LEAST_READOUT else 0.0


def warn_of_region(warn: Warn) -> None:
    """Warns that a rolling shutter takes the render region for the whole picture."""
    warn(
        Sentence(
            "cycles-rolling-shutter",
            "The rolling shutter reads out the render region in the whole time, not as a part of the picture",
        )
    )


def _is_curved(shutter: Any) -> bool:
    """Returns True if a shutter curve transmits less light while the shutter opens or closes."""
    return any(point.location[1] < 1 - TOLERANCE for curve in shutter.curves[:1] for point in curve.points)


def depths_of(scene: Any) -> dict[str, int]:
    """Returns the request's settings that limit bounces by kind, and transparent surfaces, as Cycles does.

    After n bounces Cycles still computes the direct light at the next surface, so a limit of n bounces is a depth of n + 1.
    Limits that are not below the limit of all bounces are omitted, except for transmissions, since smooth ones are not part of
    the total.
    """
    cycles = getattr(scene, "cycles", None) if scene.render.engine in ENGINES else None
    if cycles is None:
        return {}
    found = {"transmission_depth": min(cycles.transmission_bounces, cycles.max_bounces) + 1}
    for kind in ("diffuse", "glossy"):
        if (most := getattr(cycles, f"{kind}_bounces")) < cycles.max_bounces:
            found[f"{kind}_depth"] = most + 1
    found["transparency_depth"] = max(cycles.transparent_max_bounces, 1)
    return {name: min(int(depth), MOST_DEPTH) for name, depth in found.items()}


def warn_of_settings(scene: Any, layer: Any, warn: Warn, is_clamped: bool, has_filter: bool) -> None:
    """Warns about a scene's Cycles settings that Rayfarm does not support.

    is_clamped, has_filter: whether the user has set Rayfarm's own clamping of indirect light and pixel filter.
    """
    render = scene.render
    cycles = getattr(scene, "cycles", None) if render.engine in ENGINES else None
    owners = {"render": render, "cycles": cycles, "layer": layer}
    moves = takes_time(scene, layer)
    for row in (*ROWS, *(TRANSPARENT if render.film_transparent else ()), *(SIMPLIFIED if render.use_simplify else ())):
        value = getattr(owners[row.owner], row.name, None)
        if value is not None and row.differs(value):
            warn(row.sentence(value))
    if moves and _is_curved(render.motion_blur_shutter_curve):
        warn(Sentence("cycles-shutter-curve", "The shutter opens and closes at once; its curve is ignored"))
    if abs(render.pixel_aspect_x - render.pixel_aspect_y) > TOLERANCE:
        warn(Sentence("cycles-pixel-aspect", "Pixels are square; the pixel aspect is ignored"))
    if cycles is None:
        return
    if not is_clamped and cycles.sample_clamp_indirect not in (0.0, USUAL_CLAMP):
        warn(
            Sentence(
                "cycles-clamp-indirect", "Indirect light is not clamped at {value}", value=f"{cycles.sample_clamp_indirect:g}"
            )
        )
    if not has_filter:
        told = cycles.pixel_filter_type.replace("_", "-").title()
        if told == "Gaussian" or (told == "Blackman-Harris" and abs(cycles.filter_width - USUAL_WIDTH) > TOLERANCE):
            warn(
                Sentence(
                    "cycles-pixel-filter",
                    "The pixel filter is Blackman-Harris, {own_width} pixels wide, not {filter}, {width} wide",
                    own_width=f"{USUAL_WIDTH:g}",
                    filter=told,
                    width=f"{cycles.filter_width:g}",
                )
            )


def warn_of_volumes(scene: Any, warn: Warn) -> None:
    """Warns about the unsupported volume settings of a scene with scattering volumes."""
    most = getattr(getattr(scene, "cycles", None), "volume_bounces", MIN_RELEVANT_BOUNCES)
    if scene.render.engine in ENGINES and most < MIN_RELEVANT_BOUNCES:
        warn(
            Sentence(
                "cycles-volume-bounces",
                "Light scatters in volumes up to the limit of all bounces (Volume is {limit} in Blender)",
                limit=most,
            )
        )


class Flags:
    """Records which objects have Cycles flags that Rayfarm does not support.

    They are recorded during the export, since the objects may no longer exist when it ends.
    """

    def __init__(self, scene: Any, layer: Any) -> None:
        self._asked = OF_MOVING if takes_time(scene, layer) else ()
        if getattr(getattr(scene, "cycles", None), "feature_set", "") == "EXPERIMENTAL":
            self._asked = (*self._asked, DICED)
        self._names: dict[str, dict[str, None]] = {}

    def inspect(self, thing: Any) -> None:
        """Records the unsupported flags of an object.

        Objects may be passed repeatedly, and need not be from the dependency graph.
        """
        own = getattr(thing, "cycles", None) if self._asked else None
        for name, value, words in self._asked if own is not None else ():
            if getattr(own, name, not value) == value:
                self._names.setdefault(words, {})[thing.name] = None

    def warn_of_found(self, warn: Warn) -> None:
        """Calls `warn` once for each kind of recorded flag, with the names of the objects."""
        for words, names in self._names.items():
            warn(
                Sentence("cycles-objects-differ", "{names}: {difference}", names=first_items(names, MOST_NAMES), difference=words)
            )


def warn_of_material(material: Any, warn: Warn) -> None:
    """Warns about the settings of a material that Rayfarm does not support."""
    if not getattr(material, "use_transparent_shadow", True) and _is_transparent(material):
        warn(
            Sentence("cycles-transparent-shadows", "light passes its transparent parts, unlike in Blender (Transparent Shadows)")
        )


def _is_transparent(material: Any) -> bool:
    def is_so(node: Any) -> bool:
        if node.type == "BSDF_TRANSPARENT":
            return True
        alpha = node.inputs.get("Alpha") if node.type == "BSDF_PRINCIPLED" else None
        return alpha is not None and (alpha.is_linked or alpha.default_value < 1)

    tree = material.node_tree if material.use_nodes else None
    return tree is not None and any(is_so(node) for node in tree.nodes)


def warn_of_passes(layer: Any, warn: Warn) -> None:
    """Warns about the render passes of a view layer that are not supported."""
    told = [
        each.name
        for owner in (layer, getattr(layer, "cycles", None))
        if owner is not None
        for each in owner.bl_rna.properties
        if each.identifier.startswith("use_pass_")
        and each.identifier.removeprefix("use_pass_") not in PASSES
        and getattr(owner, each.identifier)
    ]
    told = [name for name in told if name != "Cryptomatte Accurate"]
    told += [f"{each.name} (shader AOV)" for each in layer.aovs] + [f"{each.name} (light group)" for each in layer.lightgroups]
    if told:
        warn(Sentence("cycles-passes-left-out", "Passes that the farm does not support are left out: {names}", names=told))
