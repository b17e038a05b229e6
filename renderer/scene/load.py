"""Loads a scene: reads a folder of untrusted files into a SceneDescription."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import reduce
from pathlib import Path, PurePosixPath
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.formats import MESH_FORMATS
from renderer.scene.animation import BETWEEN, SHUTTER, Moment, Shutter
from renderer.scene.bounds import bounds_of
from renderer.scene.description import F32, Environment, Material, Mesh, SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.presets import is_named, light_by_name
from renderer.scene.readers.by_format import read_file
from renderer.scene.readers.file_damage import plain_error
from renderer.scene.readers.polygon_meshes import of_triangles, triangulated
from renderer.scene.readers.up_axis import turn_up
from renderer.scene.shutter_merge import interpolate_numbered_files, merge_over_shutter
from renderer.scene.studio import NO_LIGHTS_WARNING, add_floor, light_studio
from renderer.scene.textures import TextureShelf
from renderer.scene.vary import keeps_surfaces, varied
from renderer.sentences import Sentence, first_items, joined_faults, reason_of, with_full_stop
from renderer.settings import chosen
from renderer.variation import Variation

__all__ = ["Shot", "environment_light", "read"]

F64 = npt.NDArray[np.float64]

_START = Moment()
_ATTRIBUTES = ("normals", "uvs", "uvs1", "colors", "tangents", "diameters")
_MOST_ENVIRONMENTS = 8  # whose images are kept in memory
_REASONS = 3  # warnings, or meshes, that a sentence lists


class Shot:
    """An animated scene, read frame by frame; data that is the same in all frames is read once.

    Its arguments are those of `read`; `main` may be a file name pattern such as smoke.####.obj, with one file per frame.
    variation: varies the scene from frame to frame (renderer/scene/vary.py); a static scene is then read once.
    """

    def __init__(
        self,
        folder: Path,
        main: str,
        environment: str | None = None,
        variant: str | None = None,
        up: str | None = None,
        floor: str | None = None,
        variation: Variation | None = None,
    ) -> None:
        self._files = SceneFiles(folder, environment)
        self._main, self._environment, self._variant = main, environment, variant
        self._up, self._floor = up, floor
        self._variation = variation
        self._static: SceneDescription | None = None  # the unvaried scene, if it does not move
        self._static_token = object()  # `still` of its variations
        self._environments: dict[str, SceneDescription] = {}  # by name, those that were chosen last
        self._boxes: dict[str | None, F64] = {}  # bounds at the beginning of each clip, for the height of the floor
        self._finite: dict[int, F32] = {}  # positions already checked, by identity

    @property
    def start(self) -> float:
        """The first frame: 0, or for numbered files the first frame that exists."""
        return float(next(iter(self._files.frames_of(self._main)), 0))

    def scene_at(self, moment: Moment = _START) -> SceneDescription:
        """Returns the scene at a moment, varied as its frame is; the result does not depend on earlier calls.

        Raises SceneError under the conditions of `read`, and SettingsError if the variation does not fit the scene.
        """
        if self._variation is None:
            return self.unvaried_at(moment)
        base = self._static or self.unvaried_at(moment)
        if not base.moves:
            self._static = base
        found = varied(base, self._variation, self._variation.number_of(moment.frame), self._set_environment)
        keeps = keeps_surfaces(self._variation)
        found.still = (base.still if base.moves else self._static_token) if keeps else None
        return found

    def _set_environment(self, name: str, description: SceneDescription) -> None:
        """Replaces a scene's environment as `environment_light` does; images that were read for an earlier frame are kept."""
        known = self._environments.pop(name, None)
        if known is None:
            known = SceneDescription()
            environment_light(self._files, name, known)
        self._environments[name] = known
        while len(self._environments) > _MOST_ENVIRONMENTS:
            del self._environments[next(iter(self._environments))]
        light = known.environment
        assert light is not None
        if light.image is not None:
            description.images.append(known.images[light.image])
            light = replace(light, image=len(description.images) - 1)
        description.environment = light

    def unvaried_at(self, moment: Moment = _START) -> SceneDescription:
        """Returns the scene at a moment as its files describe it. Raises SceneError under the conditions of `read`."""
        description = self._read(moment)
        is_lit = description.environment is not None or _emits(description)
        if self._environment is not None:
            environment_light(self._files, self._environment, description)
        if description.environment is None and not _emits(description):
            light_studio(description)
            description.warnings.append(NO_LIGHTS_WARNING)
        if self._floor == "on" or (self._floor == "auto" and not is_lit):
            add_floor(description, self._box_at_start(moment, description))
        return description

    def _box_at_start(self, moment: Moment, description: SceneDescription) -> F64:
        """Returns the bounds (2, 3) of the scene in the shot's first frame.

        The studio's floor is placed below these bounds in all frames, since it must not move with the scene.
        """
        if not description.moves:
            return bounds_of(description)
        if moment.clip not in self._boxes:
            start = replace(moment, frame=self.start, offset=0.0)
            self._boxes[moment.clip] = bounds_of(description if moment == start else self._read(start))
        return self._boxes[moment.clip]

    def _read(self, moment: Moment) -> SceneDescription:
        """Returns the scene at a moment as its file describes it, without default lighting."""
        self._files.read_anew()
        main = self._files.at_frame(self._main, moment.frame, ".")
        description = SceneDescription(name=PurePosixPath(main).stem, moves=main != self._main)
        format = read_file(self._files, main, description, self._variant, moment=moment)
        if main != self._main:
            for mesh in description.meshes:
                mesh.deforms = True
        self._check_positions(main, description)
        try:
            _check(main, description)
        except SceneError as error:  # such as a picture that is named as a scene of text
            raise plain_error(self._files.path(main), main, error) or error from None
        turn_up(main, format, self._up, description, guesses=main == self._main)
        description.studio_for_accents = any(main.lower().endswith(f.suffix) for f in MESH_FORMATS)
        return description

    def _check_positions(self, main: str, description: SceneDescription) -> None:
        known, self._finite = self._finite, {}
        for i, mesh in enumerate(description.meshes):
            if id(mesh.positions) not in known and not np.isfinite(mesh.positions).all():
                title = Sentence("mesh-of-file", "{file}: mesh {name}", file=main, name=mesh.name[:120])
                if not len(mesh.triangles):
                    description.meshes[i] = _without_triangles(mesh)
                    continue
                if mesh.deforms or mesh.keys:
                    raise SceneError(
                        Sentence(
                            "scene-positions-not-finite",
                            "{title} contains positions that are not finite numbers; export the file again",
                            title=title,
                        )
                    )
                corners, shelf = mesh.triangles.reshape(-1), TextureShelf(description, self._files)
                try:
                    whole = triangulated(np.full(len(mesh.triangles), 3), corners, mesh.positions, title, shelf).face
                except SceneError as error:  # no triangle is left: without the mesh, the others can be shown
                    description.warnings.append(with_full_stop(error))
                    description.meshes[i] = _without_triangles(mesh)
                    continue
                mesh = description.meshes[i] = of_triangles(mesh, whole)
            self._finite[id(mesh.positions)] = mesh.positions
        self._check_attributes(main, description, known)

    def _check_attributes(self, main: str, description: SceneDescription, known: dict[int, F32]) -> None:
        """Removes mesh attributes with non-finite values, and adds a warning with the number of affected meshes.

        known: attributes that were checked for an earlier frame, compared by identity and not checked again.
        """
        left_out: dict[str, list[str]] = {}
        for mesh in description.meshes:
            for name in _ATTRIBUTES:
                values: F32 | None = getattr(mesh, name)
                if values is None:
                    continue
                if id(values) not in known and not np.isfinite(values).all():
                    setattr(mesh, name, None)
                    left_out.setdefault(name, []).append(mesh.name)
                    continue
                self._finite[id(values)] = values
        for name, meshes in left_out.items():
            description.warnings.append(
                Sentence(
                    "mesh-attribute-not-finite",
                    "{file}: values of {name} that are not finite numbers are left out, in {count} meshes: {meshes}.",
                    file=main,
                    name=name,
                    count=len(meshes),
                    meshes=first_items((each[:60] for each in meshes), _REASONS),
                )
            )

    def over_shutter(self, moment: Moment = _START, requested: Mapping[str, Any] = MappingProxyType({})) -> SceneDescription:
        """Returns the scene while the shutter is open, with keys for moving objects; without a shutter, the scene at the moment.

        requested: the requested shutter settings; those that are missing are taken from the file. Raises SceneError if a moment
        cannot be read.
        """
        if requested.get("shutter") == 0:
            return self.scene_at(moment)
        first = self.scene_at(moment)
        shutter = Shutter.from_settings(chosen({name: requested.get(name) for name in SHUTTER}, first.defaults))
        if shutter.length == 0 or not first.moves or self._static is not None:
            return first
        moving = merge_over_shutter(lambda each: first if each == moment else self.scene_at(each), moment, shutter)
        if self._files.is_numbered:
            interpolate_numbered_files(
                moving, shutter, self._read_neighbouring_files(moment, -1.0), self._read_neighbouring_files(moment, 1.0)
            )
        return moving

    def between_frames(self, moment: Moment = _START, shutter: Shutter = BETWEEN) -> SceneDescription:
        """Returns the scene from the previous frame to the next, with three keys for moving objects: the input of motion vectors.

        shutter: another time around the moment, with other keys. If a neighbouring frame is empty or cannot be read, returns the
        scene at the moment. Raises SceneError if that cannot be read.
        """
        try:
            return self.over_shutter(moment, dict(zip(SHUTTER, (shutter.length, shutter.at, shutter.keys), strict=True)))
        except SceneError:
            return self.scene_at(moment)

    def _read_neighbouring_files(self, moment: Moment, frames: float) -> SceneDescription | None:
        """Reads a sequence of numbered files at a moment, but from the files whose numbers are `frames` greater.

        Returns None if these files cannot be read.
        """
        if moment.frame + frames < 0:
            return None
        try:
            return self.scene_at(replace(moment, frame=moment.frame + frames, offset=moment.offset - frames))
        except SceneError:
            return None


