"""Tests of data sets that are copied to an S3 bucket, and continued from there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import obstore
import pytest

import rayfarm
from renderer.errors import SettingsError
from service.store.s3 import open_bucket
from tests.object_store import s3, s3_server
from tests.rayfarm.datasets.test_datasets import made

__all__ = ["s3", "s3_server"]  # fixtures

OUTPUTS = ["depth", "masks"]


def objects(url: str) -> dict[str, bytes]:
    """Returns the objects of a bucket below a prefix, by the rest of their names."""
    store = open_bucket(url)
    names = [item["path"] for page in obstore.list(store) for item in page]
    return {name: bytes(obstore.get(store, name).bytes()) for name in names}


def files(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.long
def test_a_run_continues_from_the_bucket_on_another_machine(s3: str, tmp_path: Path) -> None:
    seen = list[int]()

    def stop(done: int, total: int) -> None:
        seen.append(done)
        if done == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        made(tmp_path / "a", OUTPUTS, sink=s3, watch=stop)
    assert "depth/000000.npy" in objects(s3) and "depth/000001.npy" not in objects(s3)
    seen.clear()
    again = made(tmp_path / "b", OUTPUTS, sink=s3, sinks=["coco"], watch=lambda done, total: seen.append(done))
    assert seen == [1, 2, 3]  # the first view came from the bucket
    assert objects(s3) == files(tmp_path / "b")
    assert again.views == made(tmp_path / "c", OUTPUTS).views
    obstore.put(open_bucket(s3), "depth/000002.npy", b"damaged")
    third = made(tmp_path / "d", OUTPUTS, sink=s3)
    assert third.views == again.views and objects(s3)["depth/000002.npy"] == files(tmp_path / "b")["depth/000002.npy"]
    with pytest.raises(SettingsError, match="some/prefix holds another data set; name a new prefix"):
        made(tmp_path / "e", ["depth"], sink=s3)
    with pytest.raises(SettingsError, match="there is no bucket nowhere; create it"):
        made(tmp_path / "f", ["depth"], sink="s3://nowhere/a")


def test_a_manifest_of_a_bucket_names_files_of_views_alone() -> None:
    from rayfarm.datasets.s3 import _is_name

    assert _is_name("flow_forward_occluded/000012.npy")
    assert not any(map(_is_name, ("../depth/000000.npy", "/etc/passwd", "depth/../../a.npy", "dataset.json", "depth/0.npy\n")))


@pytest.mark.parametrize("sink", ["s3://bucket", "gs://bucket/a", "s3:///a", "folder", 7])
def test_an_address_that_is_none_is_refused(sink: Any, tmp_path: Path) -> None:
    with pytest.raises(rayfarm.RayfarmError, match="it is an address such as s3://bucket/prefix"):
        made(tmp_path / "a", ["depth"], sink=sink)
