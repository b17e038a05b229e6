"""Opens a .blend file with its scripts off, or an Alembic file, and writes its content as a scene that Rayfarm reads.

Run by Blender's Python:

    python export.py JOB        for a Python with Blender as a module
    blender --background --factory-startup --disable-autoexec --python export.py -- JOB

JOB: a file with a JSON object: `folder` with the uploaded files, the name of the `main` one in it, `out`, an empty folder,
`most_bytes`, and `addon`, the folder of the add-on's package or null. Writes into `out`: blender-scene.yaml, blender-scene.glb,
blender-world.exr, and last report.json, with `version` and `main`, or an `error`.
"""

from __future__ import annotations

import json
import os
import sys
import traceback
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

if __name__ == "__main__":  # run as a script: makes the modules next to it importable as a package
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    __package__ = "inside"

from .sentences import Sentence, to_text
from .untrusted import DamagedError, safe_copy

ALEMBIC = ".abc"
COPIES = ".copies"
NOWHERE = "//missing-files/"
MOST_FILES = 20_000
MIN_VERSION = (4, 2)


class UploadedFiles:
    """The uploaded files of a scene, and sanitised copies of the .blend files among them."""

    def __init__(self, folder: Path, copies: Path) -> None:
        self._folder, self._copies = folder, copies
        self._files: dict[str, str] = {}  # by lower-case name
        self._bare: dict[str, str] = {}  # by name without folders
        for here, folders, names in os.walk(folder):
            folders[:] = sorted(name for name in folders if not name.startswith("."))
            for name in sorted(names):
                path = Path(here) / name
                if path.is_symlink() or not path.is_file():
                    continue
                relative = path.relative_to(folder).as_posix()
                self._files.setdefault(relative.lower(), relative)
                self._bare.setdefault(name.lower(), relative)
            if len(self._files) > MOST_FILES:
                break

    def blends(self) -> list[str]:
        """Returns the names of the .blend files."""
        return [name for name in self._files.values() if name.lower().endswith(".blend")]

    def path_to_open(self, name: str) -> Path:
        """Returns the path of the file to open in Blender: for a .blend its sanitised copy, else the uploaded file itself."""
        return (self._copies if name.lower().endswith(".blend") else self._folder) / name

    def resolve(self, path: str, beside: str) -> str:
        """Returns the replacement for `path` in the sanitised copy of a .blend: an uploaded file, or a path that does not exist.

        beside: the name of that .blend, to which relative paths refer.
        """
        cleaned = path.replace("\\", "/")
        parts = [part for part in cleaned.removeprefix("//").split("/") if part not in ("", ".") and not part.endswith(":")]
        while ".." in parts:
            i = parts.index("..")
            del parts[max(i - 1, 0) : i + 1]
        home = PurePosixPath(beside).parent
        for first in range(len(parts)):
            for base in dict.fromkeys((home, PurePosixPath())):
                if (found := self._find(base.joinpath(*parts[first:]).as_posix())) is not None:
                    return found
        bare = parts[-1] if parts else "nothing"
        return self._find(self._bare.get(bare.lower(), "")) or NOWHERE + bare

    def _find(self, name: str) -> str | None:
        if "<UDIM>" in name:
            start, _, end = name.partition("<UDIM>")
            known = [n for low, n in self._files.items() if low.startswith(start.lower()) and low.endswith(end.lower())]
            tiles = [n for n in known if n[len(start) : len(n) - len(end)].isdigit()]
            return (
                str(self._folder / (tiles[0][: len(start)] + "<UDIM>" + tiles[0][len(tiles[0]) - len(end) :])) if tiles else None
            )
        found = self._files.get(name.lower())
        return str(self.path_to_open(found)) if found else None


