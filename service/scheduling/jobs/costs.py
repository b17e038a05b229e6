"""Expected rendering time of a sample in each tile of a job's film.

A machine that becomes busy slows down all tiles at once. So the measured cost of a tile is corrected by the change of speed
since its measurement. Batches then have the right length, although most tiles were not rendered at the new speed.
"""

from __future__ import annotations

__all__ = ["Costs"]

SMOOTHING = 0.3
LEAST_COST = 32.0  # the cost is at least 1/32 of the average, which limits the effect of a wrong measurement
MOST_OVERHEAD = 8.0  # a batch takes at most this many times as long as its samples
OVERHEAD_SMOOTHING = 0.1
OUTLIER_RATIO = 4.0  # larger ratios of measured to expected time are ignored as outliers, such as a first kernel compilation
MOST_FASTER, MOST_SLOWER = 1.5, 4.0  # limits of corrections by the pace


class Costs:
    """Costs of the tiles, in slot-seconds per pixel sample."""

    def __init__(self) -> None:
        self.average = 0.0  # over the latest batches; 0 without any
        self._pace = 1.0  # measured / expected time, multiplied over all batches
        self._overhead_s = 0.0  # of a batch, whatever its number of samples
        self._latest: dict[int, tuple[float, int]] = {}  # tile -> seconds and samples of its latest batch
        self._tiles: dict[int, tuple[float, float]] = {}  # tile -> its latest cost, and the pace at that time

    def expected_cost(self, tile: int) -> float:
        """Returns the expected cost of a tile.

        This is the average over all tiles if the tile has no measurement, and 0 before the first batch.
        """
        if tile not in self._tiles:
            return self.average
        cost, pace = self._tiles[tile]
        return cost * min(max(self._pace / pace, 1 / MOST_FASTER), MOST_SLOWER)

    def future_cost(self, tile: int) -> float:
        """Returns the cost of a tile in long batches; the average over all tiles if it had no batch.

        Unlike the expected cost, it leaves out the overhead of a batch, which takes most of the first ones, and the change of
        speed since its measurement, which the duration of short batches exaggerates.
        """
        if tile not in self._latest:
            return self.average
        seconds, samples = self._latest[tile]
        return max(seconds - self._overhead_s, seconds / MOST_OVERHEAD) / samples

    def record(self, tile: int, seconds: float, samples: int) -> bool:
        """Records how long a batch of a tile took. Returns False if that is 0 and no other cost is known.

        samples: its samples, over its pixels.
        """
        cost = max(seconds / samples, self.average / LEAST_COST)
        if cost <= 0.0:
            return False
        self._learn_overhead(tile, seconds, samples)
        if tile in self._tiles and 1 / OUTLIER_RATIO < (ratio := cost / self.expected_cost(tile)) < OUTLIER_RATIO:
            self._pace *= ratio**SMOOTHING
        self._tiles[tile] = cost, self._pace
        self.average += (cost - self.average) * (SMOOTHING if self.average else 1.0)
        return True

    def _learn_overhead(self, tile: int, seconds: float, samples: int) -> None:
        """Estimates the overhead of a batch, by a straight line through a tile's batch and a smaller one before it."""
        before_s, before = self._latest.get(tile, (seconds, samples))
        if samples >= 2 * before:
            found = min(max((before_s * samples - seconds * before) / (samples - before), 0.0), before_s)
            self._overhead_s += (found - self._overhead_s) * (OVERHEAD_SMOOTHING if self._overhead_s else 1.0)
        self._latest[tile] = seconds, samples
