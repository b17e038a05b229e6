"""Stack, spilled registers and registers of the kernels for graphics cards, as ptxas reports them, and their limits."""

from __future__ import annotations

import importlib.util
import re
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from renderer.variant_names import suffixes_of

__all__ = ["Used", "architectures", "assembled", "find_assembler", "over_budget"]


class Used(NamedTuple):
    """Resources of a kernel's thread: bytes of stack, bytes of spilled registers, and number of registers."""

    stack: int
    spills: int
    registers: int


# Limits for the kernels of all variants.
BUDGET = {
    "trace_rays": Used(768, 128, 200),
    "find_camera_media": Used(768, 128, 200),
    "trace_shadow_rays": Used(1152, 320, 200),
    "trace_subsurface": Used(2304, 640, 200),
    "sample_caustics": Used(3328, 640, 255),
    "scatter_rare": Used(1152, 640, 255),
    "scatter_in_medium": Used(256, 128, 255),  # ptxas gives one of the variants 168 registers and spills 72 bytes
    "shade_misses": Used(256, 192, 200),
    "end_paths": Used(256, 64, 64),
    "prepare_draft": Used(0, 0, 64),
    "smooth_draft": Used(0, 0, 64),
    "encode_draft": Used(0, 0, 40),
    "shade_hits": Used(256, 192, 255),  # its spills are those of reflection catchers; without, there are 16 bytes
}
# Limits for kernels that add light to each group and path.
BY_LIGHT = {"end_paths": Used(256, 64, 128), "shade_misses": Used(256, 192, 240)}
OTHERS = Used(256, 64, 255)
_MEASURED = re.compile(
    r"Function properties for (\w+)\n\s+(\d+) bytes stack frame, (\d+) bytes spill stores.*\n.*Used (\d+) registers"
)


def find_assembler() -> str | None:
    """Returns the path of ptxas: of that on the PATH, or in the wheel nvidia-cuda-nvcc; None if there is neither."""
    if (found := shutil.which("ptxas")) is not None:
        return found
    package = importlib.util.find_spec("nvidia")
    folders = [] if package is None else package.submodule_search_locations or []
    return next((str(path) for folder in folders for path in sorted(Path(folder).glob("*/bin/ptxas"))), None)


def architectures(assembler: str) -> tuple[str, str]:
    """Returns the oldest architecture that ptxas assembles for and that of the H200. assembler: the path of ptxas."""
    version = subprocess.run([assembler, "--version"], capture_output=True, text=True, check=True).stdout
    is_new = int(re.findall(r"release (\d+)", version)[0]) >= 13  # and does not assemble for 7.0
    return "sm_75" if is_new else "sm_70", "sm_90"


def assembled(assembler: str, ptx: Path, architecture: str) -> dict[str, Used]:
    """Assembles a PTX file, and returns what each kernel uses. Writes the machine code beside the file."""
    command = [assembler, f"-arch={architecture}", "-v", str(ptx), "-o", str(ptx.with_suffix(".cubin"))]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stderr
    return {name: Used(*map(int, used)) for name, *used in _MEASURED.findall(said)}


def over_budget(variant: str, found: Mapping[str, Used]) -> dict[str, Used]:
    """Returns the kernels of a variant that exceed their limits. variant: with suffixes (renderer/variant_names.py)."""
    budget = BUDGET | (BY_LIGHT if suffixes_of(variant) & {"-paths", "-groups"} else {})
    return {
        name: used
        for name, used in found.items()
        if any(value > limit for value, limit in zip(used, budget.get(name, OTHERS), strict=True))
    }
