"""Compiles kernels in advance, while a new worker reads scenes, waits or renders: the plain one, then the full one.

Otherwise the first scene that needs the full-featured kernel (with textures and everything else) would wait half a minute for
it. The plain kernel is compiled at once and at the worker's own priority, since all pictures wait for it; the full one later and
at low priority. If a slot needs a kernel before it is complete, the slot waits (renderer.jit.compiling).

Runs as a separate process: `python -m worker.exchange.kernel_precompile --service URL --kernels NAME,...`, with the farm's token
in RAYFARM_TOKEN.
"""

from __future__ import annotations

import argparse
import logging
import os
import subprocess
import sys
import threading
import time
from collections.abc import Sequence

from renderer import jit
from renderer.child_processes import delayed_command, spawn_guard
from renderer.render import PLAIN, kernel_name
from worker.exchange.errors import WorkerError
from worker.exchange.kernels import upload_kernel_with_retries
from worker.exchange.link import Link
from worker.exchange.ready import fetch_or_compile
from worker.telemetry import logs

__all__ = ["precompile_kernels"]

log = logging.getLogger("worker")

START_DELAY_S = 3.0  # before any kernel but the plain one: the worker has its first tile to render
NICE_INCREMENT = 5  # nice levels; moderate, so that a slot waiting for the kernel on a busy machine gets it


def precompile_kernels(link: Link, variants: Sequence[str]) -> None:
    """Starts a process that compiles those of the kernel variants that this machine lacks, in this order.

    The process ends together with this one.
    """
    missing = [variant for variant in variants if not jit.is_cached(kernel_name(variant=variant))]
    if not missing:
        return
    is_urgent = missing[0] == PLAIN
    command = delayed_command("worker.exchange.kernel_precompile", 0.0 if is_urgent else START_DELAY_S)
    guard = spawn_guard()

    def begin() -> None:
        guard()
        if not is_urgent:
            os.nice(NICE_INCREMENT)

    process = subprocess.Popen(
        [*command, f"--service={link.service}", f"--kernels={','.join(missing)}"],
        env={**os.environ, "RAYFARM_TOKEN": link.token},
        stdin=subprocess.DEVNULL,
        preexec_fn=begin,
    )
    threading.Thread(target=process.wait, name="kernels precompiled", daemon=True).start()  # reaps the child


def main() -> int:
    """Compiles or downloads the kernels. Returns the exit code.

    A failure is only logged, since a slot can compile on demand.
    """
    parser = argparse.ArgumentParser(prog="python -m worker.exchange.kernel_precompile", description="Gets kernels ready.")
    parser.add_argument("--service", required=True, help="the service's address, as http://host:8000")
    parser.add_argument("--kernels", required=True, help="names of kernel variants, separated by commas")
    options = parser.parse_args()
    logs.set_up()
    link = Link(options.service, os.environ.get("RAYFARM_TOKEN", ""))
    first, *more = options.kernels.split(",")
    code = _compile(link, first)
    for variant in more:
        time.sleep(START_DELAY_S)
        os.nice(NICE_INCREMENT)
        code = max(code, _compile(link, variant))
    return code


def _compile(link: Link, variant: str) -> int:
    """Compiles or downloads one kernel, and uploads it. Returns the exit code."""
    name = kernel_name(variant=variant)
    try:
        if not fetch_or_compile(link, variant=variant):
            upload_kernel_with_retries(link, jit.cache_folder(), name)
    except (WorkerError, OSError) as error:
        log.warning("the kernel %s is not uploaded: %s", name, error)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
