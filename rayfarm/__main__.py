"""The program `rayfarm`, and `python -m rayfarm`. Ctrl-C ends it silently even while it is still loading."""

from __future__ import annotations

import sys

__all__ = ["main"]


def main() -> None:
    """Loads the commands, and runs the one on the command line."""
    try:
        from rayfarm import preload

        preload.begin(sys.argv[1:])
        from rayfarm.cli import main as run

        run()
    except KeyboardInterrupt:
        sys.exit(130)  # rayfarm.errors.EXIT_INTERRUPTED


if __name__ == "__main__":
    main()
