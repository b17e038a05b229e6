"""The form in which a valid scene is stored that is to be damaged, and the random choice of the damage."""

from __future__ import annotations

import io
import random
import zipfile
from typing import NamedTuple

from tests.benchmarks.mutations.damage import damaged

__all__ = ["Seed", "draw", "kind_of", "packed"]

_MOSTLY = 0.75
# Relative frequency of formats in a campaign, if not 1: Blender takes seconds per file.
_SHARES = {".blend": 0.2}


class Seed(NamedTuple):
    """A valid scene to be damaged: the name of its main file, and the contents of all its files.

    victims: names of the files that are damaged most often; default: the main file. is_package: the files are packed into the
    main file after one of them was damaged.
    """

    main: str
    files: dict[str, bytes]
    victims: tuple[str, ...] = ()
    is_package: bool = False


def kind_of(number: int, seed: int, seeds: dict[str, list[Seed]]) -> str:
    """Returns the format of the file that a campaign draws for this number.

    seed: of the campaign. seeds: valid scenes by format.
    """
    return _kind(random.Random(f"{seed}:{number}"), seeds)


def draw(number: int, seed: int, seeds: dict[str, list[Seed]]) -> tuple[str, str, dict[str, bytes], str]:
    """Draws the file for this number of a campaign, and damages it.

    Returns (format, main file, all files, description of the damage). The result depends only on the arguments. seed: of the
    campaign. seeds: valid scenes by format.
    """
    dice = random.Random(f"{seed}:{number}")
    kind = _kind(dice, seeds)
    chosen = dice.choice(seeds[kind])
    victims = chosen.victims or ((chosen.main,) if chosen.main in chosen.files else tuple(sorted(chosen.files)))
    victim = dice.choice(victims if dice.random() < _MOSTLY else sorted(chosen.files))
    data, how = damaged(chosen.files[victim], dice)
    files = {**chosen.files, victim: data}
    return kind, chosen.main, packed(chosen.main, files) if chosen.is_package else files, f"{victim}: {how}"


def packed(main: str, parts: dict[str, bytes]) -> dict[str, bytes]:
    """Packs all parts into a zip; returns the zip as the only file, by the name `main`."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in parts.items():
            archive.writestr(name, data)
    return {main: out.getvalue()}


def _kind(dice: random.Random, seeds: dict[str, list[Seed]]) -> str:
    kinds = sorted(seeds)
    return dice.choices(kinds, [_SHARES.get(kind, 1.0) for kind in kinds])[0]
