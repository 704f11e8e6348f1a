"""Spectra and refractive indices by name."""

import numpy as np
import pecs
import pytest


def test_a_blackbody_is_planck_s():
    nm, power = pecs.spectrum("blackbody:2856")
    planck = nm**-5.0 / np.expm1(1.438776877e7 / (nm * 2856))
    np.testing.assert_allclose(power / power.max(), planck / planck.max(), rtol=1e-12)
    peak_nm = 2.897771955e6 / 5000  # Wien
    at = np.arange(400.0, 800.0)
    assert abs(at[np.argmax(pecs.spectrum("blackbody:5000", at))] - peak_nm) < 5
    assert pecs.spectrum("blackbody:2856", 560) == pytest.approx(100)


def test_names_files_and_tables(tmp_path):
    daylight = pecs.spectrum("daylight:6504", np.arange(400, 701, 10))
    np.testing.assert_allclose(daylight, pecs.spectrum("d65", np.arange(400, 701, 10)), rtol=0.01)
    (tmp_path / "lamp.csv").write_text("wavelength_nm,value\nwavelength_nm,again\n450,0.3  # peak\n\n550 0.9\n")
    found = pecs.spectrum(tmp_path / "lamp.csv", [[440, 450], [500, 600]])
    np.testing.assert_allclose(found, [[0, 0.3], [0.6, 0]])
    assert pecs.spectrum("basis/srgb").shape[0] == 4
    np.testing.assert_allclose(pecs.spectrum("basis/srgb", [500, 600]).sum(0), 1, atol=0.01)
    with pytest.raises(pecs.PecsNotFoundError, match="d65"):
        pecs.spectrum("d66")
    (tmp_path / "bad.csv").write_text("450,0.3\n440,0.4\n")
    with pytest.raises(pecs.PecsInputError, match="line 2"):
        pecs.spectrum(tmp_path / "bad.csv")


def test_glass_has_the_manufacturer_s_formula():
    """N-BK7: Schott's data sheet, n_F, n_d, n_C, n_t."""
    at = [486.1327, 587.5618, 656.2725, 1013.98]
    np.testing.assert_allclose(pecs.glass("N-BK7", at), [1.52238, 1.51680, 1.51432, 1.50731], atol=1e-5)
    assert np.array_equal(pecs.glass("schott/N-BK7", at), pecs.glass("N-BK7", at))
    assert pecs.glass("N-BK7", 550).shape == ()
    np.testing.assert_allclose(pecs.glass((1.5168, 64.17), at[:3]), pecs.glass("N-BK7", at[:3]), atol=2e-5)
    with pytest.raises(pecs.PecsNotFoundError, match="schott"):
        pecs.glass("N-NOSUCH", 550)
    with pytest.raises(pecs.PecsInputError, match="its formula"):
        pecs.glass("N-BK7", 5000)
    with pytest.raises(pecs.PecsInputError, match="vd"):
        pecs.glass((1.5, 1.0), 550)
