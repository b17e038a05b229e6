"""Checks whether this machine can render."""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from rayfarm.doctor.finding import Finding, fact, fault, fine, note_finding
from renderer.cache_folders import cache_home, reason_to_distrust

__all__ = ["check_machine"]

PYTHONS = ((3, 11), (3, 12), (3, 13))
NEEDED_CACHE = 2 << 30
LOW_MEMORY = 4 << 30
# Advice for a machine whose cards are not used, by the code of the reason.
DRIVER_ADVICE = {
    "cards-unused": "Install NVIDIA's driver, 530 or later, with its library for CUDA (Debian: libcuda1). In a container, "
    "NVIDIA's container toolkit provides the machine's driver.",
    "cards-none-found": "`nvidia-smi` shows the cards that the driver finds; a container has to be given them.",
    "cards-driver-not-started": "`nvidia-smi` may name the cause; restart the machine after an update of the driver.",
}
OLDEST_CLOCK = 1735689600.0  # 2025: older than any release


def check_machine() -> Iterator[Finding]:
    """Checks Python, the compiler, processor and graphics cards, the denoiser, memory, the cache and the clock.

    Yields the findings.
    """
    yield _python()
    if importlib.util.find_spec("numba") is None:  # a service's container image
        yield note_finding("Compiler", "Numba is not installed: nothing is rendered here.", "Workers render, elsewhere.")
        yield _memory()
    else:
        yield _compiler()
        yield from _cards()
        yield _denoiser()
        yield _memory()
        yield from _cache(cache_home())
    yield _clock()


def _python() -> Finding:
    version = ".".join(map(str, sys.version_info[:3]))
    if sys.version_info[:2] not in PYTHONS:
        return fault(
            "Python", f"This is Python {version}, for which Rayfarm is not tested.", "Install it under Python 3.11, 3.12 or 3.13."
        )
    return fine("Python", f"{version} at {sys.executable}.")


def _compiler() -> Finding:
    try:
        jit = importlib.import_module("renderer.jit")  # pins the target, and raises on an unsupported processor
        numba = importlib.import_module("numba")
    except ImportError as error:
        return fault(
            "Compiler", f"The compiler cannot be loaded ({error}).", "Install Rayfarm anew, in an environment of its own."
        )
    except Exception as error:  # the message names what the processor lacks
        return fault("Processor", f"{error}".rstrip(".") + ".", "Render on another machine; this one can run `up --workers 0`.")
    used = f"{jit.TARGET} with AVX-512" if jit.HAS_AVX512 else jit.TARGET
    return fine("Compiler", f"Numba {numba.__version__}; kernels for {used}, which this processor runs.")


def _cards() -> Iterator[Finding]:
    """Lists the graphics cards: a fault of the driver is a note, since a newer one mends it; an unusable card is a fact."""
    from renderer.cuda.cards import NOT_YET_TRIED, described, find_cards, has_nvidia_hardware
    from renderer.cuda.verdicts import failure_of, kernels_with_verdicts

    cards = find_cards()
    for card in cards.usable:
        if reason := failure_of(card):
            yield note_finding("Card", reason, "A newer driver may mend it; `python -m renderer.self_test` tests it again.")
            continue
        tested = kernels_with_verdicts(card)
        state = f"passed the self-test of the kernels {', '.join(tested)}" if tested else "a worker tests it before it uses it"
        yield fine("Card", f"Card {described(card)}; {state} ({NOT_YET_TRIED}).")
    for reason in cards.refused:
        code = getattr(reason, "code", "")
        if code == "cards-driver-too-old":
            yield note_finding("Card", reason)
        elif code in DRIVER_ADVICE and (code == "cards-driver-not-started" or has_nvidia_hardware()):
            yield note_finding("Card", reason, DRIVER_ADVICE[code])
        else:
            yield fact("Card", "No card found (no NVIDIA driver); the cores render." if code == "cards-unused" else reason)


def _denoiser() -> Finding:
    from renderer.denoise import is_available

    if is_available():
        return fine("Denoiser", f"Open Image Denoise is there (pyoidn {importlib.metadata.version('pyoidn')}).")
    return note_finding(
        "Denoiser",
        "Open Image Denoise is not installed; pictures cannot be denoised here.",
        "pip install pyoidn, where it has wheels.",
    )


def _memory() -> Finding:
    total = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    if total < LOW_MEMORY:
        return note_finding(
            "Memory",
            f"This machine has {total / 1e9:.1f} GB.",
            "Large scenes may not fit: give the farm another machine as a worker.",
        )
    return fine("Memory", f"{total / 1e9:.1f} GB.")


def _cache(folder: Path) -> Iterator[Finding]:
    place = next(path for path in (folder, *folder.parents) if path.exists())
    if not os.access(place, os.W_OK | os.X_OK):
        yield fault(
            "Cache",
            f"{folder} cannot be written; kernels would be compiled at each start.",
            "Set RAYFARM_CACHE to a folder of yours.",
        )
        return
    if reason := reason_to_distrust(place.stat()) if place == folder else "":
        yield note_finding(
            "Cache", f"{folder} {reason}; a private folder in it is used.", "Make it this user's alone: chown, chmod go-w."
        )
    free = shutil.disk_usage(place).free
    if free < NEEDED_CACHE:
        yield note_finding(
            "Cache", f"The disk of {folder} has {free / 1e9:.1f} GB left.", "Make room: a worker keeps fetched scenes there."
        )
        return
    yield fine("Cache", f"{folder}, with {free / 1e9:.0f} GB of room.")


def _clock() -> Finding:
    if time.time() < OLDEST_CLOCK:
        now = time.strftime("%Y-%m-%d")
        return fault("Clock", f"This machine believes it is {now}.", "Set its clock: certificates and ages are judged by it.")
    try:
        asked = ["timedatectl", "show", "-p", "NTPSynchronized", "--value"]
        is_kept = subprocess.run(asked, capture_output=True, text=True, timeout=5, check=False).stdout.strip()
    except (OSError, subprocess.TimeoutExpired):
        is_kept = ""
    if is_kept == "no":
        return note_finding("Clock", "Nobody keeps this machine's clock right.", "timedatectl set-ntp true")
    return fine("Clock", time.strftime("%Y-%m-%d %H:%M:%S %z") + ".")
