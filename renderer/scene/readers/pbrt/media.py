"""Converts pbrt's media, inside shapes and in the world, and its subsurface material.

Lengths are in scene units. pbrt multiplies coefficients by `scale`; its named media have coefficients per millimetre, so they
assume a scene in millimetres.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from renderer.scene.description import Material, Medium, SceneDescription, Vec3, Volume
from renderer.scene.matrices import Matrix, product
from renderer.scene.readers.camera_medium import fill_world
from renderer.scene.readers.number_ranges import clamped
from renderer.scene.readers.pbrt.notes import Notes, Place
from renderer.scene.readers.pbrt.parameters import Parameters
from renderer.scene.readers.pbrt.textures import Textures
from renderer.scene.readers.scattering import dense_medium_surface, interior_fields, medium, radius_beneath_a_boundary
from renderer.scene.readers.substances import SUBSTANCES
from renderer.sentences import Sentence

__all__ = ["NOTHING", "Interface", "Media", "subsurface"]

NOTHING = Medium()
_MILK = SUBSTANCES["Wholemilk"]  # default of pbrt's subsurface

Interface = tuple[str, str]  # names of the media inside and outside; "" for none


class Media:
    """The named media of a file."""

    def __init__(self, textures: Textures, notes: Notes) -> None:
        self._textures, self._notes = textures, notes
        self._named: dict[str, Medium] = {"": NOTHING}
        self._inside: set[str] = set()  # names of media inside shapes
        self._outside: dict[str, Place] = {}  # media named as exteriors
        self._unsaid = False  # whether any glass names no medium
        self._volumes: dict[str, Volume] = {}

    def define(self, name: str, source: Parameters, place: Matrix) -> None:
        """Adds a named medium; one of an unsupported kind becomes an empty medium, with a note.

        place: the transformation from the medium's space to the world.
        """
        kind = source.type
        if name in self._named:
            self._notes.add(
                source.place,
                Sentence("pbrt-medium-redefined", "The medium {name} is redefined: the later one is used", name=repr(name[:60])),
            )
        if kind == "homogeneous":
            self._named[name] = self._homogeneous(source)
            return
        if kind == "uniformgrid" and (volume := self._grid(source, place)) is not None:
            self._volumes[grid := f"grid {len(self._volumes)}"] = volume
            self._named[name] = replace(self._homogeneous(source), volume=grid)
            return
        source.used.update(source.values)
        self._named[name] = NOTHING
        self._notes.add(
            source.place,
            Sentence(
                "pbrt-medium-heterogeneous",
                "The medium {name} varies in space ({kind}), which is not supported: it is left out",
                name=repr(name[:60]),
                kind=kind[:40],
            ),
        )

    def find(self, name: str, place: Place) -> Medium:
        """Returns a medium by name. Raises SceneError if it is undefined."""
        if name not in self._named:
            raise place.error(
                Sentence(
                    "pbrt-medium-undefined",
                    "there is no medium {name}; define it with MakeNamedMedium first",
                    name=repr(name[:60]),
                )
            )
        return self._named[name]

    def bounds(self, between: Interface, place: Place) -> bool:
        """Returns True if a surface separates two different media. between: names of the media inside and outside."""
        inside, outside = between
        return inside != outside and (self.find(inside, place) != NOTHING or self.find(outside, place) != NOTHING)

    def fill(self, material: Material, source: Parameters | None, between: Interface, place: Place) -> Material:
        """Returns a material filled with the medium inside its shape; equal media inside and outside have no effect, as in pbrt.

        material: the material to fill; source: its parameters in the file; between: names of the media inside and outside.
        """
        inside, outside = between
        lets_through = material.kind in ("glass", "interface") or material.transmission > 0 or material.diffuse_transmission > 0
        if inside == outside:
            self._unsaid |= material.kind == "glass" and not material.thin
            return material
        found = self.find(inside, place)
        self.find(outside, place)
        self._inside.add(inside)
        self._outside.setdefault(outside, place)
        if material.kind == "interface":
            return replace(material, name=inside or "interface", **interior_fields(found))
        if lets_through and not material.thin:
            return replace(material, **interior_fields(found))
        if found != NOTHING and lets_through:
            self._notes.add(
                place, Sentence("pbrt-thin-shape-with-medium", "{source}: its medium is ignored, since it is thin", source=source)
            )
        return material

    def surround(self, description: SceneDescription, camera: str, place: Place) -> None:
        """Sets the world's medium to the one that contains the camera. Must be called after all shapes are added."""
        description.volumes |= self._volumes
        fill_world(description, self.find(camera, place))
        if self._unsaid and any(each != NOTHING for each in self._named.values()):
            self._notes.add(
                place,
                Sentence(
                    "pbrt-glass-interior-clear",
                    "Glass without a MediumInterface is clear inside; in pbrt the surrounding medium continues",
                ),
            )
        for name, where in self._outside.items():
            if name not in self._inside and name != camera and self._named[name] != NOTHING:
                self._notes.add(
                    where,
                    Sentence(
                        "pbrt-exterior-medium-ignored",
                        "The exterior medium {name} of a shape is ignored, since it fills no other shape",
                        name=repr(name[:60]),
                    ),
                )

    def _grid(self, source: Parameters, place: Matrix) -> Volume | None:
        """Returns the density grid of a medium; None if it has none, or a wrong number of values."""
        counts = [source.integer(axis, 1) for axis in ("nx", "ny", "nz")]
        values = source.numbers("density")
        if values is None or min(counts) < 1 or len(values) != counts[0] * counts[1] * counts[2]:
            return None
        low, high = (np.array(source.vector(*each)) for each in (("p0", (0.0, 0.0, 0.0)), ("p1", (1.0, 1.0, 1.0))))
        unit = np.diag((*(high - low), 1.0))
        unit[:3, 3] = low
        return Volume(np.maximum(values, 0).astype(np.float32).reshape(counts[::-1]), product(place, unit))

    def _homogeneous(self, source: Parameters) -> Medium:
        known = SUBSTANCES.get(source.text("preset")) if source.get("preset") is not None else None
        if known is None and source.get("preset") is not None:
            self._notes.add(
                source.place,
                Sentence(
                    "pbrt-medium-preset-unknown",
                    "{preset} is not a known substance: its numbers are used",
                    preset=repr(source.text("preset")[:40]),
                ),
            )
        source.used.update(("sigma_a", "sigma_s", "type", "Le", "Lescale"))
        scattered, absorbed = known or (
            coefficients(source, "sigma_s", (1.0,) * 3, self._textures),
            coefficients(source, "sigma_a", (1.0,) * 3, self._textures),
        )
        if source.get("Le") is not None:
            self._notes.add(
                source.place, Sentence("pbrt-medium-emission-ignored", "{source}: its emission (Le) is ignored", source=source)
            )
        return medium(absorbed, scattered, source.number("g", 0.0), source.number("scale", 1.0))


