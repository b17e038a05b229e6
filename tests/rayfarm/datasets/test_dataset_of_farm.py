"""Tests that a farm's data set is that of this process, and that an interrupted one continues with the same job."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import rayfarm
from rayfarm import Cameras
from rayfarm.client import Client, ClientError
from tests.helpers import ROOT, Farm

CORNELL = ROOT / "scenes" / "cornell-box.yaml"
CAMERAS = Cameras.orbit(3, radius=3.1, target=(0.0, 1.0, 0.0), elevation=12.0, turns=0.12, start=-105.0)
REQUEST: dict[str, Any] = {"fov": 40, "width": 48, "height": 32, "spp": 4, "max_depth": 4, "seed": 3}


def test_views_of_a_farm_have_the_bits_of_this_process(farm: Farm, tmp_path: Path) -> None:
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
        frames = client.frames(job)
    assert [frame.number for frame in frames] == [0, 1, 2]
    here = rayfarm.dataset(CORNELL, CAMERAS, folder=tmp_path / "here", outputs=outputs, sinks=["coco"], **REQUEST)
    assert there.views == here.views and len({*here.digests}) == 3
    assert (tmp_path / "there" / "coco.json").read_bytes() == (tmp_path / "here" / "coco.json").read_bytes()


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
