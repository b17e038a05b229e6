"""A frame of an active job: its settings, compiled scene, plan and noise."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from renderer import film as film_math
from renderer.film import CHANNELS, COLOR, COLOR_HALF, SAMPLES, SAMPLES_HALF
from renderer.settings import RenderSettings, Tile
from service.scheduling.jobs.noise_budget import NoiseBudget
from service.scheduling.jobs.plan import FramePlan, Range
from service.store.coverage import Coverage
from service.store.films import Film

__all__ = ["FIRST_ESTIMATE_SAMPLES", "NOISE_PLANES", "ActiveFrame", "FrameNumbers", "FrameRow"]

FIRST_ESTIMATE_SAMPLES = 8  # samples; noise estimates of fewer are unreliable
ESTIMATE_FACTOR = 4  # factor of samples between noise estimates
NOISE_PLANES = (*range(CHANNELS)[COLOR], *range(CHANNELS)[COLOR_HALF], SAMPLES, SAMPLES_HALF)  # planes that film_math.noise reads


class FrameNumbers(NamedTuple):
    """Progress of a frame: its state and its numbers of samples, summed over all pixels, and its noise.

    A named tuple is used because listing jobs creates thousands of these.
    """

    state: str
    samples: int
    target: int
    bad_samples: int
    progress: float
    noise: float | None
    error: str | None


class FrameRow(NamedTuple):
    """The columns that the engine reads of a frame's database row. has_settings: whether the row stores the render settings."""

    number: int
    samples: int
    target: int
    bad_samples: int
    state: str
    error: str | None
    noise: float | None
    spp: int | None
    compiled: dict[str, Any] | None
    has_settings: bool


def _ignore_change(key: int) -> None:
    """Does nothing. Default callback of a frame that belongs to no job."""


