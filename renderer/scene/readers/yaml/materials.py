"""A scene file's materials: friendly names for the fields of a Material, and which kind knows which."""

from __future__ import annotations

import math
from typing import Any

from renderer.scene.description import SINGLE_TEXTURES, Material, MaterialKind
from renderer.scene.readers.metals import METALS
from renderer.scene.readers.yaml.lines import Path, Yaml
from renderer.scene.readers.yaml.textures import Textures
from renderer.scene.readers.yaml.values import color, radiance, vec3

__all__ = ["read_material"]

_ALL = {
    "kind",
    "color",
    "texture",
    "opacity",
    "alpha_mode",
    "alpha_cutoff",
    "emission",
    "emission_texture",
    "double_sided",
    "normal_texture",
    "normal_scale",
}
_ROUGHNESS = {"roughness", "metallic_roughness_texture"}
_ANISOTROPY = {"anisotropy", "anisotropy_rotation", "anisotropy_texture"}
_REFRACTION = {"ior", "dispersion", "abbe", "thin", "attenuation_color", "attenuation_distance"}
_EXTENDED = {
    *("metallic", "specular", "specular_texture", "specular_color", "specular_color_texture"),
    *("clearcoat", "clearcoat_texture", "clearcoat_roughness", "clearcoat_roughness_texture"),
    *("clearcoat_normal_texture", "clearcoat_normal_scale"),
    *("sheen_color", "sheen_color_texture", "sheen_roughness", "sheen_roughness_texture"),
    *("transmission", "transmission_texture", "diffuse_transmission", "diffuse_transmission_texture"),
    *("diffuse_transmission_color", "diffuse_transmission_color_texture"),
    *("iridescence", "iridescence_texture", "iridescence_ior", "iridescence_thickness", "iridescence_thickness_texture"),
}
_FIELDS: dict[MaterialKind, set[str]] = {
    "diffuse": set(),
    "mirror": set(),
    "unlit": set(),
    "glass": _ROUGHNESS | _REFRACTION,
    "conductor": _ROUGHNESS | _ANISOTROPY | {"metal", "eta", "k"},
    "blinn_phong": {"specular_color", "shininess"},
    "metallic_roughness": _EXTENDED | _ROUGHNESS | _ANISOTROPY | _REFRACTION,
}

_SRGB_TEXTURES = {
    "texture",
    "emission_texture",
    "specular_color_texture",
    "sheen_color_texture",
    "diffuse_transmission_color_texture",
}
_COLORS = {"specular_color", "sheen_color", "attenuation_color", "diffuse_transmission_color"}
_PLAIN = {  # as they are
    *("kind", "metallic", "roughness", "ior", "opacity", "alpha_mode", "alpha_cutoff", "double_sided", "normal_scale"),
    *("specular", "clearcoat", "clearcoat_roughness", "clearcoat_normal_scale", "sheen_roughness", "transmission", "thin"),
    *("attenuation_distance", "anisotropy", "iridescence", "iridescence_ior", "dispersion", "diffuse_transmission", "shininess"),
}


def read_material(name: str, source: dict[str, Any], textures: Textures, document: Yaml, path: Path) -> Material:
    """The material under a name. Raises SceneError for fields that its kind does not know."""
    kind: MaterialKind = source.get("kind") or _kind_of(source)
    for key in source:
        if key not in _ALL | _FIELDS[kind]:
            kinds = ", ".join(k for k, known in _FIELDS.items() if key in known)
            raise document.error((*path, key), f"means nothing for the kind {kind}; it is for {kinds}")
    fields: dict[str, Any] = {"name": name, "kind": kind}
    for key, value in source.items():
        if key.endswith("texture"):
            if key in SINGLE_TEXTURES and isinstance(value, list):
                raise document.error((*path, key), "takes one texture: its values are no colours that layers could be laid on")
            texture = textures.stack(value, (*path, key), key in _SRGB_TEXTURES)
            fields["base_color_texture" if key == "texture" else key] = texture
        elif key in _COLORS:
            fields[key] = color(value)
        elif key in _PLAIN:
            fields[key] = value
    white = "texture" in source or kind in ("glass", "mirror")
    fields["base_color"] = color(source.get("color", 1.0 if white else 0.8))
    fields["emission"] = radiance(source.get("emission", 0.0))
    if "anisotropy_rotation" in source:
        fields["anisotropy_rotation"] = math.radians(source["anisotropy_rotation"])
    if "iridescence_thickness" in source:
        thickness = source["iridescence_thickness"]
        fields["iridescence_thickness"] = tuple(thickness) if isinstance(thickness, list) else (0.0, float(thickness))
    if "abbe" in source:
        fields["dispersion"] = 20.0 / source["abbe"]
    if kind == "conductor":
        _conductor(source, fields, document, path)
    if kind == "blinn_phong" and "specular_color" not in source:
        raise document.error(path, "blinn_phong needs its specular_color (ks), as well as its color (kd)")
    if source.get("opacity", 1) < 1 and "alpha_mode" not in source:
        fields["alpha_mode"] = "blend"
    return Material(**fields)


def _kind_of(source: dict[str, Any]) -> MaterialKind:
    if {"metal", "eta", "k"} & source.keys():
        return "conductor"
    if "shininess" in source:
        return "blinn_phong"
    return "metallic_roughness" if _FIELDS["metallic_roughness"] & source.keys() else "diffuse"


def _conductor(source: dict[str, Any], fields: dict[str, Any], document: Yaml, path: Path) -> None:
    if ("metal" in source) == ("eta" in source or "k" in source) or ("eta" in source) != ("k" in source):
        raise document.error(path, "a conductor has either a metal, or eta and k")
    if "metal" in source:
        fields["eta"], fields["k"] = METALS[source["metal"]]
    else:
        fields["eta"], fields["k"] = (vec3(v if isinstance(v, list) else [v] * 3) for v in (source["eta"], source["k"]))
