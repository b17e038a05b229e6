"""`python -m service.make_secrets FOLDER`: creates the secrets shared by a farm's containers, one file each.

token            the workers' token; $RAYFARM_TOKEN if it is set
redis-password   the password of Redis; $RAYFARM_REDIS_PASSWORD if it is set

A value in the environment replaces the file's. Otherwise existing files stay as they are.
"""

from __future__ import annotations

import secrets
import sys
from pathlib import Path

from renderer.printable import printable
from renderer.variables import VariableError, value_of
from service.store.atomic_files import write_atomically, write_if_missing

__all__ = ["SECRETS", "main", "make_secrets"]

SECRETS = {"token": "RAYFARM_TOKEN", "redis-password": "RAYFARM_REDIS_PASSWORD"}
SECRET_BYTES = 32


def make_secrets(folder: Path) -> None:
    """Writes the secrets that the environment sets, and creates those that have no file yet. Raises OSError, VariableError."""
    for name, variable in SECRETS.items():
        path, given = folder / name, value_of(variable)
        known = path.read_text().strip() if path.exists() else ""
        if given and given != known:
            write_atomically(path, f"{given}\n".encode())
        elif not known:
            path.unlink(missing_ok=True)  # an empty file
            write_if_missing(path, f"{secrets.token_hex(SECRET_BYTES)}\n".encode())


def main() -> int:
    """Creates the secrets. Returns exit code 0, or 1 after an error."""
    (folder,) = map(Path, sys.argv[1:])
    try:
        make_secrets(folder)
    except (OSError, VariableError) as error:
        print(printable(f"The secrets in {folder} cannot be made: {error}."), file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
