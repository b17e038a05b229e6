"""`python -m service.standby UVICORN'S OPTIONS`: the service, loaded and ready to begin when a line comes on standard input.

To load it takes most of a second of a processor, several on a machine whose slots all render. Whoever watches over the service
keeps one that has that behind it (rayfarm/local/supervisor.py), so that a killed service is back at once.
"""

from __future__ import annotations

import sys

import uvicorn

import service.main  # noqa: F401 - what takes so long

if __name__ == "__main__":
    if sys.stdin.readline():  # else whoever would have said so is gone
        uvicorn.main(args=sys.argv[1:], prog_name="uvicorn")
