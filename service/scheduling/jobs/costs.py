"""Expected rendering time of a sample in each tile of a job's film.

A machine that becomes busy slows down all tiles at once. So the measured cost of a tile is corrected by the change of speed
since its measurement. Batches then have the right length, although most tiles were not rendered at the new speed.
"""

from __future__ import annotations

__all__ = ["Costs"]

SMOOTHING = 0.3
LEAST_COST = 32.0  # the cost is at least 1/32 of the average, which limits the effect of a wrong measurement
OUTLIER_RATIO = 4.0  # larger ratios of measured to expected time are ignored as outliers, such as a first kernel compilation
MOST_FASTER, MOST_SLOWER = 1.5, 4.0  # limits of corrections by the pace


class Costs:
    """Costs of the tiles, in slot-seconds per pixel sample."""

    def __init__(self) -> None:
        self.average = 0.0  # over the latest batches; 0 without any
        self._pace = 1.0  # measured / expected time, multiplied over all batches
        self._tiles: dict[int, tuple[float, float]] = {}  # tile -> its latest cost, and the pace at that time

    def expected_cost(self, tile: int) -> float:
        """Returns the expected cost of a tile.

        This is the average over all tiles if the tile has no measurement, and 0 before the first batch.
        """
        if tile not in self._tiles:
            return self.average
        cost, pace = self._tiles[tile]
        return cost * min(max(self._pace / pace, 1 / MOST_FASTER), MOST_SLOWER)

    def record(self, tile: int, cost: float) -> bool:
        """Records the cost that was measured for a batch of a tile. Returns False if it is 0 and no other cost is known."""
        cost = max(cost, self.average / LEAST_COST)
        if cost <= 0.0:
            return False
        if tile in self._tiles and 1 / OUTLIER_RATIO < (ratio := cost / self.expected_cost(tile)) < OUTLIER_RATIO:
            self._pace *= ratio**SMOOTHING
        self._tiles[tile] = cost, self._pace
        self.average += (cost - self.average) * (SMOOTHING if self.average else 1.0)
        return True
