"""`python -m worker.standby`: like `python -m worker`, but imports everything first and then reads its options from stdin.

The imports take more than a second of processor time. `rayfarm up` and `rayfarm worker` start this process before their own
imports (rayfarm/local/early.py).
"""

from __future__ import annotations

import contextlib
import sys

from renderer import jit
from renderer.child_processes import wait_for_start_line
from renderer.render import kernel_name, warm_up
from renderer.shipped_kernels import copy_shipped_kernels
from worker.__main__ import main
from worker.work.reader import begin_launcher


def load() -> None:
    """Starts the launcher of confined readers, and loads the plain kernel (of scenes without textures) if it is cached."""
    copy_shipped_kernels(jit.cache_folder())
    begin_launcher()
    if jit.is_cached(kernel_name()):
        warm_up()


if __name__ == "__main__":
    with contextlib.suppress(Exception):  # `main` meets the same error, and reports it
        load()
    arguments = wait_for_start_line()
    if arguments is not None:  # at the end of the input, the supervisor is gone
        sys.exit(main(arguments))
