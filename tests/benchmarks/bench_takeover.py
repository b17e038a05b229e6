"""Takeover time with two services: the owner of the farm is killed or suspended, until the other one is ready.

    python3 farm.py bench takeover [--times 20] [--how kill|stop] [--database sqlite|postgresql]

Measured from the signal until the other service's `/readyz` reports `ready`, polled fifty times per second. Nothing is rendered
during the takeover; `farm.py bench faults --kinds 'two services,'` measures the time until samples arrive again.
"""

from __future__ import annotations

import argparse
import os
import signal
import statistics
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

from tests.helpers import running_redis
from tests.service.conftest import until
from tests.service.ownership.test_two_services import Started, states_and_logs
from tests.service.store.postgres import PostgresServer, find_postgres

SIGNALS = {"kill": signal.SIGKILL, "stop": signal.SIGSTOP}
PATIENCE_S = 120.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=int, default=20)
    parser.add_argument("--how", choices=SIGNALS, default="kill")
    parser.add_argument("--database", choices=["sqlite", "postgresql"], default="sqlite")
    options = parser.parse_args()
    with ExitStack() as ends:
        folder = Path(ends.enter_context(tempfile.TemporaryDirectory()))
        settings = {"redis_url": ends.enter_context(running_redis(folder)), "lease_s": 6.0}
        if options.database == "postgresql":
            binaries = find_postgres()
            if binaries is None:
                raise SystemExit("PostgreSQL is not installed. On Debian: apt install postgresql")
            server = PostgresServer(binaries)
            ends.callback(server.stop)
            settings["database_url"] = server.new()
        taken = [round(seconds, 2) for seconds in takeovers(folder, settings, options, ends)]
    told_of = f"median {statistics.median(taken):.1f} s, worst {max(taken):.1f} s"
    print(f"{options.how}, {options.database}: {len(taken)} times, {told_of}")


def takeovers(folder: Path, settings: dict[str, object], options: argparse.Namespace, ends: ExitStack) -> list[float]:
    """Ends or suspends the owner again and again; returns the seconds of each takeover."""
    started: list[Started] = []

    def start() -> Started:
        started.append(Started(folder / "data", f"service{len(started)}", **settings))
        ends.callback(started[-1].end)
        return started[-1]

    taken = []
    owner, other = pair([start(), start()])
    for _ in range(options.times):
        begun = time.monotonic()
        owner.process.send_signal(SIGNALS[options.how])
        until(other.is_ready, "the other takes over", PATIENCE_S, other.says)
        taken.append(time.monotonic() - begun)
        print(f"{taken[-1]:6.2f} s   load {os.getloadavg()[0]:.0f}", flush=True)
        owner.process.send_signal(signal.SIGCONT)
        owner, other = pair([other, start() if options.how == "kill" else owner])
    return taken


def pair(both: list[Started]) -> tuple[Started, Started]:
    """Waits until both services are ready, and returns (owner, standby)."""
    until(
        lambda: sorted(each.says() for each in both) == ["ready", "stands by"],
        "both are there",
        PATIENCE_S,
        lambda: states_and_logs(both),
    )
    owner, other = sorted(both, key=Started.says)
    return owner, other


if __name__ == "__main__":
    main()
