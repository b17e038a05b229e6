"""The bounded child: whatever a file does to its reader, the worker gets a sentence.

Run in a process of one thread, as a slot of a worker is: in one for all of them, as what it imports takes longer than most.
"""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.helpers import ROOT

Run = Callable[[str], dict[str, Any]]

PROGRAM = """
import errno, json, os, resource, signal, sys, threading, time
from concurrent.futures import ThreadPoolExecutor
from renderer.errors import SceneError
from worker.work.bounded import run_bounded
from worker.exchange.errors import MachineError, WorkError

def good(send):
    send({"step": "reading", "fraction": 0.5})
    return {"triangles": 12}

def fault(send):
    raise SceneError("truck.glb: the buffer ends early; export it again")

def hungry(send):
    return {"sum": len(bytearray(4 << 30))}

def slow(send):
    time.sleep(60)

def segfault(send):
    os.kill(os.getpid(), signal.SIGSEGV)

def odd(send):
    return {}["missing"]

def deep(send):
    return deep(send)

def quiet(send):
    os._exit(0)

def full(send):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "compiled.safetensors")

def too_large(send):
    raise OSError(errno.ENOMEM, os.strerror(errno.ENOMEM))

def missing(send):
    open("/nowhere/texture.png")

def crowded(send):
    raise AssertionError("never started")

def chatty(send):
    for _ in range(3):
        send({"step": "reading", "fraction": 0.5})
    return {"triangles": 12}

def threaded(send):
    all_here = threading.Barrier(6)
    with ThreadPoolExecutor(6) as pool:
        list(pool.map(lambda size: (all_here.wait(), bytearray(size)), [5000] * 6))
        return {"sum": len(bytearray(150 << 20))}

def last_signal(send):
    os.kill(os.getpid(), signal.SIGRTMAX)

def tried(what):
    said = []

    def hear(message):
        if what == "chatty":
            time.sleep(1.0)
        said.append(message)

    try:
        answer = run_bounded(globals()[what], hear, 256 << 20, 2.0, (SceneError,), "truck.glb")
    except MachineError as error:
        return {"machine": str(error), "said": said}
    except WorkError as error:
        return {"error": str(error), "said": said}
    return {"answer": answer, "said": said}

for what in sys.argv[1:]:
    print(json.dumps({what: tried(what)}), flush=True)

def fork():
    raise OSError(errno.EAGAIN, os.strerror(errno.EAGAIN))

os.fork = fork
print(json.dumps({"crowded": tried("crowded")}))
"""
SENTENCES = {
    "fault": "truck.glb: the buffer ends early; export it again",
    "hungry": "truck.glb needs more than the 0.2 GiB that this worker grants one scene",
    "slow": "truck.glb took longer than 2 seconds",
    "segfault": "truck.glb made its reader crash (SIGSEGV)",
    "odd": "truck.glb cannot be read (KeyError: 'missing')",
    "deep": "truck.glb is nested too deeply",
    "quiet": "truck.glb could not be prepared",
}
OTHERS = ("good", "full", "too_large", "missing", "last_signal", "chatty", "threaded")


@pytest.fixture(scope="module")
def run() -> Run:
    """What came of each."""
    command = [sys.executable, "-c", PROGRAM, *SENTENCES, *OTHERS]
    done = subprocess.run(command, capture_output=True, cwd=ROOT, timeout=120, check=False)
    found: dict[str, dict[str, Any]] = {}
    for line in done.stdout.splitlines():
        found |= json.loads(line)
    assert done.returncode == 0, f"after {[*found]}: {done.stderr.decode()}"
    return found.__getitem__


def test_the_answer_and_the_progress_arrive(run: Run) -> None:
    assert run("good") == {"answer": {"triangles": 12}, "said": [{"step": "reading", "fraction": 0.5}]}


@pytest.mark.parametrize("what", SENTENCES)
def test_every_way_to_fail_is_a_sentence(run: Run, what: str) -> None:
    assert run(what)["error"].startswith(SENTENCES[what])


def test_the_child_ends_with_its_parent(tmp_path: Path) -> None:
    note = tmp_path / "pid"
    program = f"""
import os, time
from pathlib import Path
from worker.work.bounded import run_bounded
def work(send):
    Path({str(note)!r}).write_text(str(os.getpid()))
    time.sleep(60)
run_bounded(work, print, 1 << 30, 60.0)
"""
    parent = subprocess.Popen([sys.executable, "-c", program], cwd=ROOT)
    from tests.helpers import wait_until

    wait_until(lambda: note.exists() and bool(note.read_text()), 10, "the child has begun")
    child = int(note.read_text())
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    wait_until(lambda: not _alive(child), 5, "the child has ended")


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
        # A child that has ended and waits to be reaped by init still has its number.
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (ProcessLookupError, FileNotFoundError):
        return False


def test_the_machines_own_trouble_is_not_the_files(run: Run) -> None:
    assert "No space left on device" in run("full")["machine"]
    assert "cannot start another process" in run("crowded")["machine"]
    assert "grants one scene" in run("too_large")["error"]
    assert "No such file" in run("missing")["error"]


def test_any_signal_has_a_name(run: Run) -> None:
    assert "crash" in run("last_signal")["error"]


def test_who_hears_of_the_progress_may_be_slow(run: Run) -> None:
    """A Redis that is away while the child works: three seconds of waiting for it are none of the child's two."""
    assert run("chatty")["answer"] == {"triangles": 12}


def test_threads_leave_the_memory_to_who_needs_it(run: Run) -> None:
    """Six threads that allocate next to nothing, and then most of the child's 256 MiB."""
    assert run("threaded") == {"answer": {"sum": 150 << 20}, "said": []}
