"""Scenes with one renderer feature each, which the add-on must support or report. Run by a Python that has bpy."""

from __future__ import annotations

import math
from collections.abc import Callable

import bpy
import numpy as np
from blender_scenes import add, background, empty, lamp, look, principled, smoke_filled, waxen, world_node

Survey = tuple[Callable[[bpy.types.Scene], None], str, str]


def _sky(kind: str) -> Callable[[bpy.types.Scene], None]:
    def build(scene: bpy.types.Scene) -> None:
        _things()
        node = world_node(scene, "ShaderNodeTexSky")
        node.sky_type = kind
        if kind == "NISHITA":
            node.sun_elevation, node.sun_rotation, node.sun_size = 0.6, 0.8, 0.1
            background(scene).inputs["Strength"].default_value = 0.1
        else:
            node.sun_direction = (0.4, -0.5, 0.76)

    return build


def _things() -> None:
    """Adds the objects of every surveyed scene, on a diffuse floor.

    None is so glossy that a lamp's reflection covers only single pixels.
    """
    add("plane", principled("floor", Base_Color=(0.6, 0.55, 0.5, 1), Roughness=0.9, Specular_IOR_Level=0.0), 1, size=12)
    red = principled("red", Base_Color=(0.7, 0.08, 0.05, 1), Roughness=0.6)
    blue = principled("blue", Base_Color=(0.05, 0.2, 0.5, 1), Roughness=0.7)
    add("uv_sphere", red, 2, location=(-1.1, -0.3, 0.7), radius=0.7)
    add("cube", blue, 3, smooth=False, location=(1.0, 0.2, 0.5), size=1.0, rotation=(0, 0, 0.6))
    bpy.data.materials["red"].pass_index, bpy.data.materials["blue"].pass_index = 11, 12


def _plain(scene: bpy.types.Scene) -> None:
    _things()
    lamp("AREA", 400.0, (2, -3, 5), size=2.0)


def _area(**values) -> Callable[[bpy.types.Scene], None]:
    def build(scene: bpy.types.Scene) -> None:
        _things()
        thing = lamp("AREA", 300.0, (1.5, -2.5, 3), **values)
        thing.scale = (1.0, 2.0, 1.0)

    return build


def _lens(**values) -> Callable[[bpy.types.Scene], None]:
    def build(scene: bpy.types.Scene) -> None:
        _plain(scene)
        data = scene.camera.data
        for name, value in values.items():
            setattr(data.dof if hasattr(data.dof, name) else data, name, value)

    return build


def _render(**values) -> Callable[[bpy.types.Scene], None]:
    def build(scene: bpy.types.Scene) -> None:
        _plain(scene)
        for name, value in values.items():
            setattr(scene.render, name, value)

    return build


def _thing(**values) -> Callable[[bpy.types.Scene], None]:
    def build(scene: bpy.types.Scene) -> None:
        _plain(scene)
        for name, value in values.items():
            setattr(bpy.data.objects["Cube"], name, value)

    return build


def _cycles(**values) -> Callable[[bpy.types.Scene], None]:
    """Returns a scene builder that sets properties of Cycles. values: by property name, different from the defaults."""

    def build(scene: bpy.types.Scene) -> None:
        _plain(scene)
        for name, value in values.items():
            setattr(scene.cycles, name, value)

    return build


def _blurred(position: str) -> Callable[[bpy.types.Scene], None]:
    """Returns a scene builder that adds a cube moving while the shutter is open. position: Blender's shutter position."""

    def build(scene: bpy.types.Scene) -> None:
        _plain(scene)
        cube = bpy.data.objects["Cube"]
        for frame, x in ((0, -1.0), (1, 0.4), (2, 2.4)):
            cube.location[0] = x
            cube.keyframe_insert("location", frame=frame)
        for curve in cube.animation_data.action.fcurves:
            for key in curve.keyframe_points:
                key.interpolation = "LINEAR"
        scene.frame_start = scene.frame_end = 1
        scene.render.use_motion_blur, scene.render.motion_blur_shutter = True, 0.8
        scene.render.motion_blur_position = position
        scene.frame_set(1)

    return build


def _layered(**values) -> Callable[[bpy.types.Scene], None]:
    def build(scene: bpy.types.Scene) -> None:
        _plain(scene)
        for name, value in values.items():
            setattr(bpy.context.view_layer, name, value)

    return build


def _shutter_of_layer(scene: bpy.types.Scene) -> None:
    """Enables motion blur in the scene's settings, and disables it in those of the view layer."""
    _blurred("CENTER")(scene)
    bpy.context.view_layer.use_motion_blur = False


