"""Shared code of commands that join a farm: address, token, and a supervised process that runs until Ctrl-C."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import time
from pathlib import Path

from rayfarm.console import PROGRAM, err, out
from rayfarm.errors import CommandError
from rayfarm.machine import StopSignals
from renderer.variables import value_of
from worker.exchange.foreign_server import is_address

__all__ = ["farm_address", "run", "token_to_send"]

GRACE_S = 10.0
FATAL_EXIT_CODE = 3  # exit code after which a restart does not help
_LAST_LINES = 100  # of a log, in which the reason of an exit is looked for


def farm_address(join: str) -> str:
    """Returns the farm's complete URL. join: URL or host:port. Raises CommandError if it is invalid."""
    if "://" not in join:
        join = f"http://{join}"
    if not is_address(join):
        raise CommandError(f"{join!r} is not the address of a farm; give one such as http://host:8000")
    return join


def token_to_send(subject: str, token: str, token_file: Path | None) -> str:
    """Returns the token to send to the farm. subject: the subject of the error message. Raises CommandError without a token."""
    if token:
        err.print("rayfarm: everyone on this machine can read --token. Better: RAYFARM_TOKEN, or --token-file.")
    elif token_file is not None:
        try:
            token = token_file.expanduser().read_text().strip()
        except UnicodeDecodeError:
            raise CommandError(f"{token_file} contains no token: it is not text.") from None
    token = token or value_of("RAYFARM_TOKEN")
    if not token:
        raise CommandError(
            f"{subject} needs the farm's token. Set RAYFARM_TOKEN to it, or write it into a file and give --token-file; "
            f"`{PROGRAM} up` prints the whole command."
        )
    return token


def run(
    name: str,
    command: list[str],
    token: str,
    sentence: str,
    arguments: list[str] | None = None,
    waiting: subprocess.Popen[bytes] | None = None,
) -> None:
    """Runs and restarts a process until Ctrl-C, and shows its log. Raises CommandError if the process fails permanently.

    sentence: text to print at the start. arguments: options for a process that imports first and then reads them from standard
    input; None for other processes. waiting: such a process, if it is already started.
    """
    from rayfarm.local.state import ROOT
    from rayfarm.local.supervisor import WORKER_STEADY_S, Part, Supervisor
    from renderer.cache_folders import cache_home

    signals = StopSignals()
    supervisor = Supervisor(ROOT, lambda sentence: err.print(sentence, markup=False, soft_wrap=True))
    env = {"RAYFARM_TOKEN": token, "PYTHONUNBUFFERED": "1"}
    log = cache_home() / "logs" / f"{name}-{os.getpid()}.log"
    part = Part(name, command, log, env, GRACE_S, (FATAL_EXIT_CODE,), WORKER_STEADY_S, arguments=arguments, spare=waiting)
    shown = 0  # bytes of the log that are printed
    try:
        log.parent.mkdir(parents=True, exist_ok=True)
        log.touch()  # raises if the log is not writable, with which the supervisor would start anyway
        supervisor.start(part)
    except OSError as error:
        raise CommandError(
            f"The {name}'s log {log} cannot be written ({error.strerror}). Set RAYFARM_CACHE to a folder of yours."
        ) from error
    try:
        out.print(f"{sentence} Log: {log}", soft_wrap=True)
        while not signals.stop():
            shown = _print_from(log, shown)
            if supervisor.check_parts() is not None:
                raise CommandError(_exit_reason(part.last_log_lines(_LAST_LINES), f"rayfarm {name}: "))
            time.sleep(0.2)
    finally:
        supervisor.stop(signals.is_immediate)
        _print_from(log, shown)
        log.unlink(missing_ok=True)


def _exit_reason(log: str, prefix: str) -> str:
    """Returns the last message of the log that starts with `prefix`, without the prefix.

    If no message starts with it, returns the last message. A library may print lines while the process exits, after the message.
    """
    messages = [_log_message(line) for line in log.splitlines()] or [""]
    return next((each for each in reversed(messages) if each.startswith(prefix)), messages[-1]).removeprefix(prefix)


def _log_message(line: str) -> str:
    """Returns the message of a JSON log line; other lines are returned unchanged."""
    with contextlib.suppress(ValueError, TypeError, KeyError):
        return str(json.loads(line)["message"])
    return line


def _print_from(log: Path, offset: int) -> int:
    """Prints the log from byte `offset` to its end. Returns the offset of the end of the printed part."""
    try:
        with log.open("rb") as file:
            if file.seek(0, os.SEEK_END) < offset:
                offset = 0  # the supervisor has truncated it
            file.seek(offset)
            text = file.read()
    except OSError:
        return offset
    if text:
        err.print(text.decode(errors="replace").rstrip("\n"), markup=False, soft_wrap=True)
    return offset + len(text)
