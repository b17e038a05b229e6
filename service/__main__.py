"""`python -m service --host 0.0.0.0 --port 8000 ...`: the service, by uvicorn's options and with bounded connections."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import uvicorn
from uvicorn.config import HTTP_PROTOCOLS

from service.connections import Connection, most_connections

__all__ = ["serve"]

# Pictures are noise, which is hardly made smaller, by work on the loop that everybody waits for. What a socket is told is short.
ALWAYS = ("--factory", "--http", "auto", "--ws-per-message-deflate", "false", "--ws-max-size", str(4 << 20))


def serve(arguments: Sequence[str]) -> None:
    """Run the service until it is told to end. arguments: more of uvicorn's."""
    Connection.most = most_connections()
    HTTP_PROTOCOLS["auto"] = f"{Connection.__module__}:{Connection.__qualname__}"
    uvicorn.main(args=["service.main:create_app", *ALWAYS, *arguments], prog_name="python -m service")


if __name__ == "__main__":
    serve(sys.argv[1:])
