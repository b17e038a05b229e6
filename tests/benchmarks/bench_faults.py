"""Injects random faults while jobs render, and checks that every job ends with the digest of an undisturbed run.

    python3 farm.py bench faults [--count 60] [--seed 1] [--kinds WORDS] [--grounds WORDS] [--log FILE] [--page]

A farm renders small jobs; one or more faults are injected into each. `back after` is the time from the kill, or from the end of a
lasting fault (a lock, a full disk, a cut cable), until new samples arrive. When a job has ended, its digest is compared with that
of the same frame rendered by this process alone. `batches repeated` counts results whose samples had arrived before.

If run as root, data folders are small separate disks, and hosts have separate networks (`faults/hosts.py`); without root the
faults that need these are left out.
"""

from __future__ import annotations

import argparse
import contextlib
import random
import shutil
import sys
import tempfile
import time
from pathlib import Path

import psutil
import pytest
import redis

from rayfarm.client import ClientError
from tests.benchmarks.faults import clocks, disks, hosts, pair, processes, queues  # noqa: F401 - each adds its kinds
from tests.benchmarks.faults.attack import KINDS, Attack, Kind
from tests.benchmarks.faults.frame import SCENE, digest_alone, request
from tests.benchmarks.faults.ground import OVER, Ground, UnrecoveredError
from tests.benchmarks.faults.stream import Stream
from tests.benchmarks.faults.tally import Fault, into_page, read, table, write
from tests.helpers import ROOT

GROUNDS = {"one machine": Ground, "another clock": clocks.ClockGround, "three hosts": hosts.HostsGround}
GROUNDS |= {each.name: each for each in (pair.PairGround, pair.PostgresPairGround)}
FAULTS_A_GROUND = 20
SEEDS = 4  # job seeds; a farm renders each once, so that no earlier result can be reused
NEARLY_DONE = 0.9
MENDS_ITSELF_S = 45.0


