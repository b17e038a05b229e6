"""Converts an upload to the stored files of a scene. If a check fails, no file is stored."""

from __future__ import annotations

import hashlib
import json
from collections.abc import AsyncIterator, Callable, Collection, Iterable
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import PurePosixPath
from typing import Any, TypeVar

from starlette.concurrency import run_in_threadpool

from protocol.contract import BlobRef
from renderer.errors import SceneError
from renderer.formats import ARCHIVE_SUFFIXES, FORMATS, UP_AXES, is_junk, nested_archives, pick_main
from renderer.frames import frame_name, numbers_of
from renderer.presets import PRESETS
from renderer.sentences import Sentence, first_items
from service.errors import Invalid, TooLarge
from service.intake.archives import extract_archive
from service.intake.examples import TITLE
from service.intake.multipart import Form, read_form
from service.intake.names import plain_title, safe_name
from service.intake.projects import id_in_project
from service.settings import Settings
from service.store.blobs import BlobStore
from service.store.disk_space import disk_checker, translated_disk_errors
from service.store.garbage import Garbage
from service.store.models import Scene
from service.store.staging import BlobWriter, commit_all

__all__ = ["Upload", "changed_upload", "joined_chunks", "light_text", "receive_upload", "scene_id", "sky_text", "store_form"]

PIECE = 1 << 20
STATED_WITHIN = 1 << 16  # bytes of a YAML file in which its name is looked for
SKY = "sky:"
AUTO = "auto"
UPS = (AUTO, *UP_AXES)
FLOORS = ("on", AUTO, "off")
T = TypeVar("T")


@dataclass(frozen=True)
class Upload:
    """The stored files of a scene. `id`: hash of all other fields except name and notes.

    environment: path of an image among the files, or a preset or sky in the notation of renderer.scene. variant: material variant
    of a glTF file. strict: whether warnings make the scene fail. up: the file's axis that becomes Y; None: guessed. floor: "on",
    "auto" (for scenes without lights), or None.
    """

    id: str
    name: str
    main: str
    environment: str | None
    files: list[BlobRef]
    notes: list[str]
    variant: str | None = None
    strict: bool = False
    up: str | None = None
    floor: str | None = None

    def as_strict(self) -> Upload:
        """Returns a copy that is strict. It has a different id, so its failure does not affect the non-strict scene."""
        if self.strict:
            return self
        return replace(self, id=hashlib.sha256(f"strict\n{self.id}".encode()).hexdigest()[: len(self.id)], strict=True)

    @property
    def size(self) -> int:
        """Total size of the files in bytes."""
        return sum(file.size for file in self.files)


async def joined_chunks(chunks: AsyncIterator[bytes]) -> AsyncIterator[bytes]:
    """Yields the first chunk at once, and joins the others to pieces of at least PIECE bytes.

    Each piece is hashed and written in a thread; for small chunks the overhead would be too high.
    """
    pieces: list[bytes] = []
    size, enough = 0, 1
    async for chunk in chunks:
        pieces.append(chunk)
        size += len(chunk)
        if size >= enough:
            yield b"".join(pieces)
            pieces, size, enough = [], 0, PIECE
    if pieces:
        yield b"".join(pieces)


async def receive_upload(
    content_type: str,
    chunks: AsyncIterator[bytes],
    store: BlobStore,
    garbage: Garbage,
    settings: Settings,
    record: Callable[[Upload], T],
    find: Callable[[str], Scene] | None = None,
) -> T:
    """Receives, unpacks, checks and stores an upload. Returns the result of `record`, which is called with the stored upload.

    find: returns an existing scene by its id, for uploads that add files to it. Raises FarmError; then nothing is stored.
    """
    check_disk = disk_checker(settings.data, settings.min_free_bytes)
    limits = settings.max_upload_files, settings.max_upload_bytes
    with translated_disk_errors():
        form = await read_form(content_type, joined_chunks(chunks), store, *limits, check_disk)
        try:
            return await run_in_threadpool(store_form, form, store, garbage, settings, check_disk, record, find)
        finally:
            form.discard()  # a service that stops may cancel this before the thread has started


