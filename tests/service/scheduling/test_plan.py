"""The plan, driven by a farm that loses, doubles and reorders batches."""

from __future__ import annotations

import random

from hypothesis import given, settings
from hypothesis import strategies as st

from renderer.settings import tiles_of
from service.scheduling.plan import FramePlan, Range
from service.store.coverage import Coverage


class Bench:
    """A plan and the coverage that stands for its film; a tile's noise falls with its samples and differs by tile."""

    def __init__(self, spp: int, noise: float | None, size: int = 16) -> None:
        self.tiles = tiles_of(50, 40, size)
        self.coverage = [Coverage() for _ in self.tiles]
        self.args = (self.tiles, spp, noise, lambda t: self.coverage[t], lambda t: (1 + t % 5) / self.coverage[t].total ** 0.5)
        self.plan = FramePlan(*self.args)

    def arrive(self, batch: Range) -> None:
        if self.plan.wants(batch) and not self.coverage[batch.tile].overlaps(batch.first, batch.count):
            self.coverage[batch.tile].add(batch.first, batch.count)
        self.plan.settle(batch)

    def finish(self, seed: int, wanted: int = 8, loss: float = 0.0, restart: float = 0.0) -> list[Range]:
        """Run to the end; returns what was handed out."""
        dice = random.Random(seed)
        out: list[Range] = []
        history = []
        for _ in range(20_000):
            if self.plan.done:
                return history
            if restart and dice.random() < restart:
                self.plan = FramePlan(*self.args)  # what is in `out` arrives late, from an earlier life
            while len(out) < 6 and (batch := self.plan.next(lambda tile: dice.randint(1, wanted))) is not None:
                out.append(batch)
                history.append(batch)
            batch = out.pop(dice.randrange(len(out)))
            if dice.random() < loss:
                self.plan.lose(batch)
                continue
            self.arrive(batch)
            if dice.random() < loss:
                self.arrive(batch)
        raise AssertionError("the plan does not come to an end")


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 90), st.sampled_from([0.0, 0.3]), st.sampled_from([0.0, 0.05]))
def test_every_tile_gets_exactly_the_samples(seed: int, spp: int, loss: float, restart: float) -> None:
    bench = Bench(spp, None)
    bench.finish(seed, loss=loss, restart=restart)
    assert [c.ranges for c in bench.coverage] == [[(0, spp)]] * len(bench.tiles)
    assert bench.plan.samples == bench.plan.target_samples == 50 * 40 * spp


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([0.0, 0.3]), st.sampled_from([0.0, 0.05]))
def test_where_a_tile_stops_does_not_depend_on_the_way(seed: int, loss: float, restart: float) -> None:
    plain, disturbed = Bench(300, 0.2), Bench(300, 0.2)
    plain.finish(0, wanted=300)
    disturbed.finish(seed, loss=loss, restart=restart)
    totals = [c.total for c in plain.coverage]
    assert [c.total for c in disturbed.coverage] == totals
    assert set(totals) == {32, 128, 256, 300}, "checks are at 32, 64, 128, ... and the cap ends what is noisier"


def test_nothing_is_handed_out_twice_without_need() -> None:
    bench = Bench(64, None)
    history = bench.finish(1)
    assert sum(batch.count for batch in history) == 64 * len(bench.tiles)


def test_the_first_wave_covers_the_whole_frame_from_the_middle() -> None:
    bench = Bench(64, None)
    wave = [bench.plan.next(lambda tile: 1000) for _ in bench.tiles]
    assert {batch.tile for batch in wave if batch} == set(range(len(bench.tiles)))
    assert all(batch and (batch.first, batch.count) == (0, 1) for batch in wave)
    assert wave[0] is not None
    assert bench.tiles[wave[0].tile] == (16, 16, 16, 16)


def test_more_samples_on_a_finished_frame_begin_where_it_ended() -> None:
    bench = Bench(10, None)
    bench.finish(2)
    bench.plan = FramePlan(bench.tiles, 25, *bench.args[2:])
    assert not bench.plan.done
    assert min(batch.first for batch in bench.finish(3)) == 10
    assert all(c.ranges == [(0, 25)] for c in bench.coverage)
