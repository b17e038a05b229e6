"""One attempt to deliver one message to one hook."""

from __future__ import annotations

import asyncio
import contextlib
import functools
import json
import os
import signal
import ssl
import subprocess
import tempfile
import time
from typing import IO, Any
from urllib.parse import urlsplit

import httpx

from service.hooks.signing import headers

__all__ = ["RefusedError", "UndeliveredError", "post", "run", "shown"]

ANSWER_WITHIN_S = 10.0
RUN_WITHIN_S = 60.0
SAID = 300  # characters of what a program said that are kept


def shown(hook: str) -> str:
    """A hook as it may be told and written down: what stands behind its host is often its secret."""
    parts = urlsplit(hook)
    return f"{parts.scheme}://{parts.hostname}/..." if parts.scheme and parts.netloc else hook


class UndeliveredError(Exception):
    """It did not arrive; why, as a sentence. It may at another time."""


class RefusedError(UndeliveredError):
    """It is not wanted there any more."""


def post(url: str, secret: str, id: str, message: dict[str, Any]) -> None:
    """Send a message, signed. Raises UndeliveredError."""
    body = json.dumps(message, separators=(",", ":")).encode()
    signed = {"Content-Type": "application/json", "User-Agent": "rayfarm", **headers(secret, id, int(time.time()), body)}
    try:
        status = asyncio.run(_status(url, body, signed))
    except TimeoutError:
        raise UndeliveredError(f"It did not answer within {ANSWER_WITHIN_S:.0f} s.") from None
    except (httpx.HTTPError, httpx.InvalidURL) as error:
        raise UndeliveredError(f"It could not be reached ({type(error).__name__}: {error}).") from None
    if status == httpx.codes.GONE:
        raise RefusedError("It answered 410: it wants no more messages.")
    if not 200 <= status < 300:
        raise UndeliveredError(f"It answered {status}.")


async def _status(url: str, body: bytes, signed: dict[str, str]) -> int:
    # httpx's own limits are for each piece of an answer, of which there may be many.
    client = httpx.AsyncClient(timeout=None, follow_redirects=False, verify=_certificates())
    async with asyncio.timeout(ANSWER_WITHIN_S), client, client.stream("POST", url, content=body, headers=signed) as answer:
        return answer.status_code


@functools.cache
def _certificates() -> ssl.SSLContext:
    """Whom to believe, read once: it takes longer than sending a message."""
    return httpx.create_ssl_context()


def run(program: str, id: str, message: dict[str, Any]) -> None:
    """Run a program with the message as its standard input. Raises UndeliveredError."""
    data = message["data"]
    told = {"RAYFARM_EVENT": message["type"], "RAYFARM_MESSAGE_ID": id}
    told |= {f"RAYFARM_JOB_{key.upper()}": str(data.get(key) or "") for key in ("id", "name", "state", "error", "page")}
    # The farm's own secrets are not the program's business.
    inherited = {key: value for key, value in os.environ.items() if not key.startswith("RAYFARM_")}
    try:
        with tempfile.TemporaryFile() as stderr:  # a pipe would stay open with what the program leaves running
            env = inherited | {key: value.replace("\0", "") for key, value in told.items()}
            returned = _ended([program], json.dumps(message).encode(), env, stderr)
            stderr.seek(max(0, stderr.seek(0, os.SEEK_END) - 4 * SAID))
            said = stderr.read(4 * SAID).decode(errors="replace").strip()[-SAID:]
    except subprocess.TimeoutExpired:
        raise UndeliveredError(f"The program took longer than {RUN_WITHIN_S:.0f} s and was ended.") from None
    except OSError as error:
        raise UndeliveredError(f"The program could not be started ({error.strerror}).") from None
    if returned:
        raise UndeliveredError(f"The program ended with {returned}." + (f" It said: {said}" if said else ""))


def _ended(command: list[str], text: bytes, env: dict[str, str], stderr: IO[bytes]) -> int:
    """What a program returns. Raises subprocess.TimeoutExpired; then what it has started is ended too, or each message to come
    would leave some of that behind."""
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=stderr, env=env, start_new_session=True
    ) as process:
        try:
            process.communicate(text, timeout=RUN_WITHIN_S)
        except BaseException:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            raise
        return process.returncode