def _still(scene: bpy.types.Scene) -> None:
    """Adds a moving cube, and disables motion blur for this object."""
    _blurred("CENTER")(scene)
    bpy.data.objects["Cube"].cycles.use_motion_blur = False


def _panes(scene: bpy.types.Scene) -> None:
    """Adds a transparent ball whose shadow is nevertheless opaque."""
    _plain(scene)
    ghost = principled("ghost", Base_Color=(0.8, 0.3, 0.1, 1), Roughness=1.0, Alpha=0.4)
    ghost.use_transparent_shadow = False
    add("uv_sphere", ghost, 9, location=(0.2, -1.5, 0.9), radius=0.4)


def _culled(scene: bpy.types.Scene) -> None:
    """Adds surfaces with backface culling, which Cycles ignores."""
    _plain(scene)
    red = bpy.data.materials["red"]
    red.use_backface_culling = True
    bpy.ops.mesh.primitive_plane_add(size=1.5, location=(0.2, -1.0, 1.2), rotation=(-2.2, 0, 0))
    bpy.context.object.data.materials.append(red)


def _normals(space: str) -> Callable[[bpy.types.Scene], None]:
    """Returns a scene builder that adds a tilted plane with a normal map. space: Blender's name of object or world space."""

    def build(scene: bpy.types.Scene) -> None:
        _plain(scene)
        image = bpy.data.images.new("normals", 64, 64, alpha=False)
        image.colorspace_settings.name = "Non-Color"
        v, u = np.mgrid[0:64, 0:64] / 64
        bent = np.stack([0.5 * np.sin(6 * u), 0.4 * np.cos(6 * u), 1 + 0.3 * np.sin(9 * v)], -1)
        texels = np.ones((64, 64, 4), np.float32)
        texels[..., :3] = bent / np.linalg.norm(bent, axis=-1, keepdims=True) * 0.5 + 0.5
        image.pixels.foreach_set(texels.ravel())
        image.pack()
        red = bpy.data.materials["red"]
        turn = (0.9, 0.3, 0.5) if space == "OBJECT" else (0.1, 0.1, 0.5)
        add("plane", red, 5, size=2, location=(-1, -1, 1.2), rotation=turn)
        bpy.data.objects["Sphere"].data.materials[0] = bpy.data.materials["blue"]
        tree = red.node_tree
        shown, normal = tree.nodes.new("ShaderNodeTexImage"), tree.nodes.new("ShaderNodeNormalMap")
        shown.image, normal.space = image, space
        tree.links.new(shown.outputs[0], normal.inputs["Color"])
        tree.links.new(normal.outputs[0], tree.nodes["Principled BSDF"].inputs["Normal"])

    return build


def _bright(entry: str) -> Callable[[bpy.types.Scene], None]:
    """Returns a scene builder that connects a Noise texture, scaled above 1, to the input `entry` of the ball's material."""

    def build(scene: bpy.types.Scene) -> None:
        _plain(scene)
        tree = bpy.data.materials["red"].node_tree
        surface = tree.nodes["Principled BSDF"]
        noise, times = tree.nodes.new("ShaderNodeTexNoise"), tree.nodes.new("ShaderNodeVectorMath")
        noise.inputs["Scale"].default_value = 3
        times.operation, times.inputs[1].default_value = "MULTIPLY", (3, 1.5, 0.5)
        tree.links.new(noise.outputs["Color"], times.inputs[0])
        tree.links.new(times.outputs[0], surface.inputs[entry])
        surface.inputs["Emission Strength"].default_value = 1.2 if entry == "Emission Color" else 0.0

    return build


def _film(scene: bpy.types.Scene) -> None:
    _plain(scene)
    scene.cycles.film_exposure = 2.0


def _view(scene: bpy.types.Scene) -> None:
    """Sets a view transform and an exposure, which must not affect the pixels of an EXR."""
    _plain(scene)
    scene.view_settings.view_transform, scene.view_settings.exposure = "AgX", 1.5


def _scaled_camera(scene: bpy.types.Scene) -> None:
    _plain(scene)
    scene.camera.scale = (2.0, 0.5, 3.0)


def _held(scene: bpy.types.Scene) -> None:
    """Makes an object a holdout, through the view layer's setting for the object's collection."""
    _plain(scene)
    aside = bpy.data.collections.new("aside")
    scene.collection.children.link(aside)
    cube = bpy.data.objects["Cube"]
    scene.collection.objects.unlink(cube)
    aside.objects.link(cube)
    bpy.context.view_layer.layer_collection.children["aside"].holdout = True


