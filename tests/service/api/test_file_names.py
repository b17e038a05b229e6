"""Tests that download file names use the user's names, without characters that file systems or headers do not allow."""

from __future__ import annotations

from urllib.parse import unquote

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.http.file_names import content_disposition, picture_name, title_of
from service.store.models import Job

# Any character except surrogates, which JSON cannot hold. As numbers, since `st.text` first builds a table of all characters,
# which takes seconds.
LETTERS = st.one_of(st.integers(0, 0x2FF), st.integers(0, 0xD7FF), st.integers(0xE000, 0x10FFFF)).map(chr)
TEXTS = st.lists(LETTERS, max_size=300).map("".join)


def job(name: str, shot: dict[str, int] | None = None) -> Job:
    return Job(id="0a1b", name=name, settings={"width": 10, "height": 5}, shot=shot)


@pytest.mark.parametrize(
    ("name", "title"),
    [
        ("CesiumMilkTruck.glb", "CesiumMilkTruck"),
        ("Café 3.5 (night)", "Café-3.5-(night)"),
        ("../../etc/passwd", "etc-passwd"),
        ("牛乳トラック", "牛乳トラック"),
        ('a"b\\c\r\nd', "a-b-c-d"),
        ("...", "0a1b"),
    ],
)
def test_title_is_valid_file_name(name: str, title: str) -> None:
    assert title_of(job(name)) == title


def test_picture_name_has_frame_samples_and_aov() -> None:
    assert picture_name(job("Truck.glb"), 0, 50 * 128 + 7, "", "exr") == "Truck-128spp.exr"
    assert picture_name(job("Truck.glb", {"every": 1}), 12, 50, "normal", "png") == "Truck-0012-1spp-normal.png"
    assert picture_name(job("Truck"), 0, 0, "denoised", "jpg") == "Truck-0spp-denoised.jpg"


@given(TEXTS)
def test_content_disposition_round_trip(name: str) -> None:
    found = picture_name(job(name), 0, 50, "", "png")
    header = content_disposition(found)
    header.encode("ascii")
    assert not set(found) & set('/\\"\r\n\0:*?<>|')
    assert len(found.encode()) <= 255 * 2
    if "filename*" in header:
        assert unquote(header.split("filename*=UTF-8''")[1]) == found
    else:
        assert header == f'inline; filename="{found}"'
