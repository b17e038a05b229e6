"""Tests of compiling kernels in advance: once, the full-featured one at low priority, and without harm if it fails."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Any

import pytest

from protocol.terms import Terms
from renderer import jit
from renderer.child_processes import delayed_command
from renderer.render import FULL, PLAIN, kernel_name
from worker.exchange import kernel_precompile
from worker.exchange.errors import LinkError
from worker.exchange.link import Link
from worker.process.apply_terms import TermsKeeper

LINK = Link("http://127.0.0.1:9", "token")


@pytest.fixture(autouse=True)
def token(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RAYFARM_TOKEN", "token")


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[tuple[list[str], subprocess.Popen[bytes]]]:
    """Replaces started processes by a program that prints its nice level.

    Returns a list to which each start is added, as (command, process).
    """
    found: list[tuple[list[str], subprocess.Popen[bytes]]] = []
    popen = subprocess.Popen

    def start(command: list[str], **options: Any) -> subprocess.Popen[bytes]:
        assert options["env"]["RAYFARM_TOKEN"] == "token"
        program = "import os; print(os.getpriority(os.PRIO_PROCESS, 0))"
        found.append((command, popen([sys.executable, "-S", "-c", program], stdout=subprocess.PIPE, **options)))
        return found[-1][1]

    monkeypatch.setattr(subprocess, "Popen", start)
    return found


@pytest.mark.parametrize(("cached", "missing"), [((), "plain,full"), ((PLAIN,), "full")])
def test_only_the_full_kernel_is_compiled_late_and_at_low_priority(
    started: list[tuple[list[str], subprocess.Popen[bytes]]],
    monkeypatch: pytest.MonkeyPatch,
    cached: tuple[str, ...],
    missing: str,
) -> None:
    have = {kernel_name(variant=name) for name in cached}
    monkeypatch.setattr(jit, "is_cached", lambda name: name in have)
    kernel_precompile.precompile_kernels(LINK, [PLAIN, FULL])
    ((command, process),) = started
    delay, nice = (kernel_precompile.START_DELAY_S, kernel_precompile.NICE_INCREMENT) if cached else (0.0, 0)
    assert command[1:] == [
        *delayed_command("worker.exchange.kernel_precompile", delay)[1:],
        "--service=http://127.0.0.1:9",
        f"--kernels={missing}",
    ]
    assert process.stdout is not None
    assert int(process.stdout.read()) == min(os.getpriority(os.PRIO_PROCESS, 0) + nice, 19)
    process.stdout.close()


def test_cached_kernels_are_not_compiled_again(
    started: list[tuple[list[str], subprocess.Popen[bytes]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []
    monkeypatch.setattr(jit, "is_cached", lambda name: asked.append(name) or True)
    kernel_precompile.precompile_kernels(LINK, [PLAIN, FULL])
    assert (started, asked) == ([], [kernel_name(variant=PLAIN), kernel_name(variant=FULL)])


@pytest.fixture
def process(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Makes this process compile both kernels. Returns the list of its steps."""
    done: list[str] = []
    monkeypatch.setattr(sys, "argv", ["ahead", "--service=http://127.0.0.1:9", "--kernels=plain,full"])
    monkeypatch.setattr(kernel_precompile.logs, "set_up", lambda: None)
    monkeypatch.setattr(kernel_precompile.time, "sleep", lambda seconds: done.append("wait"))
    monkeypatch.setattr(kernel_precompile.os, "nice", lambda by: done.append("nice"))
    return done


@pytest.mark.parametrize("fetched", [True, False])
def test_compiled_kernels_are_uploaded(monkeypatch: pytest.MonkeyPatch, process: list[str], fetched: bool) -> None:
    monkeypatch.setattr(kernel_precompile, "fetch_or_compile", lambda link, variant: process.append(variant) or fetched)
    monkeypatch.setattr(kernel_precompile, "upload_kernel_with_retries", lambda link, folder, kernel: process.append(kernel))
    assert kernel_precompile.main() == 0
    sent = [[], []] if fetched else [[kernel_name(variant=name)] for name in (PLAIN, FULL)]
    assert process == [PLAIN, *sent[0], "wait", "nice", FULL, *sent[1]]


def test_unreachable_farm_is_tolerated(
    monkeypatch: pytest.MonkeyPatch, process: list[str], caplog: pytest.LogCaptureFixture
) -> None:
    def away(*_: Any) -> None:
        raise LinkError("nobody answers")

    monkeypatch.setattr(kernel_precompile, "fetch_or_compile", lambda link, variant: process.append(variant) or False)
    monkeypatch.setattr(kernel_precompile, "upload_kernel_with_retries", away)
    assert kernel_precompile.main() == 1
    assert "nobody answers" in caplog.text
    assert process == [PLAIN, "wait", "nice", FULL]


def test_worker_with_usage_limits_does_not_precompile() -> None:
    assert TermsKeeper(1).may_precompile()
    for own in (Terms(hours="Mon"), Terms(idle_minutes=5.0), Terms(nice=5), Terms(memory=1 << 30)):
        assert not TermsKeeper(1, own=own).may_precompile(), own
