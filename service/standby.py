"""`python -m service.standby OPTIONS`: as `python -m service OPTIONS`, loaded, and waiting for a line on standard
input to begin.

Loading takes most of a second of processor time, and several seconds on a machine whose slots are all rendering. The supervisor
keeps one spare that has done this already (rayfarm/local/supervisor.py), so that a killed service is back at once.
"""

from __future__ import annotations

import gc
import sys

gc.disable()  # while modules come: each collection looks through all that have come; service/main.py lets it begin

import service.main  # noqa: E402, F401 - what takes so long
from service.__main__ import serve  # noqa: E402

if __name__ == "__main__":
    if sys.stdin.readline():  # else whoever would have said so is gone
        serve(sys.argv[1:])
