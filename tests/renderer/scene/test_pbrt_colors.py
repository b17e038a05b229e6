"""Tests of pbrt's colours, against published values and Mitsuba's tables: light spectra, reflectances, metals and glasses."""

from pathlib import Path

import numpy as np
import pytest

from renderer.arrays.spectrum import GIVEN_ETA, GIVEN_K, GIVEN_LIGHT, GIVEN_REFLECTANCE
from renderer.scene.given_spectra import spectrum_rows
from renderer.scene.observer import D65, MATCHING, WAVELENGTHS, at_wavelengths, planck
from renderer.scene.readers.coats import dielectric_albedo, effective_albedo_under_coat
from renderer.scene.readers.pbrt.conductors import _match_reflectance, normal_reflectance
from renderer.scene.readers.pbrt.named_spectra import METALS
from renderer.scene.readers.pbrt.spectra import balanced
from tests.renderer.scene.pbrt_files import BALL, HEAD, SQUARE, world

# Chromaticities of black bodies: CIE 015:2018, the Planckian locus. Wyszecki and Stiles 1982, table 1(3.11).
LOCUS = {2000: (0.5267, 0.4133), 2856: (0.4476, 0.4074), 4000: (0.3805, 0.3768), 6500: (0.3135, 0.3237), 10000: (0.2807, 0.2884)}


@pytest.mark.parametrize("kelvin", LOCUS)
def test_black_body_colors(kelvin):
    xyz = MATCHING @ planck(kelvin)
    np.testing.assert_allclose((xyz / xyz.sum())[:2], LOCUS[kelvin], atol=4e-4)


def test_daylight_is_white():
    xyz = MATCHING @ D65
    np.testing.assert_allclose((xyz / xyz.sum())[:2], (0.3127, 0.3290), atol=3e-4)


def test_observer_matches_mitsuba():
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    theirs = np.array([[float(v) for v in mi.cie1931_xyz(float(w))] for w in WAVELENGTHS]).T
    assert np.abs(MATCHING - theirs).max() < 0.03
    np.testing.assert_allclose(MATCHING.sum(axis=1), theirs.sum(axis=1), rtol=1e-3)


def tabulated(name):
    """Returns a column (W,) of the spectral tables that Mitsuba and pbrt share."""
    mi = pytest.importorskip("mitsuba")
    text = (Path(mi.__file__).parent / "data" / "ior" / name).read_text()
    rows = np.array([line.split() for line in text.splitlines() if line.strip() and not line.startswith("#")], float)
    return at_wavelengths(rows[:, 0], rows[:, 1])


@pytest.mark.parametrize("metal", [name for name in METALS if name != "CuZn"])
def test_named_metals_match_their_spectra(metal):
    eta, k = tabulated(f"{metal}.eta.spd"), tabulated(f"{metal}.k.spd")
    np.testing.assert_allclose(METALS[metal], _match_reflectance(eta, k), atol=1e-4)


# Linear Rec.709 reflectance at normal incidence: S. Lagarde, Memo on Fresnel equations, 2013.
@pytest.mark.parametrize(
    ("metal", "known"),
    [("Cu", (0.955, 0.638, 0.538)), ("Ag", (0.972, 0.960, 0.915)), ("Al", (0.913, 0.922, 0.924)), ("Au", (1.0, 0.782, 0.344))],
)
def test_named_metal_colors(metal, known):
    np.testing.assert_allclose(normal_reflectance(*(np.array(v) for v in METALS[metal])), known, atol=0.003)


def lights(scene, words):
    return scene("a.pbrt", world(f"LightSource {words} {BALL}")).lights[0]


def test_lights_of_spectra_have_a_luminance_of_one(scene):
    for words in (
        '"blackbody I" 2700',
        '"spectrum I" [380 3 780 3]',
        '"spectrum I" "stdillum-F11"',
        '"spectrum I" [500 0 560 9 620 0]',
    ):
        light = lights(scene, f'"point" {words} "float scale" 5')
        assert np.dot(light.intensity, (0.2126, 0.7152, 0.0722)) == pytest.approx(5, rel=0.06 if "560" in words else 0.003)
    assert lights(scene, '"point" "rgb I" [1 2 3] "float scale" 2').intensity == (2, 4, 6)
    assert lights(scene, '"point" "spectrum I" "stdillum-D65"').intensity == pytest.approx((1, 1, 1), rel=2e-3)
    # Equal-energy white is warmer than daylight: Rec.709 of XYZ (1, 1, 1).
    assert lights(scene, '"point" "spectrum I" [300 1 900 1]').intensity == pytest.approx((1.2048, 0.9483, 0.9088), rel=5e-3)


def test_power_and_illuminance(scene):
    assert lights(scene, '"point" "float power" 100').intensity == pytest.approx([100 / (4 * np.pi)] * 3)
    assert lights(scene, '"distant" "float illuminance" 7 "rgb L" [1 .5 0]').intensity == pytest.approx((7, 3.5, 0))
    square = scene("a.pbrt", world(f'AreaLightSource "diffuse" "float power" 12 {SQUARE}')).materials[0]
    assert square.emission == pytest.approx([12 / (2 * np.pi)] * 3)  # each of the two triangles has this power
    ball = scene("b.pbrt", world(f'AreaLightSource "diffuse" "float power" 12 "bool twosided" true {BALL} "float radius" 2'))
    assert ball.materials[0].emission == pytest.approx([12 / (2 * np.pi * 16 * np.pi)] * 3)
    assert ball.materials[0].double_sided
    sky = scene("c.pbrt", world(f'LightSource "infinite" "float illuminance" 6 {BALL}')).environment
    assert sky.color == pytest.approx([6 / np.pi] * 3)


