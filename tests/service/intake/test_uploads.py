"""Tests of untrusted uploads: accepted completely, or refused with an error message and without traces."""

from __future__ import annotations

import asyncio
import io
import json
import socket
import zipfile
from collections.abc import AsyncIterator, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx
import psutil
import pytest

from service.intake import uploads
from service.intake.multipart import Form
from service.intake.uploads import receive_upload
from service.settings import Settings
from service.store.blobs import BlobFolder
from service.store.staging import BlobWriter
from tests.helpers import running_redis
from tests.service.conftest import OBJ, Service, until

LIMIT = 200_000


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis) -> Iterator[Service]:
    limits = {"max_upload_bytes": LIMIT, "max_upload_files": 20, "max_unzipped_bytes": 40 << 20, "max_unzip_ratio": 50.0}
    service = Service(tmp_path_factory.mktemp("uploads") / "data", redis_server, **limits)
    yield service
    service.stop()


def stored(service: Service) -> set[Path]:
    data: Path = service.options["data"]
    return {path for name in ("blobs", "tmp") for path in (data / name).rglob("*") if path.is_file()}


def post(service: Service, files: list[tuple[str, bytes]], **fields: str) -> httpx.Response:
    return service.http.post("/api/scenes", files=[("files", file) for file in files], data=fields)


def zip_bytes(files: dict[str, bytes], **options: Any) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name) if options else name, content, **options)
    return out.getvalue()


def assert_upload_rejected(service: Service, status: int, files: list[tuple[str, bytes]], **fields: str) -> str:
    """Uploads files, and checks that they are refused with a problem and leave no traces."""
    before = stored(service)
    answer = post(service, files, **fields)
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    assert stored(service) == before
    detail = str(answer.json()["detail"])
    named = "main", "environment", "up", "floor", *(name for name, _ in files)
    assert detail[0].isupper() or detail.startswith(named)
    assert detail.endswith(".")
    return detail


def files_of(service: Service, answer: httpx.Response) -> dict[str, bytes]:
    assert answer.status_code == 201, answer.text
    farm = service.farm
    return {file["path"]: b"".join(farm.blobs.serve(file["sha256"]).chunks) for file in answer.json()["files"]}


def test_upload_with_folders_in_names(service: Service) -> None:
    answer = post(service, [("model/cube.obj", OBJ), ("model/textures/wood.png", b"wood")], name="A cube")
    assert files_of(service, answer) == {"cube.obj": OBJ, "textures/wood.png": b"wood"}
    body = answer.json()
    assert (body["name"], body["main"], body["status"]) == ("A cube", "cube.obj", "preparing")
    assert answer.headers["location"] == f"/api/scenes/{body['id']}"


@pytest.mark.parametrize(
    ("text", "name"),
    [('name: "A still life"\n', "A still life"), ("name: lamp\n", "lamp"), ("# no name\n", "file"), ('name: "a\x07b"\n', "file")],
)
def test_yaml_file_states_scene_name(service: Service, text: str, name: str) -> None:
    assert post(service, [("file.yaml", b"shapes: []\n" + text.encode())]).json()["name"] == name


def test_zip_equals_upload_of_its_files(service: Service) -> None:
    files = {"cube.obj": OBJ, "wood.png": b"wood"}
    plain = post(service, list(files.items()))
    archive = zip_bytes({**{f"cube/{k}": v for k, v in files.items()}, "__MACOSX/cube/._cube.obj": b"x", "cube/.DS_Store": b"x"})
    packed = post(service, [("cube.zip", archive)])
    assert files_of(service, packed) == files
    assert packed.json()["id"] == plain.json()["id"]


