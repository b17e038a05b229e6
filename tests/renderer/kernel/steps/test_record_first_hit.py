"""Tests of the AOVs of a first hit: each field has film planes of its own."""

from __future__ import annotations

from renderer.film import CHANNELS, COLOR, COLOR_HALF, FIRST_HIT, SAMPLES, SAMPLES_HALF
from renderer.kernel.steps.record_first_hit import IDS, MEANS, FirstHit

ALPHA = ("uncovered", "caught", "unshadowed", "shadowed")


def test_every_field_has_planes_of_its_own() -> None:
    assert set(FIRST_HIT) == {*FirstHit._fields} - {*ALPHA}  # whose planes only some films have
    of_hits = [*MEANS[:, 1].tolist(), *IDS[:, 1].tolist()]
    others = [*range(CHANNELS)[COLOR], *range(CHANNELS)[COLOR_HALF], SAMPLES, SAMPLES_HALF]
    assert sorted(of_hits + others) == list(range(CHANNELS))


def test_ids_are_stored_from_one_sample() -> None:
    assert {name for name, planes in FIRST_HIT.items() if planes in IDS[:, 1].tolist()} == {"object", "material"}
