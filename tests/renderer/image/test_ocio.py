"""Tests of OpenColorIO views: known values, names, broken configs, and the error of the baked table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from renderer.errors import SettingsError
from renderer.image import ocio, tonemap
from renderer.image.encode import encode
from renderer.luminance import REC_709

ACES_SDR = "ocio:sRGB - Display/ACES 2.0 - SDR 100 nits (Rec.709)"
UNTONEMAPPED = "ocio:Un-tone-mapped"

# A config as of a studio: reference ACES2065-1 by its role, working space linear Rec.2020, a display with a plain gamma.
STUDIO = """
ocio_profile_version: 2
roles: {aces_interchange: aces, scene_linear: lin2020, default: aces}
displays:
  Grading/Wall:
    - !<View> {name: Film/Print, colorspace: gamma2}
    - !<View> {name: Linear, colorspace: lin2020}
looks:
  - !<Look> {name: Half, process_space: lin2020, transform: !<MatrixTransform> {matrix: [0.5,0,0,0, 0,0.5,0,0, 0,0,0.5,0, 0,0,0,1]}}
colorspaces:
  - !<ColorSpace> {name: aces, isdata: false}
  - !<ColorSpace>
    name: lin2020
    isdata: false
    from_scene_reference: !<MatrixTransform> {matrix: [1.49040952054172, -0.266170919926613, -0.224238600615105, 0, -0.0801674998722558, 1.18216712109757, -0.10199962122531, 0, 0.00322763119162216, -0.0347764757450576, 1.03154884455344, 0, 0, 0, 0, 1]}
  - !<ColorSpace>
    name: gamma2
    isdata: false
    from_scene_reference: !<GroupTransform>
      children:
        - !<ColorSpaceTransform> {src: aces, dst: lin2020}
        - !<ExponentTransform> {value: 2, direction: inverse}
"""  # noqa: E501
# Linear Rec.709 to linear Rec.2020, both D65 (ITU-R BT.2087).
REC_2020 = np.array([[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]])


@pytest.fixture(scope="module")
def studio(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("ocio") / "studio.ocio"
    path.write_text(STUDIO)
    return str(path)


def shown(name: str, *colours: tuple[float, float, float], source: str = "cg") -> np.ndarray:
    curve = ocio.curve_of(name, source)
    assert isinstance(curve, ocio.ViewTransform)
    return curve.encode(np.array(colours, np.float32))


def test_aces_sdr_shows_middle_grey_at_ten_nits_and_its_peak_as_white():
    """ACES 2.0 renders 18 % grey at 10 nits, a tenth of the display's 100."""
    grey, black, peak = shown(ACES_SDR, (0.18,) * 3, (0.0,) * 3, (1e18,) * 3)
    assert tonemap.decode_srgb(grey) == pytest.approx(0.1, abs=5e-4)
    assert np.ptp(grey) < 1e-5
    assert black == pytest.approx(0, abs=1e-6)
    assert peak == pytest.approx(1, abs=1e-4)


def test_primaries_keep_their_hue_and_the_order_of_their_luminance():
    found = tonemap.decode_srgb(shown(ACES_SDR, (0.5, 0, 0), (0, 0.5, 0), (0, 0, 0.5)))
    assert (found.argmax(axis=1) == [0, 1, 2]).all()
    luminance = found @ REC_709
    assert luminance[2] < luminance[0] < luminance[1]


def test_view_without_tone_curve_is_srgb():
    """The conversion to the config's working space (ACEScg) and back leaves Rec.709 unchanged."""
    colours = np.random.default_rng(1).random((50, 3)).astype(np.float32)
    np.testing.assert_allclose(shown(UNTONEMAPPED, *map(tuple, colours)), tonemap.encode_srgb(colours), atol=2e-5)


def test_config_of_a_studio_is_converted_from_rec_709(studio: str):
    colours = np.random.default_rng(2).random((20, 3)).astype(np.float32)
    linear = shown("ocio:Linear", *map(tuple, colours), source=studio)
    np.testing.assert_allclose(linear, colours @ REC_2020.T, atol=5e-4)
    film = shown("ocio:Grading/Wall/Film/Print", *map(tuple, colours), source=studio)
    np.testing.assert_allclose(film, np.sqrt(colours @ REC_2020.T), atol=5e-4)
    np.testing.assert_allclose(shown("ocio:Film/Print/Half", *map(tuple, colours), source=studio), np.sqrt(linear / 2), atol=5e-4)


