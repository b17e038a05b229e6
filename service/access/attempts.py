"""Rate limit for failed logins.

Attempts are counted per address and name, so that guessing does not lock out the real user; per address, to limit trying many
names; and per name, to limit trying from many addresses. An attempt is counted before the password is checked, so concurrent
attempts cannot exceed the limit.
"""

from __future__ import annotations

import ipaddress
import threading
import time
from collections import OrderedDict, deque

__all__ = ["Attempts"]

WINDOW_S = 900.0
MAX_PER_ADDRESS_AND_NAME = 6  # limit for one address and one name
MAX_PER_ADDRESS = 30
MAX_PER_NAME = 120
MAX_COUNTERS = 20_000  # counters kept; the least recently used are dropped first


class Attempts:
    """Counts the failed logins of the last WINDOW_S seconds. The counts are in memory and are reset by a restart."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._tries: OrderedDict[tuple[str, str], deque[float]] = OrderedDict()

    def begin(self, address: str, name: str) -> float | None:
        """Counts a login attempt and returns None. If the limit is reached, counts nothing and returns the seconds to wait."""
        now = time.monotonic()
        with self._lock:
            waits = [self._seconds_to_wait(key, most, now) for key, most in self._keys(address, name)]
            if (longest := max(waits)) > 0:
                return longest
            for key, _ in self._keys(address, name):
                self._tries.setdefault(key, deque()).append(now)
                self._tries.move_to_end(key)
            while len(self._tries) > MAX_COUNTERS:
                self._tries.popitem(last=False)
        return None

    def succeeded(self, address: str, name: str) -> None:
        """Records that a login succeeded.

        Removes it, and all earlier failures with this address and name, from the counts.
        """
        with self._lock:
            (both, _), *others = self._keys(address, name)
            failed = len(self._tries.pop(both, ()))
            for key, _ in others:
                for _ in range(min(failed, len(self._tries.get(key, ())))):
                    self._tries[key].pop()

    def _seconds_to_wait(self, key: tuple[str, str], max_attempts: int, now: float) -> float:
        tries = self._tries.get(key)
        while tries and now - tries[0] > WINDOW_S:
            tries.popleft()
        if tries is not None and not tries:
            del self._tries[key]
        return WINDOW_S - (now - tries[0]) if tries and len(tries) >= max_attempts else 0.0

    @staticmethod
    def _keys(address: str, name: str) -> list[tuple[tuple[str, str], int]]:
        where, name = _network(address), name.casefold()[:64]
        return [((where, name), MAX_PER_ADDRESS_AND_NAME), ((where, ""), MAX_PER_ADDRESS), (("", name), MAX_PER_NAME)]


def _network(address: str) -> str:
    """Returns the address under which login attempts are counted.

    For IPv6 this is the /64 network, which usually belongs to one household or machine.
    """
    try:
        parsed = ipaddress.ip_address(address)
    except ValueError:
        return address or "?"
    if parsed.version == 6:
        return str(parsed.ipv4_mapped or ipaddress.ip_network((parsed, 64), strict=False))
    return str(parsed)
