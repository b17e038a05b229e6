"""The parts of the tests that the processes of pytest-xdist run.

Each process collects and runs the files of its own part only, so that it imports neither the other files nor the libraries
that only they use. A file's part is known in advance, so that files which share something, such as a farm or a compiled kernel,
can be run by one process.
"""

from __future__ import annotations

import os
from functools import cache

__all__ = ["PARTS", "SHARE_A_FARM", "is_in_part", "own_part", "place"]

# Files that use the fixture `farm` or `browser`. The last one kills processes of the farm.
SHARE_A_FARM = (
    "e2e/",
    "rayfarm/test_with_farm.py",
    "rayfarm/library/test_farm_render.py",
    "rayfarm/datasets/test_dataset_of_farm.py",
    "rayfarm/test_job_template.py",
    "rayfarm/test_mcp_server.py",
    "submitters/",
    "chaos/test_kernels",
    "chaos/test_digest",
)

# Folders and files below tests/, by part and in the order in which a part runs them. The longest name that fits decides. In the
# default run, all parts take about equally long. Four of them mostly wait for processes and threads of farms and services; the
# others use the processors meanwhile.
PARTS: tuple[tuple[str, ...], ...] = (
    (*SHARE_A_FARM, "chaos/"),
    ("service/api/", "service/access/"),
    ("service/scheduling/", "service/ownership/", "service/maintenance/"),
    ("test_", "protocol/", "telemetry/", "page/", "worker/", "benchmarks/", "rayfarm/"),
    ("service/", "renderer/arrays/", "renderer/guiding/", "renderer/", "lineage/", "peers/"),
    ("blender/", "renderer/blender/", "renderer/confine/", "renderer/image/", "renderer/scene/", "renderer/kernel/"),
    (
        *("renderer/bvh/", "renderer/cuda/", "renderer/wide/"),
        *("renderer/kernel/bsdf/", "renderer/kernel/light/", "renderer/kernel/surface/"),
    ),
)


@cache
def place(file: str) -> tuple[int, int]:
    """Returns the number of a test file's part, and of the folder in that part. file: the path below tests/.

    Raises KeyError if no part has the file.
    """
    fits = [(len(name), n, m) for n, names in enumerate(PARTS) for m, name in enumerate(names) if file.startswith(name)]
    if not fits:
        raise KeyError(f"tests/{file} has no part: enter its folder in tests/parts.py")
    return max(fits)[1:]


def own_part() -> tuple[int, int]:
    """Returns the number of this process of pytest-xdist and the count of all; (0, 1) without xdist."""
    number = os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")
    return int(number), int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))


def is_in_part(file: str, number: int, count: int) -> bool:
    """Returns whether process `number` of `count` runs a test file, given by its path below tests/.

    Fewer processes than parts run several parts each.
    """
    return place(file)[0] % count == number % count
