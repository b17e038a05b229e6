"""Converts a .blend or .abc file to Rayfarm's scene format, by Blender in a sandboxed process with resource limits."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

from renderer.blender.program import Blender
from renderer.errors import SceneError
from renderer.sentences import Sentence, from_text

__all__ = ["SUFFIX", "convert"]

SUFFIX = ".blend"
HERE = Path(__file__).resolve().parent
SCRIPT = HERE / "inside" / "export.py"
SENTENCES = HERE.parent / "sentences.py"  # loaded by `inside`
# The folder of Blender's add-on with shader modules: at the top of a clone, in the service's package of an installation.
_ABOVE = HERE.parents[1]
_ADDONS = tuple(place / "blender" / "rayfarm_addon" for place in (_ABOVE, _ABOVE / "service"))
OUTPUT_FILES = ("blender-scene.yaml", "blender-scene.glb", "blender-world.exr", "blender-lamp-*.exr")
OWN_MEMORY = 6 << 30  # address space that Blender uses before opening a file
MOST_BYTES = 8 << 30
MAX_ERROR_OUTPUT = 600
# System files: libraries, font settings, the time zone, the number of processors.
SYSTEM = (
    *("/usr", "/lib", "/lib64", "/bin", "/opt", "/etc/ld.so.cache", "/etc/fonts", "/etc/localtime", "/etc/alternatives"),
    *("/proc/self", "/proc/cpuinfo", "/proc/meminfo", "/proc/stat", "/proc/sys/vm", "/sys/devices/system", "/sys/fs/cgroup"),
    *("/dev/urandom", "/dev/random", "/dev/zero"),
)


class _SlowError(Exception):
    """Raised if the conversion exceeded its time limit."""


def convert(blender: Blender, folder: Path, main: str, out: Path, memory_bytes: int, seconds: float) -> str:
    """Writes blender-scene.yaml and the files that it refers to into the folder `out`; returns the name of the scene file.

    folder: the uploaded files, the only ones that Blender may open. main: the name of the file to convert. seconds: time limit.
    Raises SceneError with a sentence that begins with that name.
    """
    with tempfile.TemporaryDirectory(prefix="rayfarm-blender-") as name:
        room = Path(name).resolve()
        work = room / "out"
        work.mkdir()
        (room / "home").mkdir()
        job = room / "job.json"
        addon = next((str(place) for place in _ADDONS if place.is_dir()), None)
        told = {"folder": str(folder.resolve()), "main": main, "out": str(work), "addon": addon}
        job.write_text(json.dumps({**told, "most_bytes": min(memory_bytes, MOST_BYTES)}))
        try:
            ended = _run(blender, folder, room, job, memory_bytes + OWN_MEMORY, seconds)
        except _SlowError:
            raise SceneError(
                Sentence(
                    "blender-timeout",
                    "{file}: took longer than {seconds} seconds in Blender. Make it smaller.",
                    file=main,
                    seconds=f"{seconds:.0f}",
                )
            ) from None
        try:
            report = json.loads((work / "report.json").read_text())
            if not isinstance(report, dict):
                raise ValueError("no report")
        except (OSError, ValueError, RecursionError):
            raise SceneError(
                Sentence(
                    "blender-importer-failed",
                    "{file}: {ended} It may be damaged, or need more memory than allowed; export glTF from it.",
                    file=main,
                    ended=ended,
                )
            ) from None
        if "error" in report:
            raise SceneError(
                Sentence("blender-import-error", "{file}: {error}.", file=main, error=from_text(str(report["error"])))
            )
        for path in sorted(found for each in OUTPUT_FILES for found in work.glob(each)):
            if path.is_file() and not path.is_symlink():
                shutil.move(path, out / path.name)
    return OUTPUT_FILES[0]


def _run(blender: Blender, folder: Path, work_folder: Path, job: Path, memory: int, seconds: float) -> str:
    """Runs the conversion; returns a sentence about how the process ended. Raises _SlowError at the time limit."""
    limits = {
        "reads": [
            *SYSTEM,
            *blender.reads,
            str(HERE),
            str(SCRIPT.parent),
            str(SENTENCES),
            *map(str, _ADDONS),
            str(folder.resolve()),
            str(job),
        ],
        "writes": [str(work_folder / "out"), str(work_folder / "home"), "/dev/null"],
        "memory": memory,
        "seconds": int(seconds * (os.cpu_count() or 1)) + 1,
    }
    command = [
        sys.executable,
        "-I",
        str(HERE / "confined.py"),
        json.dumps(limits),
        *blender.command(SCRIPT, str(job)),
    ]
    home = str(work_folder / "home")
    env = {
        "PATH": "/usr/bin:/bin",
        "LANG": "C.UTF-8",
        **dict.fromkeys(("HOME", "TMPDIR", "XDG_CONFIG_HOME", "XDG_CACHE_HOME", "XDG_DATA_HOME", "BLENDER_USER_RESOURCES"), home),
        "PYTHONDONTWRITEBYTECODE": "1",
        "MALLOC_ARENA_MAX": "2",
    }
    log = work_folder / "log.txt"
    with log.open("wb") as said:
        child = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=said, stderr=subprocess.STDOUT, env=env, cwd=home, start_new_session=True
        )
        try:
            code = child.wait(seconds)
        except subprocess.TimeoutExpired:
            raise _SlowError from None
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(child.pid, signal.SIGKILL)
            child.wait()
    with log.open("rb") as output:
        output.seek(max(log.stat().st_size - MAX_ERROR_OUTPUT, 0))
        words = output.read().decode("utf-8", "replace").strip().splitlines()
    print("\n".join(words), file=sys.stderr)
    how = next((each.name for each in signal.Signals if each == -code), f"code {code}")
    return Sentence(
        "blender-ended", "Blender {version} ended while it opened the file ({how}).", version=blender.version, how=how
    )
