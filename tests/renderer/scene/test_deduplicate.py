import numpy as np
import pytest

from renderer.scene.deduplicate import unique_corners, unique_rows, unique_threes, used_among


@pytest.mark.parametrize("dtype", [np.float32, np.int32, np.int64])
@pytest.mark.parametrize("shape", [(0, 3), (1, 3), (1000, 1), (1000, 3), (1000, 4)])
def test_unique_rows_match_numpy(dtype, shape):
    table = np.random.default_rng(7).integers(-4, 4, shape).astype(dtype)
    first, kind = unique_rows(table)
    _, expected, inverse = np.unique(table, axis=0, return_index=True, return_inverse=True)
    np.testing.assert_array_equal(first, expected)
    np.testing.assert_array_equal(kind, inverse.reshape(-1))


def test_signed_zeros_are_equal():
    first, kind = unique_rows(np.array([[0.0, 1.0], [-0.0, 1.0]], np.float32))
    assert (len(first), kind.tolist()) == (1, [0, 0])


@pytest.mark.parametrize("count", [0, 1, 2, 1000])
def test_unique_threes_match_unique_rows_in_first_order(count):
    table = np.random.default_rng(4).integers(-3, 3, (count, 3)).astype(np.int32)
    first, kind = unique_threes(table)
    np.testing.assert_array_equal(table[first][kind], table)
    assert len(first) == len(unique_rows(table)[0])
    assert (np.diff(first) > 0).all()


@pytest.mark.parametrize("widths", [(), (1,), (3, 2)])
def test_corners_with_equal_values_are_merged(widths):
    rng = np.random.default_rng(8)
    point = rng.integers(0, 50, 400)
    values = [rng.integers(-1, 2, (400, width)).astype(np.float32) * np.float32(0.5) for width in widths]
    first, kind = unique_corners(point, 50, values)
    table = np.column_stack([point, *values]) + 0.0
    np.testing.assert_array_equal(table[first][kind], table)
    assert len(first) == len(unique_rows(table)[0])
    assert (np.diff(first) > 0).all()


@pytest.mark.parametrize("count", [10, 1000])
def test_used_numbers_are_found(count):
    numbers = np.random.default_rng(9).integers(0, 10, (20, 3))
    used, place = used_among(numbers, count)
    np.testing.assert_array_equal(used, np.unique(numbers))
    np.testing.assert_array_equal(used[place], numbers)
