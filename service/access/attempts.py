"""Rate limit for failed logins.

Attempts are counted per address and name, so that guessing does not lock out the real user; per address, to limit trying many
names; and per name, to limit trying from many addresses. An attempt is counted before the password is checked, so concurrent
attempts cannot exceed the limit.
"""

from __future__ import annotations

from service.access.rate_limit import RateLimit, network_of

__all__ = ["Attempts"]

WINDOW_S = 900.0
MAX_PER_ADDRESS_AND_NAME = 6  # limit for one address and one name
MAX_PER_ADDRESS = 30
MAX_PER_NAME = 120


class Attempts:
    """Counts the failed logins of the last WINDOW_S seconds. The counts are in memory and are reset by a restart."""

    def __init__(self) -> None:
        self._limit = RateLimit(WINDOW_S)

    def begin(self, address: str, name: str) -> float | None:
        """Counts a login attempt and returns None. If the limit is reached, counts nothing and returns the seconds to wait."""
        return self._limit.count(_keys(address, name))

    def succeeded(self, address: str, name: str) -> None:
        """Records that a login succeeded.

        Removes it, and all earlier failures with this address and name, from the counts.
        """
        (both, _), *others = _keys(address, name)
        self._limit.forget(both, [key for key, _ in others])


def _keys(address: str, name: str) -> list[tuple[tuple[str, str], int]]:
    where, name = network_of(address), name.casefold()[:64]
    return [((where, name), MAX_PER_ADDRESS_AND_NAME), ((where, ""), MAX_PER_ADDRESS), (("", name), MAX_PER_NAME)]