def test_picture_file_has_the_view():
    rgb = np.full((2, 3, 3), 0.045, np.float32)
    curve = ocio.curve_of("ocio", "cg")
    assert tonemap.apply(rgb, 2.0, curve)[0, 0] == pytest.approx(89, abs=0)
    assert encode(rgb, "png", 2.0, curve) == encode(rgb, "png", 2.0, ocio.curve_of(ACES_SDR, "cg"))
    assert encode(rgb, "png", 2.0, curve) != encode(rgb, "png", 2.0, "neutral")
    assert tonemap.apply(np.array([[[np.nan, -1, np.inf]]], np.float32), 0.0, curve).shape == (1, 1, 3)


@pytest.mark.parametrize(
    ("name", "source", "code"),
    [
        ("ocio:ACES", "cg", "ocio-view-unknown"),
        ("ocio:sRGB - Display", "cg", "ocio-view-unknown"),
        ("ocio", "/nowhere/config.ocio", "ocio-config-unreadable"),
        ("ocio", __file__, "ocio-config-unreadable"),
        ("ocioo", "cg", "tone-curve-unknown"),
    ],
)
def test_unknown_names_and_broken_configs_are_refused(name: str, source: str, code: str):
    with pytest.raises(SettingsError) as refused:
        ocio.curve_of(name, source)
    assert refused.value.args[0].code == code


def test_config_without_relation_to_rec_709_is_refused(tmp_path: Path):
    path = tmp_path / "old.ocio"
    path.write_text(
        "ocio_profile_version: 1\nroles: {scene_linear: lin, default: lin}\n"
        "displays:\n  Mon:\n    - !<View> {name: Film, colorspace: lin}\n"
        "colorspaces:\n  - !<ColorSpace> {name: lin, isdata: false}\n"
    )
    with pytest.raises(SettingsError, match="aces_interchange"):
        ocio.curve_of("ocio", str(path))


def test_missing_package_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(ocio, "is_installed", lambda: False)
    with pytest.raises(SettingsError, match=r'pip install "rayfarm\[ocio\]"'):
        ocio.ColorConfig("studio")


def interpolated(lut: np.ndarray, rgb: np.ndarray) -> np.ndarray:
    """Returns the table's values for colours (n, 3), by tetrahedral interpolation, as the page's shader has it."""
    points = np.stack([lut & 1023, lut >> 10 & 1023, lut >> 20], axis=-1) / 1023  # by blue, green, red
    at = np.log2(1 + 255 * np.clip(rgb, 0, 257)) / 16 * (ocio.LUT_SIZE - 1)
    corner = np.minimum(at.astype(int), ocio.LUT_SIZE - 2)
    rest = at - corner
    order = np.argsort(-rest, axis=1, kind="stable")
    weights = np.take_along_axis(rest, order, axis=1)
    weights = np.concatenate([np.ones((len(rgb), 1)), weights, np.zeros((len(rgb), 1))], axis=1)
    weights = weights[:, :-1] - weights[:, 1:]
    found = np.zeros((len(rgb), 3))
    for k in range(4):
        found += weights[:, k, None] * points[corner[:, 2], corner[:, 1], corner[:, 0]]
        if k < 3:
            corner[np.arange(len(rgb)), order[:, k]] += 1
    return found


@pytest.mark.parametrize(("name", "mean", "most_of_all", "largest"), [(ACES_SDR, 0.15, 0.6, 20), (UNTONEMAPPED, 0.15, 0.3, 0.35)])
def test_table_is_close_to_the_view(name: str, mean: float, most_of_all: float, largest: float):
    """The errors in 8-bit steps are those that the documentation states. Colours: nine stops below 1 to five above."""
    rng = np.random.default_rng(3)
    brightness = np.exp2(rng.uniform(-9, 5, (20_000, 1)))
    colours = (brightness * np.exp2(-rng.exponential(rng.choice([0.3, 1, 3], (20_000, 1)), (20_000, 3)))).astype(np.float32)
    curve = ocio.curve_of(name, "cg")
    assert isinstance(curve, ocio.ViewTransform)
    error = np.abs(interpolated(curve.lut(), colours) - np.clip(curve.encode(colours), 0, 1)).max(axis=1) * 255
    assert (error.mean() < mean, np.percentile(error, 99) < most_of_all, error.max() < largest) == (True, True, True)
