"""Tests of finding the files that belong to a scene given by name."""

import zipfile
from pathlib import Path

import pytest

from rayfarm import scene_files
from rayfarm.errors import CommandError
from rayfarm.scene_files import files_to_upload, opened_scene


@pytest.fixture
def scene_folder(tmp_path: Path) -> Path:
    (tmp_path / "textures").mkdir()
    (tmp_path / "room.obj").write_text("mtllib room.mtl\nv 0 0 0\n")
    (tmp_path / "room.mtl").write_text("newmtl a\nmap_Kd textures/old floor.png\n")
    (tmp_path / "textures" / "old floor.png").write_bytes(b"png")
    (tmp_path / "diary.txt").write_text("not for the farm")
    (tmp_path / "other.obj").write_text("v 1 1 1\n")
    return tmp_path


def test_referenced_files_are_uploaded_and_no_others(scene_folder: Path) -> None:
    assert set(files_to_upload(scene_folder / "room.obj")) == {"room.obj", "room.mtl", "textures/old floor.png"}


def test_url_encoded_names_are_found(tmp_path: Path) -> None:
    (tmp_path / "a b.bin").write_bytes(b"\0")
    (tmp_path / "scene.gltf").write_text('{"buffers": [{"uri": "a%20b.bin"}]}')
    assert set(files_to_upload(tmp_path / "scene.gltf")) == {"scene.gltf", "a b.bin"}


def test_light_profiles_and_textures_are_uploaded(tmp_path: Path) -> None:
    for name in ("lamp.ies", "slide.png", "other.ies"):
        (tmp_path / name).write_bytes(b"\0")
    (tmp_path / "a.yaml").write_text("lights: [{profile: lamp.ies}, {picture: slide.png}]\n")
    assert set(files_to_upload(tmp_path / "a.yaml")) == {"a.yaml", "lamp.ies", "slide.png"}


def test_folder_is_uploaded_without_junk_files(scene_folder: Path) -> None:
    (scene_folder / ".DS_Store").touch()
    assert set(files_to_upload(scene_folder)) == {"room.obj", "room.mtl", "textures/old floor.png", "diary.txt", "other.obj"}


def test_external_environment_is_placed_in_scene_folder(scene_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    sky = tmp_path_factory.mktemp("skies") / "sky.exr"
    sky.write_bytes(b"exr")
    with opened_scene(scene_folder / "room.obj", sky) as (folder, main, inside):
        assert main == "room.obj"
        assert inside is not None
        assert (folder / inside).read_bytes() == b"exr"
        assert (folder / "textures" / "old floor.png").exists()
        assert folder != scene_folder
    assert not folder.exists()
    assert sky.exists()


def test_damaged_zip_gives_error(tmp_path: Path) -> None:
    archive = tmp_path / "room.zip"
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr("a.obj", "v 0 0 0\n" * 5000)
    whole = bytearray(archive.read_bytes())
    whole[35:55] = b"\xff" * 20  # bytes of the compressed stream, after the entry's name
    archive.write_bytes(whole)
    with pytest.raises(CommandError, match=r"room\.zip cannot be unpacked"), opened_scene(archive):
        pass


def test_zip_is_unpacked_temporarily(scene_folder: Path, tmp_path: Path) -> None:
    archive = tmp_path / "room.zip"
    with zipfile.ZipFile(archive, "w") as packed:
        packed.write(scene_folder / "room.obj", "inside/room.obj")
        packed.writestr("__MACOSX/room.obj", "junk")
        packed.writestr("../climbing.obj", "v 0 0 0")
    with opened_scene(archive) as (folder, main, _):
        assert (folder / main).exists()
        assert (folder / "inside" / "room.obj").exists()
        assert not (folder.parent / "climbing.obj").exists()
        assert not (folder / "__MACOSX").exists()


def test_zip_in_a_zip_is_unpacked(scene_folder: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "inner.zip", "w") as packed:
        packed.write(scene_folder / "room.obj", "room.obj")
    with zipfile.ZipFile(tmp_path / "model.zip", "w") as packed:
        packed.write(tmp_path / "inner.zip", "source/inner.zip")
    with opened_scene(tmp_path / "model.zip") as (folder, main, _):
        assert main == "source/inner/room.obj"
        assert (folder / main).read_bytes() == (scene_folder / "room.obj").read_bytes()


def test_limit_of_size_holds_for_both_levels_of_zips(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("a.zip", "b.zip"):
        with zipfile.ZipFile(tmp_path / name, "w", zipfile.ZIP_DEFLATED) as packed:
            packed.writestr("room.obj", "v 0 0 0\n" * 1000)
    with zipfile.ZipFile(tmp_path / "model.zip", "w") as packed:
        for name in ("a.zip", "b.zip"):
            packed.write(tmp_path / name, name)
    monkeypatch.setattr(scene_files, "MAX_UNPACKED", 15_000)
    with pytest.raises(CommandError, match=r"^b\.zip unpacks to"), opened_scene(tmp_path / "model.zip"):
        pass


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("missing.glb", None, "There is no file"),
        ("empty.glb", b"", "empty.glb is empty"),
        ("notes.docx", b"text", "notes.docx is not a 3D scene"),
        ("sky.exr", b"light", "To light a scene with it, give it by --env sky.exr"),
        ("model.max", b"text", "model.max cannot be read here. In 3ds Max, choose"),
        ("broken.zip", b"PK no zip", "broken.zip cannot be unpacked"),
    ],
)
def test_path_that_is_no_scene_gives_error(tmp_path: Path, name: str, content: bytes | None, sentence: str) -> None:
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(CommandError, match=sentence), opened_scene(path):
        pass


def test_names_in_other_encodings_are_found(tmp_path: Path) -> None:
    for name in ("木纹.png", "木目.png", "cafe\u0301.png", "paint.1002.png", "diary.png"):
        (tmp_path / name).write_bytes(b"png")
    (tmp_path / "m.obj").write_text("mtllib lost.mtl\n")
    text = "map_Kd 木纹.png\n".encode("gbk") + "map_Ks 木目.png\n".encode("cp932")
    text += "map_Ke café.png\nnorm paint.<UDIM>.png".encode()
    (tmp_path / "m.mtl").write_bytes(text)
    assert set(files_to_upload(tmp_path / "m.obj")) == {
        "m.obj",
        "m.mtl",
        "木纹.png",
        "木目.png",
        "cafe\u0301.png",
        "paint.1002.png",
    }


def test_zip_with_backslashes_is_unpacked_into_folders(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("x\\m.obj", "v 0 0 0\n")
        archive.writestr("..\\t.png", "")
    with opened_scene(tmp_path / "a.zip") as (folder, main, _):
        assert main == "x/m.obj"
        assert (folder / "t.png").is_file()
