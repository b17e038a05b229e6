"""Tests of the sky and its sun: plausible by day and at dusk, and each parameter has its effect."""

import math
from dataclasses import replace

import numpy as np
import pytest

from renderer.errors import SceneError
from renderer.film import mean
from renderer.luminance import luminance
from renderer.render import render_frame
from renderer.scene import atmosphere
from renderer.scene.compile import compile_scene
from renderer.scene.description import Environment, Image, Instance, Material, SceneDescription, Sky
from renderer.scene.environment import tabulate_environment, with_environment_changed
from renderer.scene.load import read
from renderer.scene.sky import image_of_sky, parse_sky, sun_of_sky
from tests.grids import grid
from tests.renderer.builders import gray, settings, square
from tests.renderer.judge import assert_mean

WHITE = Material(base_color=gray(1.0))
FLOOR = square((0, 0, 0), (50, 0, 0), (0, 0, -50), 0)


@pytest.fixture(autouse=True, scope="module")
def shared_scattering():
    """Shares the scattering integral between skies of one sun height: it takes almost a second and does not depend on azimuth."""
    known = {}

    def scattered(*arguments):
        key = tuple(each.tobytes() if isinstance(each, np.ndarray) else each for each in arguments)
        if key not in known:
            known[key] = atmosphere.scattered(*arguments)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("renderer.scene.sky.scattered", scattered)
        yield


@pytest.fixture
def coarse(monkeypatch):
    """Uses a grid with 1/9 of the points, for tests of sums over the whole sky."""
    monkeypatch.setattr("renderer.scene.sky._ELEVATIONS", 32)
    monkeypatch.setattr("renderer.scene.sky._AZIMUTHS", 16)


def onto_ground(image):
    """Returns the irradiance (3,) of the image's upper half on a horizontal plane."""
    rows = len(image) // 2
    elevation = math.pi / 2 - (np.arange(rows) + 0.5) * math.pi / len(image)
    cell = np.cos(elevation) * np.sin(elevation) * (math.pi / len(image)) ** 2
    return (image[:rows].astype(float).sum(1) * cell[:, None]).sum(0)


def facing(sun):
    return np.zeros(3) if sun is None else sun.radiance * math.pi * math.sin(sun.half_angle) ** 2


def lit(sky, rotation=0.0, mesh=FLOOR, material=WHITE):
    description = SceneDescription(meshes=[mesh], instances=[Instance(0)], materials=[material])
    description.environment = Environment(sky=sky, rotation=rotation)
    return compile_scene(description)


@pytest.mark.long
def test_noon_sun_exceeds_the_sky():
    """At noon the sun gives several times the sky's light.

    On clear days the diffuse share of light on a horizontal plane is 1/10 to 1/4, and the total about 3/4 of pi.
    """
    sky = Sky(sun_elevation=60)
    diffuse, direct = luminance(onto_ground(image_of_sky(sky))), luminance(facing(sun_of_sky(sky))) * math.sin(math.radians(60))
    assert 0.05 < diffuse / (diffuse + direct) < 0.3
    assert 0.6 < (diffuse + direct) / (math.pi * math.sin(math.radians(60))) < 0.95


@pytest.mark.long
def test_ground_brightens_the_sky_and_energy_is_conserved(coarse):
    """Snow brightens the sky, and the light that leaves the air downwards stays below the sun's input."""
    for height in (5, 60):
        dark, snow = (onto_ground(image_of_sky(Sky(height, ground_albedo=gray(a)))) for a in (0.0, 1.0))
        assert (snow > dark).all()
        incoming = np.sin(math.radians(height)) * facing(sun_of_sky(Sky(90, air=0, dust=0, ozone=0)))
        assert (dark + facing(sun_of_sky(Sky(height))) * math.sin(math.radians(height)) < incoming).all()


@pytest.mark.long
def test_irradiance_decreases_with_sun_elevation(coarse):
    heights = [90, 50, 20, 5, 0, -1, -6, -10]
    sky = [luminance(onto_ground(image_of_sky(Sky(h)))) for h in heights]
    sun = [luminance(facing(sun_of_sky(Sky(h)))) for h in heights]
    assert (np.diff(sky) <= 0).all()
    assert (np.diff(sun) <= 0).all()
    assert sun[heights.index(0)] > 0 == sun[heights.index(-1)]
    assert sky[heights.index(-1)] > 0


