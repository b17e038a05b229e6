"""Graphics cards for `rayfarm render --gpu`, `render(device=...)` and workers, and messages about cards."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from rayfarm.console import err
from rayfarm.errors import CommandError
from renderer.cuda.cards import NOT_YET_TRIED, CardsError, chosen_cards, described, find_cards
from renderer.errors import MachineError, SettingsError

if TYPE_CHECKING:
    from renderer.cuda.render import CardRenderer

__all__ = ["WorkerCards", "check_device", "device_card", "on_card_or_cores", "open_card", "slot_count"]

T = TypeVar("T")

WorkerCards = Annotated[
    str,
    typer.Option(
        "--gpu",
        metavar="CARDS",
        help="NVIDIA cards to render with, one slot each of a second worker NAME-gpu: `auto` (those that pass the self-test), "
        f"`none`, `all`, numbers such as 0,1 (an error if one cannot be used), or `only` (all, without cores); {NOT_YET_TRIED}.",
    ),
]

_DEVICE = re.compile(r"cpu|cuda(?::(\d{1,4}))?", re.ASCII)


def check_device(device: Any) -> str:
    """Returns the device that `render` was given: cpu, cuda or cuda:NUMBER; None is cpu. Raises SettingsError."""
    if device is None:
        return "cpu"
    if not isinstance(device, str) or not _DEVICE.fullmatch(device):
        raise SettingsError(f"device is {device!r}; give 'cpu', 'cuda' for the first NVIDIA card, or 'cuda:1' for another")
    return device


@contextlib.contextmanager
def device_card(device: str) -> Iterator[CardRenderer | None]:
    """Context manager that opens the graphics card of a device, as returned by `check_device`; yields None for cpu.

    Raises SettingsError if there is no such card, MachineError if its driver fails.
    """
    if device == "cpu":
        yield None
        return
    match = _DEVICE.fullmatch(device)
    assert match is not None
    cards = find_cards()
    number = match[1] and int(match[1])
    card = next((each for each in cards.usable if number is None or each.number == number), None)
    if card is None:
        others = "; ".join(described(each) for each in cards.usable)
        reason = f"This machine's cards: {others}." if others else " ".join(cards.refused)
        raise SettingsError(f"device is {device!r}, and there is no such card. {reason} 'cpu' renders with the processor.")
    from renderer.cuda.driver import DriverError
    from renderer.cuda.render import CardRenderer

    try:
        renderer = CardRenderer(card)
    except DriverError as error:
        raise MachineError(f"card {card.number} ({card.name}) cannot be used: {error}") from error
    try:
        yield renderer
    finally:
        with contextlib.suppress(DriverError):  # after a failure the driver refuses this too; the failure itself is raised
            renderer.close()


def on_card_or_cores(card: CardRenderer | None, render: Callable[[CardRenderer | None], T], note: Callable[[str], None]) -> T:
    """Returns what `render` makes with a card, if given; if its memory is too small for the scene, with the cores.

    The bits are the same. note: called with a sentence if the cores take its place.
    """
    if card is None:
        return render(None)
    from renderer.cuda.render import CardMemoryError

    try:
        return render(card)
    except CardMemoryError as error:
        note(f"{error}; the processor renders it")
        return render(None)


def slot_count(gpu: str, cpu_slots: int) -> int:
    """Returns the number of slots of a worker: one per requested card, plus one per CPU slot unless `gpu` is "only".

    Raises CommandError if a requested card is missing.
    """
    if gpu in ("auto", "none"):
        return cpu_slots
    try:
        cards, with_cpu = chosen_cards(gpu, find_cards())
    except CardsError as error:
        raise CommandError(str(error)) from None
    return len(cards) + (cpu_slots if with_cpu else 0)


def open_card() -> CardRenderer:
    """Opens the first usable card, and prints its name on standard error.

    Raises CommandError with the reason if there is none.
    """
    cards = find_cards()
    if not cards.usable:
        raise CommandError(f"--gpu: {' '.join(cards.refused)} Leave out --gpu to render with the processor.")
    card = cards.usable[0]
    from renderer.cuda.driver import DriverError
    from renderer.cuda.render import CardRenderer

    err.print(f"rendering with card {described(card)} ({NOT_YET_TRIED})", markup=False, soft_wrap=True)
    try:
        return CardRenderer(card)
    except DriverError as error:
        raise CommandError(f"card {card.number} ({card.name}) cannot be used: {error}") from error
