"""`python -m service --host 0.0.0.0 --port 8000 ...`: runs the service in uvicorn, with limits on its connections."""

from __future__ import annotations

import argparse
import gc
import logging
import os
import sys
from collections.abc import Sequence

import uvicorn
from uvicorn.config import HTTP_PROTOCOLS, LOGGING_CONFIG

from service.connections import Connection, most_connections

__all__ = ["serve"]

# WebSocket compression is off: images are noisy and compress poorly, at the cost of time on the event loop; other messages are
# short. Idle connections are kept for longer than clients keep theirs (httpx: 5 s, uvicorn's default too): if both close at the
# same time, a request may arrive on a connection that is being closed, and fails.
KEEP_ALIVE_S = 20
UVICORN_OPTIONS = (
    *("--factory", "--http", "auto", "--timeout-keep-alive", str(KEEP_ALIVE_S)),
    *("--ws-per-message-deflate", "false", "--ws-max-size", str(4 << 20)),
    "--no-proxy-headers",  # service/http/client_address.py uses RAYFARM_TRUSTED_PROXIES instead
)
HOST, PORT = "127.0.0.1", "8000"
log = logging.getLogger(__name__)
LINES = {"default": "%(message)s", "access": '%(client_addr)s - "%(request_line)s" %(status_code)s'}  # of uvicorn's formatters
HEALTH_CHECK_PATHS = ("/healthz", "/readyz")
WEBSOCKET_LINES = ('%s - "WebSocket %s" [accepted]', "connection open", "connection closed")  # of uvicorn and websockets


def serve(arguments: Sequence[str]) -> None:
    """Runs the service until it is stopped. arguments: further command line options of uvicorn.

    Sets RAYFARM_HOST and RAYFARM_PORT to the values of these options. From the address the service's settings derive whether a
    login is required and which host names are accepted.
    """
    gc.disable()  # during imports, as in service/standby.py
    Connection.most = most_connections()
    HTTP_PROTOCOLS["auto"] = f"{Connection.__module__}:{Connection.__qualname__}"
    where = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    where.add_argument("--host", default=os.environ.get("RAYFARM_HOST") or HOST)
    where.add_argument("--port", default=os.environ.get("RAYFARM_PORT") or PORT)
    address, others = where.parse_known_args(arguments)
    os.environ |= {"RAYFARM_HOST": address.host, "RAYFARM_PORT": address.port}
    if "FORWARDED_ALLOW_IPS" in os.environ:
        log.warning("FORWARDED_ALLOW_IPS is not read. Set RAYFARM_TRUSTED_PROXIES to the addresses of your proxies.")
    logging.getLogger("uvicorn.access").addFilter(_is_not_health_check)
    logging.getLogger("uvicorn.error").addFilter(_is_not_routine_websocket)
    for name, message in LINES.items():
        LOGGING_CONFIG["formatters"][name]["fmt"] = f"%(asctime)s %(levelname)s {message}"  # as the workers' lines
    listening = ("--host", address.host, "--port", address.port)
    uvicorn.main(args=["service.main:create_app", *UVICORN_OPTIONS, *listening, *others], prog_name="python -m service")


def _is_not_health_check(record: logging.LogRecord) -> bool:
    """Logging filter: drops access log records of successful health probes, which come every few seconds.

    uvicorn's arguments of the record are client, method, path, HTTP version and status.
    """
    if not isinstance(record.args, tuple) or len(record.args) != 5:
        return True
    _, method, path, _, status = record.args
    return not (method == "GET" and str(path).partition("?")[0] in HEALTH_CHECK_PATHS and status == 200)


def _is_not_routine_websocket(record: logging.LogRecord) -> bool:
    """Logging filter: drops the lines of accepted and closed WebSockets, of which every open page makes several."""
    return record.msg not in WEBSOCKET_LINES


if __name__ == "__main__":
    serve(sys.argv[1:])