def copied(job: dict[str, Any]) -> Path:
    """Copies all uploaded .blend files with safe paths; returns the copy of the main one, for Blender to open."""
    folder, copies = Path(job["folder"]).resolve(), Path(job["out"]).resolve() / COPIES
    came = UploadedFiles(folder, copies)
    left = int(job["most_bytes"])
    for name in dict.fromkeys((job["main"], *came.blends())):
        target = copies / name
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            safe_copy(folder / name, target, partial(came.resolve, beside=name), left)
        except DamagedError as error:
            if name == job["main"]:
                raise
            target.unlink(missing_ok=True)  # its content is missing, and reported
            print(f"{name} {error}", file=sys.stderr)
            continue
        left -= target.stat().st_size
    return copies / job["main"]


def opened(path: Path) -> Any:
    """Opens a .blend file with factory settings (Blender's home folder is empty); returns the bpy module.

    Raises DamagedError if Blender cannot read it.
    """
    bpy = _start_blender()
    try:
        bpy.ops.wm.open_mainfile(filepath=str(path), load_ui=False, use_scripts=False)
    except RuntimeError as error:
        raise DamagedError(
            Sentence(
                "blend-open-error",
                "cannot be opened by Blender {version} ({error})",
                version=bpy.app.version_string,
                error=_error_text(error),
            )
        ) from None
    return bpy


def imported(path: Path) -> Any:
    """Imports an Alembic file into an empty scene; returns the bpy module.

    Raises DamagedError if Blender cannot read it.
    """
    bpy = _start_blender()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    try:
        # Not as a background job, which would never run here.
        bpy.ops.wm.alembic_import(filepath=str(path), as_background_job=False, set_frame_range=True)
    except RuntimeError as error:
        raise DamagedError(
            Sentence(
                "blend-open-error",
                "cannot be opened by Blender {version} ({error})",
                version=bpy.app.version_string,
                error=_error_text(error),
            )
        ) from None
    if not bpy.context.scene.objects:
        raise DamagedError(Sentence("blend-nothing-to-show", "contains nothing that Blender shows; it may be incomplete"))
    bpy.context.scene.name = path.stem
    return bpy


def _start_blender() -> Any:
    import bpy

    if bpy.app.version[:2] < MIN_VERSION:
        raise DamagedError(
            Sentence(
                "blend-blender-too-old",
                "needs Blender {needed} or later; this worker has {version}",
                needed=f"{MIN_VERSION[0]}.{MIN_VERSION[1]}",
                version=bpy.app.version_string,
            )
        )
    bpy.context.preferences.filepaths.use_scripts_auto_execute = False
    return bpy


def _error_text(error: Exception) -> str:
    return str(error).strip().splitlines()[0][:300] if str(error).strip() else type(error).__name__


def main(job: dict[str, Any]) -> dict[str, Any]:
    """Exports the scene; returns the content of report.json."""
    source = Path(job["folder"]).resolve() / job["main"]
    is_blend = source.suffix.lower() != ALEMBIC
    bpy = opened(copied(job)) if is_blend else imported(source)
    from .write_scene import write_scene

    addon = job.get("addon")
    notes = write_scene(bpy, Path(job["out"]), Path(addon) if addon else None, has_settings=is_blend)
    return {"main": "blender-scene.yaml", "version": bpy.app.version_string, "notes": len(notes)}


def run() -> int:
    """Runs this script's command line; returns the exit status."""
    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    job = json.loads(Path(arguments[0]).read_text())
    report: dict[str, Any]
    try:
        report = main(job)
    except DamagedError as error:
        report = {"error": to_text(str(error))}
    except MemoryError:
        report = {
            "error": to_text(Sentence("blend-memory", "needs more memory than this worker allows for one scene. Simplify it"))
        }
    except Exception as error:
        traceback.print_exc()
        report = {
            "error": to_text(
                Sentence(
                    "blend-conversion-failed",
                    "could not be converted to a scene ({type}: {error}). Export glTF from it instead",
                    type=type(error).__name__,
                    error=_error_text(error),
                )
            )
        }
    out = Path(job["out"])
    (out / "report.part").write_text(json.dumps(report))
    (out / "report.part").rename(out / "report.json")
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)  # Blender's shutdown is slow, and may crash


if __name__ == "__main__":
    run()
