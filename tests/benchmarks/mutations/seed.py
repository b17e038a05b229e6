"""What is damaged: a sound scene."""

from __future__ import annotations

import io
import random
import zipfile
from typing import NamedTuple

from tests.benchmarks.mutations.damage import damaged

__all__ = ["Seed", "draw", "kind_of", "packed"]

_MOSTLY = 0.75
# Shares of the formats in a campaign, where one is not as large as the others': Blender takes seconds for each of its files.
_SHARES = {".blend": 0.2}


class Seed(NamedTuple):
    """The main file's name, and all files.

    victims: those that are mostly damaged, in place of the main one. is_package: the files are what the main one is packed of,
    after one was damaged.
    """

    main: str
    files: dict[str, bytes]
    victims: tuple[str, ...] = ()
    is_package: bool = False


def kind_of(number: int, seed: int, seeds: dict[str, list[Seed]]) -> str:
    """The format of the number-th file of a campaign."""
    return _kind(random.Random(f"{seed}:{number}"), seeds)


def draw(number: int, seed: int, seeds: dict[str, list[Seed]]) -> tuple[str, str, dict[str, bytes], str]:
    """The format, the main file, all files and how one of them is damaged, of the number-th of a campaign."""
    dice = random.Random(f"{seed}:{number}")
    kind = _kind(dice, seeds)
    chosen = dice.choice(seeds[kind])
    victims = chosen.victims or ((chosen.main,) if chosen.main in chosen.files else tuple(sorted(chosen.files)))
    victim = dice.choice(victims if dice.random() < _MOSTLY else sorted(chosen.files))
    data, how = damaged(chosen.files[victim], dice)
    files = {**chosen.files, victim: data}
    return kind, chosen.main, packed(chosen.main, files) if chosen.is_package else files, f"{victim}: {how}"


def packed(main: str, parts: dict[str, bytes]) -> dict[str, bytes]:
    """The zip that a main file is."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in parts.items():
            archive.writestr(name, data)
    return {main: out.getvalue()}


def _kind(dice: random.Random, seeds: dict[str, list[Seed]]) -> str:
    kinds = sorted(seeds)
    return dice.choices(kinds, [_SHARES.get(kind, 1.0) for kind in kinds])[0]