def test_film_exposure_scales_all_lights(scene):
    head = world("").replace('"rgb" ', '"rgb" "float iso" 200 ').replace('"float fov"', '"float shutterclose" 0.25 "float fov"')
    found = scene("a.pbrt", head + f'LightSource "point" LightSource "infinite" AreaLightSource "diffuse" {BALL}')
    assert found.lights[0].intensity == (0.5, 0.5, 0.5)
    assert found.environment.color == (0.5, 0.5, 0.5)
    assert found.materials[0].emission == (0.5, 0.5, 0.5)


def test_colour_spaces(scene):
    def red(space):
        text = (
            f'ColorSpace "{space}" Material "diffuse" "rgb reflectance" [.5 .5 .5] {BALL} LightSource "point" "rgb I" [.6 .5 .4]'
        )
        return scene("a.pbrt", world(text))

    wide = red("rec2020")
    assert wide.materials[0].base_color == pytest.approx((0.5, 0.5, 0.5))
    # ITU-R BT.2087, linear: the inverse of its matrix from Rec.709.
    from_709 = np.array([[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]])
    np.testing.assert_allclose(wide.lights[0].intensity, np.linalg.solve(from_709, [0.6, 0.5, 0.4]), rtol=1e-3)


def test_reflectance_spectra(scene):
    def color(words):
        return scene("a.pbrt", world(f'Material "diffuse" {words} {BALL}')).materials[0].base_color

    assert color('"spectrum reflectance" [300 .4 900 .4]') == pytest.approx((0.4, 0.4, 0.4), rel=1e-6)
    r, g, b = color('"spectrum reflectance" [400 0 580 0 620 .8 700 .8]')
    assert r > 0.3
    assert max(g, b) < 0.15


def test_glass_index_and_dispersion(scene):
    found = scene("a.pbrt", world(f'Material "dielectric" "spectrum eta" "glass-BK7" {BALL}')).materials[0]
    assert (found.ior, found.dispersion) == (pytest.approx(1.5168), pytest.approx(20 / 64.17))


def test_coat_reflectance():
    # Hemispherical reflectance of glass of index 1.5: 0.0918 from outside, 0.596 from inside (Egan and Hilgeman 1973).
    outside = dielectric_albedo(1.5)
    assert outside == pytest.approx(0.0918, abs=2e-4)
    inner = 1 - (1 - outside) / 1.5**2
    assert inner == pytest.approx(0.5963, abs=3e-4)
    assert effective_albedo_under_coat((1.0, 0.0, 0.5), inner) == pytest.approx(
        (1, 0, 0.5 * (1 - inner) / (1 - inner / 2)), rel=1e-6
    )


@pytest.mark.parametrize(("kelvin", "xy"), [(5000, (0.3457, 0.3586)), (6504, (0.3127, 0.3291)), (10_000, (0.2788, 0.2920))])
def test_balanced_daylight_is_white(kelvin, xy):
    """A film balanced for daylight shows daylight as white; chromaticities of daylight from CIE 015:2018."""
    x, y = xy
    to_709 = np.array(
        [[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252]]
    )
    light = to_709 @ (x / y, 1, (1 - x - y) / y)
    np.testing.assert_allclose(balanced(kelvin, "srgb") @ light, (1, 1, 1), atol=4e-3)


def test_white_balance_applies_to_lights_and_sky(scene):
    head = HEAD.replace('"integer yresolution" [ 32 ]', '"integer yresolution" 32 "float whitebalance" 4500')
    found = scene("scene.pbrt", world('LightSource "point" "rgb I" [2 2 2] LightSource "infinite" "rgb L" [1 1 1] ' + BALL, head))
    expected = balanced(4500, "srgb").sum(axis=1)
    assert found.lights[0].intensity == pytest.approx(tuple(2 * expected))
    assert found.environment.color == pytest.approx(tuple(expected))
    assert expected[0] < 1 < expected[2]  # light that is white for a warm balance is blue for a daylight balance


def test_spectra_are_kept_for_spectral_rendering(scene):
    """Lights of any power, reflectances and metals belong to their spectra by the colours that the materials have."""
    found = scene(
        "a.pbrt",
        world(
            'LightSource "point" "blackbody I" 2700 "float scale" 5'
            f' Material "diffuse" "spectrum reflectance" [400 .1 700 .8] {BALL}'
            f'Material "conductor" "spectrum eta" [400 1.5 700 .2] "spectrum k" [400 2 700 4] {BALL}'
        ),
    )
    rows = spectrum_rows(found.spectra)
    colors = {kind: rows[rows[:, 0] == kind, 1:4][0] for kind in range(4)}
    matt, metal = (next(m for m in found.materials if m.kind == kind) for kind in ("diffuse", "conductor"))
    np.testing.assert_array_equal(colors[GIVEN_REFLECTANCE], np.float32(matt.base_color))
    np.testing.assert_array_equal(colors[GIVEN_ETA], np.float32(metal.eta))
    np.testing.assert_array_equal(colors[GIVEN_K], np.float32(metal.k))
    intensity = np.array(found.lights[0].intensity)
    np.testing.assert_allclose(colors[GIVEN_LIGHT], intensity / intensity.max(), rtol=1e-6)
    shown = rows[rows[:, 0] == GIVEN_LIGHT][0, 4:] * D65 / planck(2700)
    np.testing.assert_allclose(shown, shown[0], rtol=1e-4)
    np.testing.assert_allclose(rows[rows[:, 0] == GIVEN_K][0, [4 + 4, 4 + 64]], (2, 4), rtol=1e-6)
