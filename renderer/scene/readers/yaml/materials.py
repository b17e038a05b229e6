"""Reads the materials of a scene file: field names and values, and the fields of each kind."""

from __future__ import annotations

from typing import Any

from renderer.scene.material import HAIR_IOR, PARAMETERS, HairModel, Material
from renderer.scene.parameters import EVERY_KIND, SURFACES, MaterialKind, Parameter
from renderer.scene.readers.metals import METALS
from renderer.scene.readers.yaml.lines import Path, Yaml
from renderer.scene.readers.yaml.textures import Textures
from renderer.scene.readers.yaml.values import color, value_of
from renderer.sentences import Sentence

__all__ = ["SPELLINGS", "read_material"]

_PARAMETERS_BY_NAME = {parameter.in_file: parameter for parameter in PARAMETERS}
# Alternative fields for parameters.
SPELLINGS = {"abbe": "dispersion", "metal": "eta"}

_FIELDS: dict[str, frozenset[str]] = {
    kind: frozenset(
        {name for name, p in _PARAMETERS_BY_NAME.items() if kind in p.kinds}
        | {name for name, same in SPELLINGS.items() if kind in _PARAMETERS_BY_NAME[same].kinds}
    )
    for kind in EVERY_KIND
}
_CHIANG, _HUANG = {"beta_m", "beta_n"}, {"roughness", "distribution", "aspect_ratio", "r", "tt", "trt"}  # of one model of hair
# Fields that imply the kind "metallic_roughness".
_PRINCIPLED_FIELDS = _FIELDS["metallic_roughness"] - frozenset.intersection(*map(_FIELDS.__getitem__, SURFACES))


def read_material(name: str, source: dict[str, Any], textures: Textures, document: Yaml, path: Path) -> Material:
    """Returns a material of a scene file. name: the material's name in the file.

    Raises SceneError for fields that have no meaning for its kind.
    """
    kind: MaterialKind = source.get("kind") or _kind_of(source)
    for key in source:
        if key not in _FIELDS[kind]:
            kinds = [k for k, known in _FIELDS.items() if key in known]
            raise document.error(
                (*path, key),
                Sentence(
                    "material-parameter-meaningless",
                    "has no meaning for the kind {kind}, only for {kinds}; leave it out",
                    kind=kind,
                    kinds=kinds,
                ),
            )
    fields: dict[str, Any] = {"name": name, "kind": kind}
    for key, value in source.items():
        if key in _PARAMETERS_BY_NAME:
            fields[_PARAMETERS_BY_NAME[key].name] = _value(_PARAMETERS_BY_NAME[key], value, textures, document, (*path, key))
    white = "texture" in source or kind in ("glass", "mirror")
    if kind == "interface":
        return Material(**fields)
    fields["base_color"] = color(source.get("color", 1.0 if white else 0.8))
    if "abbe" in source:
        fields["dispersion"] = 20.0 / source["abbe"]
    if kind == "hair":
        fields.setdefault("ior", HAIR_IOR)
        fields["model"] = _model_of(source, document, path)
    if kind == "conductor":
        _conductor(source, fields, document, path)
    if kind == "blinn_phong" and "specular_color" not in source:
        raise document.error(
            path,
            Sentence("blinn-phong-specular-missing", "blinn_phong needs its specular_color (ks), as well as its color (kd)"),
        )
    if source.get("opacity", 1) < 1 and "alpha_mode" not in source:
        fields["alpha_mode"] = "blend"
    return Material(**fields)


def _model_of(source: dict[str, Any], document: Yaml, path: Path) -> HairModel:
    """Returns the model of hair, by its fields unless given. Raises SceneError if a field has no meaning for its model."""
    model: HairModel = source.get("model") or ("huang" if _HUANG & source.keys() else "chiang")
    for key in source:
        if key in (_HUANG if model == "chiang" else _CHIANG):
            other = "huang" if model == "chiang" else "chiang"
            raise document.error(
                (*path, key),
                Sentence(
                    "hair-field-of-other-model",
                    "has no meaning for hair of the model {model}, only for {other}; leave it out or write model: {other}",
                    model=model,
                    other=other,
                ),
            )
    return model


def _value(parameter: Parameter, value: Any, textures: Textures, document: Yaml, path: Path) -> Any:
    if parameter.form == "texture":
        if not parameter.layered and isinstance(value, list):
            raise document.error(
                path,
                Sentence("material-single-texture-only", "takes one texture: its values are not colours that could be layered"),
            )
        return textures.stack(value, path, parameter.srgb)
    return value_of(parameter, value)


def _kind_of(source: dict[str, Any]) -> MaterialKind:
    if {"metal", "eta", "k"} & source.keys():
        return "conductor"
    if "shininess" in source:
        return "blinn_phong"
    if "nonlinear" in source:
        return "plastic"
    if {"eumelanin", "pheomelanin", "model", *_CHIANG, *(_HUANG - {"roughness", "distribution"})} & source.keys():
        return "hair"
    return "metallic_roughness" if _PRINCIPLED_FIELDS & source.keys() else "diffuse"


def _conductor(source: dict[str, Any], fields: dict[str, Any], document: Yaml, path: Path) -> None:
    if ("metal" in source) == ("eta" in source or "k" in source) or ("eta" in source) != ("k" in source):
        raise document.error(path, Sentence("conductor-metal-or-eta", "a conductor needs either metal, or eta and k"))
    if "metal" in source:
        fields["eta"], fields["k"] = METALS[source["metal"]]
