"""Tests of environments: orientation of the image, and sampling by its tables."""

import functools

import numpy as np
import pytest

from renderer.arrays.scene import seal
from renderer.jit import entry, subroutine
from renderer.kernel.light.environment import environment_light, sample_cdf, sample_cdf_row, sample_environment
from renderer.reference import Packed, by_reference
from renderer.scene.cutpoints import cutpoints
from renderer.scene.description import Environment, Image, Material, SceneDescription
from renderer.scene.environment import search_tables, tabulate_environment
from renderer.scene.lights import cumulative
from tests.grids import grid
from tests.renderer.builders import scene, square
from tests.renderer.judge import chi_squared

N = 300_000


@subroutine
def _run_all(which, made, given, direction, value):
    for i in range(len(given)):
        if which == 0:
            direction_i, value[i, 0] = sample_environment(made, given[i, 2], (given[i, 0], given[i, 1]))
            for k in range(3):
                direction[i, k] = direction_i[k]
        else:
            radiance, value[i, 0] = environment_light(made, (given[i, 0], given[i, 1], given[i, 2]), True)
            for k in range(3):
                direction[i, k] = radiance[k]


@entry
def _run(which, made, given, direction, value):
    _run_all(which, by_reference(made), given, direction, value)


@entry
def _choose(cdf, u, index, rest, width):
    for i in range(len(u)):
        index[i], rest[i], width[i] = sample_cdf(cdf, u[i])


@entry
def _choose_from(cdf, start, u, index, rest, width):
    for i in range(len(u)):
        index[i], rest[i], width[i] = sample_cdf_row(cdf, start, np.uint32(0), u[i])


@functools.cache
def _without_sky():
    return scene([Material()], (square((0, 0, 0), (1, 0, 0), (0, 0, -1), 0),))


class Sky:
    """An environment's sampling tables, with the kernel functions that use them."""

    def __init__(self, pixels, rotation=0.0):
        description = SceneDescription(images=[Image("sky", np.asarray(pixels, np.float32), srgb=False)])
        description.environment = Environment(image=0, rotation=rotation)
        tables = tabulate_environment(description)
        self.radiance, self.frame = tables.radiance, tables.frame(1.0)
        search = search_tables(tables.marginal, tables.conditional)
        self.made = seal(_without_sky()._replace(environment=self.radiance, environment_frame=self.frame, **search))
        self.rotation = np.radians(rotation)

    def _run(self, which, given):
        given = np.ascontiguousarray(given, np.float32)
        direction, value = np.zeros((len(given), 3), np.float32), np.zeros((len(given), 1), np.float32)
        _run(which, Packed(self.made), given, direction, value)
        return direction, value[:, 0]

    def sample(self, n=N, seed=0):
        return self._run(0, np.random.default_rng(seed).random((n, 3), np.float32))

    def pdf(self, direction):
        return self._run(1, direction)[1]

    def at(self, direction):
        return self._run(1, direction)[0]

    def texel(self, direction):
        """Returns the (row, column) of a direction in float64."""
        height, width = self.radiance.shape[:2]
        x, y, z = np.asarray(direction, float).T
        turned = np.arctan2(x, -z) + self.rotation  # a counter-clockwise rotation, seen from above, moves left in the image
        row = np.clip((np.arccos(np.clip(y, -1, 1)) / np.pi * height).astype(int), 0, height - 1)
        return row, ((turned / (2 * np.pi) + 0.5) % 1 * width).astype(int) % width


def random_sky(height=8, width=16, seed=1):
    return np.random.default_rng(seed).gamma(0.6, size=(height, width, 1)).repeat(3, 2)


def solid_angles(height, width):
    edge = np.cos(np.arange(height + 1) * np.pi / height)
    return (edge[:-1] - edge[1:])[:, None] * 2 * np.pi / width * np.ones(width)