def _linked(scene: bpy.types.Scene) -> None:
    """Restricts a lamp to a single object by light linking."""
    _plain(scene)
    receivers = bpy.data.collections.new("receivers")
    receivers.objects.link(bpy.data.objects["Cube"])
    bpy.data.objects["area"].light_linking.receiver_collection = receivers


def _far(scene: bpy.types.Scene) -> None:
    """Sets a camera clipping distance that hides all but the first metres of the floor."""
    _plain(scene)
    scene.camera.data.clip_end = 7.0


def _dark_world(scene: bpy.types.Scene) -> None:
    """Makes the world invisible to the camera, although it still lights the scene."""
    _plain(scene)
    scene.camera.rotation_euler[0] += 0.25
    scene.world.cycles_visibility.camera = False


def _foggy(scene: bpy.types.Scene) -> None:
    _plain(scene)
    tree = scene.world.node_tree
    fog = tree.nodes.new("ShaderNodeVolumeScatter")
    fog.inputs["Density"].default_value = 0.05
    tree.links.new(fog.outputs[0], tree.nodes["World Output"].inputs["Volume"])


def _changed(change: Callable[..., None], **values) -> Callable[[bpy.types.Scene], None]:
    """Returns a scene builder that calls `change` with the node tree of the ball's material, and with `values`."""

    def build(scene: bpy.types.Scene) -> None:
        _plain(scene)
        scene.cycles.volume_bounces = 12
        change(bpy.data.materials["red"].node_tree, **values)

    return build


def _overridden(scene: bpy.types.Scene) -> None:
    """Overrides the material of all objects, by the view layer's setting."""
    _plain(scene)
    bpy.context.view_layer.material_override = principled("clay", Base_Color=(0.8, 0.3, 0.1, 1), Roughness=1.0)


def _mirrored(scene: bpy.types.Scene) -> None:
    """Mirrors the ball by a negative scale, and shears the cube by a rotated, scaled parent."""
    _plain(scene)
    parent = bpy.data.objects.new("parent", None)
    parent.scale, parent.rotation_euler = (1.5, 0.7, 1.0), (0, 0, 0.5)
    scene.collection.objects.link(parent)
    cube, ball = bpy.data.objects["Cube"], bpy.data.objects["Sphere"]
    cube.parent, ball.scale = parent, (-1.0, 1.0, 0.8)


def _simplified(scene: bpy.types.Scene) -> None:
    """Limits subdivision to one level by the scene's Simplify setting, for a cube with four levels."""
    _plain(scene)
    scene.render.use_simplify, scene.render.simplify_subdivision, scene.render.simplify_subdivision_render = True, 0, 1
    smooth = bpy.data.objects["Cube"].modifiers.new("smooth", "SUBSURF")
    smooth.levels, smooth.render_levels = 4, 4


def _hidden(scene: bpy.types.Scene) -> None:
    """Adds balls that are invisible to the camera or cast no shadows, with numbers for the index passes."""
    _plain(scene)
    for i, (name, flag) in enumerate((("unseen", "visible_camera"), ("shadeless", "visible_shadow"))):
        colored = principled(name, Base_Color=(0.2, 0.6, 0.2, 1), Roughness=0.8)
        colored.pass_index = 21 + i
        thing = add("uv_sphere", colored, 31 + i, location=(-0.2 + 0.9 * i, -1.6, 0.3), radius=0.3)
        setattr(thing, flag, False)
    shared = add("uv_sphere", bpy.data.materials["red"], 40, location=(1.8, -1.0, 0.3), radius=0.3)
    shared.visible_shadow = False


def _pano(kind: str, border: bool = False) -> Callable[[bpy.types.Scene], None]:
    def build(scene: bpy.types.Scene) -> None:
        _plain(scene)
        scene.camera.data.type = "PANO"
        data = scene.camera.data
        (data if hasattr(data, "panorama_type") else data.cycles).panorama_type = kind
        scene.camera.location, scene.camera.rotation_euler = (0.3, -2.2, 1.2), (math.pi / 2 - 0.2, 0.1, 0.3)
        if border:
            _cut(scene)

    return build


def _cut(scene: bpy.types.Scene, is_cropped: bool = True) -> None:
    render = scene.render
    render.use_border, render.use_crop_to_border = True, is_cropped
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.75, 0.25, 0.75


def _border(scene: bpy.types.Scene) -> None:
    _plain(scene)
    _cut(scene, is_cropped=False)


