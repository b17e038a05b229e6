"""Compiles the full-featured kernel (with textures and everything else) in advance, while a new worker waits or renders.

Otherwise the first scene that needs this kernel would wait half a minute for it. Runs as a separate process at low priority:
`python -m worker.exchange.kernel_precompile --service URL`, with the farm's token in RAYFARM_TOKEN. If a slot needs the kernel
before it is complete, the slot waits (renderer.jit.compiling).
"""

from __future__ import annotations

import argparse
import logging
import os
import subprocess
import sys
import threading

from renderer import jit
from renderer.child_processes import delayed_command, spawn_guard
from renderer.render import FULL, kernel_name
from worker.exchange.errors import WorkerError
from worker.exchange.kernels import upload_kernel
from worker.exchange.link import Link
from worker.exchange.ready import fetch_or_compile
from worker.telemetry import logs

__all__ = ["precompile_full_kernel"]

log = logging.getLogger("worker")

START_DELAY_S = 3.0  # the worker has its first tile to render
NICE_INCREMENT = 5  # nice levels; moderate, so that a slot waiting for the kernel on a busy machine gets it


def precompile_full_kernel(link: Link) -> None:
    """Starts the compiling process, unless this machine has the kernel.

    The process waits START_DELAY_S seconds before it compiles, and ends together with this one.
    """
    if jit.is_cached(kernel_name(variant=FULL)):
        return
    guard = spawn_guard()

    def stand_back() -> None:
        guard()
        os.nice(NICE_INCREMENT)

    process = subprocess.Popen(
        [*delayed_command("worker.exchange.kernel_precompile", START_DELAY_S), f"--service={link.service}"],
        env={**os.environ, "RAYFARM_TOKEN": link.token},
        stdin=subprocess.DEVNULL,
        preexec_fn=stand_back,
    )
    threading.Thread(target=process.wait, name="a kernel got ready ahead", daemon=True).start()  # reaps the child


def main() -> int:
    """Compiles or downloads the kernel once. Returns the exit code.

    A failure is only logged, since a slot can compile on demand.
    """
    parser = argparse.ArgumentParser(
        prog="python -m worker.exchange.kernel_precompile", description="Gets the next kernel ready."
    )
    parser.add_argument("--service", required=True, help="the service's address, as http://host:8000")
    options = parser.parse_args()
    logs.set_up()
    link = Link(options.service, os.environ.get("RAYFARM_TOKEN", ""))
    try:
        if not fetch_or_compile(link, variant=FULL):
            upload_kernel(link, jit.cache_folder(), kernel_name(variant=FULL))
    except (WorkerError, OSError) as error:
        log.warning("the kernel %s is not uploaded: %s", kernel_name(variant=FULL), error)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