def store_form(
    form: Form,
    store: BlobStore,
    garbage: Garbage,
    settings: Settings,
    check_disk: Callable[[int], None],
    record: Callable[[Upload], T],
    find: Callable[[str], Scene] | None = None,
) -> T:
    """Unpacks, checks and stores a received form. Returns the result of `record`, during which the new blobs are pinned.

    find: see `receive_upload`. Raises FarmError; then nothing is stored.
    """
    sent: list[tuple[str, BlobWriter]] = []
    files: dict[str, BlobWriter] = {}
    notes: list[str] = []
    try:
        title = plain_title(form.fields.get("name", ""))
        is_strict = _boolean_field("strict", form)
        sent = _expand_archives(form, store, settings, check_disk, notes)
        for name, writer in sent:
            if name in files:
                raise Invalid(Sentence("upload-file-duplicate", "The file {name} is sent twice. Send it once.", name=name))
            files[name] = writer
        _refuse_files_as_folders(files)
        if find is not None and "base" in form.fields:
            main = form.fields.get("main", "").strip()
            return _record_added_files(
                partial(find, form.fields["base"].strip()), files, main, is_strict, garbage, settings, record
            )
        main, environment = _choose_main_and_environment(form, files, notes)
        chosen = _strip_common_folder(files, main)
        if environment is not None and environment in files:
            environment = chosen.strip(environment)
        name = title[:200] or _stated_name(chosen) or _archive_name(form) or PurePosixPath(chosen.main).stem
        with translated_disk_errors(), garbage.pinned(writer.sha256 for writer in chosen.files.values()):
            refs = _commit_files(chosen.files)
            up, floor = (
                _stored_up_axis(_choice_field("up", form, UPS), chosen.main),
                _stored_floor(_choice_field("floor", form, FLOORS)),
            )
            id = scene_id(refs, chosen.main, environment, None, up, floor)
            upload = Upload(id, name, chosen.main, environment, refs, notes, up=up, floor=floor)
            return record(upload.as_strict() if is_strict else upload)
    finally:
        form.discard()
        for _, writer in sent:
            writer.discard()


def _stated_name(chosen: _StrippedPaths) -> str:
    """Returns the name that a scene file in YAML states at its beginning; empty if it states none."""
    if not chosen.main.endswith((".yaml", ".yml")):
        return ""
    with chosen.files[chosen.main].rewind() as file:
        found = TITLE.search(file.read(STATED_WITHIN).decode("utf-8", errors="replace"))
    try:
        return plain_title(found[1])[:200] if found else ""
    except Invalid:  # for example with control characters
        return ""


def _archive_name(form: Form) -> str:
    """Returns the name without suffix of the archive that is the whole upload; empty if the upload is something else."""
    names = [PurePosixPath(safe_name(name)) for name, _ in form.files if name and not is_junk(safe_name(name))]
    if len(names) != 1 or names[0].suffix.lower() not in ARCHIVE_SUFFIXES:
        return ""
    try:
        return plain_title(names[0].stem)[:200]
    except Invalid:
        return ""


def _record_added_files(
    find: Callable[[], Scene],
    files: dict[str, BlobWriter],
    requested: str,
    is_strict: bool | None,
    garbage: Garbage,
    settings: Settings,
    record: Callable[[Upload], T],
) -> T:
    """Records a copy of a scene with added or replaced files or another main file, so that missing files can be sent later.

    find: returns the scene; raises an error if it was deleted. requested: the main file in the form; empty: unchanged.
    """
    if not requested and all(writer.size == 0 for writer in files.values()):
        raise Invalid(Sentence("upload-without-files", "The upload is empty. Choose the files to add."))
    scene = find()
    kept = [ref for ref in (BlobRef(**ref) for ref in scene.files) if ref.path not in files]
    if len(kept) + len(files) > settings.max_upload_files:
        raise TooLarge(
            Sentence(
                "scene-files-too-many",
                "With these the scene has more than {most} files. Leave some out.",
                most=settings.max_upload_files,
            )
        )
    if sum(ref.size for ref in kept) + sum(writer.size for writer in files.values()) > settings.max_upload_bytes:
        raise TooLarge(
            Sentence(
                "scene-size-too-large",
                "With these files the scene is larger than the {most} bytes allowed. Leave some out.",
                most=settings.max_upload_bytes,
            )
        )
    _refuse_files_as_folders([*files, *(ref.path for ref in kept)])
    hashes = [writer.sha256 for writer in files.values()]
    with translated_disk_errors(), garbage.pinned([*hashes, *(ref.sha256 for ref in kept)]):
        find()  # the scene may have been deleted meanwhile, with its files
        refs = sorted((*kept, *_commit_files(files)), key=_path)
        main, notes, variant, up, name = scene.main, scene.notes, scene.variant, scene.up, scene.name
        if requested:
            main, notes = _choose_main_file([ref.path for ref in refs], requested)
            variant, up = (variant, up) if main == scene.main else (None, None)
            name = PurePosixPath(main).stem if name == PurePosixPath(scene.main).stem else name
        id = scene_id(refs, main, scene.environment, variant, up, scene.floor)
        upload = Upload(id, name, main, scene.environment, refs, notes, variant, up=up, floor=scene.floor)
        return record(upload.as_strict() if (scene.strict if is_strict is None else is_strict) else upload)


