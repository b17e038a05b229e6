"""Determines which files belong to a scene named on the command line."""

from __future__ import annotations

import contextlib
import re
import shutil
import tempfile
import unicodedata
import zipfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from urllib.parse import quote

from rayfarm.console import err
from rayfarm.errors import CommandError
from renderer.errors import SceneError
from renderer.formats import ARCHIVE_SUFFIXES, COLOR_CONFIG, NAMING_SUFFIXES, SCENE_SUFFIXES, is_junk, nested_archives, pick_main
from renderer.frames import frame_name, numbers_of
from renderer.zip_names import entry_names
from renderer.zips import DAMAGED

__all__ = ["files_to_upload", "is_numbered", "opened_scene", "relative_to_root"]

_ENCODINGS: tuple[str, ...] = (
    "utf-8",
    "utf-16-le",
    "utf-16-be",
    "gb18030",
    "cp932",
    "cp949",
    "big5",
    "latin-1",
    "cp1251",
    "cp437",
)
# Limits above which the folder of a scene is taken for a user's home folder.
MAX_NEIGHBOURS = 5000
MAX_UNPACKED = 8 << 30


def is_numbered(scene: Path) -> bool:
    """Returns True if a path is a pattern with one file per frame, such as smoke.####.obj."""
    return "#" in scene.name and not scene.exists() and scene.parent.is_dir() and scene.suffix.lower() in SCENE_SUFFIXES


def check(scene: Path) -> None:
    """Raises CommandError if the path cannot be a scene."""
    if is_numbered(scene):
        if not numbers_of(scene.name, [path.name for path in scene.parent.iterdir()]):
            raise CommandError(f"There is no file {scene}, nor one with a number in place of #: {frame_name(scene.name, 1)}.")
        return
    if not scene.exists():
        raise CommandError(f"There is no file {scene}.")
    if scene.is_file() and scene.suffix.lower() not in SCENE_SUFFIXES + ARCHIVE_SUFFIXES:
        if scene.suffix.lower() in (".exr", ".hdr"):
            raise CommandError(f"{scene.name} is an image, not a scene. To light a scene with it, give it by --env {scene.name}.")
        try:
            pick_main([scene.name])
        except SceneError as error:
            raise CommandError(str(error)) from None
    if scene.is_file() and scene.stat().st_size == 0:
        raise CommandError(f"{scene.name} is empty (0 bytes). Export or copy it again.")


@contextlib.contextmanager
def opened_scene(
    scene: Path, environment: Path | None = None, root: Path | None = None
) -> Iterator[tuple[Path, str, str | None]]:
    """Context manager that opens a scene: yields its folder, and relative to it the main file and the environment image.

    The latter is None if there is none. root: a folder that contains the scene; the scene may refer to all files in it. A .zip is
    unpacked temporarily. Scene readers open nothing outside the folder, so an environment image from elsewhere is placed together
    with the scene's files in a temporary folder.
    """
    check(scene)
    with contextlib.ExitStack() as stack:

        def scratch() -> Path:
            return Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="rayfarm-")))

        folder = scene if scene.is_dir() else scene.parent if root is None else root
        names = [scene.name if root is None else relative_to_root(scene, root)]
        if scene.is_dir():
            names = [p.relative_to(scene).as_posix() for p in scene.rglob("*") if p.is_file()]
        if scene.suffix.lower() in ARCHIVE_SUFFIXES:
            folder = scratch()
            names = _unpack(scene, folder, MAX_UNPACKED)
            for nested in nested_archives(names):
                inner = PurePosixPath(nested).with_suffix("")
                left = MAX_UNPACKED - sum((folder / name).stat().st_size for name in names)
                names += [f"{inner}/{name}" for name in _unpack(folder / nested, folder / inner, left)]
                names.remove(nested)
        elif environment is not None:
            folder = scratch()
            for name, path in files_to_upload(scene, root).items():
                _link(path, folder / name)
        inside = None
        if environment is not None:
            inside = f"rayfarm-environment{environment.suffix.lower()}"
            _link(environment, folder / inside)
        main, rivals = pick_main(names)
        if rivals:
            first = "unpack it and name" if scene.suffix.lower() in ARCHIVE_SUFFIXES else "name"
            err.print(
                f"note: {scene.name} holds several scenes; {main} is taken. To take another, {first} that file.", markup=False
            )
        yield folder, main, inside


