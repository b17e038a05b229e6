"""Writes the open scene as a scene file with a GLB: glTF contains the meshes and their animation, the scene file the rest."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from .bake_materials import bake
from .cameras import Cameras
from .hair import hair_and_points_as_meshes
from .instances import LEFT_OUT
from .keys import frames_of, is_animated, over_frames, scripted, shutter_frames
from .large import Taken, replace_by_stand_ins, restore_large_meshes
from .light_groups import layer_groups, light_group_of
from .light_links import LinkSets
from .lights import Lights
from .movie_textures import replace_movies_by_stills
from .prepare_scene import prepare
from .principled_materials import modules_of, simplify
from .ray_visibility import matte_flags_of, note_rays, ray_flags_of, write_extensions
from .sentences import Sentence, first_items, to_text
from .settings import note_settings, settings_of
from .surfaces import note_surfaces
from .world import world_medium, write_world

__all__ = ["write_scene"]

MESHES = ("MESH", "CURVE", "SURFACE", "FONT", "META")
MOST_NOTES = 100
MOST_NAME = 100  # characters of the scene's name


def write_scene(bpy: Any, out: Path, addon: Path | None = None, has_settings: bool = True) -> list[str]:
    """Writes blender-scene.yaml and the files that it refers to; returns notes on what is ignored, which the file contains too.

    addon: the add-on's folder, or None. has_settings: whether the file has render settings; Alembic files have none.
    """
    scene = bpy.context.scene
    notes: list[str] = []
    _note_missing(bpy, notes)
    _note_unknown_nodes(bpy, notes)
    if driven := scripted(bpy):
        notes.append(
            Sentence(
                "blend-scripted-drivers",
                "{names}: drivers written in Python are not run, since scripts are off; bake them to keyframes",
                names=first_items(driven, 5),
            )
        )
    scene.render.fps_base = 1.0  # the exporter assumes a whole number of frames per second
    fps = float(scene.render.fps)
    frames = frames_of(bpy, scene)
    layer = bpy.context.view_layer
    modules = modules_of(addon) if addon is not None else None
    cycles = getattr(modules, "cycles", None)
    settings = settings_of(scene, layer, cycles) if has_settings else {}
    if has_settings and (groups := layer_groups(layer)):
        settings["light_groups"] = groups
    exposed = shutter_frames(frames, settings) if is_animated(bpy, scene) else frames
    scene.frame_set(frames[0])
    note_settings(bpy.data.scenes, scene, layer, notes, cycles)
    taken: Taken = {}
    shown = hair_and_points_as_meshes(bpy, scene, prepare(bpy, scene, frames, exposed, addon, taken, notes), addon, taken, notes)
    _note_left_out(shown, notes)
    solid = [thing for thing in shown if thing.type in MESHES]
    replace_movies_by_stills(bpy, _materials(solid), notes)
    surfaces = simplify(bpy, solid, addon, notes)
    bake(bpy, scene, solid, notes)
    note_surfaces(_materials(solid), notes, modules is not None)
    note_rays(solid, layer, notes, scene.render.film_transparent)
    _note_flags(scene, layer, shown, modules, notes)

    cameras, lights = Cameras(bpy, scene, notes), Lights(bpy, scene, getattr(modules, "lights", None), notes, out)
    seen = over_frames(
        scene, exposed, {**_with_prefix("camera", cameras.state_functions()), **_with_prefix("light", lights.state_functions())}
    )
    scene.frame_set(frames[0])
    medium = world_medium(scene.world, getattr(modules, "subsurface", None), notes)
    if modules is not None and (medium is not None or any(modules.subsurface.scatters(each) for each in surfaces.values())):
        modules.cycles.warn_of_volumes(scene, notes.append)
    # Infinitely distant light is not visible through a medium that fills the world.
    environment, suns = write_world(bpy, scene, out, getattr(modules, "skies", None), notes) if medium is None else (None, [])
    if environment is not None and (group := light_group_of(scene.world)):
        environment["light_group"] = group
        suns = [{**sun, "light_group": group} for sun in suns]
    links = LinkSets(_object_names(solid, scene.name), notes)
    lamps, materials, shapes = lights.scene_file_lights(_states_of_kind("light", seen), exposed, fps, links)
    if solid:
        taken |= replace_by_stand_ins(bpy, solid, addon)
        scene.frame_start, scene.frame_end = exposed[0], exposed[-1]
        _write_glb(bpy, out / "blender-scene.glb", is_moving=len(exposed) > 1)
        restore_large_meshes(out / "blender-scene.glb", taken)
        write_extensions(out / "blender-scene.glb", ray_flags_of(solid, layer), surfaces, _named(solid, links, layer))
        shapes.insert(0, {"type": "mesh", "file": "blender-scene.glb", "name": scene.name[:MOST_NAME]})
    document: dict[str, Any] = {
        "name": scene.name[:200],
        "fps": fps,
        "settings": settings,
        "notes": [to_text(note[:400]) for note in _shortened_notes(notes)],
        "cameras": cameras.scene_file_cameras(_states_of_kind("camera", seen), exposed, fps),
        "environment": environment if medium is None else {"color": 0},
        "medium": medium,
        "light_links": links.sets,
        "lights": [*lamps, *suns],
        "materials": materials,
        "shapes": shapes,
    }
    (out / "blender-scene.yaml").write_text(_yaml({name: value for name, value in document.items() if value}))
    return notes


def _object_names(solid: list[Any], scene: str) -> dict[str, str]:
    """Returns object name -> name in the scene file, in which the objects are parts of a shape with the scene's name."""
    return {thing.name: f"{scene[:MOST_NAME]}/{thing.name}" for thing in solid}