def _choice_field(name: str, form: Form, among: Collection[str]) -> str | None:
    """Returns a form field that has fixed values; None if it is absent or empty. Raises Invalid for any other value."""
    text = form.fields.get(name, "").strip().lower()
    if text and text not in among:
        raise Invalid(
            Sentence(
                "choice-invalid",
                "{name} is {value}; it must be one of {values}.",
                name=name,
                value=repr(text[:60]),
                values=[*among],
            )
        )
    return text or None


def _stored_up_axis(requested: str | None, main: str) -> str | None:
    """Returns an up axis in its stored form. Raises Invalid if files in the format of `main` state their up axis."""
    if requested is None or requested == AUTO:
        return None
    suffix = PurePosixPath(main).suffix.lower()
    if not any(format.suffix == suffix and format.up for format in FORMATS):
        raise Invalid(
            Sentence("up-axis-stated-by-file", "up: {format} files state which axis is up; leave up out.", format=suffix)
        )
    return requested


def _stored_floor(requested: str | None) -> str | None:
    """Returns the value of `floor` in its stored form."""
    return None if requested == "off" else requested


def _boolean_field(name: str, form: Form) -> bool | None:
    """Returns the value of a boolean form field; None if it is absent. Raises Invalid for any other value."""
    text = form.fields.get(name, "").strip().lower()
    if text not in ("", "true", "false", "1", "0"):
        raise Invalid(
            Sentence("boolean-invalid", "{name} is {value}; it must be true or false.", name=name, value=repr(text[:60]))
        )
    return text in ("true", "1") if text else None


def _commit_files(files: dict[str, BlobWriter]) -> list[BlobRef]:
    """Commits the files to the blob store; returns their BlobRefs sorted by path."""
    hashes = commit_all(files.values())
    return sorted((BlobRef(path, sha256, files[path].size) for path, sha256 in zip(files, hashes, strict=True)), key=_path)


def _path(ref: BlobRef) -> str:
    return ref.path


def _choose_main_file(names: list[str], requested: str) -> tuple[str, list[str]]:
    """Returns the main file among `names`, and notes about other scene files. Raises Invalid if there is no scene file.

    requested: the main file in the form; it may include common folders, which are stripped from the names.
    """
    path = f"/{safe_name(requested)}"
    known = max((name for name in names if path.endswith(f"/{name}")), key=len, default=None)
    if known is not None:
        main, notes = pick_main(names, known)
        if main == known:
            return main, notes
    raise Invalid(
        Sentence(
            "main-file-not-in-scene",
            "main: the scene has no scene file {file}. Give the path of a scene file within the scene.",
            file=requested[:200],
        )
    )


def changed_upload(
    scene: Scene,
    light: str | BlobRef | None = None,
    variant: str | None = None,
    up: str | None = None,
    floor: str | None = None,
) -> Upload:
    """Returns the upload that results from applying other lighting, material variant, up axis or floor to a scene.

    light: a preset's name, a sky, or an image as a BlobRef with its path among the files; None: unchanged. variant: None:
    unchanged; empty: the file's default materials. up, floor: None: unchanged; "auto": a guessed axis, and a floor if the file
    has no lights. Raises Invalid if the variant does not exist, or the file states its up axis.
    """
    files = [BlobRef(**ref) for ref in scene.files]
    environment = light.path if isinstance(light, BlobRef) else light or scene.environment
    if isinstance(light, BlobRef):
        files = sorted([*(file for file in files if file.path != light.path), light], key=lambda file: file.path)
    variant = scene.variant if variant is None else _variant_of(scene, variant)
    up = scene.up if up is None else _stored_up_axis(up, scene.main)
    floor = scene.floor if floor is None else _stored_floor(floor)
    id = scene_id(files, scene.main, environment, variant, up, floor)
    upload = Upload(id, scene.name, scene.main, environment, files, scene.notes, variant, up=up, floor=floor)
    upload = upload.as_strict() if scene.strict else upload
    return replace(upload, id=id_in_project(scene.project, upload.id))


