"""Converts an FBX file at a moment to a scene, in metres with Y up."""

from __future__ import annotations

import functools
from collections import Counter
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError, SettingsError
from renderer.scene.animation import Moment
from renderer.scene.description import Camera, Instance, Mesh, SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.origin import in_exact_type
from renderer.scene.readers.fbx import layout, lights
from renderer.scene.readers.fbx.animation import Stacks
from renderer.scene.readers.fbx.library import (
    FbxScene,
    array,
    each,
    is_set,
    is_visible,
    matrix,
    message_of,
    number_of,
    pointed,
    struct_at,
    text,
)
from renderer.scene.readers.fbx.materials import Materials
from renderer.scene.readers.fbx.meshes import Part, is_subdivided, parts_of, subdivided_parts
from renderer.scene.readers.fbx.shapes import Skin, blended, updated_normals
from renderer.scene.readers.fbx.targets import aimed
from renderer.scene.readers.fbx.textures import Pictures
from renderer.scene.readers.shapes import quad
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence, count_of, with_count

__all__ = ["read"]

_VIEW = np.array((1.0, 0.0, 0.0))  # the direction in which a camera looks
_BLENDER = (2, 3)  # ufbx_exporter
_LOD_GROUP = 16  # ufbx_element_type
_DUAL_QUATERNIONS = (2, 3)  # ufbx_skinning_method
_LEFT_OUT = {
    "line_curves": Sentence("fbx-lines", "lines"),
    "nurbs_curves": Sentence("fbx-nurbs-curves", "NURBS curves"),
    "nurbs_surfaces": Sentence("fbx-nurbs-surfaces", "NURBS surfaces"),
    "procedural": Sentence("fbx-procedural-surfaces", "procedural surfaces"),
    "constraints": Sentence("fbx-constraints", "constraints"),
    "caches": Sentence("fbx-geometry-caches", "geometry caches"),
    "camera_switchers": Sentence("fbx-camera-switchers", "camera switchers"),
}
_NOTICES = 8  # warnings of ufbx that are passed on
MAX_NODES = 200_000
MAX_INSTANCES = 500_000


def read(files: SceneFiles, main: str, description: SceneDescription, moment: Moment = Moment()) -> None:
    """Adds the file's scene at a moment to the description.

    Raises SceneError if the file is damaged or the clip does not exist.
    """
    opened = files.get_or_make(("FBX", main), lambda: FbxScene.parse(files.read(main), main))
    if opened.scene.nodes.count > MAX_NODES:
        raise SceneError(
            Sentence(
                "nodes-too-many",
                "{file} has {count} nodes; at most {most} are allowed. Simplify it",
                file=main,
                count=opened.scene.nodes.count,
                most=MAX_NODES,
            )
        )
    stacks = Stacks(opened, main)
    description.clips = stacks.clips
    fps = float(opened.scene.settings.fps)
    if 1e-3 <= fps <= 1e4:
        description.fps = fps
    anim = stacks.selected_animation(moment)
    moving = stacks.animated_elements(anim)
    description.moves |= len(moving) > 0
    seconds = moment.seconds(description.fps)
    needs = anim is not None and bool(moving or opened.nodes_with_ignored_rotation)
    evaluated = opened.evaluate(anim, seconds, main) if anim is not None and needs else opened
    shown = stacks.animated_visibility(anim, evaluated, seconds) if anim is not None else {}
    _Reader(files, main, description, evaluated, moving, shown).read()


