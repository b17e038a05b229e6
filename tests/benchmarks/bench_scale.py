"""Load of a service with many slots: results merged per second, processor time, stream length, memory, and exactness of the sums.

    python3 farm.py bench scale [--slots 100,1000] [--tile 64,128] [--watchers 0,50] [--seconds 30]

Slots are simulated (tests/benchmarks/scale/slots.py); Redis, the service, the messages and the sums are real. A slot takes a
sixteenth of a second for a sample of a tile of 128 x 128. Processor seconds are reported in addition to wall time, since the
slots run on the same machine.

With --batches N it measures until N batches of ten seconds are merged, however long that takes on a busy machine, and before that
the processor time of idle services. From both follows the use of each resource at full speed, and what is used up first.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import math
import os
import statistics
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path

from protocol.sums import pack_sums
from rayfarm.options import Env
from rayfarm.rendering import Clock, load_scene
from renderer.film import Sums
from renderer.render import render_batch
from renderer.settings import RenderSettings, Tile, View
from tests.benchmarks.scale.measured import FULL_BATCH_S, Load, Taken, run
from tests.benchmarks.scale.slots import SAMPLES, of_one_sample
from tests.helpers import ROOT
from tests.service.store.postgres import PostgresServer, find_postgres

SCENE = ROOT / "scenes" / "cornell-box.yaml"
MIB = 1 << 20
REDIS_BYTES = 2 << 30  # memory that a farm gives its Redis
HEAD = (
    "slots  tile       frame   kB/msg  batches/s  results/s  MB/s  ms/batch  service  Redis  samples/s  stream  lost  repeated"
    "  Redis MB  service MB  health ms  exact  watchers  round p95  packets/s"
)


def main() -> None:
    """Prints a row for each combination."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--slots", default="100,200,1000")
    parser.add_argument("--tile", default="128")
    parser.add_argument("--size", default="1920x1024", help="multiples of the tiles' side")
    parser.add_argument("--watchers", default="0")
    parser.add_argument("--pictures", type=int, default=0, help="asked for at the same time")
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--warm", type=float, default=10.0, help="seconds before anything is measured")
    parser.add_argument("--alone", action="store_true", help="each slot sends its own sums, and no machine adds them up")
    parser.add_argument("--per-worker", type=int, default=32, help="slots of a machine")
    parser.add_argument("--site", action="store_true", help="the machines are of one site, with a reducer")
    parser.add_argument("--simulators", type=int, default=1, help="processes that simulate the slots")
    parser.add_argument("--cells", type=int, default=1, help="farms at the same time, among which the slots are divided")
    parser.add_argument("--batches", type=int, default=0, help="measure until each cell has merged N batches, all of 10 s")
    parser.add_argument("--durable", action="store_true", help="PostgreSQL with its default settings, which wait for the disk")
    parser.add_argument("--database", choices=["sqlite", "postgresql"], default="sqlite")
    parser.add_argument("--json", type=Path, help="write all that was measured there too")
    parser.add_argument("--plot", type=Path, help="a picture of it: against slots, tiles or frames, whichever differ")
    options = parser.parse_args()
    numbers = [[int(n) for n in text.split(",")] for text in (options.slots, options.tile, options.watchers)]
    sizes = [tuple(map(int, size.split("x"))) for size in options.size.split(",")]
    rows: list[tuple[Load, Taken]] = []
    sums = real_sums(max(numbers[1]))
    print(HEAD, flush=True)
    for slots, tile, watchers, (width, height) in itertools.product(*numbers, sizes):
        if width % tile or height % tile:
            parser.error(f"{width}x{height} is no multiple of {tile}: all tiles have the same sums")
        load = Load(
            *(slots // options.cells, tile, width, height),
            seconds=options.seconds,
            warm_s=options.warm,
            watchers=watchers,
            pictures=options.pictures,
            alone=options.alone,
            per_worker=options.per_worker,
            site=options.site,
            simulators=options.simulators,
            batches=options.batches,
        )
        cells = run_cells(load, sums, options.cells, options.database, options.durable)
        for taken in cells:
            report(load, taken, len(pack_sums(sums[:, :tile, :tile] * 8)))
            rows.append((load, taken))
        if load.batches:
            report_limits(load, cells)
        if options.json:
            options.json.write_text(json.dumps([{"load": asdict(load), "taken": asdict(taken)} for load, taken in rows]))
        if options.plot:
            from tests.benchmarks.scale.plots import plot  # importing matplotlib takes a second

            plot(rows, options.plot)


def run_cells(load: Load, sums: Sums, cells: int, database: str, durable: bool = False) -> list[Taken]:
    """Measures `cells` farms at the same time, each with that load, its own Redis, service and database of one server.

    durable: whether PostgreSQL waits for the disk, as it does by default.
    """
    with contextlib.ExitStack() as stack:
        urls, postgres = [""] * cells, None
        if database == "postgresql":
            binaries = find_postgres()
            if binaries is None:
                raise SystemExit("PostgreSQL is not installed. On Debian: apt install postgresql")
            server = PostgresServer(binaries, ()) if durable else PostgresServer(binaries)
            stack.callback(server.stop)
            postgres = server.pid
            urls = [server.new() for _ in urls]
        folders = [Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="rayfarm-scale-"))) for _ in urls]
        environments = [{"RAYFARM_DATABASE_URL": url} if url else {} for url in urls]
        with ThreadPoolExecutor(cells) as pool:
            return list(pool.map(lambda folder, more: run(load, sums, folder, postgres, **more), folders, environments))


