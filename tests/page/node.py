"""A Node.js process that runs function bodies with modules of the page."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any, Self

from tests.helpers import ROOT

__all__ = ["Node"]


class Node:
    """Runs the page's modules in a Node.js process; a context manager, at whose end the process ends."""

    def __init__(self, program: str, locale: str) -> None:
        script = Path(__file__).with_name("modules.mjs")
        command = [program, str(script), str(ROOT / "web"), locale]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with self._process:
            self._process.kill()

    def call(self, module: str, body: str, argument: Any = None) -> Any:
        """Runs JavaScript in the Node.js process, and returns its result.

        body: of an async function, in which `m` is the page's module `module`, `a` is `argument`, and `read(path)` imports a
        further module.
        """
        assert self._process.stdin and self._process.stdout
        self._process.stdin.write(json.dumps({"module": module, "body": body, "argument": argument}).encode() + b"\n")
        self._process.stdin.flush()
        answer = json.loads(self._process.stdout.readline())
        assert "error" not in answer, answer["error"]
        return answer["value"]
