"""Work of joint batches that the slots of one worker share: pieces to render, and the sums of rendered pieces.

A joint batch (protocol/joint.py) is a range of samples of one tile, cut into pieces that slots render at the same time.

Pieces are files in a folder, which needs no server process and outlives any slot. A slot claims a piece by renaming its file,
which only one slot can do. If a slot is killed while it renders a piece, the claim is deleted, and the service dispatches the
piece again. Sums that a killed slot was about to send are sent by another slot; if both send them, the film accepts them once.

SINCE.HOLD.MESSAGE/about        the message, as JSON; SINCE: when it arrived, ns; HOLD: hold_s of `add_message`, ms
                   todo-I       a free piece
                   doing-I-PID  a piece that a slot renders
                   done-I       its result, as protocol/result_bytes.py packs it
sending.PID.MESSAGE.../done-I   results that this process adds up and sends
"""

from __future__ import annotations

import contextlib
import fcntl
import itertools
import logging
import os
import re
import shutil
import tempfile
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from protocol.contract import Result
from protocol.result_bytes import result_bytes, result_of

__all__ = ["ClaimedPiece", "Pieces"]

PREFIX = "rayfarm-sums-"
SENDING_PREFIX = "sending"
STALE_S = 300.0  # since a message came: its pieces have long been handed out again

_MESSAGE = re.compile(r"[\w-]{1,100}")

log = logging.getLogger(__name__)


class ClaimedPiece(NamedTuple):
    """A piece that this process has claimed. folder: that of its message. number: the piece's index in the joint batch."""

    folder: Path
    number: int
    about: bytes  # the message


class Pieces:
    """The folder of pieces, created by the parent before it forks. Methods raise OSError if the disk fails.

    `message` is always the id of the Celery message that brought a joint batch.
    """

    def __init__(self) -> None:
        """Creates the folder, and deletes folders left by killed workers."""
        self.root = Path(tempfile.mkdtemp(prefix=PREFIX))
        self._lock = (self.root / "lock").open("w")
        fcntl.flock(self._lock, fcntl.LOCK_EX)  # its slots have it too: it ends with the last of them
        self._numbers = itertools.count()
        for other in self.root.parent.glob(f"{PREFIX}*"):
            _remove_if_abandoned(other)

    def close(self) -> None:
        """Deletes the folder."""
        shutil.rmtree(self.root, ignore_errors=True)
        self._lock.close()

    def add_message(self, message: str, about: bytes, pieces: Iterable[int], hold_s: float) -> None:
        """Adds a joint batch's free pieces. Raises ValueError if the message's id cannot be a file name.

        about: the joint batch, serialized. pieces: the indices of its pieces. hold_s: seconds after which the sums of rendered
        pieces are sent although others are missing.
        """
        if not _MESSAGE.fullmatch(message):
            raise ValueError(f"{message!r} is not a message id")
        new = Path(tempfile.mkdtemp(prefix="new-", dir=self.root))
        (new / "about").write_bytes(about)
        for number in pieces:
            (new / f"todo-{number:04}").touch()
        new.rename(self.root / f"{time.time_ns():020}.{int(1000 * hold_s)}.{message}")

    def claim(self) -> ClaimedPiece | None:
        """Claims the free piece that has waited longest; None if there is none."""
        for folder in self._groups():
            for name in sorted(_names(folder, "todo-")):
                number = int(name.partition("-")[2])
                with contextlib.suppress(FileNotFoundError):  # another was faster
                    (folder / name).rename(folder / f"doing-{number}-{os.getpid()}")
                    return ClaimedPiece(folder, number, (folder / "about").read_bytes())
        return None

    def store_result(self, piece: ClaimedPiece, result: Result) -> None:
        """Stores the sums of a claimed piece; any slot may send them."""
        written = piece.folder / f"written-{piece.number}-{os.getpid()}"
        written.write_bytes(result_bytes(result))
        written.rename(piece.folder / f"done-{piece.number:04}")
        self.release(piece)

    def release(self, piece: ClaimedPiece) -> None:
        """Deletes the file that marks a piece as claimed by this slot, after the piece was rendered or abandoned."""
        with contextlib.suppress(FileNotFoundError):
            (piece.folder / f"doing-{piece.number}-{os.getpid()}").unlink()

    def due_results(self, at_once: bool = False) -> Iterator[list[Result]]:
        """Yields the results to send now, one list per message, in the order of the pieces.

        A message is due if all its pieces are rendered, or if a rendered one has waited for its `hold_s`. at_once: all messages
        are due. Advancing the iterator deletes the files of the results that it yielded before.
        """
        for left in [*self._abandoned_folders()]:
            yield from self._sent_results(left)
        for folder in self._groups():
            self._release_claims_of_ended(folder)
            if at_once or _is_due(folder):
                mine = self.root / f"{SENDING_PREFIX}.{os.getpid()}.{_message(folder)}.{next(self._numbers)}"
                mine.mkdir()
                for name in _names(folder, "done-"):
                    with contextlib.suppress(FileNotFoundError):
                        (folder / name).rename(mine / name)
                yield from self._sent_results(mine)
            self._remove_if_finished(folder)

    def messages(self) -> list[str]:
        """Returns the ids of messages that have pieces or unsent sums here."""
        return sorted({_message(folder) for folder in [*self._groups(), *self._sending_folders()]})

    def free_count(self) -> int:
        """Returns the number of free pieces."""
        return sum(len(_names(folder, "todo-")) for folder in self._groups())

    def withdraw_unfinished(self, message: str) -> list[int] | None:
        """Removes a message's free pieces, and those claimed by slots that have ended. Returns the indices of these pieces.

        Returns None if the folder does not have the message.
        """
        for folder in self._groups():
            if _message(folder) == message:
                dead = [name for name in _names(folder, "doing-") if not _is_alive(int(name.rpartition("-")[2]))]
                return sorted([*_delete_piece_files(folder, dead), *_delete_piece_files(folder, _names(folder, "todo-"))])
        return None

    def withdraw(self) -> list[tuple[bytes, list[int]]]:
        """Removes all free pieces. Returns for each message its serialized joint batch, and the indices of these pieces."""
        taken = []
        for folder in self._groups():
            if numbers := _delete_piece_files(folder, sorted(_names(folder, "todo-"))):
                taken.append(((folder / "about").read_bytes(), numbers))
        return taken

    def _groups(self) -> list[Path]:
        """Returns the folders of all messages, oldest first."""
        return sorted(self.root / name for name in _names(self.root, *"0123456789"))

    def _sending_folders(self) -> list[Path]:
        return [self.root / name for name in _names(self.root, f"{SENDING_PREFIX}.")]

    def _sent_results(self, mine: Path) -> Iterator[list[Result]]:
        if results := [found for name in sorted(_names(mine, "done-")) if (found := _read(mine / name)) is not None]:
            yield results
        shutil.rmtree(mine, ignore_errors=True)

    def _abandoned_folders(self) -> Iterator[Path]:
        for folder in self._sending_folders():
            _, pid, message, _ = folder.name.split(".")
            if not _is_alive(int(pid)):
                mine = self.root / f"{SENDING_PREFIX}.{os.getpid()}.{message}.{next(self._numbers)}"
                with contextlib.suppress(FileNotFoundError):
                    folder.rename(mine)
                    yield mine

    def _release_claims_of_ended(self, folder: Path) -> None:
        for name in _names(folder, "doing-"):
            if not _is_alive(int(name.rpartition("-")[2])):
                with contextlib.suppress(FileNotFoundError):
                    (folder / name).unlink()

    def _remove_if_finished(self, folder: Path) -> None:
        """Deletes a message's folder if it has neither pieces nor results, or is too old."""
        if not _names(folder, "todo-", "doing-", "done-") or time.time() - _creation_time(folder) > STALE_S:
            shutil.rmtree(folder, ignore_errors=True)


