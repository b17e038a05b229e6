"""The self-test of graphics cards (renderer/self_test) in a child process, and its results, kept in this machine's cache.

There is one file for each card, driver and state of the kernels' sources. It maps a kernel's name to the hash of its PTX and the
verdict. Two processes that write at the same time may lose a verdict; the kernel is then tested once more.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

from renderer import jit
from renderer.arrays.scene_features import KERNEL_VARIANTS
from renderer.cache_folders import make_private, private_folder, read_private
from renderer.child_processes import signal_name, spawn_guard
from renderer.cuda.artefacts import ptx_of
from renderer.cuda.cards import unused_card
from renderer.cuda.driver import Card
from renderer.sentences import Sentence, from_text, to_text

__all__ = [
    "START_KERNELS",
    "Verdict",
    "discard_passing_failures",
    "failed_kernels",
    "failure_of",
    "keep_verdict",
    "kept_verdict",
    "kernels_with_verdicts",
    "run_self_test",
]

START_KERNELS = tuple(KERNEL_VARIANTS)[:2]  # tested before a worker uses a card; the others are tested before their first use
LIMIT_S = 300.0  # seconds of the test of a kernel; the driver's translation of its PTX takes most of them


class Verdict(NamedTuple):
    """The result of a self-test. reason: why the card must not be used, as the end of a sentence; "" if it passed.

    is_lasting: the result holds for this card, driver and kernel. Others, such as errors of the driver, may be due to another
    program that uses the card: a worker tests again when it starts.
    """

    reason: str
    is_lasting: bool


def run_self_test(card: Card, kernel: str, limit_s: float = LIMIT_S) -> Verdict:
    """Tests a kernel on a graphics card in a child process, and keeps the verdict in the cache.

    kernel: named as in renderer/variant_names.py; its PTX and the CPU's kernel should be in the cache, as building them counts
    towards `limit_s` seconds.
    """
    command = [sys.executable, "-m", "renderer.self_test", f"--card={card.number}", "--json", kernel]
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            check=False,
            timeout=limit_s,
            stdin=subprocess.DEVNULL,
            preexec_fn=spawn_guard(),
        )
    except subprocess.TimeoutExpired:
        slow = Sentence(
            "card-test-slow",
            "the self-test of kernel {kernel} did not end within {seconds} s",
            kernel=kernel,
            seconds=round(limit_s),
        )
        verdict = Verdict(slow, is_lasting=False)
    else:
        verdict = _verdict_of(done, kernel)
    keep_verdict(card, kernel, ptx_of(kernel), verdict)
    return verdict


def _verdict_of(done: subprocess.CompletedProcess[str], kernel: str) -> Verdict:
    """Returns the verdict that a child process printed, or that follows from its end."""
    try:
        reason, is_lasting = json.loads(done.stdout.splitlines()[-1])
        return Verdict(from_text(reason), is_lasting)
    except (IndexError, ValueError):
        last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        cause = signal_name(-done.returncode) if done.returncode < 0 else last
        ended = Sentence(
            "card-test-ended", "the process of the self-test of kernel {kernel} ended early ({cause})", kernel=kernel, cause=cause
        )
        return Verdict(ended, is_lasting=False)


def keep_verdict(card: Card, kernel: str, ptx: str, verdict: Verdict) -> None:
    """Stores a verdict. If it cannot be written, the kernel is tested again by the next process."""
    path = _path(card)
    _write(path, {**_read(path), kernel: [_hash(ptx), to_text(verdict.reason), verdict.is_lasting]})


def discard_passing_failures(card: Card) -> None:
    """Deletes a card's failures that may have passed, so that its kernels are tested again before their next use."""
    path = _path(card)
    kept = _read(path)
    lasting = {kernel: entry for kernel, entry in kept.items() if entry[2] or not entry[1]}
    if len(lasting) < len(kept):
        _write(path, lasting)


def _write(path: Path, kept: dict[str, list[Any]]) -> None:
    beside = path.with_name(f".part-{os.getpid()}-{path.name}")
    with contextlib.suppress(OSError):
        make_private(path.parent)
        beside.touch(0o600)
        beside.write_text(json.dumps(kept))
        beside.replace(path)


def kept_verdict(card: Card, kernel: str, ptx: str) -> Verdict | None:
    """Returns the verdict of a kernel with this PTX on a card; None if it was not tested."""
    entry = _read(_path(card)).get(kernel)
    return None if entry is None or entry[0] != _hash(ptx) else Verdict(from_text(entry[1]), bool(entry[2]))


def failure_of(card: Card) -> str:
    """Returns the sentence on why a card is not used, of the first kernel with which it failed; "" if it failed with none."""
    for _, reason, _ in _read(_path(card)).values():
        if reason:
            return unused_card(card, from_text(reason))
    return ""


def failed_kernels(card: Card) -> list[str]:
    """Returns the names of the kernels with which a card failed."""
    return sorted(kernel for kernel, (_, reason, _) in _read(_path(card)).items() if reason)


def kernels_with_verdicts(card: Card) -> list[str]:
    """Returns the names of the kernels that were tested on a card."""
    return sorted(_read(_path(card)))


def _path(card: Card) -> Path:
    name = json.dumps([card.name, card.capability, card.uuid, card.driver, jit.cache_folder().name])
    return private_folder("cards") / f"{_hash(name)}.json"


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def _read(path: Path) -> dict[str, list[Any]]:
    """Returns the entries of a file: kernel -> [hash of its PTX, reason, whether it lasts]; {} if it is missing or damaged."""
    try:
        found = json.loads(read_private(path) or b"{}")
        return {str(kernel): [str(ptx), str(reason), bool(lasting)] for kernel, (ptx, reason, lasting) in found.items()}
    except (OSError, ValueError, TypeError, AttributeError):
        return {}
