"""Tests that processors with and without AVX-512 render the same bits, so that workers of one kind can share a film."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from dataclasses import replace
from typing import Any

import pytest

from renderer import jit
from renderer.render import render_frame
from tests.helpers import ROOT
from tests.renderer.kernel.backends.features import FEATURES, made

pytestmark = [pytest.mark.hardware, pytest.mark.skipif(not jit.HAS_AVX512, reason="This processor has no AVX-512.")]

SPP = 8
# Options for which the kernel traces one path at a time.
ALONE: tuple[dict[str, Any], ...] = ({"integrator": "whitted"}, {"integrator": "ao"}, {"sampling": "light"}, {"sampling": "bsdf"})


def _without(program: str) -> list[str]:
    """Returns the lines that a program prints if it runs with AVX-512 disabled."""
    environment = {**os.environ, "RAYFARM_AVX512": "false", "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, env=environment, capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def digests() -> list[str]:
    """Returns one line per feature with the digest of its film."""
    lines = []
    for name in FEATURES:
        scene, settings = made(name)
        lines.append(f"{name} {hashlib.sha256(render_frame(scene, settings, SPP).tobytes()).hexdigest()}")
    scene, settings = made("metal and plastic")
    for change in ALONE:
        film = render_frame(scene, replace(settings, **change), SPP)
        lines.append(f"{change} {hashlib.sha256(film.tobytes()).hexdigest()}")
    return lines


def test_avx512_hosts_share_the_kind_but_not_the_kernels() -> None:
    program = "from renderer import jit; print(jit.kind()); print(jit.cache_folder().name); print(jit.HAS_AVX512)"
    kind, folder, has = _without(program)
    assert kind == jit.kind()
    assert folder != jit.cache_folder().name
    assert has == "False"


@pytest.mark.long  # compiles all kernels again
@pytest.mark.timeout(1800)
def test_every_feature_has_the_same_bits() -> None:
    program = "from tests.renderer.test_same_bits import digests; print(*digests(), sep='\\n')"
    assert _without(program) == digests()