class ActiveFrame:
    """A frame of an active job. Changed only by the engine's thread."""

    __slots__ = (
        *("_due", "_expected_spp", "_focus", "_is_measured", "_is_told_anew", "_json", "_measured", "_on_change", "_plan"),
        *(
            "_recorded",
            "_settings",
            "_stored",
            "_sums",
            "bad_samples",
            "ceiling",
            "compiled",
            "error",
            "film",
            "guides",
            "is_guided",
        ),
        *("is_idle", "is_preparing", "key", "noise", "noise_asked", "own", "spp", "state"),
    )

    def __init__(
        self,
        row: FrameRow,
        film: Film,
        settings: RenderSettings | Callable[[], RenderSettings] | None,
        compiled: dict[str, str],
        spp: int,
        noise: float | None,
        is_measured: bool = False,
        expected_spp: int | None = None,
        on_change: Callable[[int], None] = _ignore_change,
        is_guided: bool = False,
    ) -> None:
        """Creates the frame from its database row.

        settings: render settings at the frame's time; a function that loads them on demand; or None if they are not known yet.
        compiled: SHA-256 of the frame's compiled scene, by worker kind.
        spp: samples per pixel. With a target noise, the upper limit of a tile.
        noise: target noise; None without a target.
        is_measured: whether to estimate the noise while rendering, even without a target.
        expected_spp: expected samples per pixel, if `spp` is only an upper limit.
        on_change: called with the frame's key when its state or numbers may have changed.
        is_guided: whether it is rendered only once its path guide is known.
        """
        self.key = row.number
        self.film = film
        self._settings = settings if isinstance(settings, RenderSettings) else None
        self._stored = None if isinstance(settings, RenderSettings) else settings
        self.compiled = compiled
        self.is_guided = is_guided
        self.guides: dict[str, str] = {}  # by worker kind: SHA-256 of its path guide, or "" if each slot trains it
        self.own = dict(row.compiled or {})  # kind -> BlobRef of the scene compiled for this frame alone
        self.spp = spp
        self.noise_asked = noise
        self.state = row.state
        self.error = row.error
        self.noise = row.noise
        self.bad_samples = row.bad_samples
        self.ceiling = spp
        self.is_idle = False  # nothing can be handed out until a batch returns
        self.is_preparing = False
        self._is_measured = is_measured
        self._measured: dict[int, tuple[int, float]] = {}  # tile -> samples and noise at its latest estimate
        self._is_told_anew = False
        self._due: dict[int, None] = {}  # tiles whose noise is to be estimated when time permits
        self._recorded = row.samples, row.target
        self._expected_spp = expected_spp
        self._plan: FramePlan | None = None
        self._focus: Tile | None = None
        self._sums: tuple[int, int] | None = None  # samples and target; None after a change of the plan
        self._json: tuple[RenderSettings, dict[str, Any]] | None = None
        self._on_change = on_change

    @property
    def settings(self) -> RenderSettings | None:
        """Render settings at the frame's time; None if they are not known yet. Raises FarmError."""
        if self._stored is not None:
            self._settings, self._stored = self._stored(), None
        return self._settings

    @settings.setter
    def settings(self, settings: RenderSettings) -> None:
        self._settings, self._stored = settings, None

    @property
    def plan(self) -> FramePlan:
        """The frame's plan. Created at the first access from the samples of all tiles in the film.

        Raises FilmUnavailable or FilmLost.
        """
        if self._plan is None:
            self.bad_samples = self.film.bad_samples(self.key)[0]
            self._plan = FramePlan(
                *(self.film.tiles, self.spp, self.noise_asked, self._coverage, self._noise_for_plan, self.key, self.ceiling)
            )
            self._plan.focus(self._tiles_in_focus())
            self._notify_change()
        return self._plan

    @property
    def is_complete(self) -> bool:
        """Returns True if every tile has reached its goal. Raises FilmUnavailable or FilmLost."""
        return self.is_begun and self.plan.is_done

    @property
    def is_begun(self) -> bool:
        """Returns True if the frame has a plan, or a film file from which the plan can be created."""
        return self._plan is not None or self.film.has_file

    @property
    def has_recorded_samples(self) -> bool:
        """Returns True if the frame's database row already stores the frame's target number of samples."""
        return self._recorded[1] > 0

    def focus_on(self, focus: Tile | None) -> None:
        """Sets the rectangle of the picture, in pixels, whose tiles are rendered before the others; None removes it."""
        self._focus = focus
        if self._plan is not None:
            self._plan.focus(self._tiles_in_focus())

    def _tiles_in_focus(self) -> list[int]:
        f = self._focus
        if f is None:
            return []
        tiles = enumerate(self.film.tiles)
        return [i for i, t in tiles if t.x < f.x + f.w and f.x < t.x + t.w and t.y < f.y + f.h and f.y < t.y + t.h]

    def set_goal(self, spp: int, noise: float | None) -> None:
        """Sets a new goal: samples per pixel, and target noise. Discards the plan, so outstanding batches are planned again."""
        self.spp, self.noise_asked, self.ceiling = spp, noise, spp
        self._plan, self.is_idle = None, False
        self._notify_change()

    @property
    def is_over(self) -> bool:
        """Returns True if the frame is finished or failed."""
        return self.state in ("finished", "failed")

    @property
    def samples(self) -> int:
        """Number of rendered samples, summed over all pixels."""
        return self._sample_counts()[0]

    @property
    def target_samples(self) -> int:
        """Expected final number of samples, summed over all pixels."""
        return self._sample_counts()[1]

    def _sample_counts(self) -> tuple[int, int]:
        if self._sums is None:
            pixels = self.film.width * self.film.height
            if self._plan is None:
                samples, target = self._recorded
            else:
                samples, target = self._plan.samples, self._plan.target_samples
            if self._expected_spp is not None:
                target = max(samples, max(self.ceiling, self._expected_spp) * pixels)
            self._sums = samples, samples if self.state == "finished" else target or self.spp * pixels
        return self._sums

    @property
    def has_first_wave(self) -> bool:
        """Returns True if every tile has at least one sample."""
        return self._plan.has_first_wave if self._plan is not None else self.state == "finished"

    @property
    def progress(self) -> float:
        """Fraction of the target samples that are rendered, 0 to 1."""
        return 1.0 if self.state == "finished" else min(self.samples / max(self.target_samples, 1), 0.9999)

    def remaining(self) -> Iterator[tuple[int, int]]:
        """Yields the index of each incomplete tile, and its expected remaining samples over its pixels. None before the plan."""
        return iter(()) if self._plan is None else self._plan.remaining()

    def numbers(self) -> FrameNumbers:
        """Returns the frame's current progress numbers."""
        state = "preparing" if self.state == "queued" and self.is_preparing else self.state
        return FrameNumbers(*(state, self.samples, self.target_samples, self.bad_samples, self.progress, self.noise, self.error))

    def raise_ceiling(self, ceiling: int) -> None:
        """Sets a higher ceiling: the number of samples per pixel up to which batches may be dispatched."""
        self.ceiling = self.plan.ceiling = ceiling
        self.is_idle = False
        self._notify_change()

    def lacks_guide(self, kind: str) -> bool:
        """Returns True if the frame waits for its path guide before it is rendered by this worker kind."""
        return self.is_guided and kind not in self.guides

    def next_batch(
        self, samples_wanted: Callable[[int], int], max_run: int = 1, at_once: Callable[[int], int] | None = None
    ) -> Range | None:
        """Returns the next batch of samples up to `ceiling`; None if all are dispatched. Raises FilmUnavailable or FilmLost.

        The parameters are those of `FramePlan.next_batch`.
        """
        return self.plan.next_batch(samples_wanted, max_run, at_once)

    def requeue(self, batch: Range) -> None:
        """Puts a lost batch back into the plan, to be dispatched again."""
        self.plan.requeue(batch)
        self.is_idle = False
        self._notify_change()

    def update_from_film(self, batch: Range) -> None:
        """Updates the plan and the noise from the film after a batch was merged. Raises FilmUnavailable or FilmLost."""
        self.plan.update_from_film(batch)
        self.is_idle = False
        if self.state == "queued":
            self.state = "running"
        self._notify_change()
        if self._is_measured:
            covered = self._coverage(batch.tile)
            done = self._measured.get(batch.tile, (FIRST_ESTIMATE_SAMPLES // ESTIMATE_FACTOR, 0.0))[0]
            if self._is_told_anew:
                self.noise, self._is_told_anew = self._extrapolated_noise(), False
            if covered.prefix == covered.total and covered.total == self.ceiling >= FIRST_ESTIMATE_SAMPLES:
                self._measure_tile(batch.tile, covered.total)
                self.noise = self._extrapolated_noise()
            elif covered.total >= ESTIMATE_FACTOR * done:
                self._due[batch.tile] = None

    def estimate_noise(self, budget: NoiseBudget) -> None:
        """Estimates the noise of tiles with many new samples, until `budget` has no processor time left.

        Raises FilmUnavailable or FilmLost.
        """
        found = False
        for tile in list(self._due):
            if self._expected_spp is None and not budget.has_time():  # the next round of a shot depends on this noise
                break
            del self._due[tile]
            covered = self._coverage(tile)
            if covered.prefix == covered.total > self._measured.get(tile, (0, 0.0))[0]:
                with budget.charged():
                    self._measure_tile(tile, covered.total)
                found = True
        if found:
            self.noise = self._extrapolated_noise()

    def update_noise(self) -> None:
        """Recomputes the frame's noise. For tiles with new samples, it is extrapolated from the latest estimate."""
        if self._plan is not None and self._measured:
            self.noise = self._extrapolated_noise()

    def measured_noise(self) -> float:
        """Estimates the noise of all tiles now, and returns the noise of the frame; infinity if unknown.

        Raises FilmUnavailable or FilmLost.
        """
        for tile, covered in enumerate(self.plan.covered):
            if self._measured.get(tile, (0, 0.0))[0] != covered:
                self._measure_tile(tile, covered)
        self.noise = self._extrapolated_noise()
        self._notify_change()
        return math.inf if self.noise is None else self.noise

    def mark_failed(self, error: str) -> None:
        """Marks the frame as failed with this error message."""
        self.state, self.error = "failed", error
        self._notify_change()

    def finish(self) -> None:
        """Marks the frame as finished and frees its plan."""
        self.state = "finished"
        if self._plan is not None:  # the film stores the samples; a long shot would hold many plans
            self._recorded = self._plan.samples, self._plan.target_samples
            self._plan, self._measured, self._due = None, {}, {}
        self._notify_change()

    def _notify_change(self) -> None:
        self._sums = None
        self._on_change(self.key)

    @property
    def settings_json(self) -> dict[str, Any] | None:
        """The settings as JSON for the frame's database row; None if they are unknown or only stored there."""
        if self._settings is None:
            return None
        if self._json is None or self._json[0] is not self._settings:
            self._json = self._settings, self._settings.to_json()
        return self._json[1]

    def _noise_for_plan(self, tile: int) -> float:
        """Estimates the noise of a tile from its samples in the film, and returns it. The plan calls this at each checkpoint."""
        self._measure_tile(tile, self._coverage(tile).total)
        self._is_told_anew = True
        return self._measured[tile][1]

    def _measure_tile(self, tile: int, samples: int) -> None:
        if self._measured.get(tile, (0, 0.0))[0] != samples:
            self._measured[tile] = samples, self._tile_noise(tile)

    def _extrapolated_noise(self) -> float | None:
        """Returns the root mean square of the tiles' noise, weighted by their areas; None if unknown.

        If a tile has more samples than at its latest estimate, its noise is extrapolated.
        """
        square = area = 0.0
        for tile, (samples, noise) in self._measured.items():
            t = self.film.tiles[tile]
            square += noise**2 * samples / max(self.plan.covered[tile], 1) * t.w * t.h
            area += t.w * t.h
        found = math.sqrt(square / area) if area else math.inf
        return found if math.isfinite(found) else None

    def _coverage(self, tile: int) -> Coverage:
        return self.film.coverage(self.key, tile)

    def _tile_noise(self, tile: int) -> float:
        sums = self.film.tile_planes(self.key, tile, NOISE_PLANES)
        return math.inf if sums is None else film_math.noise(sums, self.film.film_exponent)
