"""Answers the requests of `asking.Peer`, in the process of the peer renderer. Uses the standard library only.

Other output of the peer goes to stderr, so that stdout has only the answers.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from typing import Any

__all__ = ["answer"]


def answer(commands: dict[str, Callable[..., dict[str, Any]]]) -> None:
    """Answers requests from stdin, one JSON line each, until stdin ends. commands: functions by name.

    A request is {"do": name, ...arguments}; the answer is the function's result.
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
