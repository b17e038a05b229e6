"""Adds compiled kernels to a wheel: those in $RAYFARM_WHEEL_KERNELS, a folder that `python -m renderer.precompile` has filled.

Such a wheel is for the Python version, the operating system and the processor family that it is built on. Without the variable
the wheel has no machine code and is for all of them.
"""

import os
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

FOLDER = "RAYFARM_WHEEL_KERNELS"


class KernelHook(BuildHookInterface):
    """The hook that hatchling calls before it builds a wheel."""

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
