"""Recovery time of a farm after its processes are killed, and whether the picture's digest is unchanged.

    python3 farm.py bench recovery [--kills 12] [--seed 1] [--slots 1] [--parts service,worker,slot,redis]

While a job renders, processes are killed one at a time by different signals; the seed determines which and when. `serves` is the
time from the kill until the process exists again and the service is ready, `renders` until samples arrive after that. At the end
the digest is compared with that of the same job without kills.
"""

from __future__ import annotations

import argparse
import random
import signal
import statistics
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import httpx
import psutil

from rayfarm.client import Client, ClientError
from tests.helpers import ROOT, Farm, start_farm, stop_farm

SIGNALS = (signal.SIGKILL, signal.SIGKILL, signal.SIGSEGV, signal.SIGABRT)
PATIENCE_S = 120.0
A_KILL_S = 5.0  # of rendering per kill


def main() -> None:
    options = _options()
    draw = random.Random(options.seed)
    with tempfile.TemporaryDirectory() as folder:
        farm = start_farm(Path(folder) / "data", options.slots)
        try:
            with farm.client() as client:
                measure(farm, client, draw, options)
        finally:
            stop_farm(farm)


def measure(farm: Farm, client: Client, draw: random.Random, options: argparse.Namespace) -> None:
    """Renders with and without kills; prints each kill's recovery time, and whether the digests are equal."""
    scene = client.wait_for_scene(client.upload([ROOT / "scenes" / "cornell-box.yaml"]).id)
    asked = {"width": 160, "height": 120, "max_depth": 5}
    trial = client.wait(client.submit(scene.id, **asked, spp=256).id)
    spp = round(256 * options.kills * A_KILL_S / max(trial.active_s, 0.1))
    job = client.submit(scene.id, **asked, spp=spp, fresh=True).id
    found: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for i in range(options.kills):
        name, number = options.parts[i % len(options.parts)], draw.choice(SIGNALS)
        _wait(lambda: _samples(client, job) > 0, "the job renders")
        time.sleep(draw.uniform(0.0, A_KILL_S / 2))
        if client.job(job).is_over:
            print(f"the job was over after {i} kills")
            break
        began, victim, others = time.monotonic(), _victim(farm, name, draw), _number(farm)
        victim.send_signal(number)
        serves = _wait(lambda victim=victim, others=others: _is_back(farm, victim, others), "it is back") - began  # type: ignore[misc]
        before = _samples(client, job)
        renders = _wait(lambda before=before: _samples(client, job) > before, "samples come") - began  # type: ignore[misc]
        found[name].append((serves, renders))
        print(f"{i + 1:3} {name:8} {number.name:8} serves {serves:5.2f} s   renders {renders:5.2f} s", flush=True)
    disturbed = client.wait(job)
    alone = client.wait(client.submit(scene.id, **asked, spp=spp, fresh=True).id)
    print(f"\n{'part':10}{'kills':>6}{'serves: median':>16}{'worst':>8}{'renders: median':>17}{'worst':>8}")
    for name, times in found.items():
        a, b = zip(*times, strict=True)
        print(
            f"{name:10}{len(times):6}{statistics.median(a):14.2f} s{max(a):6.2f} s{statistics.median(b):15.2f} s{max(b):6.2f} s"
        )
    same = (disturbed.state, client.digest(job)) == ("finished", client.digest(alone.id))
    print("the digest is the undisturbed one" if same else f"THE DIGEST IS ANOTHER ({disturbed.state}, {disturbed.error})")


def _slots(farm: Farm) -> list[psutil.Process]:
    try:
        return psutil.Process(farm.pids()["worker"]).children()
    except psutil.NoSuchProcess:
        return []


def _number(farm: Farm) -> int:
    return len(_slots(farm))


def _victim(farm: Farm, name: str, draw: random.Random) -> psutil.Process:
    if name != "slot":
        return psutil.Process(farm.pids()[name])
    _wait(lambda: bool(_slots(farm)), "there are slots")
    return draw.choice(_slots(farm))


def _is_back(farm: Farm, victim: psutil.Process, slots: int) -> bool:
    """Returns whether the killed process is gone, all processes run again, and the service is ready.

    slots: the number expected.
    """
    is_gone = not victim.is_running() or victim.status() == psutil.STATUS_ZOMBIE
    return is_gone and victim.pid not in farm.pids().values() and _number(farm) >= slots and _ready(farm)


def _ready(farm: Farm) -> bool:
    try:
        return httpx.get(f"{farm.url}/readyz", timeout=2.0, verify=False).is_success
    except httpx.HTTPError:
        return False


def _samples(client: Client, job: str) -> int:
    try:
        return client.job(job).samples
    except ClientError:
        return -1


def _wait(true: Callable[[], bool], what: str) -> float:
    deadline = time.monotonic() + PATIENCE_S
    while not true():
        if time.monotonic() > deadline:
            raise SystemExit(f"waited {PATIENCE_S:g} s until {what}")
        time.sleep(0.02)
    return time.monotonic()


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=12)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--slots", type=int, default=1)
    parser.add_argument("--parts", default="service,worker,slot,redis", type=lambda text: text.split(","))
    return parser.parse_args()


if __name__ == "__main__":
    main()