def coefficients(source: Parameters, name: str, default: Vec3, textures: Textures) -> Vec3:
    """Returns the parameter `name` as three non-negative coefficients; for a texture, its mean."""
    found = textures.index(source, name)
    if found is None:
        return default
    r, g, b = (max(v, 0.0) for v in textures.colors.numbers(found))
    return r, g, b


def subsurface(source: Parameters, textures: Textures, notes: Notes) -> Material:
    """Converts pbrt's `subsurface` material, except for its roughness."""
    ior = clamped(textures.one_number(source, "eta", 1.33), 1.0, 4.0)
    scale = max(source.number("scale", 1.0), 0.0)
    made = Material(kind="metallic_roughness", ior=ior, subsurface=1.0)
    g = clamped(source.number("g", 0.0), -0.999, 0.999)
    wanted, is_given = source.text("name"), source.get("sigma_a") is not None or source.get("sigma_s") is not None
    if not wanted and not is_given and source.get("reflectance") is not None:
        if g:
            notes.add(
                source.place,
                Sentence("pbrt-medium-g-ignored", "'g' of {source} is ignored, since its reflectance is given", source=source),
            )
        color = textures.color(source, "reflectance", (1.0, 1.0, 1.0))
        path = coefficients(source, "mfp", (1.0,) * 3, textures)
        radius = radius_beneath_a_boundary(textures.mean_value(color), tuple(scale * c for c in path), ior)  # type: ignore[arg-type]
        return replace(made, base_color=color.value, base_color_texture=color.texture, subsurface_radius=radius)
    if wanted and wanted not in SUBSTANCES:
        notes.add(
            source.place,
            Sentence(
                "pbrt-subsurface-preset-unknown",
                "{preset} is not a known substance: rendered as milk",
                preset=repr(wanted[:40]),
            ),
        )
    scattered, absorbed = SUBSTANCES.get(wanted, _MILK)
    if not wanted and is_given:
        absorbed = coefficients(source, "sigma_a", (0.0,) * 3, textures)
        scattered = coefficients(source, "sigma_s", (0.0,) * 3, textures)
    found = medium(absorbed, (scattered[0] * (1 - g), scattered[1] * (1 - g), scattered[2] * (1 - g)), 0.0, scale)
    if not any(found.sigma_s):
        return replace(made, base_color=(0.0, 0.0, 0.0), subsurface=0.0)
    color_seen, radius = dense_medium_surface(found.sigma_a, found.sigma_s, ior)
    return replace(made, base_color=color_seen, subsurface_radius=radius)
