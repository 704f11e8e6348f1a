"""The spectral library against colour-science, and what the renderer makes of it."""

import numpy as np
import pytest
from pecs_blender.spectral import emitters as light
from pecs_blender.spectral import spectra

NM = np.arange(400.0, 701.0, 5)


@pytest.fixture(scope="module")
def colour():
    return pytest.importorskip("colour")


def relative(values):
    return np.asarray(values) / np.mean(values)


@pytest.mark.parametrize("name", "a d50 d65 e fl2 fl11 led_b1 led_b2 led_b3 led_b4 led_b5".split())
def test_illuminants(colour, name):
    reference = colour.SDS_ILLUMINANTS[name.upper().replace("_", "-")]
    assert relative(spectra.load(name)(NM)) == pytest.approx(relative([reference[x] for x in NM]), rel=1e-4)


def test_the_band_matrix_gives_back_its_rgb(colour):
    """Under D65, a reflectance made from sRGB has that sRGB (Mallett & Yuksel: exactly; the 5 nm table: nearly)."""
    nm = np.arange(380.0, 781.0, 5)
    matrix = spectra.srgb_reflectances(nm)
    assert matrix.sum(axis=1) == pytest.approx(1, abs=1e-12) and matrix.min() >= 0
    cmfs = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    d65 = spectra.load("d65")(nm)
    xyz_bar = np.array([cmfs[x] for x in nm]) * d65[:, None]
    xyz = xyz_bar.T @ matrix / xyz_bar[:, 1].sum()
    rgb = np.linalg.inv(colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ) @ xyz
    assert rgb == pytest.approx(np.eye(3), abs=2e-3)


def test_outside_its_table_a_power_is_zero_and_a_reflectance_holds():
    red = spectra.load("colorchecker/red")
    assert red(900.0) == 0 and red.reflectance(900.0) == red.value[-1]


def test_lamps_of_different_spectra_are_equally_bright():
    emitters = light.Emitters(spectra.load("d65"))
    for name in ("a", "fl2", "blackbody:5000"):
        emitters.add(spectra.load(name))
        v = spectra.load("photopic")(spectra.VISIBLE_NM)
        assert np.sum(v * emitters.power(name, spectra.VISIBLE_NM)) == pytest.approx(1)
    assert len(emitters.mean_pairs()) > 100


def test_glass_of_an_abbe_number_keeps_the_shaders_index():
    index = spectra.glass(64.2, 1.52)
    assert index(587.56) == pytest.approx(1.52, abs=1e-5)
    assert (index(587.56) - 1) / (index(486.13) - index(656.27)) == pytest.approx(64.2, rel=1e-3)
    assert index(300.0) == index(350.0)