def test_archive_names_its_scene(service: Service) -> None:
    """The name is that of an archive that is the whole upload, unless the form or a scene file in YAML states one."""
    files = {"spot/spot_triangulated.obj": OBJ + b"# zip", "spot/spot_control_mesh.obj": OBJ}
    named = post(service, [("spot.zip", zip_bytes(files))]).json()
    assert (named["name"], named["main"]) == ("spot", "spot_triangulated.obj")
    assert post(service, [("a.zip", zip_bytes({"b.obj": OBJ + b"# b"}))], name="C").json()["name"] == "C"
    assert post(service, [("a.zip", zip_bytes({"s.yaml": b"shapes: []\nname: lamp 2\n"}))]).json()["name"] == "lamp 2"
    assert post(service, [("a.zip", zip_bytes({"wood.png": b"w"})), ("b.obj", OBJ + b"# two")]).json()["name"] == "b"


def test_zip_in_a_zip_without_scene_is_unpacked(service: Service) -> None:
    """A common layout of downloaded models: source/NAME.zip beside a folder of textures."""
    inner = zip_bytes({"cube.obj": OBJ, "__MACOSX/._cube.obj": b"x"})
    answer = post(service, [("model.zip", zip_bytes({"source/cube.zip": inner, "textures/wood.png": b"wood"}))])
    assert files_of(service, answer) == {"source/cube/cube.obj": OBJ, "textures/wood.png": b"wood"}
    assert answer.json()["main"] == "source/cube/cube.obj"
    beside = post(service, [("model.zip", zip_bytes({"a.obj": OBJ, "source/cube.zip": inner}))])
    assert files_of(service, beside) == {"a.obj": OBJ, "source/cube.zip": inner}, "the scene is there"
    deep = post(service, [("model.zip", zip_bytes({"b.zip": zip_bytes({"c.zip": inner})}))])
    assert deep.status_code == 422
    assert "c.zip cannot be read here" in deep.json()["detail"]


def test_zip_bomb_in_a_zip_is_rejected(service: Service) -> None:
    bomb = zip_bytes({"a.obj": b"\0" * (20 << 20)})
    before = stored(service)
    answer = post(service, [("model.zip", zip_bytes({"inner.zip": bomb}))])
    assert answer.status_code == 413
    assert "inner.zip" in answer.json()["detail"]
    assert stored(service) == before


def test_limits_hold_for_both_levels_of_zips(service: Service) -> None:
    """20 files are allowed: 16 are, with the inner archive, but not with its five."""
    inner = zip_bytes({f"{number}.obj": OBJ for number in range(5)})
    outer = {"inner.zip": inner, **{f"{number}.png": b"x" for number in range(15)}}
    before = stored(service)
    answer = post(service, [("model.zip", zip_bytes(outer))])
    assert answer.status_code == 413
    assert "inner.zip has 5 files; at most 4 are allowed" in answer.json()["detail"]
    long = f"{'f' * 200}/" * 4 + f"{'n' * 200}.zip"
    answer = post(service, [("model.zip", zip_bytes({long: zip_bytes({f"{'a' * 200}.obj": OBJ})}))])
    assert answer.status_code == 422
    assert "too long" in answer.json()["detail"]
    assert stored(service) == before


def test_equal_upload_gives_same_scene(service: Service) -> None:
    first = post(service, [("same.obj", OBJ + b"# same")])
    before = stored(service)
    again = post(service, [("same.obj", OBJ + b"# same")])
    assert again.json()["id"] == first.json()["id"]
    assert stored(service) == before


def test_environment_and_main_file_are_selected(service: Service) -> None:
    files = [("a.obj", OBJ), ("b.obj", OBJ + b"#"), ("sky.exr", b"sky")]
    answer = post(service, files, main="b.obj", environment="sky.exr")
    assert answer.json()["main"] == "b.obj"
    assert answer.json()["warnings"] == []
    guessed = post(service, files)
    assert guessed.json()["main"] == "a.obj"
    assert "b.obj" in guessed.json()["warnings"][0]
    assert answer.json()["id"] != guessed.json()["id"]


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("../evil.obj", "leads out"),
        ("a/../../evil.obj", "leads out"),
        ("/etc/evil.obj", "absolute"),
        ("C:/evil.obj", "absolute"),
        ("a\\evil.obj", "backslash"),
        ("a\nevil.obj", "control"),
        ("x" * 300 + ".obj", "too long"),
    ],
)
def test_unsafe_names_are_rejected(service: Service, name: str, says: str) -> None:
    assert says in assert_upload_rejected(service, 422, [("scene.obj", OBJ), (name, OBJ)])
    if says != "backslash":  # the folder separator in archives of some programs
        assert says in assert_upload_rejected(service, 422, [("pack.zip", zip_bytes({"scene.obj": OBJ, name: OBJ}))])


