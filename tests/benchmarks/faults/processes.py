"""Faults of processes: killed by several signals, or suspended for a while."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys

import psutil

from renderer.child_processes import spawn_guard
from tests.benchmarks.faults.attack import Attack, kind
from tests.benchmarks.faults.ground import stopped
from tests.helpers import ROOT

SIGNALS = (signal.SIGKILL, signal.SIGKILL, signal.SIGSEGV, signal.SIGABRT, signal.SIGTERM)


def kill(attack: Attack, *processes: psutil.Process) -> None:
    number = attack.draw.choice(SIGNALS)
    attack.over()
    for process in processes:
        with contextlib.suppress(psutil.NoSuchProcess):
            process.send_signal(number)
    psutil.wait_procs(processes, timeout=20)  # otherwise the last results of an ending service would count as recovery


def tree(process: psutil.Process) -> list[psutil.Process]:
    return [process, *process.children(recursive=True)]


@kind("a slot is killed", weight=3)
def slot(attack: Attack) -> None:
    slots = attack.ground.slots()
    if slots:
        kill(attack, attack.draw.choice(slots))


@kind("a worker is killed", weight=3)
def worker(attack: Attack) -> None:
    guest = attack.draw.random() < 0.5
    kill(attack, attack.ground.guest if guest else attack.ground.part("worker"))


@kind("the service is killed", weight=3)
def service(attack: Attack) -> None:
    kill(attack, attack.ground.part("service"))


@kind("the spare service is killed")
def spare(attack: Attack) -> None:
    kill(attack, *attack.ground.spares())


@kind("service and spare are killed")
def service_and_spare(attack: Attack) -> None:
    kill(attack, *attack.ground.spares(), attack.ground.part("service"))


@kind("Redis is killed", weight=3)
def broker(attack: Attack) -> None:
    kill(attack, attack.ground.part("redis"))


@kind("service, worker and Redis are killed")
def several(attack: Attack) -> None:
    parts = [attack.ground.part(name) for name in ("service", "worker", "redis")]
    kill(attack, *attack.draw.sample(parts, attack.draw.choice((2, 3))))


@kind("`rayfarm up` is killed, and started again", weight=1)
def everything(attack: Attack) -> None:
    attack.ground.farm.process.kill()
    attack.ground.farm.process.wait()
    attack.over()


@kind("a slot stands still")
def slot_suspended(attack: Attack) -> None:
    slots = attack.ground.slots()
    with stopped([attack.draw.choice(slots)] if slots else []):
        attack.pause(0.3, 8.0)
    attack.over()


@kind("a worker and its slots stand still")
def worker_suspended(attack: Attack) -> None:
    with stopped(tree(attack.ground.part("worker"))):
        attack.pause(0.5, 10.0)
    attack.over()


@kind("the service stands still")
def service_suspended(attack: Attack) -> None:
    with stopped([attack.ground.part("service")]):
        attack.pause(0.3, 6.0)
    attack.over()


@kind("Redis stands still")
def broker_suspended(attack: Attack) -> None:
    with stopped([attack.ground.part("redis")]):
        attack.pause(0.3, 8.0)
    attack.over()


@kind("a second service on the folder, and the owner is killed", grounds=("one machine", "another clock"))
def two_services(attack: Attack) -> None:
    """Starts a second service on the same data folder, kills the owner, and later ends the second service.

    The job must continue, whichever service then owns the farm.
    """
    ground = attack.ground
    command = [sys.executable, "-m", "service", "--no-access-log", "--port", "0"]
    owner = ground.part("service")
    environment = owner.environ()
    with (ground.folder / "second.log").open("ab") as log:
        second = subprocess.Popen(command, cwd=ROOT, env=environment, stdout=log, stderr=log, preexec_fn=spawn_guard())
    try:
        attack.pause(1.0, 3.0)
        with contextlib.suppress(psutil.NoSuchProcess):
            owner.kill()
        attack.pause(1.0, 5.0)
    finally:
        second.kill()
        second.wait()
    attack.over()
