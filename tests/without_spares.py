"""Runs `rayfarm up` without spare processes (`python -m tests.without_spares`), each of which takes two seconds of CPU."""

from __future__ import annotations

import sys

from rayfarm import preload


def main() -> None:
    """Runs the command line with the program's arguments, as `python -m rayfarm` does."""
    preload.start_preloading(sys.argv[1:])
    from rayfarm.cli import main as run
    from rayfarm.local import supervisor

    supervisor.SPARE_AFTER_S = supervisor.SPARE_AFTER_RESTART_S = float("inf")
    run()


if __name__ == "__main__":
    main()
