"""Steps that are left out where they find nothing are taken where they find something."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.jit import builder, device, entry


@device
def _twice(x):
    def double(y):
        return y + y

    return double(x)


@entry
def closures(x):
    """Four times x, by a function in a function."""
    return _twice(_twice(x))


@builder
def arrays(a, b):
    """The largest of a sum of arrays."""
    total = a + b * 2.0
    total = total[total > 0.0]
    return total.max()


def test_a_function_in_a_function_is_written_into_it() -> None:
    assert closures(3) == 12


@pytest.mark.long
def test_sums_of_arrays_are_worked_out() -> None:
    a = np.arange(1000.0)
    for _ in range(100):  # what it allocates is given back
        assert arrays(a, -a[::-1].copy()) == 999.0
