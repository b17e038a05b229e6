"""Tests of detecting whether a user is at the machine, with simulated system files and programs."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from worker.machine.presence import TICK, Presence


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.delenv("DISPLAY", raising=False)
    (tmp_path / "dev" / "pts").mkdir(parents=True)
    (tmp_path / "proc").mkdir()
    return tmp_path


def set_processor_times(machine: Path, all_s: float, own_s: float) -> None:
    """Writes the processor time, in seconds, of all programs and of the worker with its one child process to the fake /proc."""
    (machine / "proc" / "stat").write_text(f"cpu  {round(all_s * TICK)} 0 0 999 999 0 0 0\ncpu0 1\n")
    for pid, parent, seconds in ((os.getpid(), 1, 1.0), (999_999, os.getpid(), own_s - 1.0), (999_998, 1, 50.0)):
        (machine / "proc" / str(pid)).mkdir(exist_ok=True)
        fields = ["S", str(parent), *["0"] * 9, str(round(seconds * TICK)), "0", "0", "0"]
        (machine / "proc" / str(pid) / "stat").write_text(f"{pid} (a (strange) name) {' '.join(fields)}\n")


def test_processor_time_of_other_programs_counts_as_user(machine: Path) -> None:
    presence = Presence(machine / "proc", machine / "dev")
    begun = presence._present
    set_processor_times(machine, 1000.0, 10.0)
    presence.idle_s(begun + 100)
    set_processor_times(machine, 1020.0, 30.0)
    assert presence.idle_s(begun + 110) == pytest.approx(110), "the worker itself took two cores"
    assert presence.by == ("load",)
    set_processor_times(machine, 1050.0, 50.0)
    assert presence.idle_s(begun + 120) == 0, "others took one of three"
    set_processor_times(machine, 1071.0, 70.0)
    assert presence.idle_s(begun + 130) == pytest.approx(10), "a tenth of a core is nobody"


def test_terminal_input_counts_as_user(machine: Path) -> None:
    terminal = machine / "dev" / "pts" / "3"
    terminal.touch()
    presence = Presence(machine / "nowhere", machine / "dev")
    begun = presence._present
    os.utime(terminal, (begun + 95, begun))
    assert presence.idle_s(begun + 100) == pytest.approx(5)
    assert presence.by == ("terminals",)


def test_xprintidle_is_used_if_installed(machine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = machine / "xprintidle"
    program.write_text("#!/bin/sh\necho 7000\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(machine), prepend=os.pathsep)
    monkeypatch.setenv("DISPLAY", ":0")
    presence = Presence(machine / "nowhere", machine / "dev")
    begun = presence._present
    assert presence.idle_s(begun + 100) == pytest.approx(7)
    assert presence.by == ("screen",)
    program.write_text("#!/bin/sh\nexit 1\n")
    presence.idle_s(begun + 200)
    assert presence.by == ()


LOGINCTL = """#!/bin/sh
if [ "$1" = list-sessions ]; then echo "  3 1000 anna seat0 tty2"; echo " c1 120 gdm seat0 tty1"; exit; fi
[ "$2" = 3 ] && cat "{folder}/anna" || printf 'Type=wayland\nClass=greeter\nState=online\nIdleHint=no\nIdleSinceHint=1\n'
"""


def test_desktop_idle_hint_is_used(machine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Checks that the idle hint of a desktop session tells whether its user is present.

    A script prints the output of systemd 252's loginctl, since the tests run without systemd-logind.
    """
    program = machine / "loginctl"
    program.write_text(LOGINCTL.format(folder=machine))
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(machine), prepend=os.pathsep)
    presence = Presence(machine / "nowhere", machine / "dev")
    begun = presence._present

    def tell_logind(hint: str, since: float, kind: str = "wayland") -> None:
        told = f"Type={kind}\nClass=user\nState=active\nIdleHint={hint}\nIdleSinceHint={since * 1e6:.0f}\n"
        (machine / "anna").write_text(told)

    tell_logind("yes", begun + 70)
    assert presence.idle_s(begun + 100) == pytest.approx(30, abs=0.1)
    assert presence.by == ("desktop",)
    tell_logind("no", begun + 190)
    assert presence.idle_s(begun + 200) == 0
    for silent in (("no", 0.0, "x11"), ("no", begun + 290, "tty")):
        tell_logind(*silent)
        presence.idle_s(presence._looked + 100)
        assert presence.by == (), "a desktop that has never said so; a terminal, of which others tell"
    assert presence._present == begun + 200
    program.write_text("#!/bin/sh\nexit 1\n")
    presence.idle_s(begun + 700)
    assert presence.by == ()
