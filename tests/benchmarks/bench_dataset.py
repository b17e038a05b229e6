"""A data set through the farm: views a second, and for how much of its time each slot has no work.

    python3 farm.py bench dataset [--views 200] [--size 256] [--spp 4] [--slots 2] [--still] [--outputs color,depth,instance]

`rayfarm.dataset` renders views of the Cornell box, with boxes and materials varied for each, on a local farm, and annotates them
in its own process. A slot has work while a span that its worker records is open, so sending its sums and
taking the next message count as time without work; what counts is the time from the first span's
begin to the last one's end. Target: no slot without work for more than 3 % of it. For the proof on 10,000 views, on two quiet
cores: `python3 farm.py bench dataset --views 10000`.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import rayfarm
from rayfarm import Cameras
from tests.helpers import ROOT, start_farm, stop_farm
from tests.rayfarm.otlp_receiver import Receiver, Span

CORNELL = ROOT / "scenes" / "cornell-box.yaml"
TARGET = 0.03
LONGEST = 5  # gaps that are printed
VARY = {
    "seed": 7,
    "objects": {"*-box": {"move": {"uniform": [[-0.3, 0, -0.3], [0.3, 0, 0.3]]}, "turn": {"uniform": [0, 360]}}},
    "materials": {"white": {"color": {"choice": [[0.8, 0.8, 0.8], [0.7, 0.6, 0.4]]}}},
}


class Gap(NamedTuple):
    """Time in which a slot has no work, in seconds from the first span on."""

    begun: float
    ended: float
    after: str  # the name of the span before it


def main() -> None:
    """Measures and prints the results; fails if a slot has no work for longer than the target."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--views", type=int, default=200)
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--spp", type=int, default=4)
    parser.add_argument("--slots", type=int, default=2)
    parser.add_argument("--still", action="store_true", help="the same scene in all views")
    parser.add_argument("--outputs", default="color,depth,instance")
    options = parser.parse_args()
    cameras = Cameras.sample(options.views, seed=4, radius=3.6, azimuth={"uniform": [-110, -70]}, elevation={"uniform": [-5, 20]})
    request: dict[str, Any] = {"fov": 36, "width": options.size, "height": options.size, "spp": options.spp, "seed": 1}
    request |= {"outputs": options.outputs.split(","), "vary": None if options.still else VARY}
    with tempfile.TemporaryDirectory(prefix="rayfarm-bench-") as name, Receiver() as receiver:
        collector: dict[str, Any] = {"OTEL_EXPORTER_OTLP_ENDPOINT": receiver.url, "OTEL_BSP_SCHEDULE_DELAY": "200"}
        farm = start_farm(Path(name) / "farm", options.slots, **collector, OTEL_BSP_MAX_QUEUE_SIZE="20000")
        try:
            warm = {**request, "outputs": ["color"]}
            rayfarm.dataset(CORNELL, Cameras(cameras.poses[:4]), folder=Path(name) / "warm", farm=farm.url, **warm, max_depth=3)
            settle(receiver)
            receiver.spans.clear()
            begun, load = time.perf_counter(), os.getloadavg()[0]
            made = rayfarm.dataset(CORNELL, cameras, folder=Path(name) / "views", farm=farm.url, **request)
            seconds = time.perf_counter() - begun
            settle(receiver)
        finally:
            stop_farm(farm)
        slots = gaps(receiver.spans, options.slots)
    print(f"{options.views} views of {options.size} x {options.size}, {options.spp} spp, {options.slots} slots, load {load:.0f}")
    annotation = made.seconds["annotation"]
    print(f"  views a second        {options.views / seconds:8.2f}   in {seconds:.1f} s, of which annotation {annotation:.1f}")
    shares = []
    for number, (found, length) in enumerate(slots, 1):
        shares.append(sum(gap.ended - gap.begun for gap in found) / length)
        print(f"  slot {number} without work   {100 * shares[-1]:8.2f} %  of {length:.1f} s (target <= {100 * TARGET:.0f} %)")
        lengths = [1000 * (gap.ended - gap.begun) for gap in found]
        print(f"    {len(found)} gaps, the median is {statistics.median(lengths):.1f} ms; the longest:")
        for gap in sorted(found, key=lambda gap: gap.begun - gap.ended)[:LONGEST]:
            print(f"    {1000 * (gap.ended - gap.begun):8.1f} ms at {gap.begun:.2f} s, after `{gap.after}`")
    if max(shares) > TARGET:
        raise SystemExit(1)


def settle(receiver: Receiver) -> None:
    """Returns when no more spans arrive."""
    count = -1
    while count != len(receiver.spans):
        count = len(receiver.spans)
        time.sleep(1.0)


def gaps(spans: Iterable[Span], slots: int) -> list[tuple[list[Gap], float]]:
    """Returns each slot's gaps and the time that counts, in seconds, from the spans of workers.

    A task goes to the slot that has been free for the shortest time, so the sum over the slots is exact. Time after a slot's last
    task counts, too.
    """
    found = [span for span in spans if span.name in ("batch", "prepare", "prepare frames")]
    inner = {span.id for span in found}
    tasks = sorted((span for span in found if span.parent not in inner), key=lambda span: span.begun)
    if not tasks:
        raise SystemExit("no span arrived: is opentelemetry-sdk installed?")
    origin, end = tasks[0].begun, max(span.ended for span in tasks)
    free, last = [origin] * slots, ["start"] * slots
    gaps: list[list[Gap]] = [[] for _ in range(slots)]
    for task in tasks:
        ready = [slot for slot in range(slots) if free[slot] <= task.begun]
        slot = max(ready, key=free.__getitem__) if ready else min(range(slots), key=free.__getitem__)
        if task.begun > free[slot]:
            gaps[slot].append(Gap((free[slot] - origin) / 1e9, (task.begun - origin) / 1e9, last[slot]))
        free[slot], last[slot] = max(free[slot], task.ended), task.name
    for slot in range(slots):
        if free[slot] < end:
            gaps[slot].append(Gap((free[slot] - origin) / 1e9, (end - origin) / 1e9, last[slot]))
    return [(each, (end - origin) / 1e9) for each in gaps]


if __name__ == "__main__":
    main()
