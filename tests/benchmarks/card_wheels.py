"""Wheels for `bench gpu` on a machine that cannot download: packages that it may lack, with Mitsuba and Dr.Jit stripped.

    .venv/bin/python -m tests.benchmarks.card_wheels FOLDER [--python 3.12]

Mitsuba's wheel of 63 MB keeps the variants cuda_ad_rgb and scalar_rgb and the plugins of the benchmark's scenes, without symbols,
and packed by LZMA: 14 MB. All wheels take 27 MB. NumPy, SciPy, Numba, Pillow and PyYAML must be on the other machine.
"""

from __future__ import annotations

import argparse
import base64
import hashlib
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from importlib.metadata import version
from pathlib import Path

__all__ = ["PACKAGES", "main", "strip_wheel"]

PACKAGES = ("mitsuba", "drjit", "OpenImageIO", "lz4", "platformdirs")
GLIBC = (39, 35, 34, 31, 28, 27, 24, 17)  # minor versions in the tags of manylinux wheels
VARIANTS = ("cuda_ad_rgb", "scalar_rgb")
PLUGINS = (
    *("path", "independent", "hdrfilm", "perspective", "box", "gaussian"),
    *("diffuse", "twosided", "dielectric", "roughdielectric", "conductor", "roughconductor", "plastic", "roughplastic", "mask"),
    *("area", "constant", "envmap", "point", "spot", "directional"),
    *("rectangle", "cube", "sphere", "ply", "merge", "instance", "shapegroup"),
    *("bitmap", "srgb", "uniform", "regular", "d65", "normalmap", "null"),
)
# Of the stripped packages: headers, stubs, the program `mitsuba`, and the table for spectra.
LEFT_OUT = re.compile(r"\w+/(?:include|cmake|pkgconfig|mitsuba_stubs|mitsuba)(?:/|$)|.*\.pyi$|.*\.coeff$")
VARIANT = re.compile(r"mitsuba/((?:scalar|llvm|cuda)_\w+)\..*so")
PLUGIN = re.compile(r"mitsuba/plugins/(\w+)\.so")
RECORD = ".dist-info/RECORD"


def main() -> None:
    """Downloads and strips the wheels, and prints their sizes."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.card_wheels", description=__doc__)
    parser.add_argument("folder", type=Path, help="where the wheels are written")
    parser.add_argument("--python", default="3.12", help="the other machine's version of Python, by default 3.12")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        for package in PACKAGES:
            download(package, options.python, Path(folder))
        for wheel in sorted(Path(folder).glob("*.whl")):
            target = options.folder / wheel.name
            if wheel.name.startswith(("mitsuba", "drjit")):
                strip_wheel(wheel, target)
            else:
                shutil.copyfile(wheel, target)
            print(f"{target.stat().st_size / 1e6:5.1f} MB  {target}")


def download(package: str, python: str, folder: Path) -> None:
    """Downloads the wheel of this environment's version of a package for a version of Python. Raises CalledProcessError."""
    platforms = [f"--platform=manylinux_2_{minor}_x86_64" for minor in GLIBC]
    target = [f"--python-version={python}", "--implementation=cp", *platforms, "--platform=manylinux2014_x86_64"]
    command = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "--only-binary=:all:", *target, f"--dest={folder}"]
    subprocess.run([*command, f"{package}=={version(package)}"], check=True)


def strip_wheel(source: Path, target: Path) -> None:
    """Writes a wheel without the files that the benchmark does not need, and without symbols in its libraries."""
    rows = []
    with zipfile.ZipFile(source) as whole, zipfile.ZipFile(target, "w") as stripped:
        for entry in whole.infolist():
            name = entry.filename
            if name.endswith(RECORD):
                record = name
            elif is_kept(name):
                content = whole.read(entry)
                if ".so" in Path(name).suffixes:
                    content = without_symbols(content)
                stripped.writestr(entry, content, zipfile.ZIP_LZMA)
                digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
                rows.append(f"{name},sha256={digest},{len(content)}\n")
        stripped.writestr(record, "".join([*rows, f"{record},,\n"]))


def is_kept(name: str) -> bool:
    """Returns True if the benchmark may need a file of a wheel."""
    for pattern, wanted in ((VARIANT, VARIANTS), (PLUGIN, PLUGINS)):
        if (found := pattern.fullmatch(name)) is not None:
            return found[1] in wanted
    return not LEFT_OUT.match(name)


def without_symbols(library: bytes) -> bytes:
    """Returns a shared library without the symbols that linking at run time does not need; as it is, if there is no `strip`."""
    if (program := shutil.which("strip")) is None:
        return library
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "library.so"
        path.write_bytes(library)
        subprocess.run([program, "--strip-unneeded", str(path)], check=True)
        return path.read_bytes()


if __name__ == "__main__":
    main()
