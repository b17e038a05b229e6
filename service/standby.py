"""`python -m service.standby UVICORN'S OPTIONS`: the service, loaded and waiting for a line on standard input to begin.

Loading takes most of a second of processor time, and several seconds on a machine whose slots are all rendering. The supervisor
keeps one spare that has done this already (rayfarm/local/supervisor.py), so that a killed service is back at once.
"""

from __future__ import annotations

import sys

import uvicorn

import service.main  # noqa: F401 - what takes so long

if __name__ == "__main__":
    if sys.stdin.readline():  # else whoever would have said so is gone
        uvicorn.main(args=sys.argv[1:], prog_name="uvicorn")