def test_upload_without_scene_is_rejected(service: Service) -> None:
    assert "letter.txt is not a 3D scene" in assert_upload_rejected(service, 422, [("letter.txt", b"hello")])
    letters = zip_bytes({"letter.txt": b"hello", "second.txt": b"hello"})
    assert "None of the files is a scene" in assert_upload_rejected(service, 422, [("letters.zip", letters)])


def test_empty_upload_is_rejected(service: Service) -> None:
    assert "empty" in assert_upload_rejected(service, 422, [("scene.obj", b"")])
    assert "empty" in assert_upload_rejected(service, 422, [("pack.zip", zip_bytes({}))])
    empty = service.http.post("/api/scenes", content=b"--x--\r\n", headers={"content-type": "multipart/form-data; boundary=x"})
    assert empty.status_code == 422
    assert "empty" in empty.json()["detail"]
    assert service.http.post("/api/scenes").status_code == 415
    assert service.http.post("/api/scenes", json={}).status_code == 415


def test_duplicate_file_is_rejected(service: Service) -> None:
    assert "twice" in assert_upload_rejected(service, 422, [("scene.obj", OBJ), ("./scene.obj", OBJ)])
    with pytest.warns(UserWarning, match="Duplicate"):
        out = io.BytesIO()
        with zipfile.ZipFile(out, "w") as archive:
            archive.writestr("scene.obj", OBJ)
            archive.writestr("scene.obj", OBJ)
    assert "twice" in assert_upload_rejected(service, 422, [("pack.zip", out.getvalue())])


def test_path_as_file_and_folder_is_rejected(service: Service) -> None:
    says = "textures as a file, and also as the folder of textures/a.png"
    assert says in assert_upload_rejected(service, 422, [("scene.obj", OBJ), ("textures", b"x"), ("textures/a.png", b"x")])
    assert says in assert_upload_rejected(
        service, 422, [("pack.zip", zip_bytes({"scene.obj": OBJ, "textures": b"x", "textures/a.png": b"x"}))]
    )


def test_missing_main_or_environment_is_rejected(service: Service) -> None:
    assert "main" in assert_upload_rejected(service, 422, [("scene.obj", OBJ)], main="other.obj")
    assert "environment" in assert_upload_rejected(service, 422, [("scene.obj", OBJ)], environment="sky.exr")


def test_too_many_files_are_rejected(service: Service) -> None:
    many = {f"{i}.obj": OBJ for i in range(21)}
    assert "20 files" in assert_upload_rejected(service, 413, list(many.items()))
    assert "20 are allowed" in assert_upload_rejected(service, 413, [("pack.zip", zip_bytes(many))])


def test_upload_keeps_few_files_open(tmp_path: Path, service: Service) -> None:
    """The files of an upload are not all open at once, since many textures would use up the process's file descriptors."""
    are_open: list[int] = []

    class Folder(BlobFolder):
        def put(self, writer: BlobWriter) -> None:
            are_open.append(psutil.Process().num_fds())
            super().put(writer)

    settings = Settings(data=tmp_path, min_free_bytes=0)
    many = [(f"{i}.png", b"texture %d" % i) for i in range(100)]
    parts = [*many, ("scene.obj", OBJ), ("more.zip", zip_bytes({f"more/{name}": data for name, data in many}))]
    head = b'--x\r\nContent-Disposition: form-data; name="files"; filename="%s"\r\n\r\n%s\r\n'
    body = b"".join(head % (name.encode(), data) for name, data in parts) + b"--x--\r\n"

    async def chunks() -> AsyncIterator[bytes]:
        yield body

    before, store = psutil.Process().num_fds(), Folder(tmp_path / "blobs", tmp_path)
    form = "multipart/form-data; boundary=x"
    upload = asyncio.run(receive_upload(form, chunks(), store, service.farm.garbage, settings, lambda kept: kept))
    assert len(upload.files) == len(are_open) == 201
    assert max(are_open) - before < 50


