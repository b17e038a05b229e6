"""A worker with a substitute for a graphics card that takes 1 ms: for measuring all other stages of a live view.

    python3 -m tests.benchmarks.instant_card SCENE WIDTHxHEIGHT [options of python -m worker]

It renders the scene's picture once with the CPU, and answers every view with it.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from renderer.cuda.driver import Card
from renderer.film import CHANNELS, COLOR, SAMPLES, BatchSums
from renderer.kernel.draft_of_film import draft_of
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.load import read
from renderer.settings import RenderSettings, Tile
from worker import __main__ as program
from worker.work import slot_card, view_card

SPP = 4
RENDER_S = 0.001  # more samples per second than a draft then has are no credible rate


class InstantCard:
    """Has the methods of CardRenderer that a slot calls for views."""

    def __init__(self, card: Card) -> None:
        self.card = card

    def has_kernel(self, variant: str) -> bool:
        return True

    def close(self) -> None:
        pass


class Picture:
    """SPP samples of a picture, and its drafts."""

    def __init__(self, scene: str, width: int, height: int) -> None:
        description = read(Path(scene).parent, Path(scene).name)
        settings = RenderSettings(width, height, description.cameras[0].view)
        sums = render_frame(compile_scene(description), settings, SPP)
        self.sample = sums[COLOR] // SPP
        self.words = [draft_of(sums, settings.film_exponent, is_smooth=is_smooth) for is_smooth in (False, True)]
        self.drafts: dict[tuple[int, int, bool], Any] = {}

    def draft(self, scene: Any, settings: RenderSettings, *_: Any, exposure: float, is_smooth: bool) -> Any:
        """Returns every n-th pixel of the draft, in the size of the settings."""
        time.sleep(RENDER_S)
        key = settings.width, settings.height, is_smooth
        if key not in self.drafts:
            self.drafts[key] = np.ascontiguousarray(self.words[is_smooth][self._places(settings)])
        return self.drafts[key]

    def batch(self, scene: Any, settings: RenderSettings, tile: Tile, first: int, count: int, card: Any) -> BatchSums:
        """Returns sums whose mean is that of the picture."""
        time.sleep(RENDER_S)
        rows, columns = self._places(settings)
        places = rows[tile.y : tile.y + tile.h], columns[:, tile.x : tile.x + tile.w]
        sums = np.zeros((CHANNELS, tile.h, tile.w), np.int64)
        sums[COLOR] = count * self.sample[:, *places]
        sums[SAMPLES] = count
        return BatchSums(sums, [], 0)

    def _places(self, settings: RenderSettings) -> tuple[Any, Any]:
        height, width = self.words[0].shape
        rows = np.arange(settings.height) * height // settings.height
        return rows[:, None], np.arange(settings.width)[None] * width // settings.width


def main() -> int:
    """Renders the picture, and runs the worker."""
    scene, size, *options = sys.argv[1:]
    width, height = map(int, size.split("x"))
    picture = Picture(scene, width, height)
    card = Card(0, "Instant", (8, 6), 8 << 30, 1)
    replaced: list[tuple[Any, str, Any]] = [
        (program, "_choose_cards", lambda options, link: ((card,), ())),
        (slot_card, "CardRenderer", InstantCard),
        (slot_card, "check_kernel", lambda *_: ""),
        (slot_card, "_load", lambda *_: None),
        (view_card, "render_batch", picture.batch),
        (view_card, "render_draft", picture.draft),
    ]
    for module, name, substitute in replaced:
        setattr(module, name, substitute)
    slot_card._cards[0] = InstantCard(card)  # type: ignore[assignment]
    return program.main(["--slots", "1", "--gpu", "only", *options])


if __name__ == "__main__":
    sys.exit(main())
