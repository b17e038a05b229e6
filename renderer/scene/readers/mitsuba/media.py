"""Mitsuba's media, inside shapes and around the sensor."""

from __future__ import annotations

from dataclasses import replace
from pathlib import PurePosixPath

from renderer.errors import SceneError
from renderer.scene.description import Material, Medium, SceneDescription, Vec3, Volume
from renderer.scene.matrices import product
from renderer.scene.readers.camera_medium import fill_world
from renderer.scene.readers.mitsuba.document import Document, Element
from renderer.scene.readers.mitsuba.textures import constant_of
from renderer.scene.readers.mitsuba.values import rgb
from renderer.scene.readers.scattering import interior_fields, medium
from renderer.scene.readers.substances import substance
from renderer.scene.readers.volume_files import read_volume, vol_bounds
from renderer.sentences import Sentence

__all__ = ["Media"]

NOTHING = Medium()
_OLD_SUBSTANCE = "skin1"  # Mitsuba 0.6's default
_SCATTERING_SKIN = ("dipole", "multipole", "singlescatter", "adipole")  # Mitsuba 0.6's subsurface integrators


class Media:
    """The media of a document's shapes, each read once."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._known: dict[int, Medium] = {}  # by the identity of their values
        self._inside: set[tuple[Vec3, Vec3, float, str]] = set()
        self._outside: dict[tuple[Vec3, Vec3, float, str], str] = {}
        self._unsaid = False  # whether any glass names no medium
        self._volumes: dict[str, Volume] = {}

    def inside(self, shape: Element, is_inside_out: bool) -> Medium | None:
        """Returns the medium that fills a shape; None if the shape has no medium.

        A shape with only an exterior medium is empty inside. is_inside_out: True if the shape's glass has the lower index of
        refraction inside, so that the shape is inverted and its exterior medium fills it.
        """
        media = {child.name: child for child in shape.children_of("medium")}
        if not media:
            return None
        filled, around = media.get("interior", media.get("")), media.get("exterior")
        if is_inside_out:
            filled, around = around, filled
        if around is not None:
            self._outside.setdefault(_key(self._get_or_read(around)), shape.description)
        found = NOTHING if filled is None else self._get_or_read(filled)
        self._inside.add(_key(found))
        return found

    def fill(self, material: Material, found: Medium | None, shape: Element) -> Material:
        """Returns a shape's material with its interior filled by a medium, if the material lets light through.

        found: the medium inside the shape, from `inside`; None if the shape has no medium.
        """
        lets_through = material.kind in ("glass", "interface") or material.transmission > 0
        if found is None:
            self._unsaid |= material.kind == "glass" and not material.thin
            return material
        if lets_through and not material.thin:
            return replace(material, **interior_fields(found))
        if found != NOTHING and (lets_through or material.alpha_mode == "blend"):
            self._document.ignore(
                Sentence(
                    "mitsuba-medium-in-thin-shape",
                    "{what}: its medium is ignored, since its material is thin",
                    what=shape.description,
                )
                if lets_through
                else Sentence(
                    "mitsuba-medium-in-holes",
                    "{what}: its medium is ignored, since its material has holes",
                    what=shape.description,
                )
            )
        return material

    def surround(self, description: SceneDescription) -> None:
        """Sets the world's medium to the one around the first sensor. Must be called after all shapes are added."""
        sensor = next(iter(self._document.scene.children_of("sensor")), None)
        around = None if sensor is None else next(iter(sensor.children_of("medium")), None)
        found = NOTHING if around is None else self._get_or_read(around)
        description.volumes |= self._volumes
        fill_world(description, found)
        if self._unsaid and any(key != _key(NOTHING) for key in (*self._inside, *self._outside, _key(found))):
            self._document.ignore(
                Sentence(
                    "mitsuba-glass-interior-clear",
                    "Glass without a medium is clear inside; in Mitsuba the surrounding medium continues",
                )
            )
        for key, what in self._outside.items():
            if key not in self._inside and key not in (_key(found), _key(NOTHING)):
                self._document.ignore(
                    Sentence(
                        "mitsuba-exterior-medium-ignored",
                        "The medium around {what} is ignored",
                        what=what,
                    )
                )

    def _get_or_read(self, source: Element) -> Medium:
        key = id(source.values)  # shared by references
        if key not in self._known:
            self._known[key] = self._read(source)
        return self._known[key]

    def _read(self, source: Element) -> Medium:
        if source.type in _SCATTERING_SKIN:
            self._document.ignore(
                Sentence(
                    "mitsuba-bsdf-without-subsurface",
                    "{what}: its subsurface scattering is not supported",
                    what=source.description,
                )
            )
            return NOTHING
        if source.type not in ("homogeneous", "heterogeneous"):
            self._document.ignore(
                Sentence(
                    "mitsuba-medium-type-unsupported",
                    "{what} is not supported as a medium: it is left out",
                    what=source.description,
                )
            )
            return NOTHING
        scale, g = source.number("scale", 1.0), self._direction(source)
        named = source.get("material", _OLD_SUBSTANCE if self._document.is_old and not _declares_coefficients(source) else None)
        if named is not None:
            known = substance(str(named))
            if known is not None:
                if g:
                    self._document.ignore(
                        Sentence(
                            "mitsuba-medium-phase-ignored",
                            "{what}: its phase function is ignored, since it names a material",
                            what=source.description,
                        )
                    )
                return medium(known[1], known[0], 0.0, scale)
            self._document.ignore(
                Sentence(
                    "mitsuba-medium-material-unknown",
                    "{what}: the material {material} is unknown; its numbers are used",
                    what=source.description,
                    material=str(named)[:40],
                )
            )
        absorbed, scattered = (self._color(source, name) for name in ("sigma_a", "sigma_s"))
        if absorbed is not None or scattered is not None:
            return medium(absorbed or (0.0,) * 3, scattered or (0.0,) * 3, g, scale)
        grid = next((each for each in source.children if each.name == "sigma_t" and each.type == "gridvolume"), None)
        name = "" if grid is None or source.type != "heterogeneous" else self._read_grid(grid)
        if name:
            source.used.add("sigma_t")
        whole, albedo = None if name else self._color(source, "sigma_t"), self._color(source, "albedo")
        if source.children and any(
            each.name in ("sigma_t", "albedo") and constant_volume(each) is None and not (name and each is grid)
            for each in source.children
        ):
            return NOTHING
        r, s = albedo or (0.75,) * 3, whole or (1.0,) * 3
        taken, turned = [t * (1 - a) for t, a in zip(s, r, strict=True)], [t * a for t, a in zip(s, r, strict=True)]
        return replace(medium(taken, turned, g, scale), volume=name)

    def _read_grid(self, source: Element) -> str:
        """Returns the name of the volume of a gridvolume, read from its file; empty, with a note, if it cannot be read."""
        source.mark_used()
        wanted, files = str(source.get("filename", "")), self._document.files
        found = files.find(wanted, source.file)
        has_bounds = source.boolean("use_grid_bbox", False)
        if found is None:
            self._document.ignore(
                Sentence(
                    "mitsuba-file-missing",
                    "{file}: {name} is not among the files; add it",
                    file=source.file,
                    name=PurePosixPath(wanted).name[:120] or source.description,
                )
            )
            return ""
        for key in ("raw", "accel"):
            source.used.add(key)  # without effect on grids of one channel
        if source.get("filter_type", "trilinear") != "trilinear" or source.get("wrap_mode", "clamp") != "clamp":
            self._document.ignore(
                Sentence(
                    "mitsuba-volume-interpolation",
                    "{what}: its values are interpolated linearly, and clamped at its ends",
                    what=source.description,
                )
            )
        try:
            data = files.read(found)
            density = read_volume(data, found)
        except SceneError as error:
            self._document.ignore(error.args[0])
            return ""
        place = source.matrix()
        if has_bounds:
            place = product(place, vol_bounds(data))
        self._volumes[name := f"grid {len(self._volumes)}"] = Volume(density, place)
        return name

    def _color(self, source: Element, name: str) -> Vec3 | None:
        child = source.child(name)
        if child is None:
            found = source.get(name)
            return None if found is None else rgb(found)
        child.used.add("")
        constant = constant_volume(child)
        if constant is None:
            self._document.ignore(
                Sentence(
                    "mitsuba-medium-heterogeneous",
                    "{what}: its {name} varies in space, which is not supported: the medium is left out",
                    what=source.description,
                    name=name,
                )
            )
            child.used.update(child.values)
            return None
        return rgb(constant)

    def _direction(self, source: Element) -> float:
        """Returns the mean cosine of the scattering angle of a medium's phase function."""
        phase = next(iter(source.children_of("phase")), None)
        if phase is not None:
            phase.mark_used()
        if phase is None or phase.type == "isotropic":
            return 0.0
        if phase.type == "hg":
            return phase.number("g", 0.8)
        self._document.ignore(
            Sentence(
                "mitsuba-phase-type-unsupported",
                "{what} is not supported as a phase function: light is scattered evenly",
                what=phase.description,
            )
        )
        phase.used.update(phase.values)
        return 0.0


def constant_volume(source: Element) -> object | None:
    """Returns the value of a volume or texture that is constant in space; None for one that varies in space."""
    if source.type == "constvolume":
        inner = source.child("value")
        return source.get("value", 1.0) if inner is None else constant_of(inner)
    return constant_of(source)


def _declares_coefficients(source: Element) -> bool:
    return any(name in source.values for name in ("sigma_a", "sigma_s", "sigma_t", "albedo")) or any(
        child.name in ("sigma_a", "sigma_s", "sigma_t", "albedo") for child in source.children
    )


def _key(found: Medium) -> tuple[Vec3, Vec3, float, str]:
    return found.sigma_a, found.sigma_s, found.g, found.volume
