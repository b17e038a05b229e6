"""The peer's side of the line protocol of `asking.Peer`: answers requests. Uses the standard library only.

The peer's own output goes to stderr, so that stdout holds answers only.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from typing import Any

__all__ = ["answer"]


def answer(commands: dict[str, Callable[..., dict[str, Any]]]) -> None:
    """Answers requests from stdin until it ends.

    A request is {"do": command, ...arguments}; the answer is the command's result.
    """
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