def _variant_of(scene: Scene, name_or_number: str) -> str | None:
    """Returns the name of a material variant given by name or number, so that equivalent requests share a scene.

    A number is returned unchanged if the name at that index is not unique. Raises Invalid if there is no such variant.
    """
    if not name_or_number or scene.info is None or "variants" not in scene.info:
        return name_or_number or None  # not known yet; preparation checks it
    names: list[str] = scene.info["variants"]
    if name_or_number in names:
        return name_or_number
    if name_or_number.isascii() and name_or_number.isdigit() and len(name_or_number) < 10 and int(name_or_number) < len(names):
        name = names[int(name_or_number)]
        return name if names.index(name) == int(name_or_number) else name_or_number
    listed = ", ".join(f"{i}: {name[:60]}" for i, name in enumerate(names[:20]))
    sentence = (
        Sentence("scene-variants-are", "its variants are {variants}", variants=listed)
        if names
        else Sentence("scene-variants-none", "it has none")
    )
    raise Invalid(
        Sentence(
            "variant-not-in-scene",
            "variant: the scene has no variant {variant}; {available}.",
            variant=repr(name_or_number[:60]),
            available=sentence,
        )
    )


def sky_text(elevation: float, azimuth: float) -> str:
    """Returns a sky in the notation of renderer.scene.sky; equal skies give equal text. elevation, azimuth: degrees.

    Raises Invalid.
    """
    if not -90.0 <= elevation <= 90.0 or not abs(azimuth) <= 360.0:
        raise Invalid(
            Sentence(
                "environment-sun-out-of-range",
                "environment: the sun's elevation must be from -90 to 90 degrees, its azimuth from -360 to 360.",
            )
        )
    return f"{SKY}{elevation:g},{azimuth % 360.0:g}"


def light_text(preset: str) -> str:
    """Returns the canonical text of a lighting preset: its name, or the equivalent sky."""
    sky = PRESETS[preset].sky
    return preset if sky is None else sky_text(*sky)


def _sky_of(text: str) -> str:
    try:
        elevation, azimuth = (float(part) for part in (text.removeprefix(SKY) + ",0").split(",")[:2])
    except ValueError:
        raise Invalid(
            Sentence(
                "environment-sky-invalid",
                "environment: {text} is not a sky; give the sun's elevation and azimuth as sky:30,120.",
                text=repr(text[:60]),
            )
        ) from None
    return sky_text(elevation, azimuth)


def scene_id(
    files: list[BlobRef],
    main: str,
    environment: str | None,
    variant: str | None = None,
    up: str | None = None,
    floor: str | None = None,
) -> str:
    """Returns the id of a scene: a hash of its files, sorted by path, and of the choices that change it."""
    content: list[Any] = [[asdict(ref) for ref in files], main, environment, *([] if variant is None else [variant])]
    if up is not None or floor is not None:  # so that other scenes keep the ids of earlier releases
        content.append({"up": up, "floor": floor})
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:20]


def _refuse_files_as_folders(names: Iterable[str]) -> None:
    """Raises Invalid if a path is both a file and a folder: a disk cannot hold both `a` and `a/b`."""
    known = set(names)
    for name in known:
        for folder in PurePosixPath(name).parents:
            if str(folder) in known:
                raise Invalid(
                    Sentence(
                        "upload-file-and-folder",
                        "The upload has {folder} as a file, and also as the folder of {name}. Rename one of them.",
                        folder=folder,
                        name=name,
                    )
                )


