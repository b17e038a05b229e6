"""Compares films and drafts of built-in scenes by a graphics card and by the CPU, integer by integer."""

from __future__ import annotations

from renderer.cuda.driver import LIBRARY, Card, DriverError
from renderer.cuda.render import CardError, CardRenderer
from renderer.cuda.verdicts import Verdict
from renderer.kernel.draft_of_film import draft_of
from renderer.render import render_batch, render_draft
from renderer.self_test.scenes import SPP, scenes_for, settings_for
from renderer.sentences import Sentence
from renderer.settings import Tile
from renderer.variant_names import base_variant

__all__ = ["judge"]

_DRAFTS = (0.0, False), (1.5, False), (0.0, True)  # exposures of drafts, in stops, and whether they are smoothed


def judge(card: Card, kernel: str, library: str = LIBRARY) -> Verdict:
    """Renders the scenes of a kernel with the CPU and with a graphics card, and compares the films and drafts of the first.

    A draft depends on its film and exposure alone, so that one scene is enough. library: the driver's.
    """
    variant = base_variant(kernel)
    pictures = [(scene, scene.compiled(kernel), settings_for(kernel, scene)) for scene in scenes_for(kernel)]
    whole = [Tile(0, 0, settings.width, settings.height) for _, _, settings in pictures]
    films = [
        render_batch(scene, settings, tile, 0, SPP, variant=variant).sums
        for (_, scene, settings), tile in zip(pictures, whole, strict=True)
    ]
    try:
        renderer = CardRenderer(card, library)
        renderer.load(kernel)
        for (about, scene, settings), tile, film in zip(pictures, whole, films, strict=True):
            wrong = int((render_batch(scene, settings, tile, 0, SPP, renderer, variant=variant).sums != film).any(0).sum())
            if wrong:
                return Verdict(_other_bits(kernel, about.name, wrong, tile), is_lasting=True)
        (about, scene, settings), tile, film = pictures[0], whole[0], films[0]
        for exposure, is_smooth in _DRAFTS:
            draft = render_draft(scene, settings, tile, 0, SPP, renderer, exposure, is_smooth=is_smooth, variant=variant)
            wrong = int((draft != draft_of(film, settings.film_exponent, exposure, is_smooth=is_smooth)).sum())
            if wrong:
                return Verdict(_other_bits(kernel, f"{about.name} (draft)", wrong, tile), is_lasting=True)
        renderer.close()
    except (CardError, DriverError) as error:
        failed = Sentence("card-test-error", "the self-test of kernel {kernel} failed: {error}", kernel=kernel, error=error)
        return Verdict(failed, is_lasting=False)
    return Verdict("", is_lasting=True)


def _other_bits(kernel: str, scene: str, wrong: int, tile: Tile) -> str:
    return Sentence(
        "card-other-bits",
        "it computed other bits in the self-test: {wrong} of {pixels} pixels of the scene {scene} with kernel {kernel}",
        wrong=wrong,
        pixels=tile.w * tile.h,
        scene=scene,
        kernel=kernel,
    )
