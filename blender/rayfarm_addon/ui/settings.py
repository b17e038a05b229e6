"""The user's settings: those of the farm in the add-on's preferences, those of images in the scene.

The token is never stored in a .blend file, since such files are shared.
"""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

__all__ = ["CLASSES", "farm_of", "package", "register", "unregister"]

LOCAL = "http://127.0.0.1:8000"


def package() -> str:
    """Returns the add-on's package name in Blender; for an extension it begins with the extension repository's name."""
    return __package__.rpartition(".")[0]


class RayfarmPreferences(bpy.types.AddonPreferences):
    """The add-on's preferences: the farm's address and the token."""

    bl_idname = package()

    url: StringProperty(name="Farm", description="The address of the farm's page", default=LOCAL)
    token: StringProperty(
        name="Token",
        description="Access token of the farm, as printed by `rayfarm token make NAME`. Empty for a farm on this machine",
        subtype="PASSWORD",
    )

    def draw(self, context: bpy.types.Context) -> None:
        """Draws the preferences; called by Blender."""
        column = self.layout.column()
        column.prop(self, "url")
        column.prop(self, "token")
        column.operator("rayfarm.test_connection", icon="LINKED")


class RayfarmSceneSettings(bpy.types.PropertyGroup):
    """Rayfarm's settings for rendering a scene, stored in the scene."""

    samples: IntProperty(name="Samples", description="Samples per pixel", default=128, min=1, max=1 << 20)
    use_noise: BoolProperty(name="Noise Level", description="Stop sampling tiles whose noise is below this level", default=False)
    noise: FloatProperty(name="Noise", description="Relative noise at which a tile is done", default=0.02, min=0.001, max=1.0)
    depth: IntProperty(
        name="Path Depth",
        description="Maximum number of path segments, including the one from the camera",
        default=12,
        min=1,
        max=1024,
    )
    clamp: FloatProperty(
        name="Clamp Indirect",
        description="Maximum radiance of indirect light in a sample; 0: no limit",
        default=0.0,
        min=0.0,
        max=1e9,
    )
    seed: IntProperty(name="Seed", description="Seed of the random numbers: changes the noise pattern", default=0, min=0)
    denoise: BoolProperty(name="Denoise", description="Denoise the picture with Open Image Denoise, on the farm", default=False)
    albedo: BoolProperty(name="Albedo", description="Render the colour of surfaces without lighting as a pass", default=False)
    view_samples: IntProperty(
        name="Viewport Samples", description="Samples per pixel at which a viewport stops rendering", default=64, min=1, max=256
    )
    keys: IntProperty(
        name="Motion Keys",
        description="Number of times at which moving objects are exported while the shutter is open",
        default=3,
        min=3,
        max=17,
    )
    priority: IntProperty(
        name="Priority", description="Jobs with a higher priority are rendered first", default=0, min=-100, max=100
    )
    project: StringProperty(name="Project", description="Project on the farm; only its members see the pictures. Empty: none")
    filter: EnumProperty(
        name="Pixel Filter",
        items=[
            ("blackman-harris", "Blackman-Harris", "Smooth edges without ringing"),
            ("tent", "Tent", "Slightly sharper"),
            ("box", "Box", "All samples of a pixel have the same weight"),
        ],
        default="blackman-harris",
    )


def farm_of(context: bpy.types.Context) -> tuple[str, str]:
    """Returns the farm's address and the token. Environment variables replace preferences that do not exist or are empty."""
    import os

    known = context.preferences.addons.get(package())
    if known is None or known.preferences is None:
        return os.environ.get("RAYFARM_SERVER", LOCAL), os.environ.get("RAYFARM_API_TOKEN", "")
    return known.preferences.url, known.preferences.token or os.environ.get("RAYFARM_API_TOKEN", "")


CLASSES = (RayfarmPreferences, RayfarmSceneSettings)


def register() -> None:
    """Adds the scene settings; called after the classes are registered."""
    bpy.types.Scene.rayfarm = PointerProperty(type=RayfarmSceneSettings)


def unregister() -> None:
    """Removes the scene settings; called before the classes are unregistered."""
    del bpy.types.Scene.rayfarm
