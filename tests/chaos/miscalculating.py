"""A worker on a machine that miscalculates: a real worker that flips one bit in the sums of every fifth batch.

python -m tests.chaos.miscalculating --service URL --slots 1 --name NAME
"""

from __future__ import annotations

import sys
from typing import Any

from worker import __main__ as program
from worker.work import render

EVERY = 5
_exact = render.render_batch


def spoiled(*arguments: Any, **options: Any) -> Any:
    """Renders a batch as `render_batch` does, and flips one bit in the sums of every fifth batch."""
    found = _exact(*arguments, **options)
    spoiled.made += 1  # type: ignore[attr-defined]
    if spoiled.made % EVERY:  # type: ignore[attr-defined]
        return found
    sums = found.sums.copy()
    sums[0, sums.shape[1] // 2, 0] ^= 1 << 9
    return found._replace(sums=sums)


spoiled.made = 0  # type: ignore[attr-defined]

if __name__ == "__main__":
    render.render_batch = spoiled
    sys.exit(program.main())
