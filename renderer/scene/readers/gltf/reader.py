"""Reads a glTF file as a scene; at further moments, updates only its animated parts."""

from __future__ import annotations

from renderer.errors import SceneError
from renderer.scene.animation import Moment
from renderer.scene.description import SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.readers.gltf import (
    animation,
    draco,
    instancing,
    lights,
    materials,
    meshopt,
    nodes,
    profiles,
    textures,
    variants,
)
from renderer.scene.readers.gltf.accessors import Accessors
from renderer.scene.readers.gltf.container import Json, parse
from renderer.scene.readers.gltf.meshes import Meshes
from renderer.scene.readers.gltf.moving import AnimatedParts
from renderer.scene.readers.gltf.reevaluate import Reevaluation
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence

__all__ = ["read"]

_SUPPORTED_EXTENSIONS = {
    animation.EXTENSION,
    draco.EXTENSION,
    instancing.EXTENSION,
    lights.EXTENSION,
    nodes.VISIBILITY,
    nodes.RAYS,
    profiles.EXTENSION,
    variants.EXTENSION,
    "KHR_mesh_quantization",
    *materials.EXTENSIONS,
    *meshopt.EXTENSIONS,
    *textures.EXTENSIONS,
}
_CHARACTER_PREFIX = "VRM"  # poses and toon shading; the surfaces are plain glTF
_WITHOUT_EFFECT = {"KHR_xmp_json_ld"}  # metadata


def read(
    files: SceneFiles,
    main: str,
    description: SceneDescription,
    variant: str | None = None,
    moment: Moment = Moment(),
    thickness: float | None = None,
) -> None:
    """Adds the file's default scene at a moment to the description.

    variant: name of the material variant; None for the file's own materials. thickness: width of points and lines; None leaves
    them out. Raises SceneError if the file cannot be read or the variant or clip does not exist.
    """
    key = ("glTF again", main, variant, moment.clip, thickness)
    is_alone = not description.materials and not description.meshes
    known: Reevaluation | None = files.stored(key) if is_alone else None
    if known is not None and known.fill_at(moment, description):
        return
    meshes_before = len(description.meshes)
    root, binary = files.get_or_make(("glTF", main), lambda: parse(files.read(main), main))
    shelf = TextureShelf(description, files)
    _check_extensions(root, shelf)
    accessors = Accessors(root, binary, files)
    moving = animation.Animations(root, accessors, files)
    description.clips = moving.clips
    description.moves |= len(moving.clips) > 0
    root = moving.root_at(moment)
    for sentence in moving.warnings:
        shelf.warn(sentence)
    surfaces = materials.Materials(root, textures.Textures(root, accessors, files, shelf), shelf, description.materials)
    chosen = variants.Variants(root, variant)
    description.variants = chosen.names
    restless = AnimatedParts(root, moving.moving)
    meshes = Meshes(root, accessors, files, surfaces, chosen, shelf, description.meshes, restless, thickness)
    shaping = profiles.Profiles(root, accessors, files, shelf)
    walked = nodes.Nodes(root, accessors, meshes, shelf, description, restless, shaping)
    walked.add_scene()
    root.faults.pass_on(shelf.warn)
    if root.faults.first is not None and len(description.meshes) == meshes_before:
        raise root.faults.first
    if is_alone and moving.clips and restless.only_transforms_move and not any(meshes.refracts(m) for m in walked.deforming()):
        files.store(key, Reevaluation(moving, walked, description))


def _check_extensions(root: Json, shelf: TextureShelf) -> None:
    for key in ("extensionsRequired", "extensionsUsed"):
        names = root.value.get(key, [])
        if not isinstance(names, list) or not all(isinstance(n, str) for n in names):
            raise root.damage(key, Sentence("gltf-not-name-list", "is not a list of names"))
        unknown = [n[:60] for n in names if n not in _SUPPORTED_EXTENSIONS and n not in _WITHOUT_EFFECT]
        needed = [name for name in unknown if not name.startswith(_CHARACTER_PREFIX)]
        if needed and key == "extensionsRequired":
            raise SceneError(
                Sentence(
                    "gltf-extension-required",
                    "{file}: needs {extensions}, which is not supported; export it without",
                    file=root.file,
                    extensions=[*needed[:8]],
                )
            )
        if unknown:
            shelf.warn(
                Sentence("gltf-extensions-left-out", "Not supported and left out: {extensions}.", extensions=[*unknown[:20]])
            )
