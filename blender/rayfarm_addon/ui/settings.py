"""The user's settings: of the farm in the add-on's preferences, of pictures in the scene.

The token is never stored in a .blend file, since those are shared.
"""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

__all__ = ["CLASSES", "farm_of", "package", "register", "unregister"]

LOCAL = "http://127.0.0.1:8000"


def package() -> str:
    """Returns the add-on's package name in Blender, prefixed by the repository's name for an extension."""
    return __package__.rpartition(".")[0]


class RayfarmPreferences(bpy.types.AddonPreferences):
    """Which farm, and what it is shown."""

    bl_idname = package()

    url: StringProperty(name="Farm", description="The address of the farm's page", default=LOCAL)
    token: StringProperty(
        name="Token",
        description="What the farm is shown: `rayfarm token make NAME` prints one. Empty for a farm on this machine",
        subtype="PASSWORD",
    )

    def draw(self, context: bpy.types.Context) -> None:
        """Draws the preferences; called by Blender."""
        column = self.layout.column()
        column.prop(self, "url")
        column.prop(self, "token")
        column.operator("rayfarm.test_connection", icon="LINKED")


class RayfarmSceneSettings(bpy.types.PropertyGroup):
    """Of the pictures of one scene."""

    samples: IntProperty(name="Samples", description="Of each pixel", default=128, min=1, max=1 << 20)
    use_noise: BoolProperty(name="Noise Level", description="Tiles that are as clean as this need no more samples", default=False)
    noise: FloatProperty(name="Noise", description="Relative noise at which a tile is done", default=0.02, min=0.001, max=1.0)
    depth: IntProperty(
        name="Path Depth", description="Segments of a path, that from the camera included", default=12, min=1, max=1024
    )
    clamp: FloatProperty(
        name="Clamp Indirect", description="The most that bounced light adds; 0: all of it", default=0.0, min=0.0, max=1e9
    )
    seed: IntProperty(name="Seed", description="Another seed, another noise", default=0, min=0)
    denoise: BoolProperty(name="Denoise", description="By Open Image Denoise, on the farm", default=False)
    albedo: BoolProperty(name="Albedo", description="The colour of surfaces without light, as a pass", default=False)
    view_samples: IntProperty(name="Viewport Samples", description="At which a viewport rests", default=64, min=1, max=256)
    keys: IntProperty(
        name="Motion Keys", description="How often what moves is looked at while the shutter is open", default=3, min=3, max=17
    )
    priority: IntProperty(name="Priority", description="Higher is sooner", default=0, min=-100, max=100)
    project: StringProperty(name="Project", description="Of the farm, whose members alone see it; empty: none")
    filter: EnumProperty(
        name="Pixel Filter",
        items=[
            ("blackman-harris", "Blackman-Harris", "Smooth edges without ringing"),
            ("tent", "Tent", "A little crisper"),
            ("box", "Box", "Every sample counts the same within its pixel"),
        ],
        default="blackman-harris",
    )


def farm_of(context: bpy.types.Context) -> tuple[str, str]:
    """Returns the address and the token; from the environment variables where the preferences have none."""
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
