"""AYON: publish plug-in that submits published USD to a farm. Its folder is a publish path of an add-on.

It does nothing unless "Render on Rayfarm" is chosen for the instance. After the integration it submits the published .usd with
the instance's frame range, and stores the job's id as `rayfarmJob` in the instance's data.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyblish.api
from ayon_core.lib import BoolDef, NumberDef, TextDef
from ayon_core.pipeline.publish import AYONPyblishPluginMixin
from rayfarm_submit.farm import frames_of, submit

__all__ = ["SubmitRayfarm"]

EXTENSIONS = (".usd", ".usda", ".usdc", ".usdz")


class SubmitRayfarm(pyblish.api.InstancePlugin, AYONPyblishPluginMixin):
    """Submits the USD of an instance once it is published."""

    order = pyblish.api.IntegratorOrder + 0.4
    label = "Submit to Rayfarm"
    families = ["usd"]  # noqa: RUF012 - as pyblish reads it

    @classmethod
    def get_attribute_defs(cls) -> list[Any]:
        """Returns the options that AYON's publisher shows."""
        return [
            BoolDef("rayfarm", label="Render on Rayfarm", default=False),
            NumberDef("rayfarm_spp", label="Samples per pixel", default=256, minimum=1, decimals=0),
            NumberDef("rayfarm_priority", label="Priority", default=0, minimum=-100, maximum=100, decimals=0),
            TextDef("rayfarm_server", label="Farm's address", default=""),
        ]

    def process(self, instance: Any) -> None:
        """Submits the published file. Raises FarmError, which AYON shows."""
        values = self.get_attr_values_from_data(instance.data)
        if not values.get("rayfarm"):
            return
        path = published_usd(instance.data)
        if path is None:
            self.log.warning("Nothing was submitted: the instance has no published USD.")
            return
        first, last = (float(instance.data[name]) for name in ("frameStart", "frameEnd"))
        # A farm counts frames from the stage's start, which a published file must not change.
        frames = frames_of(0, last - first)
        options = ["--spp", str(int(values["rayfarm_spp"])), "--priority", str(int(values["rayfarm_priority"]))]
        instance.data["rayfarmJob"] = submit(path, frames, server=values["rayfarm_server"] or None, options=options)
        self.log.info(f"Rayfarm's job {instance.data['rayfarmJob']}: its frame 0 is {first:.10g}.")


def published_usd(data: Any) -> Path | None:
    """Returns the path of the first published USD file of an instance's data; None if there is none."""
    for each in (data.get("published_representations") or {}).values():
        path = Path(each["representation"]["attrib"]["path"])
        if path.suffix in EXTENSIONS:
            return path
    return None
