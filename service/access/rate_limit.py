"""Rate limits: counts events of the last seconds by key, in memory."""

from __future__ import annotations

import ipaddress
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Sequence

__all__ = ["RateLimit", "network_of"]

MAX_COUNTERS = 20_000  # counters kept; the least recently used are dropped first

Key = tuple[str, str]


class RateLimit:
    """Counts the events of the last `window_s` seconds under several keys each. A restart resets the counts. Thread-safe."""

    def __init__(self, window_s: float) -> None:
        self._window_s = window_s
        self._lock = threading.Lock()
        self._events: OrderedDict[Key, deque[float]] = OrderedDict()

    def count(self, limits: Sequence[tuple[Key, int]]) -> float | None:
        """Counts an event and returns None. If a limit is reached, counts nothing and returns the seconds to wait.

        limits: the keys under which it is counted, each with its maximum number of events.
        """
        now = time.monotonic()
        with self._lock:
            if (longest := max(self._seconds_to_wait(key, most, now) for key, most in limits)) > 0:
                return longest
            for key, _ in limits:
                self._events.setdefault(key, deque()).append(now)
                self._events.move_to_end(key)
            while len(self._events) > MAX_COUNTERS:
                self._events.popitem(last=False)
        return None

    def forget(self, key: Key, others: Sequence[Key]) -> None:
        """Removes all events of a key, and as many of the latest events of each of the other keys."""
        with self._lock:
            count = len(self._events.pop(key, ()))
            for other in others:
                for _ in range(min(count, len(self._events.get(other, ())))):
                    self._events[other].pop()

    def _seconds_to_wait(self, key: Key, most: int, now: float) -> float:
        events = self._events.get(key)
        while events and now - events[0] > self._window_s:
            events.popleft()
        if events is not None and not events:
            del self._events[key]
        return self._window_s - (now - events[0]) if events and len(events) >= most else 0.0


def network_of(address: str) -> str:
    """Returns the address under which a client's events are counted.

    For IPv6 this is the /64 network, which usually belongs to one household or machine.
    """
    try:
        parsed = ipaddress.ip_address(address)
    except ValueError:
        return address or "?"
    if parsed.version == 6:
        return str(parsed.ipv4_mapped or ipaddress.ip_network((parsed, 64), strict=False))
    return str(parsed)
