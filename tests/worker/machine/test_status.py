"""Tests of the shared memory in which slots write their status and the parent reads it, across a real fork."""

import subprocess
import sys

from tests.helpers import ROOT
from worker.machine.status import SlotBoard


def test_parent_reads_status_of_child() -> None:
    program = """
import os
from worker.machine.status import SlotBoard
board = SlotBoard(2)
if os.fork() == 0:
    board.write(1, {"job": "j", "tile": [0, 0, 64, 64]}, 2e6)
    os._exit(0)
os.wait()
print(board.read())
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout.strip() == "([{}, {'job': 'j', 'tile': [0, 0, 64, 64]}], 2000000.0)"


def test_idle_slot_keeps_last_speed() -> None:
    board = SlotBoard(2)
    board.write(0, {"job": "a"}, 1e6)
    board.write(0, {})
    board.write(1, {}, 3e6)
    assert board.read() == ([{}, {}], 2e6)
    assert (board.speed(0), board.speed(1)) == (1e6, 3e6)


def test_oversized_record_is_empty() -> None:
    board = SlotBoard(1)
    board.write(0, {"job": "x" * 1000})
    assert board.read() == ([{}], 0.0)
    assert board.speed(0) == 0.0