def report(load: Load, taken: Taken, size: int) -> None:
    """Prints a row and what explains it. size: bytes of a result."""
    if taken.pictures:
        own = f"{1e3 * max(taken.own_health_s):.0f} ms"
        at_worst = f"health at worst {1e3 * max(taken.health_s):.0f} ms, {own} at its own port"
        print(f"pictures by status: {dict(taken.pictures)}, {at_worst}")
    if taken.repeated:
        whole = ", ".join(f"{name} {taken.in_all.get(name, 0)}" for name in ("merged", "dropped", "lost", "doubled", "failed"))
        print(f"from start to end: {whole}; {taken.unread} results were never read")
    print(line(load, taken, size), flush=True)
    print(f"    processors: {'; '.join(f'{name} {share}' for name, share in taken.shares.items())}")
    engine_ms = 1e3 * taken.shares["service"].thread_used * taken.seconds
    each = f"{engine_ms / max(taken.merged, 1):.2f} ms a batch, {engine_ms / max(taken.results, 1):.2f} ms a result"
    unfed, held_up = (100 * spent / (load.slots * taken.seconds) for spent in (taken.unfed_s, taken.held_up_s))
    print(f"    of the slots' time: {unfed:.1f} % without work, {held_up:.1f} % waiting for the process that simulates them")
    print(f"    the service's busiest thread: {each}", flush=True)