def _expand_archives(
    form: Form, store: BlobStore, settings: Settings, check_disk: Callable[[int], None], notes: list[str]
) -> list[tuple[str, BlobWriter]]:
    """Returns the form's files with archives replaced by their contents, without junk files.

    If there is no scene among them, archives that were in archives are replaced too.
    """
    found: list[tuple[str, BlobWriter]] = []
    left_files, left_bytes = settings.max_upload_files, settings.max_unzipped_bytes

    def expand(path: str, writer: BlobWriter, folder: str = "") -> None:
        nonlocal left_files, left_bytes
        for name, made in extract_archive(
            writer.rewind(), path, store, left_files, left_bytes, settings.max_unzip_ratio, check_disk, notes
        ):
            found.append((folder + name, made))
            safe_name(folder + name)  # may be too long
            left_files -= 1
            left_bytes -= made.size
        writer.discard()  # all its content is stored separately by now

    try:
        for name, writer in form.files:
            if not name and writer.size == 0:
                continue  # browsers send this for a file field without a selection
            path = safe_name(name)
            if is_junk(path):
                continue
            if PurePosixPath(path).suffix.lower() not in ARCHIVE_SUFFIXES:
                found.append((path, writer))
                continue
            expand(path, writer)
        for path in nested_archives([name for name, _ in found]):
            number = next(i for i, (name, _) in enumerate(found) if name == path)
            expand(path, found[number][1], f"{PurePosixPath(path).with_suffix('')}/")
            del found[number]
    except BaseException:
        for _, writer in found:
            writer.discard()
        raise
    return found


def _choose_main_and_environment(form: Form, files: dict[str, BlobWriter], notes: list[str]) -> tuple[str, str | None]:
    """Returns the path of the main file, and the environment: an image's path, a preset or a sky. Raises Invalid."""
    if files and all(writer.size == 0 for writer in files.values()):
        raise Invalid(
            Sentence(
                "upload-files-empty",
                "The upload is empty ({files}: 0 bytes). Export or copy the scene again.",
                files=first_items(sorted(files), 5),
            )
        )
    if not files:
        raise Invalid(Sentence("upload-without-scene", "The upload is empty. Choose a scene file and its textures."))
    main = form.fields.get("main", "").strip()
    if main:
        main = safe_name(main)
        numbered = [frame_name(main, number) for number in numbers_of(main, files)]  # a sequence smoke.####.obj
        if main not in files and not numbered:
            raise Invalid(
                Sentence(
                    "main-file-sequence-missing",
                    "main: there is no file {file} in the upload, nor one with a number in place of #. Give a path "
                    "within the upload.",
                    file=main,
                )
                if "#" in main
                else Sentence(
                    "main-file-not-in-upload",
                    "main: there is no file {file} in the upload. Give a path within the upload.",
                    file=main,
                )
            )
    try:
        picked, warnings = pick_main([main] if main else list(files))
    except SceneError as error:
        raise Invalid(str(error)) from None
    if picked in files and files[picked].size == 0:
        raise Invalid(Sentence("scene-file-zero-bytes", "The scene file {file} is empty. Export it again.", file=picked))
    notes += warnings
    environment = form.fields.get("environment", "").strip() or None
    if environment is not None and environment.startswith(SKY):
        environment = _sky_of(environment)
    elif environment in PRESETS and environment not in files:
        environment = light_text(environment)
    elif environment is not None:
        environment = safe_name(environment)
        if environment not in files:
            raise Invalid(
                Sentence(
                    "environment-not-in-upload",
                    "environment: there is no file {file} in the upload. Add it, or give another path.",
                    file=environment,
                )
            )
    return picked, environment


@dataclass(frozen=True)
class _StrippedPaths:
    files: dict[str, BlobWriter]
    main: str
    folder: str

    def strip(self, name: str) -> str:
        return name.removeprefix(self.folder)


def _strip_common_folder(files: dict[str, BlobWriter], main: str) -> _StrippedPaths:
    """Removes leading folders that all files share, so that a folder, or a zip of it, gives the same scene as its contents."""
    folder = "".join(f"{part}/" for part in PurePosixPath(main).parts[:-1])
    while folder and not all(name.startswith(folder) for name in files):
        folder = folder[: folder.rstrip("/").rfind("/") + 1]
    return _StrippedPaths({name.removeprefix(folder): w for name, w in files.items()}, main.removeprefix(folder), folder)
