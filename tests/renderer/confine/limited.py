"""Runs a job under a limit on address space, and prints the kind and the message of its error. Arguments: JOB BYTES FOLDER.

BYTES: the limit; 0 for none. The job `size` prints the address space in bytes that a reader has when it starts.
"""

from __future__ import annotations

import resource
import sys
from pathlib import Path

from renderer.confine.running import Bounds, run
from renderer.errors import RayfarmError
from tests.renderer.confine import jobs


def main(job: str, limit: str, folder: str) -> None:
    """Runs the job named `job` in a reader process that may access `folder`.

    limit: largest address space in bytes; 0 for no limit.
    """
    if int(limit):
        resource.setrlimit(resource.RLIMIT_AS, (int(limit), resource.getrlimit(resource.RLIMIT_AS)[1]))
    try:
        print(run(getattr(jobs, job), [Path(folder)], [Path(folder)], Bounds(16 << 30, 60.0, "a.cob")))
    except RayfarmError as error:
        print(type(error).__name__, error)


if __name__ == "__main__":
    main(*sys.argv[1:])
