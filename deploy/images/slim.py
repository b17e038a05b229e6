"""`python3 slim.py VENV`: removes unused files from a virtual environment for a container image.

These are packages' own tests, pip, type stubs, Open Image Denoise's GPU devices, unused parts of USD, Numba and Celery, libraries
whose dependencies the images lack (hwloc, TBB, OpenMP), programs, headers and library symbols. Copies of a library under several
names become links.
"""

from __future__ import annotations

import filecmp
import shutil
import subprocess
import sys
from pathlib import Path

# Patterns below site-packages, including modules used only by Celery's command line.
UNUSED = (
    "pip",
    "pip-*.dist-info",
    "setuptools",
    "setuptools-*.dist-info",
    "pkg_resources",
    "_distutils_hack",
    "distutils-precedence.pth",
    "**/tests",
    "**/*.pyi",
    "**/*.a",
    "numpy/_core/include",
    "numpy/distutils",
    "numpy/f2py",
    "numba/cuda",
    "celery/bin",
    "click_repl*",
    "prompt_toolkit*",
    "wcwidth*",
    "pxr/UsdHydra",
    "pxr/UsdLod",
    "pxr/UsdMedia",
    "pxr/UsdProc",
    "pxr/UsdProfiles",
    "pxr/UsdRender",
    "pxr/UsdRi",
    "pxr/UsdSemantics",
    "pxr/UsdValidation",
    "pxr/UsdVol",
    "OpenImageIO/bin",
    "OpenImageIO/include",
    "OpenImageIO/share",
    "pyoidn/oidn/bin",
    "pyoidn/oidn/lib/cmake",
    "pyoidn/oidn/include",
    "pyoidn/oidn/lib/*_cuda.so*",
    "pyoidn/oidn/lib/*_hip.so*",
    "pyoidn/oidn/lib/*_sycl.so*",
    "pyoidn/oidn/lib/libsycl*",
    "pyoidn/oidn/lib/libumf*",
    "pyoidn/oidn/lib/libur_*",
    "pyoidn/oidn/lib/libtbbbind*",
    "numba/np/ufunc/omppool*.so",
    "numba/np/ufunc/tbbpool*.so",
)
LIBRARY = 100_000  # minimum bytes of libraries to link and strip
LOAD = "import ctypes, os, sys; ctypes.CDLL(sys.argv[1], os.RTLD_NOW)"


def remove_unused(packages: Path) -> None:
    """Removes the files and folders that match the patterns."""
    for pattern in UNUSED:
        for path in sorted(packages.glob(pattern)):
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)


def link_copies(packages: Path) -> None:
    """Replaces a library by a link if its folder contains the same bytes under a longer name."""
    folders = {path.parent for path in packages.rglob("*.so*")}
    for folder in folders:
        files = sorted((path for path in folder.glob("*.so*") if not path.is_symlink() and path.is_file()), key=_longest)
        for number, path in enumerate(files):
            size = path.stat().st_size
            for other in files[:number]:
                if size > LIBRARY and not other.is_symlink() and filecmp.cmp(path, other, shallow=False):
                    path.unlink()
                    path.symlink_to(other.name)
                    break


def strip(packages: Path) -> None:
    """Removes symbols that loading does not need, if `strip` (binutils) is installed.

    A library that no longer loads as before is restored: auditwheel moves segments of some, which `strip` breaks.
    """
    if (program := shutil.which("strip")) is None:
        print("strip is not installed: libraries keep their symbols")
        return
    for path in sorted(packages.rglob("*.so*")):
        if path.is_symlink() or not path.is_file() or path.stat().st_size < LIBRARY:
            continue
        original = path.with_name(f"{path.name}.original")
        shutil.copy2(path, original)
        subprocess.run([program, "--strip-unneeded", path], check=True)
        if original.stat().st_size - path.stat().st_size < LIBRARY or _load(path) != _load(original):
            original.replace(path)
        else:
            original.unlink()


def _load(library: Path) -> str:
    """Returns why a library cannot be loaded in Python; "" if it can.

    The usual cause is a dependency that its package loads first.
    """
    outcome = subprocess.run([sys.executable, "-c", LOAD, library], capture_output=True, check=False, text=True)
    return "" if outcome.returncode == 0 else f"{outcome.returncode}: {outcome.stderr.replace(str(library), '').strip()}"


def _longest(path: Path) -> tuple[int, str]:
    return -len(path.name), path.name


def _size(folder: Path) -> int:
    return sum(path.lstat().st_size for path in folder.rglob("*") if path.is_file() and not path.is_symlink())


def main(venv: str) -> None:
    """Slims the environment and prints its size before and after."""
    (packages,) = Path(venv).glob("lib/python*/site-packages")
    before = _size(packages)
    remove_unused(packages)
    for program in Path(venv).glob("bin/*"):
        if not program.name.startswith("python"):
            program.unlink()
    link_copies(packages)
    strip(packages)
    print(f"{packages}: {before / 1e6:.0f} MB, now {_size(packages) / 1e6:.0f} MB")


if __name__ == "__main__":
    main(*sys.argv[1:])
