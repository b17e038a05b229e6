"""Tests that a farm's data set is that of this process, and that an interrupted one continues with the same jobs."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image

import rayfarm
from rayfarm import Cameras
from rayfarm.client import Client, ClientError
from rayfarm.datasets import pictures
from rayfarm.datasets.pictures import NEAR
from renderer.image.encode import encode
from tests.helpers import ROOT, Farm

CORNELL = ROOT / "scenes" / "cornell-box.yaml"
CAMERAS = Cameras.orbit(3, radius=3.1, target=(0.0, 1.0, 0.0), elevation=12.0, turns=0.12, start=-105.0)
REQUEST: dict[str, Any] = {"fov": 40, "width": 48, "height": 32, "spp": 4, "max_depth": 4, "seed": 3}


def test_views_of_a_farm_have_the_bits_of_this_process(farm: Farm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pictures, "VIEWS_PER_JOB", 2)
    outputs = ["color", "depth", "instance", "masks", "flow_forward"]
    seen = list[int]()

    def stop(done: int, total: int) -> None:
        seen.append(done)
        if done == 1:
            raise KeyboardInterrupt

    with Client(farm.url) as client:
        before = {job.id for job in client.jobs()}
        with pytest.raises(KeyboardInterrupt):
            rayfarm.dataset(CORNELL, CAMERAS, farm=client, folder=tmp_path / "there", outputs=outputs, watch=stop, **REQUEST)
        assert seen == [0, 1]
        there = rayfarm.dataset(
            CORNELL, CAMERAS, farm=client, folder=tmp_path / "there", outputs=outputs, sinks=["coco"], **REQUEST
        )
        (job,) = {job.id for job in client.jobs()} - before
        assert [frame.number for frame in client.frames(job)] == [2], "the job of the views before is deleted"
    here = rayfarm.dataset(CORNELL, CAMERAS, folder=tmp_path / "here", outputs=outputs, sinks=["coco"], **REQUEST)
    assert there.views == here.views and len({*here.digests}) == 3
    assert (tmp_path / "there" / "coco.json").read_bytes() == (tmp_path / "here" / "coco.json").read_bytes()


def test_frames_that_ended_are_found_near_the_first_one_left_or_anywhere() -> None:
    class Asked:
        """A farm with one job of 1,000 frames, every second view of a data set, of which some have ended."""

        def __init__(self, ended: set[int]) -> None:
            self.ended, self.sent = ended, 0

        def frames(self, job: str, offset: int = 0, limit: int = 1000) -> list[Any]:
            found = [
                SimpleNamespace(number=float(n), state="finished" if n in self.ended else "running") for n in range(0, 2000, 2)
            ]
            self.sent += len(found[offset : offset + limit])
            return found[offset : offset + limit]

    views = [*range(0, 2000, 2)]
    for ended, taken, most in (({*range(0, 1012, 2)}, 500, NEAR), ({*range(0, 1000, 2), 1998, 1500}, 500, 1000 + NEAR)):
        farm: Any = Asked(ended)
        found = pictures._ended_frames(farm, "job", views, {*views[taken:]}, len(views) - len(ended))
        assert {frame.number for frame in found} == ended - {*views[:taken]} and farm.sent == most


@pytest.mark.long
def test_a_varied_scene_before_a_transparent_background_has_the_same_bits_on_a_farm(farm: Farm, tmp_path: Path) -> None:
    vary = {
        "seed": 5,
        "objects": {"*-box": {"move": {"uniform": [[-0.2, 0, -0.2], [0.2, 0, 0.2]]}, "turn": {"uniform": [0, 360]}}},
        "materials": {"red": {"color": {"uniform": [0, 1]}}, "light": {"power": {"log_uniform": [0.5, 2]}}},
        "environment": {"light": {"choice": ["sky:20,10", "hall.hdr"]}, "rotation": {"uniform": [0, 360]}},
    }
    request = {**REQUEST, "outputs": ["color", "instance", "boxes"], "vary": vary, "background": "transparent"}
    request["distortion"] = {"model": "fisheye", "coefficients": [0.02, -0.01]}
    cameras = Cameras.sample(5, seed=2, radius=3.5, elevation={"uniform": [0, 20]}, azimuth={"uniform": [-110, -70]})
    scene = tmp_path / "box.yaml"
    scene.write_bytes(CORNELL.read_bytes())
    light = np.random.default_rng(3).gamma(1.0, 1.0, (8, 16, 3)).astype(np.float32)
    (tmp_path / "hall.hdr").write_bytes(encode(light, "hdr"))
    there = rayfarm.dataset(scene, cameras, farm=farm.url, folder=tmp_path / "there", **request)
    here = rayfarm.dataset(scene, cameras, folder=tmp_path / "here", **request)
    assert {view["variation"]["environment"]["light"] for view in here.views} == {"sky:20,10", "hall.hdr"}
    assert there.views == here.views and len({*here.digests}) == 5
    assert len({str(view["variation"]) for view in here.views}) == 5
    with Image.open(tmp_path / "here" / here.views[0]["files"]["color"]["path"]) as picture:
        assert picture.mode == "RGBA" and 0 < np.asarray(picture)[..., 3].mean() < 255
    with Client(farm.url) as client:
        known = client.wait_for_scene(client.upload([CORNELL]).id).id
        for given, message in (
            ({"objects": {"cup": {"scale": 2}}}, "vary.objects: 'cup' is none of the scene's; it has light, floor"),
            ({"objects": {"cup": {"jump": 2}}}, "vary.objects.cup has 'jump'"),
        ):
            with pytest.raises(ClientError, match=message):
                client.submit(known, spp=1, width=8, height=8, vary=given)


@pytest.mark.long
def test_a_job_with_views_varies_as_its_scene_file_says_unless_told(farm: Farm, tmp_path: Path) -> None:
    own = {"seed": 3, "objects": {"*-box": {"turn": {"uniform": [0, 90]}}}}
    (tmp_path / "own.yaml").write_text(f"{CORNELL.read_text()}\nvary: {json.dumps(own)}\n")
    eye = {"eye": [0, 0, 3.9], "target": [0, 0, 0]}
    with Client(farm.url) as client:

        def digests(scene: str, **request: Any) -> list[str]:
            job = client.submit(scene, spp=1, width=16, height=16, **request).id
            client.wait(job)
            return [client.digest(job, frame.number) for frame in client.frames(job)]

        varied, still = (client.upload([path]).id for path in (tmp_path / "own.yaml", CORNELL))
        by_file = digests(varied, views=[eye, eye])  # before the scene is prepared
        assert by_file == digests(still, views=[eye, eye], vary=own) and by_file[0] != by_file[1]
        plain = digests(still, views=[eye, eye])
        assert digests(varied, views=[eye, eye], vary=False) == plain != by_file
        assert digests(varied, view=eye) == plain[:1]
        cameras, folder = Cameras.orbit(2, radius=3.9, turns=0.0), tmp_path / "made"
        made = rayfarm.dataset(tmp_path / "own.yaml", cameras, folder=folder, farm=client, vary=False, width=16, height=16, spp=1)
        assert made.digests[0] == made.digests[1]


def test_views_that_fit_no_frames_are_refused(farm: Farm) -> None:
    view = {"eye": [0, 1, 3], "target": [0, 1, 0]}
    with Client(farm.url) as client:
        scene = client.wait_for_scene(client.upload([CORNELL]).id).id
        for request, message in (
            ({"views": [view], "frames": "0-1"}, "views has 1 views and there are 2 frames"),
            ({"views": [view], "view": view}, "give only one of view, views"),
            ({"views": [view], "turntable": 4.0}, "give only one of turntable, views"),
            ({"views": []}, "views"),
        ):
            with pytest.raises(ClientError, match=message):
                client.submit(scene, spp=1, width=8, height=8, **request)
