"""Tests of a machine that joins a farm: it loads the kernels that the first machine compiled, and leaves again."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from rayfarm.client import Client
from renderer.child_processes import spawn_guard
from tests.helpers import ROOT, Farm, wait_until

PLAIN = "render_pool-plain"


@pytest.mark.long
def test_a_machine_that_joins_compiles_nothing_and_leaves_by_ctrl_c(farm: Farm, tmp_path: Path) -> None:
    kernels = farm.data / "kernels"
    wait_until(lambda: any(kernels.glob(f"*-{PLAIN}")), 60, "the farm's own worker has handed in its kernels")
    log = tmp_path / "worker.log"
    # With a memory limit it precompiles no kernels that were not requested (worker/exchange/kernel_precompile.py).
    command = ["-m", "rayfarm", "worker", "--join", farm.url, "--slots", "1", "--memory", "64", "--name", "another-machine"]
    with log.open("wb") as out:
        joining = subprocess.Popen(
            [sys.executable, *command],
            cwd=ROOT,
            env={**os.environ, "RAYFARM_TOKEN": farm.token, "RAYFARM_CACHE": str(tmp_path / "cache")},
            stdout=out,
            stderr=out,
            preexec_fn=spawn_guard(),
        )
    try:
        with Client(farm.url) as client:

            def states() -> dict[str, str]:
                return {worker.name: worker.state for worker in client.workers()}

            wait_until(lambda: states().get("another-machine") == "ready", 120, "the worker is ready")
            assert len(states()) == 2
            assert f"fetched the farm's kernel {PLAIN}" in log.read_text()
            # Kernels compiled by this worker would be in its own folder, not among the fetched ones.
            (folder,) = (tmp_path / "cache" / "kernels").iterdir()
            fetched = next(kernels.glob(f"*-{PLAIN}")).read_bytes()
            code = list(folder.rglob("*.code"))
            assert code
            assert all(path.name.encode() in fetched for path in code)
            joining.send_signal(signal.SIGINT)
            assert joining.wait(20) == 0, log.read_text()
            wait_until(lambda: "another-machine" not in states(), 10, "it has left")
    finally:
        joining.kill()
        joining.wait()