def _is_due(folder: Path) -> bool:
    done = _names(folder, "done-")
    if not done or not _names(folder, "todo-", "doing-"):
        return bool(done)
    with contextlib.suppress(FileNotFoundError):
        oldest = min((folder / name).stat().st_mtime for name in done)
        return time.time() - oldest > int(folder.name.split(".")[1]) / 1000
    return False


def _names(folder: Path, *beginnings: str) -> list[str]:
    with contextlib.suppress(FileNotFoundError):
        return [path.name for path in folder.iterdir() if path.name.startswith(beginnings)]
    return []


def _is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return True


def _delete_piece_files(folder: Path, names: list[str]) -> list[int]:
    """Deletes the files with these names from a message's folder.

    Returns the indices of the pieces whose files this call deleted; another process may have deleted or renamed the others.
    """
    numbers = []
    for name in names:
        with contextlib.suppress(FileNotFoundError):
            (folder / name).unlink()
            numbers.append(int(name.split("-")[1]))
    return numbers


def _creation_time(folder: Path) -> float:
    return int(folder.name.partition(".")[0]) / 1e9


def _message(folder: Path) -> str:
    return folder.name.split(".")[2]


def _read(path: Path) -> Result | None:
    try:
        return result_of(path.read_bytes())
    except (OSError, ValueError) as error:
        log.warning("sums of a piece are discarded and will be rendered again: %s", error)
        return None


def _remove_if_abandoned(folder: Path) -> None:
    """Deletes the folder of a worker process that has ended without deleting it."""
    with contextlib.suppress(OSError), (folder / "lock").open() as lock:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        shutil.rmtree(folder, ignore_errors=True)
