"""Tests that kernels access memory only inside their arrays: each array is next to an inaccessible page."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from renderer.arrays.scene import check, example, flat
from renderer.arrays.scene_features import KERNEL_VARIANTS
from tests.helpers import ROOT
from tests.renderer.fenced import CHECKED, KERNELS, SIDES
from tests.renderer.kernel.backends.features import FEATURES


def rendered(side: str, kernel: str, names: list[str], **environment: str) -> None:
    """Renders features in a separate process, with an inaccessible page at the given side of each array (see fenced.py).

    Fails with the name of the feature during which the process crashed.
    """
    command = [sys.executable, "-m", "tests.renderer.fenced", side, kernel, *names]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, **environment})
    assert done.returncode == 0, f"{done.stdout.splitlines()[-1:]} died of {-done.returncode}: {done.stderr[-2000:]}"
    assert done.stdout.splitlines() == names


def test_example_scene_is_valid() -> None:
    check(flat(example()))


@pytest.mark.long
def test_media_kernel_warm_up_stays_inside_its_arrays() -> None:
    rendered("behind", "pool", ["warm-up of media", "fog"])


@pytest.mark.long
@pytest.mark.timeout(7200)  # compiles kernels
@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("kernel", KERNELS)
def test_every_feature_stays_inside_its_arrays(side: str, kernel: str) -> None:
    warmed = [f"warm-up of {variant}" for variant in KERNEL_VARIANTS] if kernel == "pool" else []
    rendered(side, kernel, [*warmed, *FEATURES])


@pytest.mark.long
@pytest.mark.timeout(7200)  # compiles every kernel again
@pytest.mark.parametrize("kernel", KERNELS)
def test_bounds_checked_kernels_find_no_fault(tmp_path: Path, kernel: str) -> None:
    rendered(CHECKED, kernel, list(FEATURES), RAYFARM_CACHE=str(tmp_path))


@pytest.mark.long
def test_bounds_check_raises_index_error(tmp_path: Path) -> None:
    """With bounds checks an access outside an array raises; if it did not, the test above could never fail."""
    (tmp_path / "outside.py").write_text(
        "import numpy as np\nfrom renderer import jit, target\ntarget._Context.enable_boundscheck = True\n"
        "@jit.device\ndef inner(a, i):\n    return a[i]\n@jit.entry\ndef outer(a, i):\n    return inner(a, i)\n"
        "assert outer(np.arange(3.0), 2) == 2\nouter(np.arange(3.0), 3)\n"
    )
    environment = {**os.environ, "RAYFARM_CACHE": str(tmp_path), "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, tmp_path / "outside.py"], check=False, capture_output=True, env=environment)
    assert b"IndexError: index is out of bounds" in done.stderr


@pytest.mark.long
def test_access_beyond_a_fence_crashes() -> None:
    """An access beyond a fence crashes the process; if it did not, the tests above could never fail."""
    program = "import numpy as np; from tests.renderer.fenced import fenced; a = fenced(np.ones(3), '{}'); "
    program += "print(np.lib.stride_tricks.as_strided(a[{}:], (2,), ({},)))"
    for side, first, stride in (("behind", 2, 8), ("before", 0, -8)):
        done = subprocess.run([sys.executable, "-c", program.format(side, first, stride)], check=False, capture_output=True)
        assert done.returncode == -11, side
