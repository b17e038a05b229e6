"""`python -m service.make_secrets FOLDER`: makes the secrets that the containers of a farm share, one file each, once.

token            what workers show; $RAYFARM_TOKEN where it is set
redis-password   Redis's; $RAYFARM_REDIS_PASSWORD where it is set

A value that is given replaces the file's. Files that are there stay otherwise, also those that somebody else put there.
"""

from __future__ import annotations

import secrets
import sys
from pathlib import Path

from renderer.printable import printable
from renderer.variables import VariableError, value_of
from service.store.whole import write_once, write_whole

__all__ = ["SECRETS", "main", "make_secrets"]

SECRETS = {"token": "RAYFARM_TOKEN", "redis-password": "RAYFARM_REDIS_PASSWORD"}
BYTES = 32


def make_secrets(folder: Path) -> None:
    """Writes what is given or missing. Raises OSError, VariableError."""
    for name, variable in SECRETS.items():
        path, given = folder / name, value_of(variable)
        known = path.read_text().strip() if path.exists() else ""
        if given and given != known:
            write_whole(path, f"{given}\n".encode())
        elif not known:
            path.unlink(missing_ok=True)  # an empty one
            write_once(path, f"{secrets.token_hex(BYTES)}\n".encode())


def main() -> int:
    """0 where all are there."""
    (folder,) = map(Path, sys.argv[1:])
    try:
        make_secrets(folder)
    except (OSError, VariableError) as error:
        print(printable(f"The secrets in {folder} cannot be made: {error}."), file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