def read(
    folder: Path,
    main: str,
    environment: str | None = None,
    variant: str | None = None,
    moment: Moment = _START,
    up: str | None = None,
    floor: str | None = None,
) -> SceneDescription:
    """Reads the scene in file `main` of a folder. Names are relative to the folder, with forward slashes.

    environment: replaces the scene's environment: an HDR image of the folder, a sky "sky:ELEVATION[,AZIMUTH]"
    (renderer/scene/sky.py), or the name of a preset (renderer/presets.py). variant: a material variant of a glTF file, by name or
    index from 0. moment: the time of an animated scene; by default its beginning. up: the axis of an OBJ, PLY, STL or OFF file
    that becomes Y (renderer/scene/readers/up_axis.py); None: a guess. floor: "on", or "auto" for scenes whose file has no light:
    adds a floor below the scene, on which its shadows fall.

    A scene without any light gets studio lighting, with a warning. So does, at compile time, a model whose lights are only
    accents (a car's tail lights), except in our own scene format, whose author specifies the lighting. Nothing outside the folder
    is opened. Raises SceneError with a sentence that names the file and a remedy.
    """
    return Shot(folder, main, environment, variant, up, floor).scene_at(moment)


def environment_light(files: SceneFiles, name: str, description: SceneDescription) -> None:
    """Replaces a scene's environment by `name`, which has the form of `read`'s environment.

    Raises SceneError if it is invalid.
    """
    if is_named(name):
        light_by_name(name, description)
        return
    shelf = TextureShelf(description, files)
    found = files.find(name, ".")
    if found is None:
        raise SceneError(
            Sentence("environment-not-in-scene", "{name}: the environment is not among the scene's files; add it", name=name)
        )
    image = shelf.environment_file(found)
    if image is None:
        reason = reason_of(description.warnings[-1]) if description.warnings else name
        raise SceneError(
            Sentence(
                "environment-image-unreadable",
                "The environment cannot be read: {reason}; give an .exr or .hdr image in equirectangular projection",
                reason=reason,
            )
        )
    description.environment = Environment(image=image)


