"""Bands: quadrature against a dense sum."""

import json
import subprocess

import numpy as np
import pecs
import pytest


def weights(**options):
    found = pecs.bands(**options)
    return np.array([[b["lambda_nm"], b["weight_nm"]] for b in found]).T


def test_gauss_is_exact_for_polynomials():
    """Under weight lambda QE E, n nodes integrate degree 2n - 1; checked with E = 1 on the flat chip: weight lambda."""
    lam, w = weights(chip="ideal", n=4, min_nm=400, max_nm=700)
    fine = np.arange(400.0, 701.0)
    ends = np.where((fine == 400) | (fine == 700), 0.5, 1.0)
    for degree in range(8):
        exact = (ends * fine * ((fine - 550) / 150) ** degree).sum()
        assert (w * lam * ((lam - 550) / 150) ** degree).sum() == pytest.approx(exact, rel=1e-9, abs=1e-6)


def test_a_lamp_divides_out(root):
    """With a lamp, smooth reflectances are integrated exactly however rough the lamp."""
    chip = json.loads((root / "sensor/chips/imx636.json").read_text())["relative_qe"]
    dense = np.arange(400.0, 901.0)
    lamp = 1 + 0.9 * np.sin(dense / 7)
    lam, w = weights(n=3, illuminant=list(zip(dense, lamp, strict=True)))

    def photocurrent(at, weight):
        reflectance = 0.5 + ((at - 650) / 300) ** 2 + ((at - 650) / 500) ** 5
        return (
            weight * at * np.interp(at, chip["lambda_nm"], chip["value"]) * np.interp(at, dense, lamp) * reflectance
        ).sum()

    ends = np.where((dense == 400) | (dense == 900), 0.5, 1.0)
    assert photocurrent(lam, w) == pytest.approx(photocurrent(dense, ends), rel=1e-9)


def test_uniform():
    lam, w = weights(n=30, placement="uniform", min_nm=400, max_nm=700)
    np.testing.assert_allclose(lam, 405 + 10 * np.arange(30))
    np.testing.assert_allclose(w, 10)


def test_lamps_have_names(root, pecs_program):
    """The library's table and its name are one; a name that is not there is answered with those that are."""
    by_name, by_file = (
        pecs_program("bands", "--illuminant", lamp, "-n", 9, "--json")
        for lamp in ("led_b3", root / "lens_data/spectra/led_b3.csv")
    )
    assert by_name.returncode == 0, by_name.stderr
    assert by_name.stdout == by_file.stdout
    missing = pecs_program("bands", "--illuminant", "candle")
    assert missing.returncode == 3 and "led_b3" in missing.stderr and len(missing.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"chip": "nope"}, 3),
        ({"n": 0}, 4),
        ({"n": 500}, 4),
        ({"illuminant": [(400, 1), (390, 1)]}, 4),
        ({"min_nm": 1}, 4),
    ],
)
def test_refused(options, code):
    with pytest.raises(pecs.PecsError) as e:
        pecs.bands(**options)
    assert e.value.code == code


@pytest.mark.parametrize("lamp", ["led_b3", "blackbody:2856", "daylight:9300", "lamp.csv"])
def test_both_programs_know_the_same_lamps(lamp, python, pecs_program, tmp_path):
    (tmp_path / "lamp.csv").write_text("# mine\nwavelength_nm,value\n400,1\n500,3\n900,2\n")
    options = ("bands", "--illuminant", lamp, "-n", "5", "--json")
    ours = pecs_program(*options, cwd=tmp_path, check=True)
    done = subprocess.run([python, "-m", "pecs_blender", *options], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for a, b in zip(json.loads(ours.stdout)["bands"], json.loads(done.stdout)["bands"], strict=True):
        assert a == pytest.approx(b, rel=1e-9)
    if lamp != "lamp.csv":
        assert pecs.bands(illuminant=lamp, n=5) == json.loads(ours.stdout)["bands"]


@pytest.mark.parametrize(
    ("lamp", "words"),
    [("blackbody:hot", "blackbody:T"), ("daylight:100", "4000"), ("d99", "led_b3"), ("x.csv", "x.csv")],
)
def test_unknown_lamps_are_named(lamp, words, pecs_program, tmp_path):
    result = pecs_program("bands", "--illuminant", lamp, cwd=tmp_path)
    assert result.returncode in (3, 4) and words in result.stderr and result.stderr.count("\n") == 1
