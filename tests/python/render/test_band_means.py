"""Bands as means over intervals: the photocurrent of ColorChecker patches after one and two reflections against dense
sums, how many bands a scene gets, and a render of 3 bands against 61."""

import json

import numpy as np
import pecs
import pytest
from pecs_blender.spectral import bands, spectra
from support import pecs_blender

LAMPS = ("a", "d65", "fl2", "led_b3")


@pytest.fixture(scope="module")
def chip():
    with pecs.Chip("imx636") as chip:
        yield chip


@pytest.fixture(scope="module")
def patches(root):
    names = sorted(p.stem for p in (root / "lens_data/spectra/colorchecker").glob("*.csv"))
    assert len(names) == 24
    return [spectra.load(f"colorchecker/{name}") for name in names]


def colours(surfaces, lamps, shares=None):
    shares = np.ones(len(lamps)) if shares is None else np.array(shares)
    return bands.Colours([s.reflectance for s in surfaces], np.ones(len(surfaces)), lamps, shares)


def choose(chip, count, found, tolerance=0.02):
    return bands.means(chip, count, found, 400, 700, tolerance)


def log_rms_percent(chip, chosen, lamp, products):
    """products: lists of reflectances that multiply. Photocurrent as the sensor sums it, against sums at 0.5 nm."""
    amperes = chip.amperes_per_unit(chosen.entries)
    light = chosen.bands.light(lamp)
    fine = np.arange(400.25, 700, 0.5)
    response = np.array(chip.amperes_per_unit([{"lambda_nm": x, "weight_nm": 0.5} for x in fine]))
    got = [np.sum(amperes * light * np.prod([chosen.bands.reflectance(s) for s in p], axis=0)) for p in products]
    true = [np.sum(response * lamp(fine) * np.prod([s.reflectance(fine) for s in p], axis=0)) for p in products]
    return 100 * float(np.std(np.log(got) - np.log(true)))


def test_shares_of_bands_are_those_of_the_photocurrent(chip, patches):
    lamp = spectra.load("d65")
    chosen = choose(chip, 6, colours(patches, [lamp]))
    amperes = np.array(chip.amperes_per_unit(chosen.entries))
    seen = [amperes * chosen.bands.light(lamp) * chosen.bands.reflectance(s) for s in patches]
    seen = np.array([one / one.sum() for one in seen])[:, 3:]
    found = chosen.shares(slice(3, 6))
    assert found["band_shares"] == pytest.approx(seen.mean(0) / seen.mean(0).sum(), rel=1e-3)
    # By hand: how much of the light up to each border each patch has too much, weighted by its light in these bands.
    weights = seen.sum(1)
    off = seen[:, :2].cumsum(1) / weights[:, None] - np.cumsum(found["band_shares"])[:2]
    assert found["share_spreads"] == pytest.approx(np.sqrt(weights @ off**2 / weights.sum()), rel=1e-3)
    assert min(found["share_spreads"]) > 0.01

    alone = choose(chip, 3, colours(patches[:1], [lamp])).shares(slice(0, 3))
    assert alone["share_spreads"] == pytest.approx([0, 0])
    assert bands.at_points(chip, 3, "gauss", None, None, None).shares(slice(0, 3)) == {}


@pytest.mark.parametrize("name", LAMPS)
def test_direct_light_is_exact_and_two_reflections_are_close(chip, patches, name):
    lamp = spectra.load(name)
    direct, twice = [[s] for s in patches], [[a, b] for a in patches for b in patches]
    errors = {}
    for count in (3, 6, 12):
        chosen = choose(chip, count, colours(patches, [lamp]))
        assert log_rms_percent(chip, chosen, lamp, direct) < 0.02
        errors[count] = log_rms_percent(chip, chosen, lamp, twice)
        assert len(chosen.entries) == count == len(chosen.edges_nm) - 1
    equal = bands.Problem(chip, colours(patches, [lamp]), 400, 700)
    at_equal = log_rms_percent(chip, equal.chosen(equal._equal(3)), lamp, twice)
    gauss = bands.at_points(chip, 3, "gauss", np.stack([lamp.lambda_nm, lamp.value], 1), 400, 700)
    print(f"{name}: two reflections {errors}, 3 equal shares {at_equal:.2f} %")
    print(f"{name}: 3 Gauss bands, direct {log_rms_percent(chip, gauss, lamp, direct):.2f} %")
    assert errors[3] < 1.2 * at_equal and 2.5 < at_equal < 6
    assert errors[3] < 4 and errors[6] < 2 and errors[12] < 0.6
    assert log_rms_percent(chip, gauss, lamp, direct) > 4


def test_the_estimate_is_that_of_dense_sums(chip, patches):
    lamp = spectra.load("led_b3")
    chosen = choose(chip, 3, colours(patches, [lamp]))
    fine = chosen.bands.grid_nm
    response = np.array(chip.amperes_per_unit([{"lambda_nm": x, "weight_nm": 1.0} for x in fine])) * lamp(fine)
    amperes = chip.amperes_per_unit(chosen.entries) * chosen.bands.light(lamp)
    errors = []
    for a in patches:
        for b in patches:
            f, g, fk, gk = a.reflectance(fine), b.reflectance(fine), *(chosen.bands.reflectance(s) for s in (a, b))
            errors.append(np.log(np.sum(amperes * fk * (1 + gk + gk**2)) / np.sum(response * f * (1 + g + g**2))))
    assert chosen.rms == pytest.approx(np.std(errors), rel=1e-3)
    assert chosen.largest == pytest.approx(np.abs(errors - np.mean(errors)).max(), rel=1e-3)


