"""Errors in plain words for files that their readers refuse; the reader's error follows in brackets.

A file may be cut off by an interrupted copy, or may have other content than its suffix says, such as a picture, a web page that
was saved in place of the file, or a Git LFS pointer.
"""

from __future__ import annotations

import re
import struct
from pathlib import Path, PurePosixPath

from renderer.errors import SceneError
from renderer.image.kinds import suffix_of
from renderer.sentences import Sentence

__all__ = ["plain_error"]

_HEAD, _TAIL = 4096, 66_000  # bytes that are looked at: the end of a zip archive may be followed by 64 KiB of comment

_ZIPPED = (".usdz", ".3mf", ".zae", ".zip")
_TEXTS = (".obj", ".off", ".ase", ".ac")
_XML = (".dae", ".xml", ".x3d", ".amf", ".irrmesh", ".xgl")

# What a file is by its first bytes, the suffixes of such files, and whether they are scenes.
_CONTENTS: tuple[tuple[re.Pattern[bytes], Sentence, tuple[str, ...], bool], ...] = (
    (re.compile(rb"glTF"), Sentence("content-glb", "a binary glTF file"), (".glb", ".gltf", ".vrm"), True),
    (re.compile(rb"Kaydara FBX Binary"), Sentence("content-fbx", "an FBX file"), (".fbx",), True),
    (re.compile(rb"BLENDER"), Sentence("content-blend", "a Blender file"), (".blend",), True),
    (re.compile(rb"PXR-USDC|#usda "), Sentence("content-usd", "a USD file"), (".usd", ".usdc", ".usda", ".usdz"), True),
    (re.compile(rb"ply\r?\n"), Sentence("content-ply", "a PLY file"), (".ply",), True),
    (re.compile(rb"PK\x03\x04"), Sentence("content-zip", "a zip archive"), (".zip", ".usdz", ".3mf", ".zae"), True),
    (
        re.compile(rb"version https://git-lfs"),
        Sentence("content-git-lfs", "a Git LFS pointer (git lfs pull gets the file)"),
        (),
        False,
    ),
    (re.compile(rb"\s*<(!doctype )?html\b", re.IGNORECASE), Sentence("content-html", "a web page"), (), False),
    (re.compile(rb"\0{128}"), Sentence("content-zeros", "a file of zeros, as a failed copy leaves it"), (), False),
    (re.compile(rb"%PDF-"), Sentence("content-pdf", "a PDF document"), (), False),
)
_PICTURES = (".png", ".jpg", ".webp", ".exr", ".hdr", ".gif", ".tif", ".avif", ".psd")
_KINDS = {".jpg": "JPEG", ".tif": "TIFF", ".webp": "WebP"}
_ENDS_EARLY = {"ufbx-truncated-file", "ufbx-vertices-truncated", "data-ends-early"}
_BEGUN_NUMBER = re.compile(rb"[-+.,/0-9eE]+")  # of a number, or of a corner v/vt/vn, as much as has been written
_COMMENT = re.compile(rb"<!--.*?(?:-->|\Z)", re.DOTALL)
_ROOT = re.compile(rb"<([A-Za-z_][\w:.-]*)[\s>/]")


def plain_error(path: Path, name: str, error: SceneError) -> SceneError | None:
    """Returns an error that states in plain words what is wrong with a file, then the reader's error; None if that is unknown.

    path: the file. name: its name in the scene. error: raised by the reader of the format that the name's suffix states.
    """
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            head = file.read(_HEAD)
            file.seek(max(0, size - _TAIL))
            tail = file.read()
    except OSError:
        return None
    suffix = PurePosixPath(name).suffix.lower()
    fault = _other_content(head, name, suffix) or _cut_off(path, head, tail, size, suffix, name, error)
    if fault is None:
        return None
    return SceneError(Sentence("fault-with-detail", "{fault} ({detail})", fault=fault, detail=_detail(error)))


