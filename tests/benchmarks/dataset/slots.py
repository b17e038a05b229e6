"""Time of a worker's slots by phase, from the spans that the worker records."""

from __future__ import annotations

import statistics
from bisect import bisect_left
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Self

from tests.rayfarm.otlp_receiver import Receiver, Span

__all__ = ["Gap", "PhaseReceiver", "SlotTime", "gaps_by_cause", "slot_times"]

RENDERING, PREPARING = "trace paths", "prepare frames"
PACKING = "pack sums"
OTHER = ("open scene", "kernel", PACKING, "send sums", "merge")
SLOT = "rayfarm.slot"


class Gap(NamedTuple):
    """Time in which a slot neither renders nor prepares a scene, in seconds since the first task began."""

    begun: float
    ended: float
    after: str  # the phase before it
    before: str = ""  # the phase after it; "" at the end

    @property
    def seconds(self) -> float:
        """Its duration."""
        return self.ended - self.begun


@dataclass
class SlotTime:
    """Time of one slot, in seconds. length: of the measurement. The rest has no work. origin: of the gaps, in nanoseconds."""

    length: float
    origin: int = 0
    rendering: float = 0.0
    preparing: float = 0.0
    gaps: list[Gap] = field(default_factory=list)

    @property
    def idle(self) -> float:
        """Seconds without work."""
        return sum(gap.ended - gap.begun for gap in self.gaps)


class PhaseReceiver(Receiver):
    """A collector that keeps only what `slot_times` and a table of phases need, since many views have very many spans."""

    def __init__(self) -> None:
        super().__init__()
        self.work: list[tuple[int, str, int, int]] = []  # slot, phase, begin and end in nanoseconds
        self.packed: list[tuple[int, int]] = []  # slot and begin of each packing of sums
        self.seconds: defaultdict[str, list[float]] = defaultdict(list)  # durations of each phase
        self.count = 0  # spans received

    def __enter__(self) -> Self:
        super().__enter__()
        return self

    def forget(self) -> None:
        """Discards what was received."""
        self.work.clear()
        self.packed.clear()
        self.seconds.clear()

    def _take(self, request: Any) -> None:
        super()._take(request)
        new = self.spans[:]
        del self.spans[: len(new)]
        self.count += len(new)
        self.work += worked(new)
        self.packed += [
            (int(span.attributes[SLOT]), span.begun) for span in new if span.name == PACKING and SLOT in span.attributes
        ]
        for span in new:
            if span.name in (RENDERING, PREPARING, *OTHER):
                self.seconds[span.name].append((span.ended - span.begun) / 1e9)

    def phases(self) -> list[tuple[str, int, float, float, float]]:
        """Returns name, number, total, median and longest duration in seconds of each phase, the longest in total first."""
        found = [(name, len(took), sum(took), statistics.median(took), max(took)) for name, took in self.seconds.items()]
        return sorted(found, key=lambda phase: -phase[2])


def worked(spans: Iterable[Span]) -> list[tuple[int, str, int, int]]:
    """Returns slot, phase, begin and end of the spans in which a slot renders or prepares scenes."""
    return [
        (int(span.attributes[SLOT]), span.name, span.begun, span.ended)
        for span in spans
        if span.name in (RENDERING, PREPARING) and SLOT in span.attributes
    ]


def slot_times(work: Iterable[tuple[int, str, int, int]], slots: int) -> list[SlotTime]:
    """Returns the time of each slot, from the first begin to the last end of any slot's work.

    A slot has work while it traces paths, or prepares scenes for the next views. Opening a scene, packing and sending sums and
    waiting for a message are work only while paths are traced meanwhile.
    """
    tasks = sorted(work, key=lambda task: task[2])
    if not tasks:
        raise SystemExit("no span arrived: is opentelemetry-sdk installed?")
    origin, end = tasks[0][2], max(task[3] for task in tasks)
    found = [SlotTime((end - origin) / 1e9, origin) for _ in range(slots)]
    free, last = [origin] * slots, ["start"] * slots
    for slot, name, begun, ended in tasks:
        if begun > free[slot]:
            found[slot].gaps.append(Gap((free[slot] - origin) / 1e9, (begun - origin) / 1e9, last[slot], name))
        seconds = max(0, ended - max(begun, free[slot])) / 1e9
        if name == RENDERING:
            found[slot].rendering += seconds
        else:
            found[slot].preparing += seconds
        free[slot], last[slot] = max(free[slot], ended), name
    for slot in range(slots):
        if free[slot] < end:
            found[slot].gaps.append(Gap((free[slot] - origin) / 1e9, (end - origin) / 1e9, last[slot]))
    return found


def gaps_by_cause(slots: Sequence[SlotTime], packed: Iterable[tuple[int, int]]) -> dict[str, list[float]]:
    """Returns the durations in seconds of all gaps, by cause, that with the most time first.

    packed: slot and begin of each packing of sums. The last sums of a message are packed in a gap, others while a kernel runs.
    """
    begun: list[list[int]] = [[] for _ in slots]
    for slot, at in packed:
        begun[slot].append(at)
    found: defaultdict[str, list[float]] = defaultdict(list)
    for slot, its in zip(slots, begun, strict=True):
        its.sort()
        for gap in slot.gaps:
            first, last = (slot.origin + round(1e9 * at) for at in (gap.begun, gap.ended))
            is_last = bisect_left(its, first) < bisect_left(its, last)
            if PREPARING in (gap.after, gap.before):
                cause = "before or after scenes are prepared"
            elif gap.after == "start" or not gap.before:
                cause = "at the start or at the end"
            else:
                cause = "after a message" if is_last else "between two batches of a message"
            found[cause].append(gap.seconds)
    return dict(sorted(found.items(), key=lambda item: -sum(item[1])))
