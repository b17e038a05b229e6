"""Compiled kernels for the kinds of workers: compiled and signed by one worker, and stored for other workers.

The service does not unpack them. They are only a cache: a worker that finds none compiles its own.
"""

from __future__ import annotations

import io
from pathlib import Path

from renderer.kernel_file import is_name, is_signed, signed_anew
from renderer.sentences import Sentence
from service.errors import Invalid, NotFound
from service.store.atomic_files import PRIVATE_FOLDER, write_atomically

__all__ = ["KernelStore"]

MAX_KERNELS = 24  # artefacts: a few kernels for each of a few kinds of workers; older ones belong to former releases


class KernelStore:
    """The compiled kernels of the farm, by name (files as in renderer.kernel_file). token: the key that signs them."""

    def __init__(self, folder: Path, token: str) -> None:
        self._folder = folder
        self._token = token
        folder.mkdir(PRIVATE_FOLDER, parents=True, exist_ok=True)
        for left_over in folder.glob(".part-*"):
            left_over.unlink(missing_ok=True)

    def find(self, name: str) -> Path | None:
        """Returns the path of a stored kernel file, or None if it does not exist."""
        path = self._folder / name
        return path if is_name(name) and path.is_file() else None

    def signed_for(self, name: str, key: str) -> bytes:
        """Returns a stored kernel file, signed again with another key.

        Raises NotFound if it is missing or its signature is invalid.
        """
        path = self.find(name)
        data = b"" if path is None else path.read_bytes()
        if not is_signed(io.BytesIO(data), self._token):
            raise NotFound(Sentence("kernels-incomplete", "The farm has no complete kernels of this name; compile them."))
        return signed_anew(data, key)

    def put(self, name: str, data: bytes) -> None:
        """Stores a kernel file atomically, and deletes the oldest files beyond KEPT.

        Raises Invalid for an invalid name or signature.
        """
        if not is_name(name):
            raise Invalid(Sentence("kernels-name-invalid", "This is not a name of kernels: see renderer/kernel_file.py."))
        if not is_signed(io.BytesIO(data), self._token):
            raise Invalid(
                Sentence(
                    "kernels-signature-invalid",
                    "The kernels are not signed with this farm's token, or arrived damaged. Send them again.",
                )
            )
        write_atomically(self._folder / name, data)
        self._delete_old()

    def _delete_old(self) -> None:
        files = sorted((p for p in self._folder.iterdir() if is_name(p.name)), key=lambda p: p.stat().st_mtime, reverse=True)
        for path in files[MAX_KERNELS:]:
            path.unlink(missing_ok=True)
