"""`python3 slim.py VENV`: removes from a virtual environment what no container runs.

That is packages' own tests, pip, type stubs, Open Image Denoise's devices for GPUs, programs, headers and libraries' symbols;
copies of a library under several names become links.
"""

from __future__ import annotations

import filecmp
import shutil
import subprocess
import sys
from pathlib import Path

# Patterns below site-packages.
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
)
# Packages whose libraries lose their symbols, and what is imported of each to see that they still load. Not numpy's and Pillow's
# own libraries: auditwheel has moved their segments, and `strip` breaks those.
STRIPPED = {
    "llvmlite": "llvmlite.binding",
    "pxr": "pxr.UsdUtils",
    "usd_core.libs": "pxr.UsdUtils",
    "lz4": "lz4.frame",
    "ufbx": "ufbx",
    "DracoPy*.so": "DracoPy",
}
LIBRARY = 100_000  # bytes from which equal files of a folder become one


def remove_unused(packages: Path) -> None:
    """Removes the files and folders that the patterns name."""
    for pattern in UNUSED:
        for path in sorted(packages.glob(pattern)):
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)


def link_copies(packages: Path) -> None:
    """Replaces a library by a link where the same folder has the same bytes under a longer name."""
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


def strip(venv: Path, packages: Path) -> None:
    """Removes symbols, where `strip` (binutils) is there. Raises CalledProcessError where a package does not load any more."""
    if (program := shutil.which("strip")) is None:
        print("strip is not there: libraries keep their symbols")
        return
    for pattern, module in STRIPPED.items():
        found = [path for each in packages.glob(pattern) for path in ([each] if each.is_file() else each.rglob("*.so*"))]
        files = [path for path in found if not path.is_symlink()]
        if files:
            subprocess.run([program, "--strip-unneeded", *files], check=True)
            subprocess.run([venv / "bin" / "python3", "-c", f"import {module}"], check=True)


def _longest(path: Path) -> tuple[int, str]:
    return -len(path.name), path.name


def _size(folder: Path) -> int:
    return sum(path.lstat().st_size for path in folder.rglob("*") if path.is_file() and not path.is_symlink())


def main(venv: str) -> None:
    """Says what it saved."""
    (packages,) = Path(venv).glob("lib/python*/site-packages")
    before = _size(packages)
    remove_unused(packages)
    for program in Path(venv).glob("bin/pip*"):
        program.unlink()
    link_copies(packages)
    strip(Path(venv), packages)
    print(f"{packages}: {before / 1e6:.0f} MB, now {_size(packages) / 1e6:.0f} MB")


if __name__ == "__main__":
    main(*sys.argv[1:])