@pytest.mark.long
def test_colours():
    """The noon sky is blue, a low sun red, and the zenith at dusk still blue, due to ozone."""
    noon = image_of_sky(Sky(70, 0))
    assert noon[128, 0, 2] > 1.3 * noon[128, 0, 0]
    high, low = facing(sun_of_sky(Sky(70))), facing(sun_of_sky(Sky(2)))
    assert high[0] < 2 * high[2]
    assert low[0] > 2 * low[1] > 4 * low[2]
    with_ozone, without = image_of_sky(Sky(-2))[0, 0], image_of_sky(Sky(-2, ozone=0))[0, 0]
    assert with_ozone[2] / with_ozone[0] > 1.2 * without[2] / without[0]


@pytest.mark.long
def test_ground_radiance_below_the_horizon():
    sky = Sky(30, ground_albedo=(0.5, 0.25, 0.1))
    image = image_of_sky(sky)
    received = onto_ground(image) + facing(sun_of_sky(sky)) * 0.5
    expected = np.broadcast_to(np.array(sky.ground_albedo) / math.pi * received, image[256:].shape)
    np.testing.assert_allclose(image[256:], expected, rtol=1e-4)


@pytest.mark.long
def test_dust_glow_and_sky_without_air():
    clear, hazy = image_of_sky(Sky(40, 0, dust=0)), image_of_sky(Sky(40, 0, dust=4))
    near, far = (slice(130, 150), slice(500, 524)), (slice(130, 150), slice(0, 24))
    assert hazy[near].mean() / hazy[far].mean() > 3 * clear[near].mean() / clear[far].mean()
    empty = Sky(40, air=0, dust=0, ozone=0)
    assert image_of_sky(empty)[:256].max() == 0
    assert luminance(facing(sun_of_sky(empty))) == pytest.approx(math.pi, rel=1e-4)  # rounded Rec.709 coefficients


@grid(("azimuth", "column"), [(0, 512), (90, 768), (-90, 256), (180, 0), (450, 768)], ordinary=(90,))
def test_sky_is_brightest_and_symmetric_at_the_sun(azimuth, column):
    image = image_of_sky(Sky(20, azimuth))
    _, brightest = np.unravel_index(image[:256, :, 1].argmax(), (256, 1024))
    assert min(abs(brightest - column), 1024 - abs(brightest - column)) <= 1
    turned = np.roll(image, 512 - column, axis=1)
    np.testing.assert_allclose(turned, turned[:, ::-1], rtol=1e-4)
    direction = sun_of_sky(Sky(20, azimuth)).direction
    x = (math.atan2(direction[0], -direction[2]) / (2 * math.pi) + 0.5) % 1 * 1024
    assert min(abs(x - column), 1024 - abs(x - column)) < 1e-6


@pytest.mark.long
def test_sky_is_continuous_at_the_seam():
    image = image_of_sky(Sky(10, 90.0 + 180 / 1024))[
        :256, :, 1
    ]  # the sun is in a texel's centre, the image's edge on the opposite side
    steps = np.abs(np.diff(image, axis=1, append=image[:, :1]))
    assert (steps[:, -1] <= steps[:, :-1].max(axis=1)).all()
    np.testing.assert_allclose(image[:, 1023], image[:, 513], rtol=1e-4)  # equally far from the sun on either side


@pytest.mark.long
def test_finer_grid_gives_the_same_sky(monkeypatch):
    coarse = image_of_sky(Sky(10))[:256]
    monkeypatch.setattr("renderer.scene.sky._ELEVATIONS", 160)
    monkeypatch.setattr("renderer.scene.sky._AZIMUTHS", 80)
    np.testing.assert_allclose(image_of_sky(Sky(10))[:256], coarse, rtol=0.02, atol=1e-3 * coarse.mean())


def test_smaller_sun_has_higher_radiance():
    wide, small = sun_of_sky(Sky(30, sun_size=4.0)), sun_of_sky(Sky(30, sun_size=0.5))
    np.testing.assert_allclose(facing(wide), facing(small), rtol=1e-9)
    assert small.radiance[0] > 60 * wide.radiance[0]
    assert sun_of_sky(Sky(30, sun=False)) is None


