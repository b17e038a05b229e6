"""Tests of guides as files: they are read as they were written, and a file that kernels must not read is refused."""

from __future__ import annotations

import io
from collections.abc import Callable

import numpy as np
import pytest

from renderer.arrays.guide import BINS, BLOCK_WIDTH, COUNT, RADIANCE_COLUMNS, Guide, empty_guide, portal_guide
from renderer.guiding.histograms import guide_of
from renderer.guiding.stored_guide import read_guide, write_guide
from tests.renderer.guiding.records import NO_PHOTONS, made_records


def _portals() -> Guide:
    frame = np.zeros(7, np.float32)
    frame[COUNT:] = 2, 3, 4
    portal = np.array([[0, 1, 2, 0.5], [1, 1, 1, 0.25]], np.float32)
    return portal_guide(frame, portal, np.ones((24, RADIANCE_COLUMNS), np.float32))


def _histograms() -> Guide:
    guide = guide_of(made_records(1 << 14), NO_PHOTONS, 0.0)
    assert (guide.cell[:, 1] > 0).any() and len(guide.cdf) > BLOCK_WIDTH
    return guide


@pytest.mark.parametrize("make", [_portals, _histograms])
def test_guides_are_read_as_written(make: Callable[[], Guide]) -> None:
    guide = make()
    data = write_guide(guide)
    found = read_guide(data)
    assert found is not None and all(np.array_equal(a, b) for a, b in zip(found, guide, strict=True))
    assert write_guide(found) == data
    assert not any(array.flags.writeable for array in found)


def test_no_guide_is_a_file_too() -> None:
    assert read_guide(write_guide(None)) is None
    assert write_guide(None) == write_guide(empty_guide())


def _with(guide: Guide, name: str, place: object, value: float) -> Guide:
    array = getattr(guide, name).copy()
    array[place] = value
    return guide._replace(**{name: array})


@pytest.mark.parametrize(
    "spoilt",
    [
        lambda portals, histograms: _with(histograms, "cell", (0, 0), 1e6),  # beyond the last block
        lambda portals, histograms: _with(histograms, "cell", (0, 0), -1),
        lambda portals, histograms: _with(histograms, "cell", (0, 0), 0.5),
        lambda portals, histograms: _with(histograms, "bin", (BINS, 1), 1e6),
        lambda portals, histograms: _with(histograms, "bin", (BINS, 0), np.nan),
        lambda portals, histograms: _with(histograms, "cdf", BLOCK_WIDTH, 2.0),
        lambda portals, histograms: _with(histograms, "frame", COUNT, 1000),  # more cells than the file has
        lambda portals, histograms: histograms._replace(cdf=histograms.cdf[:-1]),
        lambda portals, histograms: histograms._replace(cell=histograms.cell.astype(np.float64)),
        lambda portals, histograms: _with(portals, "frame", COUNT, 1e9),
        lambda portals, histograms: _with(portals, "frame", COUNT, 0),
        lambda portals, histograms: _with(portals, "portal", (0, 3), 0),
        lambda portals, histograms: _with(portals, "radiance", (0, 0), np.inf),
        lambda portals, histograms: portals._replace(radiance=portals.radiance[:-1]),
        lambda portals, histograms: portals._replace(portal=np.tile(portals.portal, (5, 1))),
    ],
)
def test_files_that_kernels_must_not_read_are_refused(spoilt: Callable[[Guide, Guide], Guide]) -> None:
    with pytest.raises(ValueError, match="damaged"):
        read_guide(write_guide(spoilt(_portals(), _histograms())))


def test_other_files_are_refused() -> None:
    data = write_guide(_portals())
    pickled = io.BytesIO()
    np.save(pickled, np.array([{"code": 1}], object), allow_pickle=True)
    for other in (b"", b"no guide", data[:-1], data + b"0", data[: len(data) // 2], pickled.getvalue() + data):
        with pytest.raises(ValueError, match="guide"):
            read_guide(other)