@grid("rotation", [0.0, 77.0, -160.0], ordinary=(-160.0,))
def test_texel_samples_follow_the_density(rotation):
    """Samples follow the texels' densities, by chi-squared tests over texels and over their quarters."""
    sky = Sky(random_sky(), rotation)
    direction, pdf = sky.sample()
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1, atol=1e-6)
    row, column = sky.texel(direction)
    counts = np.bincount(row * 16 + column, minlength=128)
    middle_v, middle_u = np.meshgrid((np.arange(8) + 0.5) / 8 * np.pi, (np.arange(16) + 0.5) / 16 * 2 * np.pi, indexing="ij")
    turn = middle_u - np.pi - sky.rotation
    middles = np.stack([np.sin(middle_v) * np.sin(turn), np.cos(middle_v), -np.sin(middle_v) * np.cos(turn)], -1).reshape(-1, 3)
    mass = sky.pdf(middles) * solid_angles(8, 16).ravel()
    assert mass.sum() == pytest.approx(1, abs=1e-5)
    edge = counts[mass == 0].sum()  # rounding may move a sample across a border
    assert edge < 1e-4 * N
    chi_squared(counts[mass > 0], mass[mass > 0] * counts[mass > 0].sum(), 3, f"rotation {rotation}")
    again = sky.pdf(direction)
    assert np.isclose(again, pdf, rtol=1e-4).mean() > 0.9999


def test_density_is_positive_above_the_mean_radiance():
    pixels = random_sky()
    sky = Sky(pixels)
    weight = solid_angles(8, 16)
    mean = (pixels[..., 0] * weight).sum() / weight.sum()
    assert sky.frame[2] == pytest.approx(mean, rel=1e-5)
    row, column = sky.texel(sky.sample()[0])
    chosen = np.zeros((8, 16))
    np.add.at(chosen, (row, column), 1)
    assert (chosen[pixels[..., 0] > 1.2 * mean] > 0).all()
    assert chosen[pixels[..., 0] < mean].sum() < 1e-4 * N


