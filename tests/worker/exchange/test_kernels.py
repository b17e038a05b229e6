"""Tests that the process that uploads kernels is reaped when it ends, so that it does not remain as a zombie."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.helpers import wait_until
from worker.exchange import kernels
from worker.exchange.link import Link


def test_upload_process_is_reaped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[int] = []

    class Started(subprocess.Popen[bytes]):
        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)
            started.append(self.pid)

    monkeypatch.setattr(subprocess, "Popen", Started)
    monkeypatch.setattr(sys, "executable", shutil.which("true"))
    kernels.upload_kernel_in_background(Link("http://127.0.0.1:1", "token"), tmp_path, "render_pool-plain")
    (pid,) = started
    wait_until(lambda: not psutil.pid_exists(pid), 10, "not even a zombie is left")
