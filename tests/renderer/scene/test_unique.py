import numpy as np
import pytest

from renderer.scene.unique import unique_rows


@pytest.mark.parametrize("dtype", [np.float32, np.int32, np.int64])
@pytest.mark.parametrize("shape", [(0, 3), (1, 3), (1000, 1), (1000, 3), (1000, 4)])
def test_rows_are_those_of_numpy(dtype, shape):
    table = np.random.default_rng(7).integers(-4, 4, shape).astype(dtype)
    first, kind = unique_rows(table)
    _, expected, inverse = np.unique(table, axis=0, return_index=True, return_inverse=True)
    np.testing.assert_array_equal(first, expected)
    np.testing.assert_array_equal(kind, inverse.reshape(-1))


def test_zeros_of_either_sign_are_the_same():
    first, kind = unique_rows(np.array([[0.0, 1.0], [-0.0, 1.0]], np.float32))
    assert (len(first), kind.tolist()) == (1, [0, 0])