def report_limits(load: Load, cells: list[Taken]) -> None:
    """Prints how much of each resource all cells use at full speed, and with how many slots it is used up.

    At full speed every slot ends a batch in FULL_BATCH_S. A resource is used in proportion to the batches, in addition to what
    an idle service uses.
    """
    slots, rate = load.slots * len(cells), load.slots / FULL_BATCH_S

    def per_batch(taken: Taken, name: str, used: float) -> float:
        return (used - taken.idle[name]) * taken.seconds / taken.merged

    def cores(name: str, used: Callable[[Taken], float]) -> list[float]:
        return [taken.idle[name] + rate * per_batch(taken, name, used(taken)) for taken in cells]

    def bytes_per_s(of: Callable[[Taken], float]) -> float:
        return rate * sum(of(taken) / taken.merged for taken in cells)

    engines = cores("engine", lambda taken: taken.shares["service"].thread_used)
    services = cores("service", lambda taken: taken.shares["service"].used)
    brokers = cores("Redis", lambda taken: taken.shares["Redis"].used)
    all_merged = statistics.mean(taken.merged / taken.seconds for taken in cells) * len(cells)
    postgres_idle = statistics.mean(taken.idle["PostgreSQL"] for taken in cells)
    postgres = statistics.mean(taken.postgres_s / taken.seconds for taken in cells)
    postgres_full = postgres_idle + (postgres - postgres_idle) * rate * len(cells) / all_merged
    line = bytes_per_s(lambda taken: taken.result_bytes)
    disk = bytes_per_s(lambda taken: taken.written["service"] + taken.written["Redis"])
    memory = max(max(taken.redis_bytes) for taken in cells)
    resources = [
        ("thread of an engine", max(engines), "of a core"),
        ("thread of a Redis", max(brokers), "of a core"),
        ("PostgreSQL, all cells", postgres_full, "of a core"),
        ("line of 1 Gbit/s, all cells", line / 125e6, f"of it: {line / 1e6:.0f} MB/s"),
        ("disk of 500 MB/s, all cells", disk / 500e6, f"of it: {disk / 1e6:.0f} MB/s"),
        ("memory of a Redis", memory / REDIS_BYTES, f"of 2 GiB: at most {memory / MIB:.0f} MiB were seen"),
    ]
    for taken in cells:
        each = 1e3 * per_batch(taken, "service", taken.shares["service"].used)
        idle = ", ".join(f"{name} {used:.3f}" for name, used in taken.idle.items())
        merged = f"{taken.merged} batches in {taken.results} results in {taken.seconds:.0f} s"
        print(f"{merged}: {each:.2f} ms of the service's processor a batch beyond idle; idle, cores: {idle}")
    print(f"at full speed, {slots} slots of {len(cells)} cells, {rate * len(cells):.0f} batches/s in all:")
    print(f"    services {sum(services):.2f} cores, Redis {sum(brokers):.2f}, PostgreSQL {postgres_full:.3f}")
    for name, used, unit in sorted(resources, key=lambda each: -each[1]):
        reach = slots / used if used > 0.0 else math.inf
        print(f"    {name:28} {used:6.3f} {unit}; used up with {reach:,.0f} slots", flush=True)


def real_sums(side: int) -> Sums:
    """Returns the sums of a tile (side x side) in the middle of a rendered picture, with realistic noise."""
    compiled, summary = load_scene(SCENE, Env(), Clock())
    view = summary["cameras"][0]["view"]
    settings = RenderSettings(1920, 1080, View(**{k: tuple(v) if isinstance(v, list) else v for k, v in view.items()}))
    return of_one_sample(render_batch(compiled, settings, Tile(896, 384, side, side), 0, SAMPLES).sums)


def line(load: Load, taken: Taken, size: int) -> str:
    """Returns the table row of one measurement."""
    each = 1e3 * taken.service_s / max(taken.merged, 1)
    health = 1e3 * statistics.quantiles(taken.health_s, n=20)[-1]
    wait = 1e3 * statistics.quantiles(taken.rounds_s, n=20)[-1] if taken.rounds_s else 0.0
    rate = taken.sample_rate
    columns = (
        f"{load.slots:5}  {load.tile:4}  {load.width}x{load.height:<4}  {size / 1e3:7.0f}",
        f"{taken.merged / taken.seconds:9.1f}  {taken.results / taken.seconds:9.1f}",
        f"{taken.result_bytes / taken.seconds / 1e6:4.1f}  {each:8.2f}",
        f"{taken.service_s / taken.seconds:7.2f}  {taken.redis_s / taken.seconds:5.2f}",
        f"{rate:9.0f}  {max(taken.stream):6}  {taken.lost:4}  {taken.repeated:8}",
        f"{max(taken.redis_bytes) / MIB:8.0f}  {max(taken.service_bytes) / MIB:10.0f}  {health:9.1f}",
        f"{'yes' if taken.is_exact else 'NO':>5}  {load.watchers:8}  {wait:9.0f}  {taken.packets / taken.seconds:9.0f}",
    )
    return "  ".join(columns)


if __name__ == "__main__":
    os.chdir(ROOT)
    main()
