"""Warns about surfaces that are rendered differently from Cycles, for the add-on's materials and for those of .blend files."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..farm.protocol.sentences import Sentence
from .nodes import Source, constant_value

__all__ = ["NUMBERS", "has_film", "warn_of_pictures", "warn_of_shader", "warn_of_surface"]

# Inputs that are exported as constants even if nodes are connected to them.
NUMBERS = {
    "IOR": Sentence("cycles-input-ior", "index of refraction"),
    "Specular IOR Level": Sentence("cycles-input-specular-level", "specular level"),
    "Anisotropic": Sentence("cycles-input-anisotropy", "anisotropy"),
    "Anisotropic Rotation": Sentence("cycles-input-anisotropy-rotation", "anisotropy's rotation"),
    "Coat IOR": Sentence("cycles-input-coat-ior", "coat's index of refraction"),
    "Coat Tint": Sentence("cycles-input-coat-tint", "coat's tint"),
    "Thin Film Thickness": Sentence("cycles-input-film-thickness", "thin film's thickness"),
    "Thin Film IOR": Sentence("cycles-input-film-ior", "thin film's index of refraction"),
}
WITHIN = {
    "Subsurface Weight": Sentence("cycles-input-subsurface-weight", "subsurface weight"),
    "Subsurface Radius": Sentence("cycles-input-subsurface-radius", "subsurface radius"),
    "Subsurface Scale": Sentence("cycles-input-subsurface-scale", "subsurface scale"),
    "Subsurface Anisotropy": Sentence("cycles-input-subsurface-anisotropy", "subsurface anisotropy"),
}
MIN_CHANNEL = 0.9
TOLERANCE = 0.01
FILMS_ON_METALS = (5, 0)  # first Blender version in which Cycles supports thin films on metals
OTHER_FACETS = {"BECKMANN": "Beckmann", "ASHIKHMIN_SHIRLEY": "Ashikhmin-Shirley"}

SPACES = ("sRGB", "Non-Color", "Linear Rec.709", "Raw")

Warn = Callable[[str], None]


def warn_of_surface(surface: Any, warn: Warn) -> None:
    """Warns if a principled surface, or a shader expressed as one, is rendered differently from Cycles."""

    def number(name: str, default: float) -> float:
        found = constant_value(surface.input(name))
        return found if isinstance(found, float) else default

    is_within = constant_value(surface.input("Subsurface Weight")) not in (None, 0.0) or _is_fed(
        surface.input("Subsurface Weight")
    )
    for name, words in (NUMBERS | WITHIN if is_within else NUMBERS).items():
        at = surface.input(name)
        if at is not None and constant_value(at) is None:
            warn(Sentence("cycles-input-nodes", "nodes of its {input} are ignored; its constant value is used", input=words))
    if number("Coat Weight", 1.0) > 0 and abs(number("Coat IOR", 1.5) - 1.5) > TOLERANCE:
        warn(Sentence("cycles-coat-ior", "its coat has an index of refraction of 1.5"))
    if number("Sheen Weight", 1.0) > 0 and surface.input("Sheen Weight") is not None:
        warn(Sentence("cycles-sheen", "its sheen follows glTF, which is brighter at grazing angles than Cycles"))
    if (
        number("Metallic", 1.0) > 0
        and surface.input("Metallic") is not None
        and _is_tinted(surface.input("Specular Tint"), 1 - TOLERANCE)
    ):
        warn(Sentence("cycles-specular-tint", "the edge tint of its metal (specular tint) is ignored"))
    is_half = 0 < number("Transmission Weight", 0.5) < 1 and surface.input("Transmission Weight") is not None
    if is_half and _is_tinted(surface.input("Base Color"), MIN_CHANNEL):
        warn(Sentence("cycles-transmission-tint", "transmitted light is tinted by its base color, darker than in Cycles"))
    base = constant_value(surface.input("Base Color"))
    if isinstance(base, list) and max(base) > 1:
        warn(Sentence("cycles-base-color-clipped", "its base color is clipped at 1"))
    if number("IOR", 1.5) < 1:
        warn(Sentence("cycles-ior-below-one", "its index of refraction is below 1; 1 is used"))


def warn_of_shader(source: Source, warn: Warn) -> None:
    """Warns if a shader that is replaced by a principled surface is rendered differently from Cycles."""
    facets = OTHER_FACETS.get(getattr(source.node, "distribution", ""))
    rough = constant_value(source.input("Roughness"))
    if source.node.type == "BSDF_SHEEN":
        return
    if facets is not None and rough != 0.0:
        warn(Sentence("cycles-microfacets", "its microfacets have the GGX distribution, not {distribution}", distribution=facets))
    if source.node.type == "BSDF_REFRACTION":
        warn(Sentence("cycles-refraction-bsdf", "its Refraction BSDF also reflects, like glass"))
    is_edged = source.node.type == "BSDF_METALLIC" and source.node.fresnel_type == "F82"
    if is_edged and _is_tinted(source.input("Edge Tint"), 1 - TOLERANCE):
        warn(Sentence("cycles-edge-tint", "the edge tint of its metal is ignored"))


def warn_of_pictures(tree: Any, warn: Warn) -> None:
    """Warns if images in a material's nodes are used differently from Cycles."""
    for node in tree.nodes:
        image = node.image if node.type == "TEX_IMAGE" else None
        if image is None or not any(entry.is_linked for entry in node.outputs):
            continue
        if node.extension == "CLIP":
            warn(
                Sentence(
                    "cycles-image-extended",
                    "the image {image} extends its edge pixels, unlike in Blender, where it is clipped",
                    image=image.name,
                )
            )
        if image.colorspace_settings.name not in SPACES:
            warn(
                Sentence(
                    "cycles-image-color-space",
                    "the image {image} has an unsupported color space: {space}",
                    image=image.name,
                    space=image.colorspace_settings.name,
                )
            )


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