def _without_triangles(mesh: Mesh) -> Mesh:
    return Mesh(mesh.name, np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32), material=mesh.material)


def _check(main: str, description: SceneDescription) -> None:
    if not description.materials:
        description.materials.append(Material())
    shown = sum(len(description.meshes[i.mesh].triangles) for i in description.instances) + len(description.spheres)
    if shown:
        return
    what = Sentence("scene-empty-at-frame", "has no surface at this frame; choose a frame with triangles or spheres")
    if not description.moves:
        what = Sentence("scene-empty", "has no surface: no triangles and no spheres. Export it with its meshes")
    reasons = [warning.rstrip(".") for warning in description.warnings[:_REASONS]]
    if not reasons:
        raise SceneError(Sentence("file-fault", "{file}: {fault}", file=main, fault=what))
    raise SceneError(
        Sentence(
            "file-fault-with-omissions",
            "{file}: {fault}. Left out: {omissions}",
            file=main,
            fault=what,
            omissions=reduce(joined_faults, reasons),
        )
    )


def _emits(description: SceneDescription) -> bool:
    if any(max(light.intensity) > 0 for light in description.lights):
        return True
    used = {s.material for s in description.spheres}
    for instance in description.instances:
        used.add(description.meshes[instance.mesh].material if instance.material is None else instance.material)
    return any(max(description.materials[m].emission) > 0 for m in used)