def _link(path: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        target.hardlink_to(path.resolve())
    except OSError:
        shutil.copyfile(path, target)


def _unpack(archive: Path, folder: Path, max_bytes: int) -> list[str]:
    """Unpacks a zip file of the user; returns the names of its files. max_bytes: most bytes of its contents.

    Parts of names that lead outside the folder, such as "..", are removed.
    """
    try:
        with zipfile.ZipFile(archive) as packed:
            entries = [entry for entry in packed.infolist() if not entry.is_dir() and entry.filename[-1:] != "\\"]
            named = entry_names(packed, entries)
            if named.guess is not None:
                err.print(f"note: {archive.name}: {named.guess}", markup=False)
            pairs = [(_safe_entry_name(name), entry) for name, entry in zip(named.names, entries, strict=True)]
            pairs = [(name, entry) for name, entry in pairs if name and not is_junk(name)]
            entries = [entry for _, entry in pairs]
            total = sum(entry.file_size for entry in entries)
            if total > max_bytes:
                raise CommandError(
                    f"{archive.name} unpacks to {total / 2**30:.1f} GiB; at most {MAX_UNPACKED >> 30} GiB are allowed in all."
                )
            for name, entry in pairs:
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                with packed.open(entry) as source, (folder / name).open("wb") as target:
                    shutil.copyfileobj(source, target)
            return [name for name, _ in pairs]
    except (*DAMAGED, OSError) as error:
        if isinstance(error, RuntimeError) and "password" in str(error):
            raise CommandError(f"{archive.name} is encrypted. Pack it again without a password.") from error
        raise CommandError(
            f"{archive.name} cannot be unpacked. Copy it again, or pack it again as a plain zip ({error})."
        ) from error


def _safe_entry_name(name: str) -> str:
    """Returns a zip entry's name without parts that lead outside the folder; empty if nothing remains."""
    return "/".join(part for part in name.split("\0")[0].split("/") if part not in ("", ".", "..") and not part.endswith(":"))


def relative_to_root(scene: Path, root: Path) -> str:
    """Returns the path of a scene relative to a root folder. Raises CommandError if it is not inside it, or not a single file."""
    if scene.is_dir() or scene.suffix.lower() in ARCHIVE_SUFFIXES:
        raise CommandError(f"--root needs a scene file; {scene.name} holds its own files.")
    try:
        return scene.resolve().relative_to(root.resolve()).as_posix()
    except ValueError:
        raise CommandError(f"--root is {root}, which is not a folder above {scene}.") from None


def files_to_upload(scene: Path, root: Path | None = None) -> dict[str, Path]:
    """Returns the files to upload, by their path inside the scene.

    These are the scene and, recursively, every file in its folder whose name occurs in them. root: the folder to search; None:
    the scene's own. Names are searched as bytes, so no format is parsed; a superfluous file is harmless.
    """
    check(scene)
    if is_numbered(scene):
        here = {path.name: path for path in scene.parent.iterdir()}
        frames = [here[frame_name(scene.name, number)] for number in numbers_of(scene.name, here)]
        return {name: path for frame in frames for name, path in files_to_upload(frame, root).items()}
    if scene.is_dir():
        files = {p.relative_to(scene).as_posix(): p for p in scene.rglob("*") if p.is_file()}
        return {name: path for name, path in files.items() if not is_junk(name)}
    taken = {scene.name if root is None else relative_to_root(scene, root): scene}
    if scene.suffix.lower() == ".obj":  # the materials of a renamed .obj, whose name it may not contain
        beside = [path for path in scene.parent.iterdir() if path.suffix.lower() == ".mtl" and path.is_file()]
        same = [path for path in beside if path.stem.casefold() == scene.stem.casefold()]
        taken |= {
            path.name if root is None else relative_to_root(path, root): path
            for path in (same or beside)
            if len(same or beside) == 1
        }
    if scene.suffix.lower() not in NAMING_SUFFIXES:
        return taken
    neighbours = _neighbours(scene, scene.parent if root is None else root)
    if COLOR_CONFIG in neighbours:
        taken[COLOR_CONFIG] = neighbours[COLOR_CONFIG]
    unread = list(taken.values())
    while unread:
        text = _searchable_bytes(unread.pop())
        for name, path in neighbours.items():
            if name not in taken and _contains_name(text, path.name):
                taken[name] = path
                if path.suffix.lower() in NAMING_SUFFIXES:
                    unread.append(path)
    return taken


def _searchable_bytes(path: Path) -> bytes:
    """Returns the bytes of a file to search for names; for binary USD, which is compressed, the names that USD finds in it."""
    data = path.read_bytes()
    if not data.startswith(b"PXR-USDC"):
        return data
    from rayfarm.reading_files import usd_names

    return "\n".join(usd_names(path)).encode() or data


def _contains_name(text: bytes, name: str) -> bool:
    """Returns True if the bytes `text` contain a file's name, in one of `_ENCODINGS` and in NFC or NFD."""
    for spelling in _name_spellings(name):
        if spelling.isascii():
            forms, encodings = {spelling}, _ENCODINGS[:3]
        else:
            forms = {unicodedata.normalize("NFC", spelling), unicodedata.normalize("NFD", spelling)}
            encodings = _ENCODINGS
        for form in forms:
            for encoding in encodings:
                with contextlib.suppress(UnicodeEncodeError):
                    if form.encode(encoding) in text:
                        return True
    return False


def _name_spellings(name: str) -> list[str]:
    """Returns the spellings by which a file may be referred to: its name, a URI, and a pattern of frames or texture tiles."""
    digits = list(re.finditer(r"\d+", name))
    if not digits:
        return [name, quote(name)]
    start, end = digits[-1].span()
    return [
        name,
        quote(name),
        name[:start] + "<UDIM>" + name[end:],
        *(name[:start] + "#" * width + name[end:] for width in range(1, end - start + 1)),
    ]


def _neighbours(scene: Path, root: Path) -> dict[str, Path]:
    found: dict[str, Path] = {}
    for path in root.rglob("*"):
        name = path.relative_to(root).as_posix()
        if path.resolve() != scene.resolve() and path.is_file() and not is_junk(name):
            found[name] = path
            if len(found) >= MAX_NEIGHBOURS:
                break
    return found
