"""Substitutes for the objects of Blender's window that a viewport render uses. Run by a Python that has bpy."""

from __future__ import annotations

import bpy
from blender_scenes import SIZE


class Region:
    """Substitute for a region of Blender's window, a 3D viewport that looks through the scene's camera."""

    def __init__(self, scene: bpy.types.Scene) -> None:
        self.width, self.height = SIZE
        self.scene = scene
        self.region, self.region_data, self.space_data = self, self, self
        self.view_perspective, self.camera = "PERSP", None

    @property
    def view_matrix(self):
        return self.scene.camera.matrix_world.inverted()

    @property
    def window_matrix(self):
        return self.scene.camera.calc_matrix_camera(bpy.context.evaluated_depsgraph_get(), x=self.width, y=self.height)


class Engine:
    """Substitute for Blender's RenderEngine object, with the methods that a viewport render calls."""

    redraws = 0

    def tag_redraw(self) -> None:
        self.redraws += 1

    def update_stats(self, *_: str) -> None:
        pass
