"""The other end of `asking.Peer`: a program that answers questions line by line. Nothing but the standard library is used.

Whatever the peer prints goes to stderr, so that stdout holds answers alone.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from typing import Any

__all__ = ["answer"]


def answer(commands: dict[str, Callable[..., dict[str, Any]]]) -> None:
    """Answer until stdin ends. A question is {"do": a command's name, ...its arguments}, an answer what the command gives."""
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for line in sys.stdin:
        question = json.loads(line)
        try:
            given = commands[question.pop("do")](**question)
        except Exception as error:
            given = {"error": f"{type(error).__name__}: {error}"}
        out.write(json.dumps(given) + "\n")
        out.flush()