class _Reader:
    """Converts a scene parsed by ufbx to a scene description."""

    def __init__(
        self,
        files: SceneFiles,
        main: str,
        description: SceneDescription,
        opened: FbxScene,
        moving: set[int],
        visible: dict[int, bool],
    ) -> None:
        self._visible = visible  # visibility of nodes by id, if animation overrides it
        self._files, self._main, self._description, self._opened, self._moving = files, main, description, opened, moving
        scene = opened.scene
        self._scene = scene
        self._by_blender = scene.metadata.exporter in _BLENDER
        self._shelf = TextureShelf(description, files)
        pictures = Pictures(scene, main, files, self._shelf, self._by_blender)
        self._materials = Materials(pictures, self._shelf, description.materials, float(scene.settings.unit))
        self._numbers: dict[tuple[int, int], int] = {}
        self._names: Counter[str] = Counter()
        self._odd: Counter[str] = Counter()
        self._restless: set[int] = set()  # ids of nodes that move

    def read(self) -> None:
        """Adds all meshes, lights and cameras to the description."""
        first = len(self._description.instances)
        nodes = pointed(self._scene.nodes, layout.Node)
        shown, restless = self._visible_nodes(nodes)
        self._restless = restless
        for node in nodes:
            if node.mesh and node.element_id in shown:
                self._add_instances(node, node.element_id in restless)
        middle = self._bounds_centre(first)
        for node in nodes:
            if node.light and node.element_id in shown:
                self._light(node, middle, node.element_id in restless)
        for node in sorted((node for node in nodes if node.camera), key=self._rank):
            self._camera(node)
        self._warn()

    def _visible_nodes(self, nodes: list[Any]) -> tuple[set[int], set[int]]:
        """Returns the ids of the visible nodes, and those of the nodes that move. nodes: in an order that has parents first."""
        shown: set[int] = set()
        restless: set[int] = set()
        for node in nodes:
            parent = struct_at(layout.Node, node.parent)
            if node.element_id in self._moving or (parent is not None and parent.element_id in restless):
                restless.add(node.element_id)
            if parent is not None and parent.attrib_type == _LOD_GROUP and self._is_coarse(node, parent):
                self._odd[Sentence("fbx-coarser-lods", "coarser levels of detail")] += 1
            elif self._is_visible(node) and (parent is None or parent.element_id in shown):
                shown.add(node.element_id)
            elif not self._is_visible(node) and (parent is None or parent.element_id in shown):
                self._odd[Sentence("fbx-hidden-nodes", "hidden nodes")] += 1
        return shown, restless

    def _is_visible(self, node: Any) -> bool:
        return self._visible.get(node.element_id, is_visible(node))

    @staticmethod
    def _is_coarse(node: Any, parent: Any) -> bool:
        first = pointed(parent.children, layout.Node, max_count=1)
        return bool(first) and first[0].element_id != node.element_id

    def _add_instances(self, node: Any, moves: bool) -> None:
        mesh = struct_at(layout.Mesh, node.mesh)
        world = self._finite(matrix(node.geometry_to_world), node)
        made_once = ("FBX parts", self._main, mesh.element_id)
        bends = bool(mesh.blends.count) or bool(mesh.skins.count)
        fine: npt.NDArray[np.float64] | None = None
        if is_subdivided(mesh) and not bends:
            unfilled = 0
            parts, fine = self._files.get_or_make(("FBX subdivided", *made_once), functools.partial(subdivided_parts, mesh))
        else:
            parts, unfilled = self._files.get_or_make(made_once, functools.partial(parts_of, mesh))
        if unfilled:
            self._odd[Sentence("unit-concave-polygons", "concave polygons, filled as if convex")] += unfilled
        if not parts:
            self._odd[Sentence("fbx-meshes-without-faces", "meshes without faces")] += 1
            return
        name = self._unique(text(node.name) or text(mesh.name) or "mesh")
        self._note_deformers(mesh)
        slots = pointed(node.materials, layout.Material) or pointed(mesh.materials, layout.Material)
        skins = pointed(mesh.skins, layout.SkinDeformer)
        source = int(mesh.element_id) if not skins else -1 - int(node.element_id)
        is_new = any((source, part.slot) not in self._numbers for part in parts)
        made = self._deformed_parts(node, mesh, parts, skins, world) if bends and is_new else None
        if len(self._description.instances) + len(parts) > MAX_INSTANCES:
            raise SceneError(
                Sentence(
                    "fbx-mesh-parts-too-many",
                    "{file} shows more than {most} mesh parts; simplify it",
                    file=self._main,
                    most=MAX_INSTANCES,
                )
            )
        for i, part in enumerate(parts):
            if slots and part.slot >= len(slots):
                self._odd[Sentence("fbx-parts-without-material", "mesh parts whose material is missing, shown grey")] += 1
            material = self._materials.number(slots[part.slot] if part.slot < len(slots) else None)
            key = (source, part.slot)
            if key not in self._numbers:
                if made is not None:
                    found = made[i]
                    found.deforms = self._deforms(mesh, skins, moves)
                else:
                    points = self._files.get_or_make(
                        ("FBX points", self._main, mesh.element_id, part.slot), functools.partial(_points, mesh, part, fine)
                    )
                    found = _mesh(name, part, points, part.normals)
                found.material = material
                if found.colors is not None and self._description.materials[material].base_color_texture is not None:
                    found.colors = None  # they are masks for games or tools: no program that writes FBX tints textures by them
                    self._odd[Sentence("fbx-vertex-colours-textured", "vertex colours of textured meshes")] += 1
                self._description.meshes.append(found)
                self._numbers[key] = len(self._description.meshes) - 1
            number = self._numbers[key]
            own = None if self._description.meshes[number].material == material else material
            place = np.eye(4) if skins else world
            restless = (moves and not skins) or self._description.meshes[number].deforms
            self._description.instances.append(Instance(number, place, own, name, restless))

    def _deformed_parts(
        self, node: Any, mesh: Any, parts: list[Part], skins: list[Any], world: npt.NDArray[np.float64]
    ) -> list[Mesh]:
        """Returns the parts of a mesh, deformed by the mesh's blend shapes and skin.

        They are in world space if the mesh has a skin, otherwise in object space.
        """
        rest = array(mesh.vertices, np.float64, 3)
        points, added = blended(mesh)
        made = []
        skin = None
        if skins:
            skin = self._files.get_or_make(("FBX skin", self._main, mesh.element_id), functools.partial(Skin, skins[0]))
            places = self._finite(Skin.joint_transforms(skins[0], world), node)
        for part in parts:
            normals = updated_normals(part, rest, points) if added is None else None
            if added is not None and part.normals is not None:
                normals = (part.normals + added[part.point]).astype(np.float32)
            if skin is None:
                made.append(_mesh(text(mesh.name), part, in_exact_type(points[part.point]), normals))
                continue
            placed, turned = skin.deformed(part, points, normals, places)
            made.append(_mesh(text(mesh.name), part, placed, turned))
            if np.linalg.det(world[:3, :3]) < 0:
                made[-1].triangles = np.ascontiguousarray(made[-1].triangles[:, ::-1])
        return made

    def _deforms(self, mesh: Any, skins: list[Any], moves: bool) -> bool:
        """Returns True if a mesh's vertices change over time. moves: whether the node with the mesh is animated."""
        channels = [
            c for blend in pointed(mesh.blends, layout.BlendDeformer) for c in pointed(blend.channels, layout.BlendChannel)
        ]
        if any(channel.element_id in self._moving for channel in channels):
            return True
        bones = [cluster.bone for skin in skins for cluster in pointed(skin.clusters, layout.SkinCluster)]
        carriers = (struct_at(layout.Node, bone) for bone in bones)
        return bool(skins) and (moves or any(node is not None and node.element_id in self._restless for node in carriers))

    def _note_deformers(self, mesh: Any) -> None:
        skins = pointed(mesh.skins, layout.SkinDeformer)
        if len(skins) > 1:
            self._odd[Sentence("fbx-further-skins", "further skins of a mesh")] += len(skins) - 1
        if any(skin.method in _DUAL_QUATERNIONS for skin in skins):
            self._shelf.warn(Sentence("dual-quaternion-skins", "Dual-quaternion skins are deformed linearly."))
        if is_subdivided(mesh) and (mesh.blends.count or skins):
            self._odd[Sentence("fbx-subdivisions", "subdivision surfaces that deform, shown as their cages")] += 1
        if mesh.color_sets.count > 1:
            self._odd[Sentence("fbx-further-colour-sets", "further sets of vertex colours")] += mesh.color_sets.count - 1
        if mesh.num_lines or mesh.num_points:
            self._odd[Sentence("fbx-loose-edges-points", "loose edges and points of meshes")] += mesh.num_lines + mesh.num_points

    def _bounds_centre(self, first: int) -> npt.NDArray[np.float64]:
        """Returns the centre of the bounding box of the visible geometry. first: index of the file's first instance."""
        corners = []
        for instance in self._description.instances[first:]:
            points = self._description.meshes[instance.mesh].positions
            box = np.stack([points.min(axis=0), points.max(axis=0)]).astype(np.float64)
            corners.append(box @ instance.transform[:3, :3].T + instance.transform[:3, 3])
        if not corners:
            return np.zeros(3)
        every = np.concatenate(corners)
        found: npt.NDArray[np.float64] = (every.min(axis=0) + every.max(axis=0)) / 2
        return found if np.isfinite(found).all() else np.zeros(3)

    def _light(self, node: Any, middle: npt.NDArray[np.float64], moves: bool) -> None:
        light = struct_at(layout.Light, node.light)
        world = self._finite(aimed(node, self._scene, matrix(node.node_to_world), np.array(light.direction)), node)
        name = self._unique(text(node.name) or "light")
        if not is_set(light, b"CastShadows", True):
            self._odd[Sentence("fbx-lights-without-shadows", "lights set to cast no shadows, which cast shadows here")] += 1
        if is_set(light, b"EnableNearAttenuation") or is_set(light, b"EnableFarAttenuation"):
            self._odd[Sentence("fbx-light-ranges", "light ranges, which are ignored")] += 1
        if light.kind == lights.VOLUME or not light.shines:
            self._odd[
                Sentence("fbx-volume-lights", "volume lights")
                if light.kind == lights.VOLUME
                else Sentence("fbx-lights-off", "lights that are switched off")
            ] += 1
        elif lights.is_area(light):
            self._area_light(light, name, world, moves)
        else:
            unit = float(self._scene.settings.unit)
            self._description.lights.append(lights.read_light(light, name, world, self._by_blender, unit, middle))
            if not self._by_blender and light.kind != lights.DIRECTIONAL and light.decay != 2:
                self._odd[
                    Sentence(
                        "fbx-lights-without-falloff",
                        "lights without falloff, which get an inverse-square falloff",
                    )
                ] += 1

    def _area_light(self, light: Any, name: str, world: npt.NDArray[np.float64], moves: bool) -> None:
        self._description.materials.append(lights.area_material(light, name, world, self._by_blender))
        mesh = quad(name)
        mesh.material = len(self._description.materials) - 1
        self._description.meshes.append(mesh)
        place = lights.upright_square(light, world)
        self._description.instances.append(Instance(len(self._description.meshes) - 1, place, name=name, moves=moves))
        self._shelf.warn(
            Sentence(
                "fbx-area-light-size-unknown",
                "FBX does not store the size of area lights: each is a square with a side of one unit of the file, scaled.",
            )
        )

    def _rank(self, node: Any) -> tuple[bool, bool]:
        """Sort key of a camera: the file's default camera first, then perspective cameras."""
        is_flat = struct_at(layout.Camera, node.camera).projection == 1
        return text(node.name) != text(self._scene.settings.camera), is_flat

    def _camera(self, node: Any) -> None:
        name = self._unique(text(node.name) or "camera")
        try:
            world = self._finite(aimed(node, self._scene, matrix(node.node_to_world), _VIEW), node)
            camera = struct_at(layout.Camera, node.camera)
            offset = number_of(camera, b"FilmOffsetX"), number_of(camera, b"FilmOffsetY")
            unit = float(self._scene.settings.unit)
            near = number_of(camera, b"NearPlane") * unit  # 0 if not stored
            tall = float(camera.orthographic[1]) * (1.0 if self._by_blender else unit)
            view = lights.read_camera(camera, world, offset, near, tall)
            if number_of(camera, b"Roll"):
                self._odd[Sentence("fbx-camera-roll", "cameras with roll, which is left out")] += 1
            if is_set(camera, b"UseDepthOfField"):
                self._odd[
                    Sentence(
                        "fbx-camera-depth-of-field",
                        "cameras with depth of field, whose aperture FBX does not store: everything is sharp",
                    )
                ] += 1
        except SettingsError as error:
            self._shelf.warn(Sentence("camera-left-out", "Camera {name}: {error}; it is left out.", name=name, error=error))
            return
        self._description.cameras.append(Camera(name, view))

    def _finite(self, found: npt.NDArray[np.float64], node: Any) -> npt.NDArray[np.float64]:
        if not np.isfinite(found).all():
            raise SceneError(
                Sentence(
                    "node-transform-not-finite",
                    "{file}: {name} has a transform that is not finite; export the file again",
                    file=self._main,
                    name=text(node.name)[:80],
                )
            )
        return found

    def _unique(self, name: str) -> str:
        self._names[name] += 1
        return name if self._names[name] == 1 else f"{name} ({self._names[name]})"

    def _warn(self) -> None:
        """Adds warnings, with counts, for content of the file that is not fully supported."""
        for key, words in _LEFT_OUT.items():
            count = getattr(self._scene, key).count
            if count:
                self._odd[words] += count
        self._odd.update(self._materials.guessed)
        if self._odd:
            listed = [count_of(count, words) for words, count in self._odd.items()]
            self._shelf.warn(
                Sentence(
                    "fbx-features-not-read", "Features of the FBX file that are not fully supported: {features}.", features=listed
                )
            )
        notices = each(self._scene.metadata.warnings, layout.Notice)
        if len(notices) > _NOTICES:
            self._shelf.warn(
                Sentence(
                    "fbx-importer-messages-more",
                    "{file}: {count} more importer warnings are not listed.",
                    file=self._main,
                    count=len(notices) - _NOTICES,
                )
            )
        for notice in notices[:_NOTICES]:
            said = with_count(message_of(notice), notice.count)
            self._shelf.warn(Sentence("importer-message", "{file}: importer message: {text}.", file=self._main, text=said))


def _points(mesh: Any, part: Part, fine: npt.NDArray[np.float64] | None) -> npt.NDArray[Any]:
    """Returns the positions of a part's vertices. fine: the points of the subdivided mesh; None: the mesh's own."""
    return in_exact_type((array(mesh.vertices, np.float64, 3) if fine is None else fine)[part.point])


def _mesh(name: str, part: Part, points: npt.NDArray[Any], normals: npt.NDArray[np.float32] | None) -> Mesh:
    return Mesh(name, points, part.triangles, normals, part.uvs, 0, part.uvs1, part.colors)
