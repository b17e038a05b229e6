"""`python -m service.standby OPTIONS`: as `python -m service OPTIONS`, but loads first and starts on a line on standard input.

Loading takes most of a second of processor time, and several seconds on a machine with busy slots. The supervisor keeps a loaded
spare process (rayfarm/local/supervisor.py), so that a killed service is replaced at once.
"""

from __future__ import annotations

import gc
import sys

gc.disable()  # during imports, each collection would scan all modules loaded so far; service/main.py enables it

import service.main  # noqa: E402, F401 - what takes so long
from service.__main__ import serve  # noqa: E402

if __name__ == "__main__":
    if sys.stdin.readline():  # at end of input, the supervisor is gone
        serve(sys.argv[1:])
