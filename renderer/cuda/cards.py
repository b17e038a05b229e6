"""Finds the graphics cards that can render, and explains why others are not used.

`python -m renderer.cuda.cards` prints the cards as JSON.
"""

from __future__ import annotations

import ctypes
import json
import re
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from renderer.cuda.driver import LIBRARY, Card, Driver, DriverError
from renderer.kernel.backends.cuda.target import CAPABILITY, CUDA_VERSION
from renderer.sentences import Sentence, from_text, to_text

__all__ = [
    "CHOICES",
    "NOT_YET_TRIED",
    "Cards",
    "CardsError",
    "cards_from_search",
    "chosen_cards",
    "described",
    "find_cards",
    "find_cards_before_fork",
    "has_driver",
    "has_nvidia_hardware",
    "reasons_unused",
    "search_command",
    "unused_card",
]

CHOICES = "auto, none, all, only, or numbers such as 0,1"
NOT_YET_TRIED = "not yet tested on a GPU in this version"
_NUMBERS = re.compile(r"\d+(,\d+)*", re.ASCII)
_DRIVER_FILES = ("/proc/driver/nvidia", "/dev/nvidiactl", "/dev/dxg")  # the last: Windows' subsystem for Linux
_PCI = "/sys/bus/pci/devices"
_NVIDIA, _DISPLAY = "0x10de", "0x03"  # vendor; begin of the class


class CardsError(Exception):
    """Raised if the requested graphics cards cannot be used."""


class Cards(NamedTuple):
    """The graphics cards of this machine: the usable ones, and sentences about the others."""

    usable: list[Card]
    refused: list[str]  # a sentence for each card that is not used, or one for all of them


def find_cards(library: str = LIBRARY) -> Cards:
    """Finds the graphics cards of this machine.

    Initialises the driver in this process, after which forked children cannot use it: see `find_cards_before_fork`.
    """
    try:
        driver = Driver(library)
    except DriverError as error:
        return Cards([], [_without_driver(error)])
    try:
        version, cards = driver.version(), driver.cards()
    except DriverError as error:
        return Cards([], [_unused(str(error))])
    if not cards:
        return Cards([], [_none_found()])
    if version < CUDA_VERSION:
        return Cards([], [_too_old(version)])
    refused = [_too_weak(card) for card in cards if card.capability < CAPABILITY]
    return Cards([card for card in cards if card.capability >= CAPABILITY], refused)


def find_cards_before_fork() -> Cards:
    """Finds the graphics cards of this machine in a separate process, so that this process can still fork."""
    found = subprocess.run(search_command(), capture_output=True, text=True, check=False)
    return cards_from_search(found.returncode, found.stdout, found.stderr)


def search_command() -> list[str]:
    """Returns the command line of a process that searches for graphics cards."""
    return [sys.executable, "-m", "renderer.cuda.cards"]


def cards_from_search(code: int, out: str, err: str) -> Cards:
    """Returns the graphics cards that a process of `search_command` found, from its exit code and its output."""
    if code:
        reason = (err.strip().splitlines() or [f"exit code {code}"])[-1]
        return Cards(
            [], [Sentence("cards-search-failed", "No graphics card is used: the search failed: {reason}.", reason=reason)]
        )
    usable, refused = json.loads(out)
    cards = [Card(number, name, (major, minor), *rest) for number, name, (major, minor), *rest in usable]
    return Cards(cards, [from_text(each) for each in refused])


def has_nvidia_hardware(root: Path = Path("/")) -> bool:
    """Returns True if this machine seems to have an NVIDIA card or its driver, without starting the driver."""
    if any((root / name.lstrip("/")).exists() for name in _DRIVER_FILES):
        return True
    return any(
        _line(device / "vendor") == _NVIDIA and _line(device / "class").startswith(_DISPLAY)
        for device in (root / _PCI.lstrip("/")).glob("*")
    )


def has_driver(library: str = LIBRARY) -> bool:
    """Returns True if the driver's library can be loaded; does not initialise it, so that this process can still fork."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def described(card: Card) -> str:
    """Returns a text with a graphics card's number, name, memory and compute capability."""
    return f"{card.number}: {card.name}, {_gibibytes(card)} GiB, compute capability {_version(card.capability)}"


def chosen_cards(choice: str, cards: Cards) -> tuple[list[Card], bool]:
    """Returns (the graphics cards to use for an option `--gpu`, whether the CPU renders too).

    choice: one of CHOICES; auto: the usable cards, if there are any. Raises CardsError if a requested card cannot be used.
    """
    if choice == "none":
        return [], True
    if choice == "auto":
        return cards.usable, True
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


def reasons_unused(cards: Cards, used: Iterable[Card]) -> list[str]:
    """Returns a sentence for each graphics card of this machine that is not in `used`."""
    numbers = {card.number for card in used}
    unchosen = [
        Sentence(
            "card-not-chosen",
            "Card {number}: {name}, {memory} GiB, compute capability {capability} is not used. To use it, start the worker with "
            "{number} in --gpu.",
            number=card.number,
            name=card.name,
            memory=_gibibytes(card),
            capability=_version(card.capability),
        )
        for card in cards.usable
        if card.number not in numbers
    ]
    return [*unchosen, *cards.refused]


def unused_card(card: Card, reason: str) -> str:
    """Returns the sentence that a card is not used. reason: the end of the sentence, without a full stop."""
    return Sentence(
        "card-unused",
        "Card {number}: {name}, {memory} GiB, compute capability {capability} is not used: {reason}.",
        number=card.number,
        name=card.name,
        memory=_gibibytes(card),
        capability=_version(card.capability),
        reason=reason,
    )


def _gibibytes(card: Card) -> int:
    return round(card.memory / 2**30)


def _version(numbers: tuple[int, int]) -> str:
    return ".".join(map(str, numbers))


def _line(file: Path) -> str:
    try:
        return file.read_text().strip()
    except OSError:
        return ""


def _unused(reason: str) -> str:
    return Sentence("cards-unused", "No graphics card is used: {reason}.", reason=reason)


def _none_found() -> str:
    return Sentence("cards-none-found", "No graphics card is used: the NVIDIA driver finds none.")


def _without_driver(error: DriverError) -> str:
    if error.code == "CUDA_ERROR_NO_DEVICE":
        return _none_found()
    if not error.code:
        return _unused(str(error))
    return Sentence(
        "cards-driver-not-started", "No graphics card is used: the NVIDIA driver does not start: {reason}.", reason=str(error)
    )


def _too_old(version: tuple[int, int]) -> str:
    return Sentence(
        "cards-driver-too-old",
        "No graphics card is used: the NVIDIA driver supports CUDA {found}, and Rayfarm needs CUDA {needed}; install driver 530 "
        "or later.",
        found=_version(version),
        needed=_version(CUDA_VERSION),
    )


def _too_weak(card: Card) -> str:
    return Sentence(
        "card-too-old",
        "Card {number}: {name}, {memory} GiB, compute capability {capability} is not used: Rayfarm needs compute capability "
        "{needed} or higher.",
        number=card.number,
        name=card.name,
        memory=_gibibytes(card),
        capability=_version(card.capability),
        needed=_version(CAPABILITY),
    )


if __name__ == "__main__":
    found = find_cards()
    print(json.dumps([found.usable, [to_text(each) for each in found.refused]]))