def test_too_many_bytes_are_rejected(service: Service) -> None:
    assert str(LIMIT) in assert_upload_rejected(service, 413, [("scene.obj", b"v" * (LIMIT + 1))])
    before = stored(service)

    def lying() -> Iterator[bytes]:
        yield b'--x\r\nContent-Disposition: form-data; name="files"; filename="scene.obj"\r\n\r\n'
        for _ in range(30):
            yield b"v" * 10_000

    answer = service.http.post("/api/scenes", content=lying(), headers={"content-type": "multipart/form-data; boundary=x"})
    assert answer.status_code == 413
    assert stored(service) == before


def test_oversized_upload_is_rejected_before_transfer(service: Service) -> None:
    head = "POST /api/scenes HTTP/1.1\r\nHost: localhost\r\nContent-Type: multipart/form-data; boundary=x\r\n"
    with socket.create_connection(("127.0.0.1", service.port), timeout=5) as connection:
        connection.sendall(f"{head}Content-Length: {2 << 30}\r\nExpect: 100-continue\r\n\r\n".encode())
        answer = connection.recv(65536)
    assert answer.startswith(b"HTTP/1.1 413")


def test_interrupted_upload_leaves_no_files(service: Service, caplog: pytest.LogCaptureFixture) -> None:
    before = stored(service)
    body = b'--x\r\nContent-Disposition: form-data; name="files"; filename="scene.obj"\r\n\r\nv 0 0 0'
    answer = service.http.post("/api/scenes", content=body, headers={"content-type": "multipart/form-data; boundary=x"})
    assert answer.status_code == 422
    assert "interrupted" in answer.json()["detail"]
    head = b"POST /api/scenes HTTP/1.1\r\nHost: localhost\r\nContent-Type: multipart/form-data; boundary=x\r\n"
    with socket.create_connection(("127.0.0.1", service.port), timeout=5) as connection:
        connection.sendall(head + b"Content-Length: 9999\r\n\r\n" + body)
        until(lambda: stored(service) != before, "the upload has begun")
    until(lambda: stored(service) == before, "what came of it is gone")
    assert "fault" not in caplog.text


def test_zip_bombs_are_rejected(service: Service) -> None:
    bomb = zip_bytes({"scene.obj": b"\0" * (30 << 20)})
    assert len(bomb) < LIMIT
    assert "bomb" in assert_upload_rejected(service, 413, [("bomb.zip", bomb)])
    assert "at most" in assert_upload_rejected(
        service, 413, [("bomb.zip", zip_bytes({f"{i}.obj": b"\0" * (15 << 20) for i in range(3)}))]
    )


def test_zip_bomb_with_false_sizes_is_rejected(service: Service) -> None:
    size = 30 << 20
    bomb = zip_bytes({"scene.obj": b"\0" * size})
    lying = bomb.replace(size.to_bytes(4, "little"), (1000).to_bytes(4, "little"))
    assert lying != bomb
    before = stored(service)
    answer = post(service, [("bomb.zip", lying)])
    assert answer.status_code in (413, 422)
    assert stored(service) == before


