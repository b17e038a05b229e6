"""Tests of the wheels for a machine with a card that cannot download."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from lz4.block import _block

from tests.benchmarks.card_wheels import PLUGINS, strip_wheel
from tests.helpers import ROOT

FILES = {
    "mitsuba/__init__.py": True,
    "mitsuba/python/util.py": True,
    "mitsuba/__init__.pyi": False,
    "mitsuba/include/mitsuba/mitsuba.h": False,
    "mitsuba/mitsuba": False,
    "mitsuba/data/ior/Au.eta.spd": True,
    "mitsuba/data/srgb.coeff": False,
    "mitsuba/cuda_ad_rgb.cpython-312-x86_64-linux-gnu.so": True,
    "mitsuba/llvm_ad_spectral.cpython-312-x86_64-linux-gnu.so": False,
    "mitsuba/mitsuba_ext.cpython-312-x86_64-linux-gnu.so": True,
    "mitsuba/plugins/path.so": True,
    "mitsuba/plugins/sunsky.so": False,
}
# Prints the plugins that Mitsuba loads for the benchmark's scenes.
LOADED = """
import re, tempfile
from pathlib import Path
import mitsuba as mi
mi.set_variant("scalar_rgb")
from tests.benchmarks.bench_gpu import mitsuba_scene
from tests.benchmarks.peers.scenes import CASES
from tests.benchmarks.peers.sizes import QUICK
for make in CASES.values():
    mi.render(mitsuba_scene(mi, make(QUICK), 8, 8), spp=1)
print(*set(re.findall(r"mitsuba/plugins/(\\w+)\\.so", Path("/proc/self/maps").read_text())))
"""


@pytest.mark.long  # starts pip
def test_stripped_wheel_can_be_installed_and_lacks_what_is_not_needed(tmp_path: Path) -> None:
    whole, wheel = tmp_path / "mitsuba-3.0-py3-none-any.whl", tmp_path / "stripped" / "mitsuba-3.0-py3-none-any.whl"
    wheel.parent.mkdir()
    about = "mitsuba-3.0.dist-info"
    with zipfile.ZipFile(whole, "w") as made:
        for name in FILES:
            made.writestr(name, Path(_block.__file__).read_bytes() if ".so" in name else name)
        made.writestr(f"{about}/METADATA", "Metadata-Version: 2.1\nName: mitsuba\nVersion: 3.0\n")
        made.writestr(f"{about}/WHEEL", "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        made.writestr(f"{about}/RECORD", "".join(f"{name},,\n" for name in FILES))
    strip_wheel(whole, wheel)
    install = [sys.executable, "-m", "pip", "install", "-q", "--no-index", "--no-deps", "--no-compile"]
    subprocess.run([*install, f"--target={tmp_path / 'site'}", str(wheel)], check=True)
    assert {name: (tmp_path / "site" / name).is_file() for name in FILES} == FILES


@pytest.mark.long
def test_plugins_of_all_scenes_are_kept() -> None:
    done = subprocess.run([sys.executable, "-c", LOADED], cwd=ROOT, capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert "path" in loaded
    assert loaded <= set(PLUGINS)
