"""`python -m service.standby`: like `python -m service`, but imports everything first and then reads its options from stdin.

The imports take more than a second of processor time, and several seconds if the machine's slots are busy. `rayfarm up` starts
this process before its own imports (rayfarm/local/early.py). It always keeps one more such process in reserve, so that it can
replace a killed service at once (rayfarm/local/supervisor.py).
"""

from __future__ import annotations

import gc

gc.disable()  # during imports, each collection would scan all modules loaded so far; service/main.py enables it

import service.main  # noqa: E402, F401 - what takes so long
from renderer.child_processes import wait_for_start_line  # noqa: E402
from service.__main__ import serve  # noqa: E402

if __name__ == "__main__":
    arguments = wait_for_start_line()
    if arguments is not None:  # at the end of the input, the supervisor is gone
        serve(arguments)
