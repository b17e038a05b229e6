"""Reads settings from environment variables: $NAME, or for secrets the content of the file named by $NAME_FILE."""

from __future__ import annotations

import os
from pathlib import Path

from renderer.errors import RayfarmError

__all__ = ["FILE", "VariableError", "value_of"]

FILE = "_FILE"
MOST_BYTES = 1 << 16


class VariableError(RayfarmError):
    """Raised if the file named by a variable cannot be read or is empty."""


def value_of(name: str, default: str = "") -> str:
    """Returns the variable's value; if it is empty or unset, the stripped content of the file named by $NAME_FILE.

    Raises VariableError if that file cannot be read or is empty.
    """
    if value := os.environ.get(name, ""):
        return value
    if not (path := os.environ.get(name + FILE, "")):
        return default
    try:
        with Path(path).expanduser().open("rb") as file:
            text = file.read(MOST_BYTES + 1)
        if len(text) > MOST_BYTES:
            raise VariableError(f"{name}{FILE}: {path} has more than {MOST_BYTES} bytes. Name a file that holds the value alone.")
        value = text.decode().strip()
    except OSError as error:
        raise VariableError(
            f"{name}{FILE}: {path} cannot be read ({error.strerror or error}). Name a file that this user may read, or unset it."
        ) from error
    except UnicodeDecodeError:
        raise VariableError(f"{name}{FILE}: {path} is not text. Name a file that holds the value alone.") from None
    if not value:
        raise VariableError(f"{name}{FILE}: {path} is empty. Write the value into it, or unset the variable.")
    return value