@grid("height", [1, 2, 64, 1024, 4096, 16384], ordinary=(1, 64))
def test_every_row_of_a_tall_image_has_its_solid_angle(height):
    """Every row of a tall image has its exact solid angle.

    Near the poles of a 16k image cosines differ by 1e-8, so subtracting them in float32 would lose their difference.
    """
    pixels = np.zeros((height, 2, 3), np.float32)
    rows = np.unique(np.clip(np.r_[0:4, height // 3, height // 2, height - 4 : height], 0, height - 1))
    for row in rows:
        pixels[:] = 0
        pixels[row] = 1.0
        direction, pdf = Sky(pixels).sample(2000)
        expected = 1 / (2 * solid_angles(height, 2)[row, 0])
        np.testing.assert_allclose(pdf, expected, rtol=2e-3)
        assert np.isfinite(direction).all()
        angle = np.arccos(np.clip(direction[:, 1].astype(float), -1, 1)) / np.pi * height
        step = 1e-3 * height if row in (0, height - 1) else 1e-6 * height / np.sin((row + 0.5) * np.pi / height)
        assert (angle > row - step - 1e-3).all()
        assert (angle < row + 1 + step + 1e-3).all()


@pytest.mark.parametrize("rotation", [0.0, 30.0, 90.0])
def test_radiance_is_bilinear_between_texels(rotation):
    """The environment's radiance equals bilinear interpolation in NumPy and float64.

    The middle column of the image is in direction -z, its top row up.
    """
    pixels = np.random.default_rng(3).random((5, 7, 3))
    sky = Sky(pixels, rotation)
    d = np.random.default_rng(4).standard_normal((20_000, 3))
    d = (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)
    turn = np.arctan2(d[:, 0].astype(float), -d[:, 2].astype(float)) + sky.rotation
    x = ((turn / (2 * np.pi) + 0.5) % 1) * 7 - 0.5
    y = np.arccos(d[:, 1].astype(float)) / np.pi * 5 - 0.5
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    s, t = (x - x0)[:, None], (y - y0)[:, None]
    rows, columns = (np.clip(y0, 0, 4), np.clip(y0 + 1, 0, 4)), (x0 % 7, (x0 + 1) % 7)
    expected = (pixels[rows[0], columns[0]] * (1 - s) + pixels[rows[0], columns[1]] * s) * (1 - t) + (
        pixels[rows[1], columns[0]] * (1 - s) + pixels[rows[1], columns[1]] * s
    ) * t
    np.testing.assert_allclose(sky.at(d), expected, atol=2e-5)


@pytest.mark.parametrize("d", [(0, 1, 0), (0, -1, 0), (0, 0, 1), (-0.0, 0, 1), (0, 0, -1), (np.nan,) * 3, (0, 1.0000001, 0)])
def test_every_direction_has_a_density(d):
    """Every direction has a density, also at the poles and the seam, and even if it is invalid; none reads outside the tables."""
    sky = Sky(random_sky())
    assert sky.pdf([d])[0] >= 0
    assert np.isfinite(sky.at([d])).all() or np.isnan(d).any()


def test_cdf_sampling_skips_empty_intervals():
    cdf = np.array([0, 0, 0.25, 0.25, 0.25, 1, 1], np.float32)
    cdf.flags.writeable = False
    u = np.array([0, 0.1, 0.2499, 0.25, 0.5, 1 - 2**-24], np.float32)
    index, rest, width = np.empty(6, np.int64), np.empty(6, np.float32), np.empty(6, np.float32)
    _choose(cdf, u, index, rest, width)
    np.testing.assert_array_equal(index, [1, 1, 1, 4, 4, 4])
    np.testing.assert_allclose(rest, [0, 0.4, 0.9996, 0, 1 / 3, 1], atol=1e-6)
    assert rest.max() < 1
    np.testing.assert_array_equal(width, [0.25] * 3 + [0.75] * 3)


def peaked(count, seed):
    """Returns a cdf of `count` weights, some 0, others similar, one possibly dominant; its steps are exact if few."""
    rng = np.random.default_rng(seed)
    weights = rng.random(count) ** 3 * (rng.random(count) > 0.2)
    weights[rng.integers(count)] = [0, 1, 1e6][seed % 3]
    return cumulative(weights)


@pytest.mark.parametrize("count", [1, 2, 6, 7, 8, 9, 31, 256, 1000])
def test_guided_search_equals_binary_search(count):
    """Both searches agree to the bit for random numbers and for numbers equal to the cdf's entries or just below them."""
    for seed in range(6):
        cdf = peaked(count, seed)
        start = cutpoints(cdf)
        cdf.flags.writeable = start.flags.writeable = False
        edges = np.concatenate([cdf, np.nextafter(cdf, np.float32(0)), np.arange(len(start), dtype=np.float32) / len(start)])
        u = np.concatenate([np.random.default_rng(seed).random(20_000, np.float32), edges[(edges >= 0) & (edges < 1)]])
        found = []
        for search, tables in ((_choose, (cdf,)), (_choose_from, (cdf, start))):
            index, rest, width = np.empty(len(u), np.int64), np.empty(len(u), np.float32), np.empty(len(u), np.float32)
            search(*tables, u.astype(np.float32), index, rest, width)
            found.append((index, rest, width))
        for ours, expected in zip(found[1], found[0], strict=True):
            assert np.array_equal(ours, expected)


def test_search_starts_at_the_cut_point():
    """The search in a cdf starts at a cut point, which is stored for each of equal intervals of the random number.

    Each image row has its own cut points. Their number is a power of two per row; it is one for one to four texels.
    """
    cdf = np.stack([peaked(300, seed) for seed in range(4)])
    start = cutpoints(cdf)
    assert start.shape == (4, 128)
    lower = np.arange(128) / 128
    for row, begin in zip(cdf, start, strict=True):
        assert (row[begin] <= lower).all()
        assert (row[begin + 1] > lower).all()
    assert cutpoints(cumulative(np.ones(1))).tolist() == [0]
