"""A test farm whose clock can be set forward or back: `time.time` is replaced in all of its processes except Redis."""

from __future__ import annotations

import os
from pathlib import Path

from tests.benchmarks.faults.attack import Attack, kind
from tests.benchmarks.faults.ground import Ground

# Python runs this file at start. time.monotonic, which measures durations, is unchanged, as on a machine whose clock is set.
# libfaketime would change every program, but Python's sleep fails (EINVAL) if libfaketime leaves monotonic time unchanged.
SITE = """
import os, time

_real, _real_ns, _monotonic = time.time, time.time_ns, time.monotonic
_known = [-1.0, 0.0]


def _ahead():
    now = _monotonic()
    if now - _known[0] > 0.2:
        try:
            with open(os.environ["RAYFARM_FAULTS_CLOCK"]) as file:
                _known[:] = now, float(file.read())
        except (OSError, ValueError):
            pass
    return _known[1]


time.time = lambda: _real() + _ahead()
time.time_ns = lambda: _real_ns() + int(_ahead() * 1e9)
"""


class ClockGround(Ground):
    """A `Ground` whose processes read the offset of their clock from a file."""

    name = "another clock"

    def __init__(self, folder: Path) -> None:
        self.clock = folder / "clock"
        self.clock.write_text("0")
        (folder / "site").mkdir()
        (folder / "site" / "sitecustomize.py").write_text(SITE)
        path = os.pathsep.join(filter(None, (str(folder / "site"), os.environ.get("PYTHONPATH", ""))))
        super().__init__(folder, {"PYTHONPATH": path, "RAYFARM_FAULTS_CLOCK": str(self.clock)})


def jump(attack: Attack, seconds: float) -> None:
    assert isinstance(attack.ground, ClockGround)
    clock = attack.ground.clock
    later = clock.with_suffix(".new")
    later.write_text(str(float(clock.read_text()) + seconds))
    later.replace(clock)
    attack.pause(0.5, 2.0)
    attack.over()


@kind("the clock jumps ahead", grounds=("another clock",), weight=8)
def ahead(attack: Attack) -> None:
    jump(attack, attack.draw.choice((5.0, 70.0, 3600.0, 90_000.0)))


@kind("the clock jumps back", grounds=("another clock",), weight=8)
def back(attack: Attack) -> None:
    jump(attack, -attack.draw.choice((5.0, 70.0, 3600.0, 90_000.0)))
