"""Tests of scattering inside glTF objects, by two Khronos drafts and as Blender exports it."""

import math

import numpy as np
import pytest

from tests.renderer.scene.builders import TRIANGLE, Gltf

VOLUME = {"thicknessFactor": 1, "attenuationColor": [0.5, 0.25, 0.9], "attenuationDistance": 0.1}
EXTINCT = -np.log([0.5, 0.25, 0.9]) / 0.1
MULTIPLE = [0.8, 0.5, 0.0]


@pytest.fixture
def look(scene):
    """Returns a function `look(NAME={...}, ...)` that reads a material with the extensions KHR_materials_NAME.

    A NAME that begins with RAYFARM is the full name of the extension.
    """

    def make(color=(0.1, 0.2, 0.3, 1.0), **extensions):
        g = Gltf()
        names = {name if name.startswith("RAYFARM") else f"KHR_materials_{name}": said for name, said in extensions.items()}
        g.material(pbrMetallicRoughness={"baseColorFactor": list(color)}, extensions=names)
        g.mesh(TRIANGLE, material=0)
        g.root["extensionsUsed"] = list(names)
        description = scene("a.glb", g.glb())
        assert [w for w in description.warnings if "no light" not in w] == []
        return description.materials[0]

    return make


def single(multiple, g=0.0):
    """Returns the single-scattering albedo for a multiple-scattering colour, by the drafts' formula."""
    s = 4.09712 + 4.20863 * multiple - math.sqrt(9.59217 + 41.6808 * multiple + 17.7126 * multiple**2)
    return (1 - s * s) / (1 - g * s * s)


@pytest.mark.parametrize("name", ["volume_scatter", "scatter"])
def test_volume_attenuation_is_split_into_scattering_and_absorption(look, name):
    said = {"multiscatterColor": MULTIPLE} if name == "volume_scatter" else {"multiscatterColorFactor": [1.0, 0.625, 0.0]}
    said |= {"scatterAnisotropy": 0.5, "scatterStrengthFactor": 0.8}
    found = look(transmission={"transmissionFactor": 1}, volume=VOLUME, **{name: said})
    albedo = np.array([single(m, 0.5) for m in MULTIPLE])
    assert 0 < albedo[1] < albedo[0] < 1
    np.testing.assert_allclose(found.sigma_s, EXTINCT * albedo, atol=1e-9)
    np.testing.assert_allclose(found.sigma_a, EXTINCT * (1 - albedo), atol=1e-9)
    assert (found.g, found.attenuation_distance, found.subsurface) == (0.5, math.inf, 0)


def test_diffuse_transmission_becomes_subsurface_scattering(look):
    through = {"diffuseTransmissionFactor": 0.5, "diffuseTransmissionColorFactor": [1, 0.5, 1]}
    scatter = {"multiscatterColor": MULTIPLE, "scatterAnisotropy": 0.2}
    found = look(diffuse_transmission=through, volume=VOLUME, volume_scatter=scatter)
    np.testing.assert_allclose(found.base_color, (0.45, 0.225, 0.15))
    np.testing.assert_allclose(found.subsurface_radius, 1 / EXTINCT)
    assert (found.subsurface, found.subsurface_anisotropy, found.diffuse_transmission) == (0.5, 0.2, 0)
    assert (found.sigma_s, found.attenuation_distance) == ((0, 0, 0), math.inf)


def test_thin_sheet_scatters_to_both_sides(look):
    """A sheet without a volume scatters the light that it does not transmit clearly: (1 + g) / 2 of it forwards, the rest back.

    Energy is conserved.
    """
    scatter = {"multiscatterColorFactor": [0.4, 0.8, 1.0], "scatterStrengthFactor": 1, "scatterAnisotropy": 0.5}
    found = look(transmission={"transmissionFactor": 0.8}, scatter=scatter)
    onwards = 0.8 * 0.75
    assert (found.transmission, found.diffuse_transmission) == (0, pytest.approx(onwards))
    assert found.diffuse_transmission_color == (0.4, 0.8, 1.0)
    back = 0.2 * np.array([0.1, 0.2, 0.3]) + 0.8 * 0.25 * np.array([0.4, 0.8, 1.0])
    np.testing.assert_allclose(np.array(found.base_color) * (1 - onwards), back)
    assert look(transmission={"transmissionFactor": 0.8}, scatter={}).transmission == 0.8


def test_no_scattering_without_a_volume(look):
    found = look(transmission={"transmissionFactor": 1}, volume_scatter={"multiscatterColor": MULTIPLE})
    assert (found.sigma_s, found.sigma_a) == ((0, 0, 0), (0, 0, 0))


def test_blender_scattering_extensions(look):
    found = look(
        RAYFARM_materials_medium={"sigmaA": [1, 2, 3], "sigmaS": [4, 5, 6], "g": -0.5, "isInterface": True},
        RAYFARM_materials_subsurface={
            "subsurfaceFactor": 0.75,
            "subsurfaceRadius": [0.3, 0.2, 0.1],
            "subsurfaceAnisotropy": 2,
        },
    )
    assert (found.kind, found.sigma_a, found.sigma_s, found.g) == ("interface", (1, 2, 3), (4, 5, 6), -0.5)
    assert (found.subsurface, found.subsurface_radius, found.subsurface_anisotropy) == (0.75, (0.3, 0.2, 0.1), 0.999)


def test_blender_hair_extension(look):
    found = look(RAYFARM_materials_hair={"betaM": 0.25, "betaN": 7, "tilt": 0.1, "ior": 1.4})
    assert (found.kind, found.beta_m, found.beta_n, found.tilt, found.ior) == ("hair", 0.25, 1.0, 0.1, 1.4)
    assert found.base_color == (0.1, 0.2, 0.3)
    assert (found.model, found.roughness, found.aspect_ratio) == ("chiang", 1.0, 1.0)
    found = look(RAYFARM_materials_hair={"model": "huang", "alpha": 0.25, "aspectRatio": 2.0, "tt": 0.5, "betaN": 0.4})
    assert (found.model, found.roughness, found.aspect_ratio) == ("huang", 0.5, 0.5)
    assert (found.r, found.tt, found.trt, found.beta_n) == (1.0, 0.5, 1.0, 0.4)


def test_blender_medium_is_attenuated_once(look):
    """A material in a medium of Blender's is attenuated only once.

    Blender's exporter writes the colour of the same nodes also as attenuation, which is ignored.
    """
    found = look(
        transmission={"transmissionFactor": 1},
        volume={"thicknessFactor": 1, "attenuationColor": [0.2, 0.7, 0.9], "attenuationDistance": 1.25},
        RAYFARM_materials_medium={"sigmaA": [0.64, 0.24, 0.08], "sigmaS": [0, 0, 0], "g": 0, "isInterface": False},
    )
    assert (found.sigma_a, found.attenuation_color, found.attenuation_distance) == ((0.64, 0.24, 0.08), (1, 1, 1), math.inf)
