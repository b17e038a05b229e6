"""`python3 -IS worker/healthy.py [--ready]`: health check of the worker in this container; the result is the exit code.

The check reads the file that worker/machine/health_file.py writes. A worker whose event loop hangs is unhealthy. A worker that
waits for the service or Redis is healthy, since a restart would not help. --ready: also checks that the worker accepts work.
"""

import os
import sys
import time

MAX_AGE_S = 30.0


def unhealthy_reason(path: str, ready: bool = False) -> str:
    """Returns a sentence on why the worker is unhealthy; "" if it is healthy. ready: also require that it accepts work.

    path: the worker's health file.
    """
    try:
        with open(path) as file:  # noqa: PTH123 - pathlib takes longer to import than the rest
            pid, state = file.read().split()
        age = time.time() - os.stat(path).st_mtime  # noqa: PTH116
        os.kill(int(pid), 0)
    except ProcessLookupError:
        return f"the worker's process {pid} has ended"
    except PermissionError:
        return f"the process {pid} is another user's"
    except (OSError, ValueError) as error:
        return f"{path} does not contain the worker's state: {error}"
    if state == "working" and age > MAX_AGE_S:
        return f"the worker's event loop was last seen {age:.0f} s ago"
    if ready and state != "working":
        return f"the worker is {state}"
    return ""


def main() -> int:
    """Returns the exit code: 0 if the worker is healthy."""
    why = unhealthy_reason(os.environ.get("RAYFARM_ALIVE", ""), "--ready" in sys.argv[1:])
    if why:
        print(why)
    return int(bool(why))


if __name__ == "__main__":
    sys.exit(main())