def _named(solid: list[Any], links: LinkSets, layer: Any) -> dict[str, dict[str, str | bool]]:
    """Returns object name -> light group and link sets of its emission and matte flags, of the objects that have any."""
    found: dict[str, dict[str, str | bool]] = {}
    for thing in solid:
        named = {"light_group": light_group_of(thing), **links.fields_for(thing)}
        extras: dict[str, str | bool] = {key: name for key, name in named.items() if name}
        extras.update(matte_flags_of(thing, layer))
        if extras:
            found[thing.name] = extras
    return found


def _yaml(document: dict[str, Any]) -> str:
    """Returns the document as JSON, which is valid YAML, with one line per list item."""
    parts = []
    for name, value in document.items():
        if isinstance(value, list):
            parts.append(f'"{name}": [\n  ' + ",\n  ".join(json.dumps(each, ensure_ascii=False) for each in value) + "\n]")
        else:
            parts.append(f'"{name}": {json.dumps(value, ensure_ascii=False)}')
    return "{" + ",\n".join(parts) + "}\n"


def _write_glb(bpy: Any, path: Path, is_moving: bool) -> None:
    wanted = {
        "filepath": str(path),
        "export_format": "GLB",
        "use_active_scene": True,
        "use_renderable": True,
        "export_cameras": False,
        "export_lights": False,
        "export_extras": False,
        "export_apply": False,  # modifiers are applied already
        "export_yup": True,
        "export_tangents": False,
        "export_image_format": "AUTO",
        "export_skins": True,
        "export_all_influences": True,
        "export_morph": True,
        "export_animations": is_moving,
        "export_animation_mode": "SCENE",
        "export_anim_scene_split_object": False,
        "export_frame_range": True,
        "export_force_sampling": True,
        "export_optimize_animation_size": True,
        "export_current_frame": not is_moving,  # otherwise frame 0 is written
        "export_gpu_instances": False,
    }
    known = set(bpy.ops.export_scene.gltf.get_rna_type().properties.keys())
    bpy.ops.export_scene.gltf(**{name: value for name, value in wanted.items() if name in known})


def _materials(objects: list[Any]) -> list[Any]:
    found = {slot.material.name: slot.material for thing in objects for slot in thing.material_slots if slot.material is not None}
    return [found[name] for name in sorted(found)]


def _note_left_out(objects: list[Any], notes: list[str]) -> None:
    for kind, kinds in LEFT_OUT.items():
        names = [thing.name for thing in objects if thing.type == kind]
        if names:
            notes.append(Sentence("blend-kind-left-out", "{kind} are left out: {names}", kind=kinds, names=first_items(names, 5)))


def _note_unknown_nodes(bpy: Any, notes: list[str]) -> None:
    """Adds a note on import nodes, which untrusted.py makes undefined since they would read files of this machine."""
    trees = [tree.name for tree in bpy.data.node_groups if any(node.bl_idname == "NodeUndefined" for node in tree.nodes)]
    if trees:
        notes.append(
            Sentence(
                "blend-unknown-nodes",
                "Node groups {names}: nodes that import files, or that are not Blender's own, are left out",
                names=first_items(trees, 5),
            )
        )


def _note_flags(scene: Any, layer: Any, objects: list[Any], modules: Any, notes: list[str]) -> None:
    if modules is None:
        return
    flags = modules.cycles.Flags(scene, layer)
    for thing in objects:
        flags.inspect(thing)
    flags.warn_of_found(notes.append)


def _note_missing(bpy: Any, notes: list[str]) -> None:
    """Adds notes on missing files, by name without folders, since the original paths are private."""
    images = [i for i in bpy.data.images if i.source in ("FILE", "SEQUENCE", "TILED") and i.users and i.packed_file is None]
    lost = sorted({_base_name(i.filepath) for i in images if "missing-files" in i.filepath})
    if lost:
        notes.append(
            Sentence(
                "blend-missing-images",
                "Missing images: {names}. Upload them with the file, or pack them in Blender (File > "
                "External Data > Pack Resources)",
                names=first_items(lost, 8),
            )
        )
    links = sorted({_base_name(each.filepath) for each in bpy.data.libraries if "missing-files" in each.filepath})
    if links:
        notes.append(
            Sentence(
                "blend-missing-libraries",
                "Missing linked files: {names}. Upload them with the file, or make linked data local "
                "in Blender (Object > Relations > Make Local > All)",
                names=first_items(links, 8),
            )
        )


def _base_name(path: str) -> str:
    return path.replace("\\", "/").rsplit("/", 1)[-1]


def _shortened_notes(notes: list[str]) -> list[str]:
    return (
        notes
        if len(notes) <= MOST_NOTES
        else [
            *notes[:MOST_NOTES],
            Sentence("blend-more-notes", "{count} more notes are not listed", count=len(notes) - MOST_NOTES),
        ]
    )


def _with_prefix(kind: str, state_functions: dict[str, Any]) -> dict[str, Any]:
    return {f"{kind} {name}": look for name, look in state_functions.items()}


def _states_of_kind(kind: str, states: dict[str, list[Any]]) -> dict[str, list[Any]]:
    return {name.removeprefix(f"{kind} "): values for name, values in states.items() if name.startswith(f"{kind} ")}