@pytest.mark.parametrize("rotation", [0.0, 50.0])
def test_floor_irradiance_from_sun_and_sky(rotation):
    sky = Sky(35, 70)
    expected = onto_ground(image_of_sky(sky)) + facing(sun_of_sky(sky)) * math.sin(math.radians(35))
    sums = render_frame(lit(sky, rotation), settings((0, 2, -1), (0, 0, 0), 0.01, max_depth=2), 64)
    assert_mean(sums, float(expected.mean()) / math.pi, slack=1e-3)


def test_sun_disk_is_visible_directly_and_in_mirrors():
    sky = Sky(35, 70, sun_size=2.0)
    radiance = sun_of_sky(sky).radiance
    towards = sun_of_sky(sky).direction
    for turn in (0.0, 40.0):
        a = math.radians(turn)
        x, y, z = towards
        seen = (x * math.cos(a) + z * math.sin(a), y, z * math.cos(a) - x * math.sin(a))
        away = square((0, -9, 0), (1, 0, 0), (0, 0, -1), 0)
        picture = mean(render_frame(lit(sky, turn, away), settings((0, 0, 0), seen, 4.0, size=96, max_depth=1), 16), 24)
        bright = picture[..., 0] > radiance[0] / 2
        across = 2 * 48 / math.tan(math.radians(2.0)) * math.tan(math.radians(1.0))  # the disk's diameter in pixels
        assert bright.sum() == pytest.approx(math.pi / 4 * across**2, rel=0.03)
        assert bright[47:49, 47:49].all()
        np.testing.assert_allclose(picture[48, 48], radiance, rtol=0.05)
    mirror = lit(sky, material=Material(kind="mirror", base_color=gray(1.0)))
    eye = (-towards[0], towards[1], -towards[2])
    picture = mean(render_frame(mirror, settings(eye, (0, 0, 0), 0.1, size=4, max_depth=2), 4), 24)
    np.testing.assert_allclose(picture, np.broadcast_to(radiance, picture.shape), rtol=0.05)


def test_environment_settings_apply_to_the_sun():
    made = lit(Sky(35))
    view = settings((0, 2, -1), (0, 0, 0), 0.01, max_depth=2)
    once, thrice = (mean(render_frame(with_environment_changed(made, None, s), view, 16), 24).mean() for s in (1.0, 3.0))
    assert thrice == pytest.approx(3 * once, rel=1e-5)
    assert_mean(render_frame(with_environment_changed(made, (0.5, 0.5, 0.5), 1.0), view, 64), 0.5, slack=1e-4)
    assert mean(render_frame(with_environment_changed(made, None, 0.0), view, 1), 24).max() == 0


@pytest.mark.parametrize("turn", [35.0, -170.0])
def test_rotation_setting_equals_rotation_in_the_file(turn):
    later, before = (
        with_environment_changed(lit(Sky(35, 40), rotation=20.0), None, 1.0, turn),
        lit(Sky(35, 40), rotation=20.0 + turn),
    )
    np.testing.assert_allclose(later.environment_frame, before.environment_frame, rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(later.environment, before.environment)


def test_sky_strings_are_parsed():
    sky = parse_sky("sky:30.5,120").sky
    assert (sky.sun_elevation, sky.sun_azimuth) == (30.5, 120)
    assert parse_sky("sky:-3").sky == Sky(-3)
    for text in ("sky:", "sky:1,2,3", "sky:noon", "30"):
        with pytest.raises(SceneError, match="sky:30,120"):
            parse_sky(text)
    with pytest.raises(SceneError, match="sun_elevation is 100"):
        parse_sky("sky:100")


@pytest.mark.parametrize(
    "change", [{"dust": -1.0}, {"sun_size": 0.0}, {"air": math.nan}, {"ground_albedo": (2.0, 0.0, 0.0)}, {"ozone": 11.0}]
)
def test_numbers_out_of_range_are_named(change):
    with pytest.raises(SceneError, match=next(iter(change))):
        tabulate_environment(SceneDescription(environment=Environment(sky=replace(Sky(), **change))))


def test_sky_replaces_the_files_environment(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    description = read(tmp_path, "a.obj", "sky:20")
    assert description.environment == Environment(sky=Sky(20))
    assert Image not in map(type, description.images)
    assert compile_scene(description).environment.shape == (512, 1024, 3)
