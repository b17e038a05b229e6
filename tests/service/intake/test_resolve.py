"""Tests that a request and a scene's defaults are resolved to complete settings, which determine the value of every sample."""

from __future__ import annotations

from typing import Any

import pytest

from rayfarm.picture import Picture
from renderer.errors import SettingsError
from renderer.settings import RenderSettings
from renderer.work import most_samples
from service.intake.resolve import resolve
from service.shot import Shot, variation_of
from service.store.models import Job, Scene

EYES = {"front": [0, 1, 5], "7": [0, 9, 1]}
INFO = {
    "cameras": [{"name": name, "view": {"eye": eye, "target": [0, 1, 0], "focus": None}} for name, eye in EYES.items()],
    "defaults": {"width": 100, "height": 50, "max_depth": 3, "ambient": [0.1, 0.2, 0.3]},
}


def resolved_settings(**request: Any) -> RenderSettings:
    job = Job(request=request)
    resolve(job, Scene(info=INFO), 1 << 20)
    assert job.settings is not None
    return RenderSettings.from_json(job.settings)


def test_scene_defaults_fill_request() -> None:
    made = resolved_settings(max_depth=5, height=25)
    assert (made.width, made.height, made.max_depth, made.ambient) == (50, 25, 5, (0.1, 0.2, 0.3))
    made = resolved_settings(environment={"color": [1, 2, 3], "strength": 0.5, "rotation": 30, "sky": None})
    assert (made.environment, made.environment_strength, made.environment_rotation) == ((1.0, 2.0, 3.0), 0.5, 30.0)


def test_views_vary_as_the_scene_file_says_unless_the_request_says_how() -> None:
    own, other = ({"objects": {"cup": {"scale": size}}} for size in (2, 3))
    views = [{"eye": [0, 1, 3], "target": [0, 1, 0]}]
    pictures = {}
    for name, said, given in (
        ("plain", None, {"views": views}),
        ("own", own, {"views": views}),
        ("same", None, {"views": views, "vary": own}),
        ("other", own, {"views": views, "vary": other}),
        ("none", own, {"views": views, "vary": False}),
        ("shot", own, {"camera": "front"}),
    ):
        job = Job(request=given, shot=Shot(frames="0").to_json(), scene="a")
        resolve(job, Scene(info={**INFO, "vary": said}), 1 << 20)
        expected = {"own": own, "same": own, "other": other}.get(name)
        assert variation_of(job.request, Shot.parse(job.shot)) == expected, name
        pictures[name] = job.picture
    assert pictures["none"] == pictures["plain"]
    assert len({pictures[name] for name in ("plain", "own", "other", "shot")}) == 4


@pytest.mark.parametrize("defaults", [{}, {"width": 100, "height": 50, "spp": 9}])
@pytest.mark.parametrize("ends", [{}, {"spp": 5}, {"noise": 0.1}, {"seconds": 60.0}, {"noise": 0.1, "spp": 7}])
def test_defaults_are_equal_with_and_without_farm(defaults: dict[str, Any], ends: dict[str, Any]) -> None:
    """Default settings are the same with and without a farm.

    Regression: `rayfarm render` stopped at 64 samples for any noise goal, and pictures of a farm had another size.
    """
    cameras = INFO["cameras"]
    job = Job(request={}, **ends)
    resolve(job, Scene(info={"cameras": cameras, "defaults": defaults}), 1 << 20)
    assert job.settings is not None
    assert RenderSettings.from_json(job.settings) == Picture().settings(cameras, defaults)  # type: ignore[arg-type]
    asked = {"spp": None, "noise": None, "seconds": None} | ends
    assert job.spp == most_samples(**asked, defaults=defaults)
    plain = defaults.get("spp", 64)
    assert job.spp == asked["spp"] or (job.spp > 10_000 if ends else job.spp == plain)


@pytest.mark.parametrize(
    ("camera", "name"), [(None, "front"), ("front", "front"), ("0", "front"), (1, "7"), ("1", "7"), ("7", "7")]
)
def test_camera_is_selected_by_name_or_number(camera: str | int | None, name: str) -> None:
    assert resolved_settings(camera=camera).view.eye == tuple(EYES[name])


@pytest.mark.parametrize("camera", ["²", "9" * 5000, "1234567", "-1", " 1", "side", "", 2, "2", 10**30])
def test_missing_camera_raises_settings_error(camera: str | int) -> None:
    """A request for a missing camera raises SettingsError, which fails only this job.

    Any other error would be raised again for each waiting job, and stop all jobs.
    """
    with pytest.raises(SettingsError, match=r"^camera is .*(0: front, 1: 7|the scene has 2)") as caught:
        resolved_settings(camera=camera)
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize(
    ("asked", "defaults", "shutter"),
    [({"shutter": 0.5}, {}, 0.5), ({}, {"shutter": 0.25}, 0.25), ({"shutter": 0.0}, {"shutter": 0.25}, 0.0), ({}, {}, 0.0)],
)
def test_still_with_open_shutter_becomes_shot(asked: dict[str, float], defaults: dict[str, float], shutter: float) -> None:
    job = Job(request=asked)
    resolve(job, Scene(info={"cameras": INFO["cameras"], "defaults": defaults}), 1 << 20)
    assert job.settings is not None
    assert job.settings["shutter"] == shutter
    assert job.shot == (Shot().to_json() if shutter else None)
