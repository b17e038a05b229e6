"""Restricts this process and then replaces it by another program.

    python confined.py LIMITS PROGRAM ARGUMENT ...

LIMITS: JSON with `reads` and `writes`, paths of files and folders; `memory` (bytes) and `seconds` of processor time.

Must run in a Python without threads. On Linux it uses Landlock (kernel 5.13 and later: files; 6.7: no TCP),
and an empty network namespace if permitted. On other systems only memory and time are limited.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from renderer.confine import rules
from renderer.confine.limits import limit_program


def main() -> None:
    """Applies the limits of the command line and executes its program."""
    limits, command = json.loads(sys.argv[1]), sys.argv[2:]
    rules.die_with_parent(os.getppid())
    rules.enter_empty_network()
    grants = [*((path, rules.RUN) for path in limits["reads"]), *((path, rules.ALL) for path in limits["writes"])]
    if not rules.restrict_files(grants) and sys.platform == "linux":
        print("this kernel has no Landlock: files are guarded by their names alone", file=sys.stderr)
    limit_program(int(limits["memory"]), int(limits["seconds"]))
    os.execv(command[0], command)


if __name__ == "__main__":
    main()
