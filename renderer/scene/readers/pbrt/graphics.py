"""Executes statements: maintains the graphics state and builds the scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import PurePosixPath

import numpy as np

from renderer.scene.animation import Moment
from renderer.scene.description import SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.matrices import Matrix, product
from renderer.scene.readers.crop_window import Window
from renderer.scene.readers.pbrt import cameras, transforms
from renderer.scene.readers.pbrt.lights import Lights
from renderer.scene.readers.pbrt.materials import Materials
from renderer.scene.readers.pbrt.media import Interface, Media
from renderer.scene.readers.pbrt.notes import Notes, Place
from renderer.scene.readers.pbrt.options import note_option
from renderer.scene.readers.pbrt.parameters import Parameter, Parameters
from renderer.scene.readers.pbrt.shapes import Shapes, ShapeState
from renderer.scene.readers.pbrt.spectra import SPACES, Colors
from renderer.scene.readers.pbrt.statements import MAX_DEPTH, Statement, Statements
from renderer.scene.readers.pbrt.textures import Textures
from renderer.scene.readers.pbrt.transforms import Ctm
from renderer.sentences import Sentence

__all__ = ["Graphics"]

_MOST_STATES = 1_000  # nested blocks
_LEAST_SECONDS = 1e-4
_ON = "_on_"
_ATTRIBUTES = ("shape", "light", "material", "medium", "texture")


@dataclass
class _State:
    """The part of the graphics state that AttributeBegin saves and AttributeEnd restores."""

    ctm: Ctm = field(default_factory=lambda: (np.eye(4),) * 2)
    active: tuple[bool, bool] = (True, True)
    reverse: bool = False
    material: Parameters | None = None
    area: Parameters | None = None
    space: str = "srgb"
    medium: Interface = ("", "")
    attributes: dict[str, dict[str, tuple[Parameter, set[str]]]] = field(default_factory=dict)


class Graphics:
    """Executes a file's statements. Raises SceneError, with the line, for an invalid statement."""

    def __init__(self, files: SceneFiles, description: SceneDescription, moment: Moment, notes: Notes) -> None:
        self._files, self._description, self._moment, self._notes = files, description, moment, notes
        self._statements = Statements(files)
        self._textures = Textures(files, Colors(files, notes, description.spectra), notes, description)
        self._media = Media(self._textures, notes)
        self._materials = Materials(self._textures, self._media, description, notes)
        self._lights = Lights(files, self._textures, description, notes)
        self._shapes: Shapes | None = None
        self._state, self._saved = _State(), list[tuple[str, _State]]()
        self._named: dict[str, Ctm] = {}
        self._world: Ctm = self._state.ctm
        self._times = 0.0, 1.0
        self._camera: tuple[Parameters, Ctm] | None = None
        self._camera_medium = ""
        self._film: Parameters | None = None
        self._rendered: Window | None = None  # of the film
        self._all: list[tuple[Parameters, int]] = []  # with the number of parameters used at first
        self._depth = 0
        self._outer = np.eye(4)
        self._do: dict[str, Callable[[Statement], None]] = {
            _directive(name): getattr(self, name) for name in dir(self) if name.startswith(_ON)
        }

    def run(self, name: str) -> None:
        """Executes the statements of a file and its includes."""
        for statement in self._statements.statements_of(name, self._depth):
            do = self._do.get(statement.directive)
            if do is None:
                raise statement.place.error(
                    Sentence(
                        "pbrt-directive-unknown",
                        "{directive} is not a directive of pbrt-v4; convert older scenes with `pbrt --upgrade`",
                        directive=repr(statement.directive[:40]),
                    )
                )
            do(statement)

    def end_scene(self, main: str) -> None:
        """Completes the scene. Raises SceneError if a block is open or WorldBegin is missing."""
        if self._shapes is None:
            raise Place(PurePosixPath(main).name, 1).error(
                Sentence("pbrt-world-begin-missing", "has no WorldBegin and so no world; give the scene's main file")
            )
        if self._saved:
            raise Place(PurePosixPath(main).name, 1).error(
                Sentence("pbrt-block-not-closed", "{block} is not closed; close it", block=self._saved[-1][0])
            )
        self._shapes.flush()
        place = self._camera[0].place if self._camera is not None else Place(PurePosixPath(main).name, 1)
        self._media.surround(self._description, self._camera_medium, place)
        for each, asked in self._all:
            if len(each.used) > asked:  # otherwise the object is unused
                each.say_unused(self._notes)

    # Files

    def _on_include(self, statement: Statement) -> None:
        wanted = self._name(statement)
        found = self._files.find(wanted, statement.place.file)
        if found is None:
            raise statement.place.error(
                Sentence(
                    "pbrt-include-missing",
                    "includes {name}, which is not among the files; add it",
                    name=repr(PurePosixPath(wanted).name[:120]),
                )
            )
        if self._depth >= MAX_DEPTH:
            raise statement.place.error(
                Sentence(
                    "pbrt-includes-circular",
                    "files include each other to a depth of {depth}; remove the circle",
                    depth=MAX_DEPTH,
                )
            )
        self._depth += 1
        self.run(found)
        self._depth -= 1

    def _on_import(self, statement: Statement) -> None:
        state = replace(self._state)
        self._on_include(statement)
        self._state = state

    # Transformations

    def _numbers(self, statement: Statement, count: int) -> Matrix:
        found = [each for each in statement.arguments if isinstance(each, np.ndarray)]
        numbers = np.concatenate(found) if found else np.zeros(0)
        if len(found) != len(statement.arguments) or len(numbers) != count:
            raise statement.place.error(
                Sentence("pbrt-directive-one-number", "{directive} needs 1 number", directive=statement.directive)
                if count == 1
                else Sentence(
                    "pbrt-directive-number-count", "{directive} needs {count} numbers", directive=statement.directive, count=count
                )
            )
        return numbers

    def _apply(self, matrix: Matrix, replaces: bool = False) -> None:
        """Changes the active transformations: multiplies each by a matrix or, if `replaces` is true, sets it to the matrix."""
        old = self._state.ctm
        first, last = (
            (matrix if replaces else product(each, matrix)) if active else each
            for each, active in zip(old, self._state.active, strict=True)
        )
        same = old[0] is old[1] and all(self._state.active)
        self._state.ctm = (first, first if same or np.array_equal(first, last) else last)

    def _on_identity(self, statement: Statement) -> None:
        self._apply(np.eye(4), replaces=True)

    def _on_translate(self, statement: Statement) -> None:
        self._apply(transforms.translation(self._numbers(statement, 3)))

    def _on_scale(self, statement: Statement) -> None:
        self._apply(transforms.scaling(self._numbers(statement, 3), statement.place))

    def _on_rotate(self, statement: Statement) -> None:
        degrees, *axis = self._numbers(statement, 4)
        self._apply(transforms.rotation(float(degrees), np.array(axis), statement.place))

    def _on_look_at(self, statement: Statement) -> None:
        self._apply(transforms.look_at(self._numbers(statement, 9), statement.place))

    def _on_transform(self, statement: Statement) -> None:
        self._apply(transforms.matrix(self._numbers(statement, 16)), replaces=True)

    def _on_concat_transform(self, statement: Statement) -> None:
        self._apply(transforms.matrix(self._numbers(statement, 16)))

    def _on_coordinate_system(self, statement: Statement) -> None:
        self._named[self._name(statement)] = self._state.ctm

    def _on_coord_sys_transform(self, statement: Statement) -> None:
        name = self._name(statement)
        if name not in self._named:
            raise statement.place.error(
                Sentence(
                    "pbrt-coordinate-system-unknown",
                    "there is no coordinate system {name}; define it with CoordinateSystem first",
                    name=repr(name[:60]),
                )
            )
        self._state.ctm = self._named[name]

    def _on_active_transform(self, statement: Statement) -> None:
        """Ignores ActiveTransform: its argument (StartTime, EndTime or All) is parsed as a directive of its own."""

    def _on_start_time(self, statement: Statement) -> None:
        self._state.active = (True, False)

    def _on_end_time(self, statement: Statement) -> None:
        self._state.active = (False, True)

    def _on_all(self, statement: Statement) -> None:
        self._state.active = (True, True)

    def _on_transform_times(self, statement: Statement) -> None:
        start, end = (float(v) for v in self._numbers(statement, 2))
        if not start < end:
            raise statement.place.error(Sentence("pbrt-transform-times-malformed", "TransformTimes needs a time and a later one"))
        self._times = start, end

    # Blocks

    def _save(self, statement: Statement) -> None:
        if len(self._saved) >= _MOST_STATES:
            raise statement.place.error(
                Sentence(
                    "pbrt-blocks-nested-too-deep",
                    "blocks are nested more than {most} levels deep; flatten them",
                    most=_MOST_STATES,
                )
            )
        self._saved.append((statement.directive, replace(self._state)))

    def _restore(self, statement: Statement, opened: str) -> _State:
        if not self._saved or self._saved[-1][0] != opened:
            raise statement.place.error(
                Sentence(
                    "pbrt-block-end-unmatched",
                    "{directive} has no matching {block}; remove it",
                    directive=statement.directive,
                    block=opened,
                )
            )
        return self._saved.pop()[1]

    def _on_attribute_begin(self, statement: Statement) -> None:
        self._save(statement)

    def _on_attribute_end(self, statement: Statement) -> None:
        self._state = self._restore(statement, "AttributeBegin")

    def _on_transform_begin(self, statement: Statement) -> None:
        self._save(statement)

    def _on_transform_end(self, statement: Statement) -> None:
        found = self._restore(statement, "TransformBegin")
        self._state = replace(self._state, ctm=found.ctm, active=found.active)

    def _on_object_begin(self, statement: Statement) -> None:
        shapes = self._world_shapes(statement)
        if shapes.in_object:
            raise statement.place.error(
                Sentence("pbrt-object-nested", "an object cannot be defined within another; end the first one before")
            )
        self._save(statement)
        shapes.begin(self._name(statement))

    def _on_object_end(self, statement: Statement) -> None:
        self._state = self._restore(statement, "ObjectBegin")
        self._world_shapes(statement).end_object()

    def _on_object_instance(self, statement: Statement) -> None:
        shapes = self._world_shapes(statement)
        if shapes.in_object:
            raise statement.place.error(
                Sentence("pbrt-object-instance-nested", "an object cannot contain an instance of another; move it out")
            )
        shapes.instance(self._name(statement), self._state.ctm, statement.place)

    def _on_attribute(self, statement: Statement) -> None:
        (target,), found = Parameters.parse("Attribute", statement, 1, self._state.space)
        if target not in _ATTRIBUTES:
            raise statement.place.error(
                Sentence(
                    "pbrt-attribute-target-unknown",
                    "Attribute applies to {targets}, not to {target}; correct it",
                    targets=[*_ATTRIBUTES],
                    target=repr(target[:40]),
                )
            )
        known = dict(self._state.attributes)
        known[target] = known.get(target, {}) | {name: (each, found.used) for name, each in found.values.items()}
        self._state.attributes = known
        self._all.append((found, -1))

    def _on_reverse_orientation(self, statement: Statement) -> None:
        self._state.reverse = not self._state.reverse

    def _on_color_space(self, statement: Statement) -> None:
        name = self._name(statement).lower()
        if name not in SPACES:
            raise statement.place.error(
                Sentence(
                    "pbrt-colour-space-unknown",
                    "{name} is not a colour space of pbrt; known are {spaces}",
                    name=repr(name[:40]),
                    spaces=[*SPACES],
                )
            )
        self._state.space = name

    # Before the world

    def _on_camera(self, statement: Statement) -> None:
        source = self._deferred_parameters(statement, "camera")
        self._camera, self._camera_medium = (source, self._state.ctm), self._state.medium[1]
        back = [transforms.inverse(each, statement.place) for each in self._state.ctm]
        self._named["camera"] = (back[0], back[0] if self._state.ctm[0] is self._state.ctm[1] else back[1])

    def _on_film(self, statement: Statement) -> None:
        self._film = self._deferred_parameters(statement, "film")
        self._rendered = cameras.set_film(self._film, self._description, self._notes)

    def _on_integrator(self, statement: Statement) -> None:
        cameras.set_integrator(self._deferred_parameters(statement, "integrator"), self._description, self._notes)

    def _on_sampler(self, statement: Statement) -> None:
        cameras.set_sampler(self._deferred_parameters(statement, "sampler"), self._description, self._notes)

    def _on_pixel_filter(self, statement: Statement) -> None:
        cameras.set_filter(self._deferred_parameters(statement, "filter"), self._description, self._notes)

    def _on_accelerator(self, statement: Statement) -> None:
        """Ignores the accelerator; the renderer builds its own BVH."""

    def _on_option(self, statement: Statement) -> None:
        note_option(self._name(statement), statement, self._notes)

    def _on_world_begin(self, statement: Statement) -> None:
        if self._shapes is not None:
            raise statement.place.error(Sentence("pbrt-world-begin-repeated", "has a second WorldBegin; remove it"))
        description = self._description
        source = self._camera[0] if self._camera else None
        self._lights.exposure = cameras.exposure_of(source, self._film)
        self._lights.balance = cameras.balance_of(self._film, self._notes)
        opens, closes = (
            sorted((source.number("shutteropen", 0.0), source.number("shutterclose", 1.0))) if source is not None else (0.0, 1.0)
        )
        description.fps = min(max(1 / max(closes - opens, _LEAST_SECONDS), 1e-3), 1e4)
        seconds = (opens + closes) / 2 + self._moment.seconds(description.fps)
        share = (seconds - self._times[0]) / (self._times[1] - self._times[0])
        to_world, outer = np.eye(4), np.eye(4)
        if self._camera is not None:
            to_world = transforms.interpolate(self._named["camera"], share)
            description.moves |= self._named["camera"][0] is not self._named["camera"][1]
        for key, size in (("width", 1280), ("height", 720)):
            description.defaults.setdefault(key, size)
        description.defaults.setdefault("spp", 16)
        description.defaults.setdefault("max_depth", 6)
        description.defaults.setdefault("transmission_depth", 0)
        description.defaults.setdefault("filter", cameras.FILTER)
        if cameras.mirrors(source, to_world):
            outer = cameras.MIRROR
        if self._camera is not None:
            cameras.add_camera(self._camera[0], product(outer, to_world), description, self._notes, self._rendered)
        self._outer = outer
        self._shapes = Shapes(self._files, self._materials, self._lights, self._textures, description, self._notes, outer, share)
        self._state.ctm, self._state.active = (np.eye(4),) * 2, (True, True)
        self._named["world"] = self._state.ctm

    # The world

    def _on_material(self, statement: Statement) -> None:
        self._state.material = self._deferred_parameters(statement, "material")

    def _on_make_named_material(self, statement: Statement) -> None:
        (name,), found = Parameters.parse("material", statement, 1, self._state.space)
        found.type = found.text("type")
        found.defaults = self._state.attributes.get("material", {})
        self._all.append((found, len(found.used)))
        if name in self._materials.named:
            self._notes.add(
                statement.place,
                Sentence(
                    "pbrt-material-redefined",
                    "The material {name} is redefined: later shapes use the new one",
                    name=repr(name[:60]),
                ),
            )
        self._materials.named[name] = found

    def _on_named_material(self, statement: Statement) -> None:
        name = self._name(statement)
        if name not in self._materials.named:
            raise statement.place.error(
                Sentence(
                    "pbrt-material-undefined",
                    "there is no material {name}; define it with MakeNamedMaterial first",
                    name=repr(name[:60]),
                )
            )
        self._state.material = self._materials.named[name]

    def _on_texture(self, statement: Statement) -> None:
        (name, kind, _), found = Parameters.parse("texture", statement, 3, self._state.space)
        if kind not in ("float", "spectrum", "color"):
            raise statement.place.error(
                Sentence("pbrt-texture-kind-unknown", "a texture is of type float or spectrum, not {kind}", kind=repr(kind[:40]))
            )
        found.defaults = self._state.attributes.get("texture", {})
        if ("float" if kind == "float" else "spectrum", name) in self._textures.named:
            self._notes.add(
                statement.place,
                Sentence(
                    "pbrt-texture-redefined",
                    "The texture {name} is redefined: later materials use the new one",
                    name=repr(name[:60]),
                ),
            )
        self._textures.define(name, kind, found, self._state.ctm[0])
        self._all.append((found, len(found.used)))

    def _on_light_source(self, statement: Statement) -> None:
        self._world_shapes(statement)
        source = self._parameters(statement, "light")
        ctm = self._state.ctm
        if ctm[0] is not ctm[1]:
            self._notes.add(statement.place, Sentence("pbrt-light-motion-ignored", "A moving light stands still, as in pbrt"))
        self._lights.add(source, product(self._outer, ctm[0]))
        source.say_unused(self._notes)

    def _on_area_light_source(self, statement: Statement) -> None:
        self._state.area = self._deferred_parameters(statement, "light")

    def _on_shape(self, statement: Statement) -> None:
        shapes = self._world_shapes(statement)
        state = self._state
        source = self._parameters(statement, "shape")
        shapes.add(source, ShapeState(state.ctm, state.material, state.area, state.reverse, state.medium))
        source.say_unused(self._notes)

    def _on_make_named_medium(self, statement: Statement) -> None:
        (name,), found = Parameters.parse("medium", statement, 1, self._state.space)
        found.type = found.text("type")
        found.defaults = self._state.attributes.get("medium", {})
        self._all.append((found, len(found.used)))
        self._media.define(name, found, product(self._outer, self._state.ctm[0]))

    def _on_medium_interface(self, statement: Statement) -> None:
        names = [each for each in statement.arguments if isinstance(each, str)]
        if len(names) != len(statement.arguments) or not 1 <= len(names) <= 2:
            raise statement.place.error(
                Sentence(
                    "pbrt-medium-interface-malformed",
                    "MediumInterface needs one or two names of media in quotes: inside and outside",
                )
            )
        self._state.medium = names[0], names[-1]

    # Helpers

    def _world_shapes(self, statement: Statement) -> Shapes:
        if self._shapes is None:
            raise statement.place.error(
                Sentence(
                    "pbrt-directive-before-world",
                    "{directive} comes before WorldBegin; move it behind",
                    directive=statement.directive,
                )
            )
        return self._shapes

    def _name(self, statement: Statement) -> str:
        first = statement.arguments[0] if statement.arguments else ""
        name = first if isinstance(first, str) else first[0] if isinstance(first, tuple) and first else ""
        if not isinstance(name, str) or not name:
            raise statement.place.error(
                Sentence("pbrt-directive-name-expected", "{directive} needs a name in quotes", directive=statement.directive)
            )
        return name

    def _parameters(self, statement: Statement, what: str) -> Parameters:
        _, found = Parameters.parse(what, statement, 1, self._state.space)
        found.defaults = self._state.attributes.get(what, {})
        return found

    def _deferred_parameters(self, statement: Statement, what: str) -> Parameters:
        """Returns the parameters of a statement that are read only when used; those unused at the end of the scene get a note."""
        found = self._parameters(statement, what)
        self._all.append((found, 0))
        return found


def _directive(method: str) -> str:
    """Returns the directive that a method executes, such as LookAt for `_on_look_at`."""
    return "".join(word.capitalize() for word in method.removeprefix(_ON).split("_"))
