"""Tests of storing compiled kernels for workers that join later."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

from renderer.kernel_file import pack
from service.access.roles import OWNER, Role
from service.store.kernels import MAX_KERNELS
from tests.service.conftest import TOKEN, Service

KERNEL = "render_pool-plain"
NAME = f"0123456789abcdef-cpython311-{KERNEL}"
SHOWN = {"Authorization": f"Bearer {TOKEN}"}


def artefact(tmp_path: Path, key: str = TOKEN) -> bytes:
    folder = tmp_path / "kernels"
    folder.mkdir(exist_ok=True)
    (folder / f"{KERNEL}.done").touch()
    file = io.BytesIO()
    pack(folder, KERNEL, key, file)
    return file.getvalue()


def test_uploaded_kernel_is_downloaded_by_other_worker(service: Service, tmp_path: Path) -> None:
    url = f"/api/farm/kernels/{NAME}"
    assert service.http.get(url, headers=SHOWN).status_code == 404
    assert service.http.put(url, content=artefact(tmp_path), headers=SHOWN).status_code == 204
    assert service.http.head(url, headers=SHOWN).status_code == 200
    service.restart()
    assert service.http.get(url, headers=SHOWN).content == artefact(tmp_path)


@pytest.mark.parametrize("name", ["x", "..%2Ftoken", "0123456789abcdef-cpython311", f"{NAME}%00"])
def test_invalid_kernel_names_are_rejected(service: Service, tmp_path: Path, name: str) -> None:
    assert service.http.put(f"/api/farm/kernels/{name}", content=artefact(tmp_path), headers=SHOWN).status_code in (404, 405, 422)
    assert service.http.get(f"/api/farm/kernels/{name}", headers=SHOWN).status_code == 404


def test_unsigned_kernel_is_rejected(service: Service, tmp_path: Path) -> None:
    url = f"/api/farm/kernels/{NAME}"
    for content in (artefact(tmp_path, "another"), artefact(tmp_path)[:-1], b""):
        answer = service.http.put(url, content=content, headers=SHOWN)
        assert answer.status_code == 422, answer.text
        assert "signed" in answer.json()["detail"]
    assert service.http.get(url, headers=SHOWN).status_code == 404
    assert not list((Path(service.options["data"]) / "kernels").iterdir())


def test_worker_token_may_only_download_kernels(service: Service, tmp_path: Path) -> None:
    url = f"/api/farm/kernels/{NAME}"
    assert service.http.put(url, content=artefact(tmp_path), headers=SHOWN).status_code == 204
    own = service.farm.access.keys.create("worker", OWNER, Role.NOBODY, "attic")[0]
    shown = {"Authorization": f"Bearer {own}"}
    assert service.http.get(url, headers=shown).content == artefact(tmp_path, own)
    answer = service.http.put(url, content=artefact(tmp_path, own), headers=shown)
    assert (answer.status_code, "own token" in answer.json()["detail"]) == (403, True)
    stored = Path(service.options["data"]) / "kernels" / NAME
    stored.write_bytes(stored.read_bytes()[:-1] + b"x")  # changed on disk, so its signature is invalid for others
    assert service.http.get(url, headers=shown).status_code == 404


def test_kernels_need_authentication(service: Service, tmp_path: Path) -> None:
    url = f"/api/farm/kernels/{NAME}"
    assert service.http.get(url).status_code == 401
    assert service.http.put(url, content=artefact(tmp_path)).status_code == 401


def test_old_kernels_are_deleted(service: Service, tmp_path: Path) -> None:
    for number in range(MAX_KERNELS + 4):
        url = f"/api/farm/kernels/{number:016x}-cpython311-{KERNEL}"
        assert service.http.put(url, content=artefact(tmp_path), headers=SHOWN).status_code == 204
    assert len(list((Path(service.options["data"]) / "kernels").iterdir())) == MAX_KERNELS
    assert service.http.get(url, headers=SHOWN).status_code == 200
