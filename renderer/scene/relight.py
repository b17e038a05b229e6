"""Replaces the environment of a compiled scene: only the environment's arrays are computed again."""

from __future__ import annotations

from renderer.arrays.scene import CompiledScene
from renderer.scene.description import SceneDescription
from renderer.scene.environment import choose_environment, search_tables, tabulate_environment

__all__ = ["CHANGED_ARRAYS", "replace_environment"]

CHANGED_ARRAYS = (
    "environment",
    "environment_marginal",
    "environment_conditional",
    "environment_row_start",
    "environment_column_start",
    "environment_frame",
)


def replace_environment(scene: CompiledScene, light: SceneDescription, lights_power: float) -> CompiledScene:
    """Returns the scene with the environment of the description `light`; nothing else of that description is used.

    The result has the same bits as if the scene were compiled with this environment. lights_power: the total power of the scene's
    lights without the environment, from ShotCache.lights_power. Raises SceneError under the conditions of `tabulate_environment`.
    """
    tables = tabulate_environment(light)
    chance = choose_environment(tables, lights_power, scene.bounds)
    frame = tables.frame(chance)
    radiance = tables.radiance
    for array in (frame, radiance):
        array.flags.writeable = False
    changed = {"environment": radiance, "environment_frame": frame, **search_tables(tables.marginal, tables.conditional)}
    assert changed.keys() == set(CHANGED_ARRAYS)
    return scene._replace(**changed)
