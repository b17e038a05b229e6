"""A peer renderer that runs in another Python environment and answers requests line by line."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from tests.helpers import ROOT

__all__ = ["Peer"]


class Peer:
    """A peer renderer's program, run by another Python; a context manager that ends the program.

    program: the name of its module in `package`.
    """

    def __init__(self, python: Path, program: str, package: str | None = __package__) -> None:
        self._log = tempfile.TemporaryFile("w+")  # noqa: SIM115 - closed with the block
        self._process = subprocess.Popen(
            [str(python), "-m", f"{package}.{program}"],
            cwd=ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            text=True,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )

    def ask(self, do: str, **arguments: Any) -> dict[str, Any]:
        """Sends a request to the peer, and returns the answer. do: name of the command.

        If the command fails, raises RuntimeError with the end of the peer's error output.
        """
        assert self._process.stdin and self._process.stdout
        try:
            self._process.stdin.write(json.dumps({"do": do, **arguments}) + "\n")
            self._process.stdin.flush()
            line = self._process.stdout.readline()
        except BrokenPipeError:
            line = ""
        answer: dict[str, Any] = json.loads(line) if line else {"error": f"it ended with {self._process.wait()}"}
        if "error" in answer:
            self._log.seek(0)
            raise RuntimeError(f"{answer['error']}\n{self._log.read()[-2000:]}".strip())
        return answer

    def __enter__(self) -> Peer:
        return self

    def __exit__(self, *_: object) -> None:
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe:
                pipe.close()
        try:
            self._process.wait(30)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._log.close()
