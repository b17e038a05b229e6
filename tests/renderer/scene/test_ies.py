"""Tests of IES profiles of each standard, type and symmetry: intensities in given directions, and warnings about bad files."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from renderer.errors import SceneError
from renderer.scene.emission_maps import flux_of, tabulate_emission
from renderer.scene.readers.ies import read_ies
from tests.renderer.scene.ies_files import HEADERS, candela_of, ies

POLAR = np.arange(0, 181, 15.0)


def dimming(theta, phi):
    """Returns an intensity that differs in all directions; theta and phi in degrees."""
    return 100 + theta + 40 * np.cos(np.radians(phi)) + 20 * np.sin(np.radians(phi))


def quadrants(theta, phi):
    """Returns an intensity that is equal in all quadrants; theta and phi in degrees."""
    return 100 + theta + 40 * np.cos(np.radians(2 * phi))


def halves(theta, phi):
    """Returns an intensity that is equal in both halves; theta and phi in degrees."""
    return 100 + theta + 40 * np.cos(np.radians(phi))


def across(theta, phi):
    """Returns an intensity symmetric about the plane of C90 and C270; theta and phi in degrees."""
    return 100 + theta + 40 * np.sin(np.radians(phi))


@pytest.mark.parametrize("header", HEADERS)
def test_every_ies_standard_is_read(header):
    web = ies([0.0, 45.0, 90.0], [0.0], lambda theta, phi: 100 - theta, header=header)
    np.testing.assert_allclose(candela_of(read_ies(web, "lamp.ies"), [0, 30, 45, 90], 123.0), [100, 70, 55, 10], rtol=1e-5)


@pytest.mark.parametrize(
    ("web", "planes"),
    [
        (quadrants, np.arange(0, 91, 5.0)),
        (halves, np.arange(0, 181, 5.0)),
        (across, np.arange(90, 271, 5.0)),
        (dimming, np.arange(0, 361, 5.0)),
        (dimming, np.arange(0, 360, 5.0)),  # files may omit the last plane, which equals the first
    ],
)
def test_symmetric_profiles_are_completed(web, planes):
    photometry = read_ies(ies(POLAR, planes, web), "lamp.ies")
    for phi in (0, 40, 95, 200, 355):
        theta = np.r_[1, POLAR[1:-1], 179]  # all planes coincide at the poles
        np.testing.assert_allclose(candela_of(photometry, theta, phi), web(theta, phi), rtol=1e-5)


def test_bilinear_interpolation_between_angles():
    vertical, planes = np.array([0.0, 2.5, 10, 20, 47.5, 90]), np.array([0.0, 30, 40, 180])
    table = np.random.default_rng(1).uniform(10, 500, (len(planes), len(vertical)))
    photometry = read_ies(ies(vertical, planes, table), "lamp.ies")
    for phi in (0, 10, 33, 40, 100, 170, 260):
        own = [np.interp(min(phi, 360 - phi), planes, column) for column in table.T]
        theta = np.array([0.1, 1.3, 7.7, 15, 33, 60, 89])
        np.testing.assert_allclose(candela_of(photometry, theta, phi), np.interp(theta, vertical, own), rtol=1e-4)


def test_intensity_is_zero_beyond_the_angles():
    photometry = read_ies(ies([0.0, 30.0, 60.0], [0.0], lambda theta, phi: 100 + 0 * theta), "lamp.ies")
    np.testing.assert_allclose(candela_of(photometry, [0, 59.9, 60.1, 120], 0), [100, 100, 0, 0])
    above = read_ies(ies([90.0, 135.0, 180.0], [0.0], lambda theta, phi: 100 + 0 * theta), "lamp.ies")
    np.testing.assert_allclose(candela_of(above, [0, 89.9, 90.1, 180], 0), [0, 0, 100, 100])


@pytest.mark.parametrize("planes", [[0.0], [0.0, 22.5, 45, 67.5, 90], list(np.arange(0, 361, 15.0))])
def test_lumens_match_an_independent_quadrature(planes):
    vertical = np.array([0.0, 5, 10, 15, 25, 35, 45, 55, 65, 75, 85, 90])
    photometry = read_ies(ies(vertical, planes, lambda theta, phi: 1000 * np.cos(np.radians(theta)) ** 3), "lamp.ies")
    nodes, weights = np.polynomial.legendre.leggauss(40)
    whole = 0.0
    for low, high in itertools.pairwise(vertical):  # between given angles the profile is linear
        theta = (low + high) / 2 + nodes * (high - low) / 2
        web = np.interp(theta, vertical, 1000 * np.cos(np.radians(vertical)) ** 3)
        whole += 2 * math.pi * float((weights * web * np.sin(np.radians(theta))).sum()) * math.radians(high - low) / 2
    assert photometry.lumens == pytest.approx(whole, rel=1e-5)
    assert flux_of(photometry.emission)[1] == pytest.approx(whole, rel=1e-5)


def test_factors_by_standard():
    for header, expected in ((HEADERS[2], 100 * 2 * 0.9 * 0.8), (HEADERS[4], 100 * 2 * 0.9)):
        web = ies([0.0, 90.0], [0.0], lambda theta, phi: 100 + 0 * theta, header=header, multiplier=2, ballast=(0.9, 0.8))
        np.testing.assert_allclose(candela_of(read_ies(web, "lamp.ies"), [10], 0), expected, rtol=1e-5)


def test_tilt_data_are_read_for_the_upright_position():
    tilt = "TILT=INCLUDE\n1\n3\n0 45 90\n1.0 0.9 0.8\n"
    photometry = read_ies(ies([0.0, 90.0], [0.0], lambda theta, phi: 100 + 0 * theta, tilt=tilt), "lamp.ies")
    np.testing.assert_allclose(candela_of(photometry, [10], 0), 100, rtol=1e-6)
    assert "its tilt is ignored" in photometry.notes[0]
    elsewhere = read_ies(ies([0.0, 90.0], [0.0], lambda theta, phi: 100 + 0 * theta, tilt="TILT=lamp.tlt\n"), "lamp.ies")
    assert "another file" in elsewhere.notes[0]


@pytest.mark.parametrize(("kind", "is_mirrored"), [("A", False), ("B", False), ("A", True), ("B", True)])
def test_types_a_and_b(kind, is_mirrored):
    """Horizontal angles are longitudes in type A and latitudes in type B.

    The poles of type A are above and below, those of type B left and right.
    """
    angles = np.arange(0 if is_mirrored else -90, 91, 10.0)

    def lamp(vertical, horizontal):
        return 200 + np.abs(horizontal) + np.abs(vertical) / 2 if is_mirrored else 200 + horizontal + vertical / 2

    photometry = read_ies(ies(angles, angles, lamp, kind=kind), "lamp.ies")
    for vertical, horizontal in ((0, 0), (30, 0), (0, 50), (20, 40), (-20, 40), (10, -60)):
        v, h = math.radians(vertical), math.radians(horizontal)
        if kind == "A":
            right, up, forward = math.cos(v) * math.sin(h), math.sin(v), math.cos(v) * math.cos(h)
        else:
            right, up, forward = math.sin(h), math.cos(h) * math.sin(v), math.cos(h) * math.cos(v)
        theta, phi = math.degrees(math.acos(forward)), math.degrees(math.atan2(up, right))
        np.testing.assert_allclose(candela_of(photometry, [theta], phi), lamp(vertical, horizontal), rtol=1e-2)
    np.testing.assert_allclose(candela_of(photometry, [120], 30), 0)


GOOD = ies([0.0, 45.0, 90.0], [0.0, 90.0], lambda theta, phi: 100 + 0 * theta).decode()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no line TILT="),
        ("IESNA:LM-63-2002\nTILT=NONE\n1 1000 1", "ends before its number of vertical angles"),
        (GOOD[: GOOD.rindex("100")], "ends before its candela values"),
        (GOOD.replace("0 45 90", "0 45 x"), "its vertical angles are not numbers"),
        (GOOD.replace("0 45 90", "0 90 45"), "vertical angles do not ascend"),
        (GOOD.replace("0 45 90", "-90 45 90"), "type C allows 0 to 180. Export it again"),
        (GOOD.replace("\n0 90\n", "\n0 70\n"), "horizontal angles go from 0 to 70"),
        (GOOD.replace("1 1000 1 3 2 1", "1 1000 1 3 2 7"), "photometric type"),
        (GOOD.replace("1 1000 1 3 2 1", "1 1000 1 3.5 2 1"), "number of vertical angles is 3.5"),
        (GOOD.replace("1 1000 1 3 2 1", "1 1000 1e30 3 2 1"), "beyond all bounds"),
        (GOOD.replace("1 1000 1 3 2 1", "1 1000 nan 3 2 1"), "beyond all bounds"),
        (GOOD.replace("1 1000 1 3 2 1", "1 1000 1 3000000 3000000 1"), "at most"),
    ],
)
def test_damaged_file_is_an_error_message(text, said):
    with pytest.raises(SceneError, match=r"lamp\.ies[: ]") as error:
        read_ies(text.encode(), "lamp.ies")
    assert said in str(error.value)


WORDS = ("0", "-1", "1e308", "nan", "inf", "3", "90", "1e-300", "", "x", "1e9", "360", "0.001")


@given(st.lists(st.tuples(st.integers(0, 60), st.sampled_from(WORDS)), min_size=1, max_size=3), st.sampled_from("ABC"))
def test_arbitrary_files_are_read_or_rejected(changes, kind):
    angles = np.arange(0, 91, 30.0)
    words = ies(angles, angles, lambda theta, phi: 100 + theta, kind=kind).decode().split(" ")
    for place, word in changes:
        words[place % len(words)] = word
    try:
        values = read_ies(" ".join(words).encode(), "lamp.ies").emission.values
    except SceneError:
        return
    assert np.isfinite(values).all() and values.min() >= 0


def test_narrow_beam_is_resampled_precisely():
    vertical = np.r_[np.arange(0, 10, 0.1), np.arange(10, 91, 5.0)]
    photometry = read_ies(ies(vertical, [0.0], lambda theta, phi: 1e5 * np.exp(-((theta / 2) ** 2))), "lamp.ies")
    theta = np.array([0.0, 0.55, 1.0, 2.0, 3.33])
    np.testing.assert_allclose(candela_of(photometry, theta, 0), 1e5 * np.exp(-((theta / 2) ** 2)), rtol=3e-3)
    assert (
        20 < math.degrees(tabulate_emission([photometry.emission]).reach[0]) < 30
    )  # at larger angles the candela are 0 in float32
