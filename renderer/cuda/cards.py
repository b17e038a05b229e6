"""Finds the graphics cards that can render, and says in a sentence why others are not used.

`python -m renderer.cuda.cards` prints them as JSON.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from typing import NamedTuple

from renderer.cuda.driver import LIBRARY, Card, Driver, DriverError
from renderer.kernel.backends.cuda.target import CAPABILITY, CUDA_VERSION

__all__ = ["CHOICES", "NOT_YET_TRIED", "Cards", "CardsError", "chosen_cards", "described", "find_cards", "find_cards_before_fork"]

CHOICES = "none, all, only, or numbers such as 0,1"
NOT_YET_TRIED = "not yet tried on a card in this version"
_NUMBERS = re.compile(r"\d+(,\d+)*", re.ASCII)


class CardsError(Exception):
    """A card that was asked for cannot be used."""


class Cards(NamedTuple):
    """The cards of this machine."""

    usable: list[Card]
    refused: list[str]  # a sentence for each card that is not used, or one for all of them


def find_cards(library: str = LIBRARY) -> Cards:
    """Returns the cards of this machine.

    Starts the driver in this process, whose children then cannot use it if they are forked: see `find_cards_before_fork`.
    """
    try:
        driver = Driver(library)
    except DriverError as error:
        return Cards([], [_without_driver(error)])
    try:
        version, cards = driver.version(), driver.cards()
    except DriverError as error:
        return Cards([], [f"No graphics card is used: {error}."])
    if not cards:
        return Cards([], ["No graphics card is used: the NVIDIA driver finds none."])
    if version < CUDA_VERSION:
        return Cards([], [_too_old(version)])
    refused = [_too_weak(card) for card in cards if card.capability < CAPABILITY]
    return Cards([card for card in cards if card.capability >= CAPABILITY], refused)


def find_cards_before_fork() -> Cards:
    """Returns the cards of this machine as `find_cards`, but starts the driver in a process of its own."""
    found = subprocess.run([sys.executable, "-m", "renderer.cuda.cards"], capture_output=True, text=True, check=False)
    if found.returncode:
        reason = (found.stderr.strip().splitlines() or [f"it ended with {found.returncode}"])[-1]
        return Cards([], [f"No graphics card is used: the search for one failed: {reason}."])
    usable, refused = json.loads(found.stdout)
    return Cards([Card(number, name, (major, minor), *rest) for number, name, (major, minor), *rest in usable], refused)


def described(card: Card) -> str:
    """Returns a card's number, name, memory and capability."""
    major, minor = card.capability
    return f"{card.number}: {card.name}, {card.memory / 2**30:.0f} GiB, compute capability {major}.{minor}"


def chosen_cards(choice: str, cards: Cards) -> tuple[list[Card], bool]:
    """Returns the cards that `--gpu` asks for, and whether the CPU renders beside them.

    choice: one of CHOICES. Raises CardsError.
    """
    if choice == "none":
        return [], True
    if choice in ("all", "only"):
        if not cards.usable:
            raise CardsError(f"--gpu {choice}: {' '.join(cards.refused)} Leave out --gpu to render with the processor.")
        return cards.usable, choice == "all"
    if not _NUMBERS.fullmatch(choice):
        raise CardsError(f"--gpu is {choice!r}; give {CHOICES}.")
    known = {card.number: card for card in cards.usable}
    numbers = list(dict.fromkeys(int(each) for each in choice.split(",")))
    if missing := [number for number in numbers if number not in known]:
        listed = "; ".join(described(card) for card in cards.usable)
        reasons = f"This machine's cards: {listed}." if listed else " ".join(cards.refused)
        raise CardsError(f"--gpu {choice}: there is no usable card {', '.join(map(str, missing))}. {reasons}")
    return [known[number] for number in numbers], True


def _without_driver(error: DriverError) -> str:
    if error.code == "CUDA_ERROR_NO_DEVICE":
        return "No graphics card is used: the NVIDIA driver finds none."
    if not error.code:
        return f"No graphics card is used: {error}."
    return f"No graphics card is used: the NVIDIA driver does not start: {error}."


def _too_old(version: tuple[int, int]) -> str:
    return (
        f"No graphics card is used: the NVIDIA driver supports CUDA {version[0]}.{version[1]}, and Rayfarm needs CUDA "
        f"{CUDA_VERSION[0]}.{CUDA_VERSION[1]}; install driver 530 or later."
    )


def _too_weak(card: Card) -> str:
    return f"Card {described(card)}, is not used: Rayfarm needs compute capability {CAPABILITY[0]}.{CAPABILITY[1]} or higher."


if __name__ == "__main__":
    print(json.dumps(find_cards()))
