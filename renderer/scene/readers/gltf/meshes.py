"""glTF meshes with their materials; each is read when a node first uses it."""

from __future__ import annotations

import functools
from collections.abc import Iterable

import numpy as np

from renderer.errors import SceneError
from renderer.scene.description import Mesh
from renderer.scene.files import SceneFiles
from renderer.scene.readers.gltf.accessors import Accessors
from renderer.scene.readers.gltf.container import Json
from renderer.scene.readers.gltf.deform import morphed, skinned
from renderer.scene.readers.gltf.faults import DamagedError
from renderer.scene.readers.gltf.materials import Materials, NodeLook
from renderer.scene.readers.gltf.moving import AnimatedParts
from renderer.scene.readers.gltf.primitives import Primitive, read_primitive
from renderer.scene.readers.gltf.transforms import Matrix
from renderer.scene.readers.gltf.variants import Variants
from renderer.scene.readers.tubes import elliptic
from renderer.scene.textures import TextureShelf
from renderer.scene.watertight import is_closed
from renderer.sentences import Sentence

__all__ = ["Meshes"]

MAX_VERTICES = 1 << 26
_RING = 6  # vertices around a fibre of hair, in files from Blender (SIDES of blender/rayfarm_addon/scene/tubes.py)


class Meshes:
    """Reads the file's meshes and adds them to the description."""

    def __init__(
        self,
        root: Json,
        accessors: Accessors,
        files: SceneFiles,
        materials: Materials,
        variants: Variants,
        shelf: TextureShelf,
        meshes: list[Mesh],
        moving: AnimatedParts,
        thickness: float | None = None,
    ) -> None:
        self._thickness = thickness
        self.sources = root.objects("meshes")
        self._variants = variants
        self._accessors, self._files = accessors, files
        self._materials, self._shelf, self._meshes, self._moving = materials, shelf, meshes, moving
        self.restless: set[int] = set()  # the description's meshes with animated emission or shape
        self._file, self._vertices = root.file, 0
        self._sources: dict[int, list[tuple[Primitive, int | None]]] = {}
        self._shaped: dict[tuple[int, tuple[float, ...], str | None], list[int]] = {}

    def name(self, index: int) -> str:
        """Returns the name of a mesh in the file."""
        return self.sources[index].text("name", "") or f"mesh {index}"

    def indices_of(self, index: int, node: Json) -> list[int]:
        """Returns the indices, in the scene description, of a mesh's primitives with a node's morph weights applied."""
        weights, alone = self._weights(index, node), self._moving.unshared_shape_key(node)
        if (index, weights, alone) not in self._shaped:
            shaped = [(mesh, m) for mesh, (_, m) in zip(self.shapes(index, node), self._primitives(index), strict=True)]
            self._shaped[index, weights, alone] = self._add(shaped, self._moving.reshapes(index, node))
        return self._shaped[index, weights, alone]

    def shapes(self, index: int, node: Json, matrices: Matrix | None = None) -> list[Mesh]:
        """Returns a mesh's primitives, without materials, deformed by a node's morph weights and by its skin, if any.

        matrices: (J, 4, 4) of the skin's joints; None for no skin. Raises DamagedError if the mesh refers to more joints.
        """
        weights = self._weights(index, node)
        found = []
        for primitive, material in self._primitives(index):
            mesh, bones = morphed(primitive.mesh, primitive.targets, weights, self._accessors), primitive.bones
            if matrices is not None and bones is not None:
                if bones.joints.max(initial=0) >= len(matrices):
                    raise node.damage(
                        "skin",
                        Sentence(
                            "gltf-joint-count-wrong",
                            "has {found} joints, but the mesh refers to {expected}",
                            found=len(matrices),
                            expected=int(bones.joints.max()) + 1,
                        ),
                    )
                mesh = skinned(mesh, bones, matrices)
            aspect = self._materials.aspect_ratio(material)
            if mesh.diameters is not None and aspect < 1 and len(mesh.positions) % _RING == 0:
                mesh = elliptic(mesh, _RING, aspect)
            found.append(mesh)
        return found

    def skinned(self, index: int, node: Json, matrices: Matrix, moves: bool) -> list[int]:
        """Adds a mesh's primitives, deformed by a skin, to the description in world space; returns their indices there.

        Primitives deformed for one node are not used for others. matrices: (J, 4, 4) of the joints; moves: whether joints are
        animated.
        """
        placed = [(mesh, m) for mesh, (_, m) in zip(self.shapes(index, node, matrices), self._primitives(index), strict=True)]
        return self._add(placed, moves or self._moving.reshapes(index, node))

    def replace_sources(self, root: Json, meshes: Iterable[int]) -> None:
        """Replaces the JSON of the meshes whose morph weights are animated."""
        for index in meshes:
            self.sources[index] = Json(root.file, self.sources[index].where, root.value["meshes"][index], root.faults)

    def material_of_node(self, number: int, look: NodeLook) -> int:
        """Returns the index of a copy of a mesh's material with the properties of a node; see `Materials.of_node`."""
        return self._materials.of_node(self._meshes[number].material, look)

    def refracts(self, index: int) -> bool:
        """Returns True if a part of a mesh transmits light, so that its material depends on whether the mesh is closed."""
        return any(m is not None and self._materials.depends_on_mesh(m) for _, m in self._primitives(index))

    def _primitives(self, index: int) -> list[tuple[Primitive, int | None]]:
        if index not in self._sources:
            self._sources[index] = []
            for source in self.sources[index].objects("primitives"):
                material = self._variants.material_of(source, self._materials.sources)
                uv_sets = self._materials.uv_sets(material)
                primitive = self._files.get_or_make(
                    ("primitive", self._file, source.where, self._thickness, uv_sets),
                    functools.partial(self._read, source, index, uv_sets),
                )
                if primitive is not None:
                    self._sources[index].append((primitive, material))
        return self._sources[index]

    def _read(self, source: Json, index: int, uv_sets: tuple[int, ...]) -> Primitive | None:
        try:
            return read_primitive(source, self.name(index), self._accessors, self._shelf, self._thickness, uv_sets)
        except DamagedError as fault:
            source.faults.add(fault)
            return None

    def _weights(self, index: int, node: Json) -> tuple[float, ...]:
        return (node if "weights" in node else self.sources[index]).numbers("weights")

    def _add(self, primitives: list[tuple[Mesh, int | None]], deforms: bool) -> list[int]:
        for mesh, material in primitives:
            mesh.material, mesh.deforms = self._materials.number(material), deforms
        self._make_open_glass_thin(primitives)
        self._vertices += sum(len(mesh.positions) for mesh, _ in primitives)
        if self._vertices > MAX_VERTICES:
            raise SceneError(
                Sentence(
                    "gltf-mesh-vertices-too-many",
                    "{file}: its meshes have more than {most} vertices, counting each pose of a skinned mesh",
                    file=self._file,
                    most=MAX_VERTICES,
                )
            )
        first = len(self._meshes)
        self._meshes += [mesh for mesh, _ in primitives]
        self.restless |= {first + i for i, (_, material) in enumerate(primitives) if material in self._moving.surfaces}
        return list(range(first, len(self._meshes)))

    def _make_open_glass_thin(self, primitives: list[tuple[Mesh, int | None]]) -> None:
        """Makes transmissive primitives thin unless they enclose a volume, alone or together with the mesh's other ones."""
        transparent = [(mesh, m) for mesh, m in primitives if m is not None and self._materials.depends_on_mesh(m)]
        if not transparent or _bound_a_volume([mesh for mesh, _ in primitives]):
            return
        for mesh, material in transparent:
            if len(primitives) == 1 or not is_closed(mesh.positions, mesh.triangles):
                mesh.material = self._materials.thin_material(material)


def _bound_a_volume(meshes: list[Mesh]) -> bool:
    offsets = np.cumsum([0, *(len(m.positions) for m in meshes)])
    positions = np.concatenate([m.positions for m in meshes])
    return is_closed(positions, np.concatenate([m.triangles + o for m, o in zip(meshes, offsets, strict=False)]))