def test_as_many_bands_as_the_scene_requires(chip, patches):
    """Grey surfaces: one pass. Saturated ones need more for a smaller tolerance; two lamps need more than one."""
    lamp, other = spectra.load("led_b3"), spectra.load("a")
    grey = choose(chip, None, colours([spectra.constant(0.1), spectra.constant(0.8)], [lamp, other]))
    assert len(grey.entries) == 3 and grey.rms < 1e-12
    counts = [len(choose(chip, None, colours(patches, [lamp]), t).entries) for t in (0.02, 0.005, 0.001)]
    assert counts[0] == 3 and counts == sorted(counts) and counts[2] > counts[0]
    for tolerance in (0.02, 0.005):
        assert choose(chip, None, colours(patches, [lamp]), tolerance).rms <= tolerance
    assert choose(chip, 3, colours(patches, [lamp, other])).rms > choose(chip, 3, colours(patches, [lamp])).rms


def test_lamps_count_by_their_share(chip, patches):
    """A band's reflectance is weighted by the mixture, which the strong lamp dominates."""
    lamp, other = spectra.load("led_b3"), spectra.load("a")
    direct = [[s] for s in patches]
    errors = []
    for share in (0.5, 0.01, 0.0):
        chosen = choose(chip, 3, colours(patches, [lamp, other], [1 - share, share]))
        errors.append(log_rms_percent(chip, chosen, lamp, direct))
    assert errors[0] > errors[1] > errors[2] and errors[2] < 0.02


def test_filters_of_a_lamp_are_exact(chip):
    """Light of an RGB colour, seen directly."""
    lamp, rgb = spectra.load("d65"), np.array([0.9, 0.2, 0.05])
    chosen = choose(chip, 3, colours([spectra.constant(0.5)], [lamp]))
    got = np.sum(chip.amperes_per_unit(chosen.entries) * chosen.bands.light(lamp) * (chosen.bands.filtered(lamp) @ rgb))
    fine = np.arange(400.25, 700, 0.5)
    response = np.array(chip.amperes_per_unit([{"lambda_nm": x, "weight_nm": 0.5} for x in fine]))
    assert got == pytest.approx(np.sum(response * lamp(fine) * (spectra.srgb_reflectances(fine) @ rgb)), rel=1e-3)


def test_refused(chip):
    found = colours([spectra.constant(0.5)], [spectra.load("d65")])
    for count, low, high in ((200, 400, 700), (3, 600, 500), (3, 100, 700)):
        with pytest.raises(pecs.PecsInputError):
            bands.means(chip, count, found, low, high, 0.02)


@pytest.fixture(scope="module")
def rendered(root, tmp_path_factory):
    """ln(photocurrent) of scenes/colorchecker_disk with the options, and stack.json."""
    folder = tmp_path_factory.mktemp("means")

    def run(*options):
        out = folder / str(len(list(folder.iterdir())))
        args = ["--lens", "none", "--focal", "25mm", "--frames", 1, "--width", 80, "--samples", 4]
        args += ["--set", "rpm=0", "--max-wavelength", "700nm", *options]
        result = pecs_blender("render", root / "scenes/colorchecker_disk", "-o", out, *args)
        with pecs.Chip("imx636") as chip:
            light = chip.photocurrent(out, 0, fnumber=8.0)
        return np.log(light.astype(float)), json.loads((out / "stack.json").read_text()), result.stderr

    return run


def test_one_pass_renders_the_chart(rendered):
    """Also where patches are lit by the grey walls."""
    reference, _, _ = rendered("--bands", 61, "--placement", "uniform")
    ours, stack, told = rendered()
    points, _, _ = rendered("--bands", 3, "--placement", "gauss")
    error, of_points = (100 * float(np.std(light - reference)) for light in (ours, points))
    print(f"3 means {error:.3f} % RMS, 3 Gauss bands {of_points:.2f} %")
    assert np.ptp(reference) > np.log(10)
    assert error < 0.1 and of_points > 3
    assert len(stack["bands"]) == 3 and "3 bands in 1 pass" in told
    assert stack["render"]["band_edges_nm"][0] == 400 and 0 < stack["render"]["band_error"]["rms"] <= 0.025
    _, grey, _ = rendered("--set", "grey=1")
    assert len(grey["bands"]) == 3 and grey["render"]["band_error"]["rms"] == 0


def test_single_wavelengths_need_a_number(root, tmp_path):
    args = ("render", root / "scenes/rotating_disk", "-o", tmp_path / "s", "--placement", "gauss")
    result = pecs_blender(*args, check=False)
    assert result.returncode == 2 and "--bands" in result.stderr
