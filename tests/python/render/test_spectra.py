"""The spectral library against colour-science, and what the renderer makes of it."""

import numpy as np
import pytest

light = pytest.importorskip("pecs_blender.spectral.emitters")
spectra = pytest.importorskip("pecs_blender.spectral.spectra")
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


def test_a_blackbody_is_planck_and_near_a(colour):
    planck = colour.sd_blackbody(2855.5, colour.SpectralShape(400, 700, 5)).values
    seen = relative(spectra.load("blackbody:2855.5")(NM))
    assert seen == pytest.approx(relative(planck), rel=1e-3)
    assert seen == pytest.approx(relative(spectra.load("a")(NM)), rel=2e-3)


def test_daylight_is_the_cies(colour):
    assert relative(spectra.load("daylight:6504")(NM)) == pytest.approx(relative(spectra.load("d65")(NM)), rel=5e-3)


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


@pytest.mark.parametrize("name", ["N-BK7", "N-SF11"])
def test_glass_has_the_catalogues_formula(name):
    """Sellmeier's formula with Schott's coefficients. A fit through n_d and the Abbe number is off by up to 0.02."""
    data = {
        "N-BK7": (1.03961212, 0.231792344, 1.01046945, 0.00600069867, 0.0200179144, 103.560653),
        "N-SF11": (1.73759695, 0.313747346, 1.89878101, 0.013188707, 0.0623068142, 155.23629),
    }[name]
    for nm in (400, 486.13, 587.56, 656.27, 900):
        um2 = (nm / 1000) ** 2
        n = np.sqrt(1 + sum(data[i] * um2 / (um2 - data[i + 3]) for i in range(3)))
        assert spectra.glass(name, 1.5)(nm) == pytest.approx(n, abs=1e-5)


def test_glass_of_an_abbe_number_keeps_the_shaders_index():
    index = spectra.glass(64.2, 1.52)
    assert index(587.56) == pytest.approx(1.52, abs=1e-5)
    assert (index(587.56) - 1) / (index(486.13) - index(656.27)) == pytest.approx(64.2, rel=1e-3)
    assert index(300.0) == index(350.0)


def test_a_csv_is_read_as_by_the_program(tmp_path):
    """Comments behind a row and spaces instead of commas are allowed."""
    (tmp_path / "lamp.csv").write_text("wavelength_nm,value\n450,0.3  # peak\n550 0.6\n")
    assert spectra.load("lamp.csv", tmp_path)(500.0) == pytest.approx(0.45)
