"""The program `rayfarm`, also `python -m rayfarm`. Ctrl-C ends it without a traceback even during its imports."""

from __future__ import annotations

import sys

__all__ = ["main"]


def main() -> None:
    """Imports the commands and runs the one on the command line."""
    try:
        from rayfarm import preload

        preload.start_preloading(sys.argv[1:])
        from rayfarm.cli import main as run

        run()
    except KeyboardInterrupt:
        sys.exit(130)  # rayfarm.errors.EXIT_INTERRUPTED


if __name__ == "__main__":
    main()
