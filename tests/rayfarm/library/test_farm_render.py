"""Tests that a farm returns the same picture as this process, in progress and finished; a notebook's widget shows both."""

from __future__ import annotations

import numpy as np
import pytest

import rayfarm
from rayfarm.client import Client
from tests.helpers import ROOT, Farm, wait_until

CORNELL = ROOT / "scenes" / "cornell-box.yaml"
SMALL = {"width": 48, "height": 32, "max_depth": 4}


def test_farm_picture_equals_local_picture(farm: Farm) -> None:
    there = rayfarm.render(CORNELL, farm=farm.url, spp=6, **SMALL)
    here = rayfarm.render(CORNELL, spp=6, **SMALL)
    assert there.keys() == here.keys()
    assert (there.spp, there.of, there.is_final) == (6, 6, True)
    for name in here:
        np.testing.assert_array_equal(there[name], here[name], err_msg=name)


@pytest.mark.long
def test_progressive_pictures_grow_and_break_cancels_job(farm: Farm) -> None:
    with Client(farm.url) as client:
        before = {job.id for job in client.jobs()}
        for image in rayfarm.progressive(CORNELL, farm=client, spp=200_000, aovs=["depth"], **SMALL):
            assert not image.is_final and 0 < image.spp < 200_000
            assert image["color"].shape == (32, 48, 3) and image["depth"].shape == (32, 48)
            break
        (job,) = [job for job in client.jobs() if job.id not in before]
        wait_until(lambda: client.job(job.id).state == "cancelled", 60, "the job is cancelled")


@pytest.mark.long
def test_widget_shows_errors() -> None:
    widget = rayfarm.show({"shapes": [{"type": "spher"}]})
    with pytest.raises(rayfarm.RayfarmError, match="spher"):
        widget.wait()
    assert "spher" in widget.status and widget.is_over
