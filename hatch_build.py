"""Adds compiled kernels to a wheel: those in the folder $RAYFARM_WHEEL_KERNELS, filled by `python -m renderer.precompile`.

Such a wheel is only for the Python version, operating system and processor family it is built on. Without the variable the wheel
has no machine code and runs on all of them.
"""

import os
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

FOLDER = "RAYFARM_WHEEL_KERNELS"


class KernelHook(BuildHookInterface):
    """The build hook that hatchling calls."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Adds the folder's kernels as renderer/kernels, where renderer/shipped_kernels.py finds them."""
        if version != "standard" or not (folder := os.environ.get(FOLDER, "")):
            return
        kernels = Path(folder) / "kernels"
        if not list(kernels.glob("*/*.done")):
            raise ValueError(f"{FOLDER} is {folder}, which has no kernels; make them by: python -m renderer.precompile {folder}")
        build_data["force_include"][str(kernels)] = "renderer/kernels"
        build_data["pure_python"] = False
        build_data["infer_tag"] = True