class Campaign:
    """Injects random faults on one test farm after the other, and records their outcomes."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.options = options
        self.draw = random.Random(options.seed)
        self.faults: list[Fault] = []
        self._failed: dict[str, float] = {}  # failed jobs and the times at which they failed
        self._asked: set[str] = set()  # jobs resumed since the last fault

    def run(self) -> None:
        while len(self.faults) < self.options.count:
            name = self.draw.choice([name for name in self.options.grounds if self._kinds(name)])
            folder = Path(tempfile.mkdtemp(prefix="rayfarm-faults-"))
            ground = None
            begun = len(self.faults)
            try:
                ground = GROUNDS[name](folder)
                self._on(ground)
            except (UnrecoveredError, pytest.fail.Exception) as error:  # pytest's exception: the farm did not start
                print(f"THE FARM DOES NOT COME BACK: {error}", flush=True)
            finally:
                if ground is not None:
                    ground.stop()
                if self.options.log:
                    write(self.options.log, self.faults[begun:])
                if all(f.digest_is_right and f.recovered_s is not None for f in self.faults[begun:]):
                    shutil.rmtree(folder, ignore_errors=True)
                else:
                    print(f"kept to be looked at: {folder}")

    def _kinds(self, ground: str) -> list[Kind]:
        words = self.options.kinds
        return [k for k in KINDS.values() if ground in k.grounds and (not words or any(word in k.name for word in words))]

    def _on(self, ground: Ground) -> None:
        with ground.client() as client:
            scene = client.wait_for_scene(client.upload([SCENE]).id).id
        done = 0
        with Stream(ground.store) as stream:
            for seed in range(SEEDS):
                if done >= FAULTS_A_GROUND or len(self.faults) >= self.options.count:
                    break
                faults: list[Fault] = []
                try:
                    self._job(ground, stream, scene, seed, faults)
                finally:
                    self.faults += faults
                    done += len(faults)

    def _job(self, ground: Ground, stream: Stream, scene: str, seed: int, faults: list[Fault]) -> None:
        with ground.client() as client:
            job = client.submit(scene, **request(self.options.spp, seed)).id
        left = self.options.count - len(self.faults)
        while len(faults) < left and ground.wait(lambda: ground.samples(job) > 0, "the job renders"):
            time.sleep(self.draw.uniform(0.0, 1.0))
            if self._progress(ground, job) > NEARLY_DONE:
                break
            faults.append(self._attack(ground, stream, job))
        self._end(ground, job, seed, faults)

    def _attack(self, ground: Ground, stream: Stream, job: str) -> Fault:
        kinds = self._kinds(ground.name)
        drawn = self.draw.choices(kinds, [k.weight for k in kinds])[0]
        fault = Fault(drawn.name, ground.name)
        attack = Attack(ground, stream, job, random.Random(self.draw.random()))
        repeated = stream.repeated
        try:
            drawn.act(attack)
        except (UnrecoveredError, pytest.fail.Exception, psutil.Error, redis.RedisError, OSError, ValueError) as error:
            fault.undone = f"{type(error).__name__}: {error}"
            attack.over()
        self._wait_for_recovery(ground, job, attack.since, fault)
        fault.repeated = stream.repeated - repeated
        took = "never" if fault.recovered_s is None else f"{fault.recovered_s:5.1f} s"
        number = len(self.faults) + 1
        print(f"{number:4}+ {drawn.name:55} {took}  {fault.repeated} repeated {fault.undone}{' asked' * fault.asked}", flush=True)
        return fault

    def _wait_for_recovery(self, ground: Ground, job: str, since: float, fault: Fault) -> None:
        """Waits until the job has new samples after the fault, and stores the recovery time in `fault`.

        since: when recovery could begin.
        """
        known = -1

        def has_new_samples() -> bool:
            nonlocal known
            now = ground.samples(job)
            if now >= 0 and (known < 0 or now < known):
                known = now
            if now == OVER and self._has_failed(ground, job):
                known = -1
                return False
            return 0 <= known < now or now == OVER

        with contextlib.suppress(UnrecoveredError):
            fault.recovered_s = round(ground.wait(has_new_samples, "samples come") - since, 2)
        fault.asked = job in self._asked
        self._asked.discard(job)
        if fault.recovered_s is None:
            print(ground.logs()[-6000:])

    def _has_failed(self, ground: Ground, job: str) -> bool:
        """Returns whether the job has failed; if its error asks the user to resume it, resumes it."""
        try:
            with ground.client() as client:
                found = client.job(job)
                if found.state != "failed":
                    self._failed.pop(job, None)
                    return False
                since = self._failed.setdefault(job, time.monotonic())
                if time.monotonic() - since > MENDS_ITSELF_S:
                    print(f"      {found.error}", flush=True)
                    client.change(job, state="running")
                    self._asked.add(job)
                    del self._failed[job]
        except (ClientError, OSError) as error:
            print(f"      {error}")
        return True

    def _progress(self, ground: Ground, job: str) -> float:
        with contextlib.suppress(ClientError, OSError), ground.client() as client:
            found = client.job(job)
            return 1.0 if found.is_over else found.progress
        return 0.0

    def _end(self, ground: Ground, job: str, seed: int, faults: list[Fault]) -> None:
        """Waits until the job has ended, and checks its digest."""
        began = time.monotonic()
        with contextlib.suppress(UnrecoveredError):
            ground.wait(lambda: ground.samples(job) == OVER and not self._has_failed(ground, job), "the job ends")
            for fault in faults:
                fault.asked |= job in self._asked and KINDS[fault.kind].harms_films
            is_right = self._read_digest(ground, job) == digest_alone(self.options.spp, seed)
            for fault in faults:
                fault.digest_is_right = is_right
            say = "the digest is the undisturbed one" if is_right else "THE DIGEST IS ANOTHER"
            print(
                f"      job of seed {seed}: {len(faults)} faults, {say}, {time.monotonic() - began:.1f} s to its end", flush=True
            )
            return
        print(f"      THE JOB DID NOT END\n{ground.logs()[-6000:]}")

    def _read_digest(self, ground: Ground, job: str) -> str:
        """Waits until the job is finished and has a digest, and returns the digest.

        A film that was damaged at the very end of the job is repaired by the farm meanwhile.
        """
        found = ""

        def has_digest() -> bool:
            nonlocal found
            with contextlib.suppress(ClientError, OSError), ground.client() as client:
                if client.job(job).state == "finished":
                    found = client.digest(job)
            return bool(found)

        ground.wait(has_digest, "the frame has a digest")
        return found


def main() -> int:
    options = _options()
    campaign = Campaign(options)
    campaign.run()
    faults = read([options.log]) if options.log else campaign.faults
    text = table(faults)
    print(text)
    if options.page:
        into_page(ROOT / "docs" / "fault-tests.md", text)
    return 0 if all(f.digest_is_right and f.recovered_s is not None for f in campaign.faults) else 1


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",")]


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--spp", type=int, default=3072)
    parser.add_argument("--kinds", type=_words, default=[], help="only those whose names have one of these words, after commas")
    parser.add_argument("--grounds", type=_words, default=[name for name, each in GROUNDS.items() if each.is_possible()])
    parser.add_argument("--log", type=Path, help="append what was found to this file; the table is of all that is in it")
    parser.add_argument("--page", action="store_true", help="write the table into docs/fault-tests.md")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
