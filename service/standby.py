"""`python -m service.standby`: as `python -m service`, but loads first and takes its options from a line on standard input.

Loading takes more than a second of processor time, and several seconds on a machine with busy slots. `rayfarm up` starts this
process before it loads itself (rayfarm/local/early.py), and keeps a loaded spare one, so that a killed service is replaced at
once (rayfarm/local/supervisor.py).
"""

from __future__ import annotations

import gc

gc.disable()  # during imports, each collection would scan all modules loaded so far; service/main.py enables it

import service.main  # noqa: E402, F401 - what takes so long
from renderer.child_processes import wait_to_begin  # noqa: E402
from service.__main__ import serve  # noqa: E402

if __name__ == "__main__":
    arguments = wait_to_begin()
    if arguments is not None:  # at the end of the input, the supervisor is gone
        serve(arguments)
