"""Tests of the views that a request gives frame by frame."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from renderer.errors import SettingsError
from service.intake.frame_view import requested_view
from service.intake.picture import picture_hash
from service.models.jobs import JobIn
from service.shot import Shot
from service.store.models import Job

VIEWS = [{"eye": [0.0, 1.0, 3.0 + n], "target": [0.0, 1.0, 0.0]} for n in range(3)]


def stored(**request: Any) -> dict[str, Any]:
    return JobIn(scene="scene", **request).model_dump(mode="json")


def test_views_belong_to_the_frames_in_order() -> None:
    for request, frames in (
        (stored(views=VIEWS), [0, 1, 2]),
        (stored(views=VIEWS, frames="8,2,4.5"), [2, 4.5, 8]),
        (stored(views=VIEWS[:1], frame=7), [7]),
    ):
        for number, view in zip(frames, VIEWS, strict=False):
            assert (requested_view(request, number) or {})["eye"] == view["eye"]
        with pytest.raises(SettingsError, match="views has no view for frame 9"):
            requested_view(request, 9)
    assert JobIn(scene="scene", views=VIEWS[:1]).is_shot
    assert requested_view(stored(), 9) is None
    assert (requested_view(stored(view=VIEWS[1]), 9) or {})["eye"] == VIEWS[1]["eye"]


@pytest.mark.parametrize("more", [{"frames": "0-3"}, {"frame": 1}, {"camera": 0}, {"turntable": 2.0}, {"view": VIEWS[0]}])
def test_views_have_one_frame_each_and_no_other_camera(more: dict[str, Any]) -> None:
    with pytest.raises(ValidationError, match=r"one view for each frame|give only one of"):
        JobIn(scene="scene", views=VIEWS, **more)


def test_the_same_views_of_other_frames_are_other_pictures() -> None:
    def hash_of(**request: Any) -> str | None:
        asked = stored(**request)
        job = Job(scene="scene", request=asked, settings={"width": 8}, tile_size=8)
        job.shot = Shot(frames=asked["frames"]).to_json()
        return picture_hash(job)

    assert hash_of(views=VIEWS) == hash_of(views=VIEWS, frames="0-2", name="again")
    assert len({hash_of(views=VIEWS), hash_of(views=VIEWS, frames="1-3"), hash_of(views=VIEWS[::-1])}) == 3
    assert hash_of(frames="0-2") == hash_of(frames="1-3")  # without views, frames are told apart by their numbers