def _lights_of_nodes(scene: bpy.types.Scene) -> None:
    _plain(scene)
    light = bpy.data.lights["area"]
    light.use_nodes = True
    falls = light.node_tree.nodes.new("ShaderNodeLightFalloff")
    light.node_tree.links.new(falls.outputs["Linear"], light.node_tree.nodes["Emission"].inputs["Strength"])


def _two_eyes(scene: bpy.types.Scene) -> None:
    _plain(scene)
    scene.render.use_multiview = True


# Name -> (function that builds the scene, word of the add-on's message, word of the .blend reader's message); "" where the
# picture must equal Cycles'.
SURVEY: dict[str, Survey] = {
    "sky-nishita": (_sky("NISHITA"), "", ""),
    "sky-hosek": (_sky("HOSEK_WILKIE"), "", ""),
    "area-ellipse": (_area(shape="ELLIPSE", size=1.5, size_y=0.6), "", ""),
    "area-spread": (_area(shape="RECTANGLE", size=1.0, size_y=0.6, spread=0.8), "spread", "spread"),
    "ortho": (_lens(type="ORTHO", ortho_scale=5.0, shift_x=0.1), "", ""),
    "pano": (_pano("EQUIRECTANGULAR"), "", ""),
    "pano-border": (_pano("EQUIRECTANGULAR", border=True), "", "region"),
    "fisheye": (_pano("FISHEYE_EQUISOLID"), "panorama", "equirectangular"),
    "blades": (_lens(use_dof=True, aperture_fstop=0.1, focus_distance=6.0, aperture_blades=5), "blades", "blades"),
    "film-exposure": (_film, "exposure", "exposure"),
    "view-exposure": (_view, "", ""),
    "camera-scaled": (_scaled_camera, "", ""),
    "camera-far": (_far, "end", "end"),
    "border": (_border, "", "region"),
    "pixel-aspect": (_render(pixel_aspect_x=2.0), "square", "square"),
    "film-transparent": (_render(film_transparent=True), "", ""),
    "two-eyes": (_two_eyes, "eye", "eye"),
    "holdout": (_thing(is_holdout=True), "holdout", "holdout"),
    "holdout-collection": (_held, "holdout", "holdout"),
    "shadow-catcher": (_thing(is_shadow_catcher=True), "shadow catcher", "shadow catcher"),
    "hidden": (_hidden, "", ""),
    "light-linking": (_linked, "inking", ""),
    "light-nodes": (_lights_of_nodes, "nodes", "nodes"),
    "world-unseen": (_dark_world, "World", "World"),
    "world-volume": (_foggy, "volume", "volume"),
    "volume": (_changed(smoke_filled, surface=""), "", ""),
    "volume-in-glass": (_changed(smoke_filled, surface="glass"), "", ""),
    "subsurface": (_changed(waxen, method="RANDOM_WALK"), "", ""),
    "subsurface-skin": (_changed(waxen, method="RANDOM_WALK_SKIN"), "", ""),
    "override": (_overridden, "", ""),
    "mirrored": (_mirrored, "", ""),
    "simplify": (_simplified, "", ""),
    "fast-gi": (_cycles(use_fast_gi=True), "Fast GI", "Fast GI"),
    "shutter-start": (_blurred("START"), "", ""),
    "shutter-center": (_blurred("CENTER"), "", ""),
    "shutter-end": (_blurred("END"), "", ""),
    "shutter-of-layer": (_shutter_of_layer, "", ""),
    "shutter-of-thing": (_still, "unlike in Blender", "unlike in Blender"),
    "no-world": (_layered(use_sky=False), "Environment", "Environment"),
    "passes": (_layered(use_pass_mist=True, use_pass_diffuse_direct=True), "Mist, Diffuse Direct", ""),
    "transparent-shadows": (_panes, "Transparent Shadows", "Transparent Shadows"),
    "backfaces": (_culled, "", ""),
    "normals-object": (_normals("OBJECT"), "normals are left out", ""),
    "normals-world": (_normals("WORLD"), "normals are left out", ""),
    "nowhere": (_thing(scale=(math.nan, 1, 1)), "no number", "not finite"),
    "bright-light": (_bright("Emission Color"), "emission", ""),
    "bright-color": (_bright("Base Color"), "base color", "Base Color above 1 are clipped"),
}


def made(name: str) -> bpy.types.Scene:
    """Builds and returns the scene with this name in SURVEY."""
    scene = empty()
    SURVEY[name][0](scene)
    if scene.camera.data.type != "PANO" and name not in ("camera-scaled", "world-unseen"):
        look(scene.camera)
    return scene