def _other_content(head: bytes, name: str, suffix: str) -> Sentence | None:
    for begins, content, suffixes, is_scene in _CONTENTS:
        if begins.match(head):
            if suffix in suffixes:
                return None
            if is_scene:
                return Sentence(
                    "file-is-other-format",
                    "{name} is {content}, not a {suffix} file. Change the end of its name to {right}",
                    name=name,
                    content=content,
                    suffix=suffix,
                    right=suffixes[0],
                )
            return _not_scene(name, content, suffix)
    picture = suffix_of(head)
    if picture in _PICTURES:
        return _not_scene(
            name, Sentence("content-picture", "a {kind} picture", kind=_KINDS.get(picture, picture[1:].upper())), suffix
        )
    return None


def _not_scene(name: str, content: Sentence, suffix: str) -> Sentence:
    return Sentence(
        "file-is-no-scene",
        "{name} is {content}, not a {suffix} file. Choose the scene's own file",
        name=name,
        content=content,
        suffix=suffix,
    )


def _cut_off(path: Path, head: bytes, tail: bytes, size: int, suffix: str, name: str, error: SceneError) -> Sentence | None:
    """Returns the error of a file that ends too early; None if it is whole, or not known to be cut off."""
    if head.startswith(b"glTF") and size >= 12:
        (declared,) = struct.unpack_from("<I", head, 8)
        if declared <= size:
            return None
        found, whole, unit = _in_one_unit(size, declared)
        return Sentence(
            "file-cut-off-of",
            "{name} ends before its data does: {found} of {declared} {unit}. Copy or export it again",
            name=name,
            found=found,
            declared=whole,
            unit=unit,
        )
    is_cut_off = (
        (head.startswith(b"PK\x03\x04") and suffix in _ZIPPED and b"PK\x05\x06" not in tail)
        or (head.startswith(b"Kaydara FBX Binary") and not _ENDS_EARLY.isdisjoint(_codes(error)))
        or (suffix == ".gltf" and head.lstrip()[:1] == b"{" and tail.rstrip()[-1:] != b"}")
        or (suffix in _XML and _is_xml_cut_off(head, tail))
        or (suffix in _TEXTS and _is_of_unended_line(path, tail, error))
    )
    return (
        Sentence("file-cut-off", "{name} ends before its data does. Copy or export it again", name=name) if is_cut_off else None
    )


def _in_one_unit(found: int, declared: int) -> tuple[int, int, str]:
    """Returns two sizes and their unit: the largest in which the second has two digits and differs from the first.

    found, declared: in bytes, found < declared.
    """
    for unit, size in (("GB", 10**9), ("MB", 10**6), ("kB", 10**3)):
        part, whole = round(found / size), round(declared / size)
        if whole >= 10 and part < whole:
            return part, whole, unit
    return found, declared, "B"


def _is_xml_cut_off(head: bytes, tail: bytes) -> bool:
    root = _ROOT.search(_COMMENT.sub(b"", head))
    return root is not None and b"</%b" % root[1] not in tail and not tail.rstrip().endswith(b"/>")


def _is_of_unended_line(path: Path, tail: bytes, error: SceneError) -> bool:
    """Returns True if the error is about the last line of a text file, which is not terminated, and may end within a number."""
    line = getattr(str(error), "params", {}).get("line")
    if not isinstance(line, int) or tail.endswith(b"\n") or path.read_bytes().count(b"\n") != line - 1:
        return False
    return all(_BEGUN_NUMBER.fullmatch(word) for word in tail.rpartition(b"\n")[2].split()[1:])


def _codes(error: SceneError) -> set[str]:
    """Returns the codes of an error's sentence and of the sentences in it."""
    found = set()
    rest = [str(error)]
    while rest:
        sentence = rest.pop()
        if isinstance(sentence, Sentence):
            found.add(sentence.code)
            rest += [each for each in sentence.params.values() if isinstance(each, str)]
    return found


def _detail(error: SceneError) -> str:
    """Returns the cause in an error, without the file's name and the advice where it has parts."""
    params = getattr(str(error), "params", {})
    if "place" in params and "fault" in params:
        return Sentence("fault-at-place", "{place} {fault}", place=params["place"], fault=params["fault"])
    if "line" in params:
        return Sentence("line-numbered", "line {line}", line=params["line"])
    return next((params[each] for each in ("error", "reason") if each in params), str(error))
