"""Warns about surfaces that differ from Cycles, for the add-on's materials and for those of .blend files."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .nodes import Source, constant_value

__all__ = ["NUMBERS", "has_film", "warn_of_pictures", "warn_of_shader", "warn_of_surface"]

# Inputs that are exported as constants even if nodes are connected to them.
NUMBERS = {
    "IOR": "index of refraction",
    "Specular IOR Level": "specular level",
    "Anisotropic": "anisotropy",
    "Anisotropic Rotation": "anisotropy's rotation",
    "Coat IOR": "coat's index of refraction",
    "Coat Tint": "coat's tint",
    "Thin Film Thickness": "thin film's thickness",
    "Thin Film IOR": "thin film's index of refraction",
}
WITHIN = {
    "Subsurface Weight": "subsurface weight",
    "Subsurface Radius": "subsurface radius",
    "Subsurface Scale": "subsurface scale",
    "Subsurface Anisotropy": "subsurface anisotropy",
}
PALE = 0.9
NEAR = 0.01
FILMS_ON_METALS = (5, 0)  # first Blender version in which Cycles supports thin films on metals
OTHER_FACETS = {"BECKMANN": "Beckmann's", "ASHIKHMIN_SHIRLEY": "Ashikhmin and Shirley's"}

SPACES = ("sRGB", "Non-Color", "Linear Rec.709", "Raw")

Warn = Callable[[str], None]


def warn_of_surface(surface: Any, warn: Warn) -> None:
    """Warns about differences from Cycles of a principled surface, or of a shader expressed as one."""

    def number(name: str, default: float) -> float:
        found = constant_value(surface.input(name))
        return found if isinstance(found, float) else default

    is_within = constant_value(surface.input("Subsurface Weight")) not in (None, 0.0) or _is_fed(
        surface.input("Subsurface Weight")
    )
    for name, words in (NUMBERS | WITHIN if is_within else NUMBERS).items():
        at = surface.input(name)
        if at is not None and constant_value(at) is None:
            warn(f"what feeds its {words} is not taken over; a plain number stands for it")
    if number("Coat Weight", 1.0) > 0 and abs(number("Coat IOR", 1.5) - 1.5) > NEAR:
        warn("its coat refracts as 1.5")
    if number("Sheen Weight", 1.0) > 0 and surface.input("Sheen Weight") is not None:
        warn("its sheen is glTF's, which is brighter towards the rim than Cycles'")
    if (
        number("Metallic", 1.0) > 0
        and surface.input("Metallic") is not None
        and _is_tinted(surface.input("Specular Tint"), 1 - NEAR)
    ):
        warn("the tint of its metal's edge (specular tint) is not taken over")
    is_half = 0 < number("Transmission Weight", 0.5) < 1 and surface.input("Transmission Weight") is not None
    if is_half and _is_tinted(surface.input("Base Color"), PALE):
        warn("what it lets through is of its base colour, and darker than in Cycles")
    base = constant_value(surface.input("Base Color"))
    if isinstance(base, list) and max(base) > 1:
        warn("its base colour is cut at 1")
    if number("IOR", 1.5) < 1:
        warn("its index of refraction is below 1, and taken as 1")


def warn_of_shader(source: Source, warn: Warn) -> None:
    """Warns about differences from Cycles of a shader that is replaced by a principled surface."""
    facets = OTHER_FACETS.get(getattr(source.node, "distribution", ""))
    rough = constant_value(source.input("Roughness"))
    if source.node.type == "BSDF_SHEEN":
        return
    if facets is not None and rough != 0.0:
        warn(f"its facets are distributed as GGX has them, not {facets} way")
    if source.node.type == "BSDF_REFRACTION":
        warn("its Refraction BSDF reflects as well, as glass does")
    is_edged = source.node.type == "BSDF_METALLIC" and source.node.fresnel_type == "F82"
    if is_edged and _is_tinted(source.input("Edge Tint"), 1 - NEAR):
        warn("the tint of its metal's edge is not taken over")


def warn_of_pictures(tree: Any, warn: Warn) -> None:
    """Warns about differences from Cycles of the images in a material's nodes."""
    for node in tree.nodes:
        image = node.image if node.type == "TEX_IMAGE" else None
        if image is None or not any(entry.is_linked for entry in node.outputs):
            continue
        if node.extension == "CLIP":
            warn(f"beyond its edges the picture {image.name} goes on as they are, though it is clipped in Blender")
        if image.colorspace_settings.name not in SPACES:
            warn(f"the colours of the picture {image.name} are not known as {image.colorspace_settings.name}")


def has_film(surface: Any) -> bool:
    """Returns True if the surface has a visible thin film. Before Blender 5, films on metals are invisible."""
    if constant_value(surface.input("Metallic")) != 1.0:
        return True
    try:
        import bpy
    except ImportError:  # nodes are read without Blender in tests
        return False
    return bool(bpy.app.version[:2] >= FILMS_ON_METALS)


def _is_fed(socket: Any) -> bool:
    return socket is not None and constant_value(socket) is None


def _is_tinted(socket: Any, threshold: float) -> bool:
    if socket is None:
        return False
    found = constant_value(socket)
    return found is None or (min(found) if isinstance(found, list) else found) < threshold
