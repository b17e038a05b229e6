"""The graphics card for `rayfarm render --gpu`, and messages about cards."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rayfarm.console import err
from rayfarm.errors import CommandError
from renderer.cuda.cards import NOT_YET_TRIED, CardsError, chosen_cards, described, find_cards

if TYPE_CHECKING:
    from renderer.cuda.render import CardRenderer

__all__ = ["open_card"]


def open_card() -> CardRenderer:
    """Opens the first usable card, and prints its name on standard error.

    Raises CommandError with the reason if there is none.
    """
    try:
        cards, _ = chosen_cards("only", find_cards())
    except CardsError as error:
        raise CommandError(str(error)) from None
    from renderer.cuda.driver import DriverError
    from renderer.cuda.render import CardRenderer

    err.print(f"rendering with card {described(cards[0])} ({NOT_YET_TRIED})", markup=False, soft_wrap=True)
    try:
        return CardRenderer(cards[0])
    except DriverError as error:
        raise CommandError(f"card {cards[0].number} ({cards[0].name}) cannot be used: {error}") from error
