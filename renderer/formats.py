"""Recognises scene files by name, and chooses the main one among several. Opens no files, so the service uses it too."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import PurePosixPath
from typing import NamedTuple

from renderer.errors import SceneError
from renderer.sentences import Sentence, first_items

__all__ = [
    "ARCHIVE_SUFFIXES",
    "BY_BLENDER",
    "COLOR_CONFIG",
    "FOREIGN",
    "FORMATS",
    "LONG_TAIL",
    "MESH_FORMATS",
    "NAMING_SUFFIXES",
    "SCENE_SUFFIXES",
    "UP_AXES",
    "WITHOUT_BLENDER",
    "Format",
    "is_junk",
    "nested_archives",
    "pick_main",
]


class Format(NamedTuple):
    """A scene file format, recognised by its file name suffixes."""

    suffix: str
    reader: str  # in renderer/scene/readers
    is_mesh_file: bool = True  # our scene files may place it as a mesh
    names_files: bool = False  # may refer to other files
    has_variants: bool = False  # has material variants
    moves: bool = False  # may be animated
    has_lines: bool = False  # and points, rendered if given a thickness
    up: str = ""  # the customary up axis of a format whose files state none: "y" or "z"


# Formats that assimp reads from a single file, with maintained importers.
LONG_TAIL = (
    *(".3ds", ".x3d", ".lwo", ".lxo", ".ac", ".ac3d", ".x", ".ase", ".b3d", ".cob", ".ms3d", ".dxf", ".amf", ".ogex", ".xgl"),
    *(".zae", ".smd", ".md2", ".md5mesh", ".nff", ".ndo", ".q3o", ".irrmesh", ".iqm", ".pmx"),
)

# Best first: if an upload contains several formats, the one with the most scene information is chosen.
FORMATS = (
    Format(".yaml", "yaml", is_mesh_file=False, names_files=True, moves=True),
    Format(".yml", "yaml", is_mesh_file=False, names_files=True, moves=True),
    Format(".glb", "gltf", names_files=True, has_variants=True, moves=True, has_lines=True),
    Format(".gltf", "gltf", names_files=True, has_variants=True, moves=True, has_lines=True),
    Format(".vrm", "gltf", names_files=True, has_variants=True, moves=True, has_lines=True),
    *(Format(suffix, "usd", names_files=True, has_variants=True, moves=True) for suffix in (".usdz", ".usd", ".usda", ".usdc")),
    Format(".fbx", "fbx", names_files=True, moves=True),
    Format(".pbrt", "pbrt", is_mesh_file=False, names_files=True, moves=True),
    Format(".xml", "mitsuba", is_mesh_file=False, names_files=True),
    Format(".dae", "collada", names_files=True, moves=True),
    Format(".blend", "blend", is_mesh_file=False, names_files=True, moves=True),
    Format(".abc", "blend", is_mesh_file=False, moves=True),
    Format(".obj", "obj", names_files=True, up="y"),
    Format(".3mf", "threemf"),
    Format(".ply", "ply", names_files=True, up="y"),
    Format(".stl", "stl", up="z"),
    Format(".off", "off", up="y"),
    *(Format(suffix, "assimp", names_files=True, moves=True) for suffix in LONG_TAIL),
)
UP_AXES = ("y", "z", "x", "-y", "-z", "-x")  # axes of a file that may become Y
MESH_FORMATS = tuple(format for format in FORMATS if format.is_mesh_file)
SCENE_SUFFIXES = tuple(format.suffix for format in FORMATS)
ARCHIVE_SUFFIXES = (".zip",)
NAMING_SUFFIXES = (*(format.suffix for format in FORMATS if format.names_files), ".mtl", ".mtlx", ".ocio")
COLOR_CONFIG = "config.ocio"  # in the scene's folder: the OpenColorIO config of a scene that names none

# .blend and Alembic files need Blender (renderer/blender); this is the advice without it.
BY_BLENDER = tuple(format.suffix for format in FORMATS if format.reader == "blend")
WITHOUT_BLENDER = Sentence(
    "advice-export-from-blender",
    'In Blender, choose File > Export > glTF 2.0 with "Punctual Lights" and "Cameras" ticked, and give the result',
)

# Native formats of other programs, and how to export each.
_UNPACK = Sentence("advice-unpack-archive", "Unpack it, and give the folder or a .zip of it")
FOREIGN = {
    ".max": Sentence("advice-export-from-3ds-max", "In 3ds Max, choose File > Export > glTF (2023 and later)"),
    ".c4d": Sentence("advice-export-from-cinema-4d", "In Cinema 4D, choose File > Export > glTF"),
    **dict.fromkeys((".ma", ".mb"), Sentence("advice-export-from-maya", "In Maya, choose File > Export All, and FBX there")),
    ".skp": Sentence(
        "advice-export-from-sketchup", "In SketchUp, choose File > Export > 3D Model, and COLLADA (.dae) or glTF there"
    ),
    **dict.fromkeys(
        (".step", ".stp", ".iges", ".igs"), Sentence("advice-export-from-cad", "Export STL or glTF from the CAD program")
    ),
    **dict.fromkeys((".rar", ".7z", ".tar", ".gz"), _UNPACK),
}

# Parts of names of auxiliary files: the cage of a subdivision surface, a collision shape.
_AUXILIARY = ("control", "cage", "collision", "collider", "proxy", "lowpoly", "low_poly")


# Suffixes of pbrt files that a scene's main file includes.
_INCLUDED = ("geometry", "materials", "material", "mats", "textures", "lights", "camera", "objects", "models", "mesh", "meshes")


def is_junk(name: str) -> bool:
    """Returns True if a file was added to an archive by an operating system: __MACOSX, .DS_Store, Thumbs.db, dot files."""
    parts = PurePosixPath(name).parts
    return any(part.startswith(".") or part in ("__MACOSX", "Thumbs.db", "desktop.ini") for part in parts)


def nested_archives(names: Iterable[str]) -> list[str]:
    """Returns the zip files among an upload's files that are unpacked too: all of them if no file is a scene.

    Models are offered for download like that, as source/NAME.zip beside textures/. The contents belong in the folder source/NAME.
    """
    known = [(name, PurePosixPath(name).suffix.lower()) for name in names if not is_junk(name)]
    if any(suffix in SCENE_SUFFIXES for _, suffix in known):
        return []
    return sorted(name for name, suffix in known if suffix in ARCHIVE_SUFFIXES)


def pick_main(names: list[str], preferred: str | None = None) -> tuple[str, list[str]]:
    """Returns the main scene file among the names, and warnings if other names could have been meant.

    A preferred name is chosen if it is a scene file. Otherwise the order is: best suffix, shallowest path, names that do not mark
    an auxiliary file, shortest name, alphabetical. Raises SceneError if no name is that of a scene file.
    """
    readers = [format.reader for format in FORMATS]
    # The layers of a USD scene may have any of USD's suffixes: the suffix does not identify the root layer.
    rank = {format.suffix: readers.index("usd") if format.reader == "usd" else i for i, format in enumerate(FORMATS)}
    found = []
    for name in names:
        path = PurePosixPath(name)
        if path.suffix.lower() in rank and not is_junk(name):
            auxiliary = any(word in path.stem.lower() for word in _AUXILIARY)
            auxiliary |= _is_included(name)
            found.append((rank[path.suffix.lower()], len(path.parts), auxiliary, len(name), name))
    if not found:
        for name in sorted(names):
            suffix = PurePosixPath(name).suffix.lower()
            if advice := _UNPACK if suffix == ".zip" else FOREIGN.get(suffix):  # a .zip inside two others is not unpacked
                shown = name[:200]
                raise SceneError(
                    Sentence("format-not-readable", "{name} cannot be read here. {advice}.", name=shown, advice=advice)
                    if advice == _UNPACK
                    else Sentence(
                        "format-to-be-exported",
                        "{name} cannot be read here. {advice}, and give the result.",
                        name=shown,
                        advice=advice,
                    )
                )
        if len(names) == 1:
            raise SceneError(
                Sentence(
                    "file-not-a-scene",
                    "{name} is not a 3D scene. Give a GLB, glTF, USD, FBX, BLEND, OBJ, PLY, STL, DAE or YAML file, "
                    "or a zip with one.",
                    name=next(iter(names))[:200],
                )
            )
        raise SceneError(
            Sentence(
                "scene-file-missing",
                "None of the files is a scene ({files}). Give a GLB, glTF, USD, FBX, BLEND, OBJ, PLY, STL, DAE or YAML file, "
                "or a zip with one.",
                files=first_items(sorted(names), 5),
            )
            if names
            else Sentence(
                "scene-files-none",
                "No file was given. A scene is one of {formats}, or a .zip with one.",
                formats=[*SCENE_SUFFIXES],
            )
        )
    found.sort(key=lambda each: (each[-1] != preferred, each))
    main = found[0][-1]
    rivals = [f[-1] for f in found[1:] if f[0] == found[0][0] and not _is_included(f[-1])]
    # A file that a scene may include is not a scene; beside a format that includes no files, every scene is one.
    alone = _format_of(main).is_mesh_file
    rivals += [f[-1] for f in found[1:] if f[0] != found[0][0] and (alone or not _format_of(f[-1]).is_mesh_file)]
    if not rivals:
        return main, []
    return main, [
        Sentence(
            "scene-files-several",
            "Several scene files were given; {file} is used. To use another, name it as `main`: {others}.",
            file=main,
            others=[*rivals[:8]],
        )
    ]


def _format_of(name: str) -> Format:
    return next(format for format in FORMATS if format.suffix == PurePosixPath(name).suffix.lower())


def _is_included(name: str) -> bool:
    path = PurePosixPath(name.lower())
    return path.suffix == ".pbrt" and path.stem in _INCLUDED
