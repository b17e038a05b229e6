"""A compiled scene under another light from all around: of its arrays only the environment's are made anew."""

from __future__ import annotations

from renderer.arrays.scene import CompiledScene
from renderer.scene.description import SceneDescription
from renderer.scene.environment import choose_environment, search_tables, tabulate_environment

__all__ = ["CHANGED", "lit"]

CHANGED = (
    "environment",
    "environment_marginal",
    "environment_conditional",
    "environment_row_start",
    "environment_column_start",
    "environment_frame",
)


def lit(scene: CompiledScene, light: SceneDescription, lights_power: float) -> CompiledScene:
    """The scene in the environment of `light`, of which nothing else counts: the same to the bit as if it had been compiled so.

    lights_power: what the scene's own lights send out, as Kept.lights_power has it. Raises SceneError as
    `tabulate_environment` does.
    """
    tables = tabulate_environment(light)
    chance = choose_environment(tables, lights_power, scene.bounds)
    frame = tables.frame(chance)
    radiance = tables.radiance
    for array in (frame, radiance):
        array.flags.writeable = False
    changed = {"environment": radiance, "environment_frame": frame, **search_tables(tables.marginal, tables.conditional)}
    assert changed.keys() == set(CHANGED)
    return scene._replace(**changed)