def test_other_archive_formats_are_rejected(service: Service) -> None:
    link = zipfile.ZipInfo("scene.obj")
    link.external_attr = 0o120777 << 16
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr(link, "/etc/passwd")
    assert "symbolic link" in assert_upload_rejected(service, 422, [("link.zip", out.getvalue())])
    plain = zip_bytes({"scene.obj": OBJ})
    locked = bytearray(plain)
    locked[6] |= 1
    locked[plain.index(b"PK\x01\x02") + 8] |= 1
    assert "encrypted" in assert_upload_rejected(service, 422, [("locked.zip", bytes(locked))])
    assert "damaged" in assert_upload_rejected(service, 422, [("half.zip", plain[: len(plain) // 2])])
    assert "damaged" in assert_upload_rejected(service, 422, [("text.zip", b"this is no archive")])


def test_full_disk_rejects_upload(tmp_path: Path, redis_server: running_redis) -> None:
    service = Service(tmp_path / "data", redis_server, min_free_bytes=1 << 60)
    assert "disk is full" in assert_upload_rejected(service, 507, [("scene.obj", OBJ)])
    service.stop()


def test_unfinished_files_are_deleted_at_start(tmp_path: Path, redis_server: running_redis) -> None:
    settings = Settings(data=tmp_path / "data")
    settings.make_folders()
    (settings.data / "tmp" / "blob-abc").write_bytes(b"half")
    service = Service(tmp_path / "data", redis_server)
    assert stored(service) == set()
    service.stop()


def test_cancelled_queued_upload_leaves_no_files(tmp_path: Path, service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    """An upload cancelled while it waits for a thread, as when the service stops, leaves no file."""
    store = BlobFolder(tmp_path / "blobs", tmp_path)
    boundary = "-" * 8
    body = f'--{boundary}\r\nContent-Disposition: form-data; name="files"; filename="a.obj"\r\n\r\n'.encode() + OBJ
    body += f"\r\n--{boundary}--\r\n".encode()
    staged = []

    async def chunks() -> AsyncIterator[bytes]:
        yield body

    async def cancelled(function: Any, form: Form, *more: Any) -> None:
        staged.extend(writer.path for _, writer in form.files)
        raise asyncio.CancelledError

    async def upload() -> None:
        kind = f"multipart/form-data; boundary={boundary}"
        with pytest.raises(asyncio.CancelledError):
            await receive_upload(kind, chunks(), store, service.farm.garbage, service.farm.settings, lambda stored: None)

    monkeypatch.setattr(uploads, "run_in_threadpool", cancelled)
    with ThreadPoolExecutor(1) as thread:  # with browser tests in the same process, its main thread already has a loop
        thread.submit(asyncio.run, upload()).result()
    assert len(staged) == 1
    assert not staged[0].exists()


def test_blob_uploads_need_token_and_matching_hash(service: Service) -> None:
    sha256 = "2cf24dba5fb0a30e26e83b2ac5b9e29e1b161e5c1fa7425e73043362938b9824"  # SHA-256 of "hello"
    path = f"/api/farm/blobs/{sha256}"
    assert service.http.put(path, content=b"hello").status_code == 401
    assert service.http.get("/api/farm/join").json()["title"] == "Unauthorized"
    headers = {"Authorization": f"Bearer {service.options['token']}"}
    assert service.http.put(path, content=b"other", headers=headers).status_code == 422
    assert service.http.get(path, headers=headers).status_code == 404
    assert service.http.put(path, content=b"hello", headers=headers).status_code == 204
    assert service.http.get(path, headers=headers).content == b"hello"
    assert service.http.get("/api/farm/blobs/..%2f..%2fetc", headers=headers).status_code == 404
    joined = service.http.get("/api/farm/join", headers=headers).json()
    assert (Path(joined["data_dir"]) / "instance").read_text().strip() == joined["instance"]
    assert (Path(joined["data_dir"]) / "blobs" / "2c" / sha256).read_bytes() == b"hello"


def test_deleting_scene_deletes_its_exclusive_blobs(service: Service) -> None:
    one = post(service, [("one.obj", OBJ + b"# one"), ("shared.png", b"shared")]).json()
    two = post(service, [("two.obj", OBJ + b"# two"), ("shared.png", b"shared")]).json()
    hashes = {file["path"]: file["sha256"] for file in one["files"]}
    assert service.http.delete(f"/api/scenes/{one['id']}").status_code == 204
    assert not service.farm.blobs.exists(hashes["one.obj"])
    assert service.farm.blobs.exists(hashes["shared.png"])
    assert service.http.get(f"/api/scenes/{one['id']}").status_code == 404
    assert two["id"] in json.dumps(service.http.get("/api/scenes").json())


def test_missing_files_are_added_to_scene(service: Service) -> None:
    mtl = b"newmtl wood\nmap_Kd textures/wood.png\n"
    base = post(service, [("models/a.obj", b"mtllib a.mtl\n" + OBJ), ("models/a.mtl", mtl)], name="Chair").json()
    added = post(service, [("wood.png", b"a picture")], base=base["id"]).raise_for_status().json()
    assert added["id"] != base["id"]
    assert (added["name"], added["main"]) == ("Chair", "a.obj")
    assert {file["path"] for file in added["files"]} == {"a.obj", "a.mtl", "wood.png"}
    again = post(service, [("wood.png", b"another")], base=added["id"]).raise_for_status().json()
    assert again["bytes"] == added["bytes"] - 2, "in place of the one of this name"
    assert service.scene(base["id"])["id"] == base["id"], "which stays as it is"
    assert "There is no scene 'nowhere'" in assert_upload_rejected(service, 404, [("wood.png", b"a picture")], base="nowhere")
    assert "empty" in assert_upload_rejected(service, 422, [("wood.png", b"")], base=base["id"])
    assert "as a file, and also as the folder" in assert_upload_rejected(
        service, 422, [("a.obj/wood.png", b"a picture")], base=base["id"]
    )
    assert "larger than" in assert_upload_rejected(service, 413, [("wood.png", b"x" * (LIMIT - 20))], base=added["id"])
    many = [(f"{n}.png", b"%d" % n) for n in range(18)]
    assert "more than 20 files" in assert_upload_rejected(service, 413, many, base=added["id"])


def test_other_main_file_needs_no_new_upload(service: Service) -> None:
    base = post(service, [("set/a.obj", OBJ), ("set/b.obj", OBJ + b"# b\n"), ("set/wood.png", b"a picture")]).json()
    other = post(service, [("", b"")], base=base["id"], main="set/b.obj").raise_for_status().json()
    assert (base["main"], other["main"], other["name"]) == ("a.obj", "b.obj", "b")
    assert [file["path"] for file in other["files"]] == ["a.obj", "b.obj", "wood.png"]
    assert other["warnings"][0].startswith("Several scene files were given; b.obj is used."), "and the way back is named"
    assert post(service, [("", b"")], base=other["id"], main="a.obj").json()["id"] == base["id"]
    for name in ("c.obj", "wood.png"):
        assert assert_upload_rejected(service, 422, [("", b"")], base=base["id"], main=name).startswith(
            "main: the scene has no scene file"
        )


def test_up_axis_and_floor_belong_to_scene(service: Service) -> None:
    files = [("m.obj", OBJ)]
    plain = post(service, files).json()
    assert (plain["up"], plain["floor"]) == (None, None)
    turned = post(service, files, up="z", floor="auto").json()
    assert (turned["up"], turned["floor"]) == ("z", "auto")
    assert turned["id"] != plain["id"] == post(service, files, up="auto", floor="off").json()["id"]
    assert "it must be one of" in assert_upload_rejected(service, 422, files, up="w")
    assert "it must be one of" in assert_upload_rejected(service, 422, files, floor="maybe")
    gltf = [("m.gltf", b'{"asset": {"version": "2.0"}}')]
    assert ".gltf files state which axis is up" in assert_upload_rejected(service, 422, gltf, up="z")
