"""Shares compiled kernels within a farm: a worker downloads a kernel of its kind before compiling, and uploads what it compiled.

Uploading runs as a separate process, so the first tile does not wait for it: `python -m worker.exchange.kernels --service URL
--folder FOLDER --kernel NAME`, with the farm's token in RAYFARM_TOKEN.
"""

from __future__ import annotations

import argparse
import logging
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from renderer.child_processes import delayed_command, spawn_guard
from renderer.kernel_file import ArtefactError, name_of, pack, unpack
from worker.exchange.errors import LinkError, WorkerError
from worker.exchange.link import Link
from worker.telemetry import logs

__all__ = ["fetch_kernel", "upload_kernel", "upload_kernel_in_background", "upload_kernel_with_retries"]

log = logging.getLogger(__name__)
_LATER_S = 10.0  # a new worker has its first tile to render
_PATIENCE_S, _PAUSE_S = 60.0, 1.0


def fetch_kernel(link: Link, folder: Path, kernel: str) -> tuple[bool, str]:
    """Downloads the kernel of this name (renderer.render.kernel_name) from the farm into `folder`, the cache of kernels.

    Returns whether it was downloaded, and a sentence for the log.
    """
    with tempfile.TemporaryFile() as file:
        try:
            if not link.kernels(name_of(folder, kernel), file):
                return False, f"the farm has no kernel {kernel} of this kind yet"
            file.seek(0)
            return True, f"fetched the farm's kernel {kernel} ({unpack(file, link.token, folder)} files)"
        except (WorkerError, ArtefactError, OSError) as error:
            return False, f"the farm's kernel {kernel} cannot be fetched: {error}"


def upload_kernel(link: Link, folder: Path, kernel: str) -> None:
    """Uploads a kernel from `folder`, unless the farm has it. Raises WorkerError or OSError."""
    name = name_of(folder, kernel)
    if link.has_kernels(name):
        return
    with tempfile.TemporaryFile() as file:
        pack(folder, kernel, link.token, file)
        link.store_kernels(name, file)


def upload_kernel_in_background(link: Link, folder: Path, kernel: str) -> None:
    """Like `upload_kernel`, but starts after some seconds, in a child process that ends together with this one."""
    command = [
        *delayed_command("worker.exchange.kernels", _LATER_S),
        f"--service={link.service}",
        f"--folder={folder}",
        f"--kernel={kernel}",
    ]
    environment = {**os.environ, "RAYFARM_TOKEN": link.token}
    guard = spawn_guard()

    def stand_back() -> None:
        guard()
        os.nice(10)

    process = subprocess.Popen(command, env=environment, stdin=subprocess.DEVNULL, preexec_fn=stand_back)
    threading.Thread(target=process.wait, name="kernels handed in", daemon=True).start()  # reaps the child


def main() -> int:
    """Uploads the kernel once. Returns the exit code. A failure is only logged: the next worker compiles the kernel itself."""
    parser = argparse.ArgumentParser(prog="python -m worker.exchange.kernels", description="Gives a farm what was compiled here.")
    parser.add_argument("--service", required=True, help="the service's address, as http://host:8000")
    parser.add_argument("--folder", required=True, type=Path, help="where the kernels are")
    parser.add_argument("--kernel", required=True, help="which of them: renderer.render.kernel_name")
    options = parser.parse_args()
    token = os.environ.get("RAYFARM_TOKEN", "")
    logs.set_up()
    try:
        upload_kernel_with_retries(Link(options.service, token), options.folder, options.kernel)
    except (WorkerError, OSError) as error:
        log.warning("the kernels are not uploaded: %s", error)
        return 1
    return 0


def upload_kernel_with_retries(link: Link, folder: Path, kernel: str) -> None:
    """Like `upload_kernel`, but retries for up to a minute, since the service may be starting or restarting."""
    until = time.monotonic() + _PATIENCE_S
    while True:
        try:
            return upload_kernel(link, folder, kernel)
        except LinkError:
            if time.monotonic() > until:
                raise
        time.sleep(_PAUSE_S)


if __name__ == "__main__":
    sys.exit(main())
