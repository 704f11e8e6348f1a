"""Wavelengths: the log photocurrents of the 24 ColorChecker patches, bands against dense sums; without rendering, and
rendered by Cycles."""

import json

import numpy as np
import pecs
import pytest
from support import pecs_blender

LAMPS = ("a", "d65", "fl2", "led_b3")


@pytest.fixture(scope="module")
def patches(root):
    folder = root / "lens_data" / "spectra"

    def read(name):
        return np.loadtxt(folder / f"{name}.csv", delimiter=",", skiprows=2).T

    names = sorted(p.stem for p in (folder / "colorchecker").glob("*.csv"))
    assert len(names) == 24
    return read, [read(f"colorchecker/{name}") for name in names]


def response(chip="imx636"):
    """lambda * QE of the chip file, as a function."""
    folder = pecs.data_dir("sensor/chips")
    curve = json.loads((folder / f"{chip}.json").read_text())["relative_qe"]
    return lambda nm: nm * np.interp(nm, curve["lambda_nm"], curve["value"], left=0, right=0)


def log_currents(nm, weight_nm, lamp, patches):
    light = weight_nm * response()(nm) * np.interp(nm, *lamp, left=0, right=0)
    return np.log([np.sum(light * np.interp(nm, *patch)) for patch in patches])


def rms(error):
    return float(np.std(error))  # a common factor is the gain


# In %, 400-700 nm: uniform with 31 bands, Gauss with 6, 9, 12; measured once on another set of ColorChecker data.
PUBLISHED = {
    "a": (1.2, 1.6, 0.43, 0.09),
    "d65": (0.80, 1.7, 0.64, 0.15),
    "fl2": (2.4, 2.1, 0.51, 0.25),
    "led_b3": (0.27, 2.0, 0.63, 0.12),
}


def error_percent(bands, nm, lamp, reflectances):
    at = np.array([[b["lambda_nm"], b["weight_nm"]] for b in bands]).T
    return 100 * rms(log_currents(*at, lamp, reflectances) - log_currents(nm, 1.0, lamp, reflectances))


@pytest.mark.parametrize("name", LAMPS)
def test_twelve_gauss_bands_beat_31_uniform_ones(patches, name):
    read, reflectances = patches
    lamp, nm = read(name), np.arange(400.0, 701.0)
    uniform = error_percent([{"lambda_nm": x, "weight_nm": 10.0} for x in nm[::10]], nm, lamp, reflectances)
    gauss = [error_percent(pecs.bands(n=n, illuminant=lamp.T, max_nm=700), nm, lamp, reflectances) for n in (6, 9, 12)]
    print(f"{name}: uniform 31 {uniform:.2f} %, Gauss 6, 9, 12: " + ", ".join(f"{e:.2f} %" for e in gauss))
    assert gauss[-1] <= 0.3 and gauss[-1] < uniform
    for seen, published in zip((uniform, *gauss), PUBLISHED[name], strict=True):
        assert abs(seen - published) < 0.5


@pytest.mark.parametrize("name", LAMPS)
def test_beyond_700_nm(patches, name):
    """Silicon sees on to where the lamp ends: stopping at 700 nm misses colour; 16 bands hold it."""
    read, reflectances = patches
    lamp, nm = read(name), np.arange(400.0, 781.0)
    stopped = error_percent([{"lambda_nm": x, "weight_nm": 10.0} for x in nm[:301:10]], nm, lamp, reflectances)
    gauss = [error_percent(pecs.bands(n=n, illuminant=lamp.T), nm, lamp, reflectances) for n in (12, 16)]
    print(f"{name}: 31 uniform to 700 nm {stopped:.2f} %, Gauss 12, 16 to 780 nm {gauss[0]:.2f} %, {gauss[1]:.2f} %")
    assert stopped > 2 and gauss[0] < 0.9 and gauss[1] <= 0.4


@pytest.fixture(scope="module")
def rendered(root, tmp_path_factory):
    """Log photocurrent of the 24 sectors of scenes/colorchecker_disk, as rendered with n bands."""
    folder = tmp_path_factory.mktemp("bands")

    def run(lamp, n):
        out = folder / f"{lamp}_{n}"
        args = ["--lens", "none", "--focal", 25, "--placement", "gauss", "--bands", n, "--frames", 1]
        args += ["--width", 80, "--samples", 4]
        args += ["--set", "rpm=0", "--set", f"lamp_spectrum={lamp}", "--max-wavelength", 700]
        pecs_blender("render", root / "scenes/colorchecker_disk", "-o", out, *args)
        with pecs.StackReader(out) as stack:
            frame, bands = stack.read_frame(0).astype(float), stack.info["bands"]
        nm, weight_nm = (np.array([b[key] for b in bands]) for key in ("lambda_nm", "weight_nm"))
        picture = np.einsum("k,kyx->yx", weight_nm * response()(nm), frame)
        # Sector i lies at (15 i + 7.5) deg, counter-clockwise from the right; its middle, at 0.7 of the rim
        height, width = picture.shape
        radius_px = 0.7 * 0.153 / 1.56 * 25 / (6.2208 / width)
        angles = np.radians(15 * np.arange(24) + 7.5)
        columns = (width / 2 + radius_px * np.cos(angles)).astype(int)
        rows = (height / 2 - radius_px * np.sin(angles)).astype(int)
        return np.log(picture[rows, columns])

    return run


@pytest.mark.parametrize("lamp", ["fl2", "led_b3"])  # the steepest; the sums above have all
def test_cycles_renders_agree(rendered, lamp):
    """400-700 nm. Same pixels, seed and samples: what differs is the wavelengths alone."""
    reference = rendered(lamp, 61)
    error = 100 * rms(rendered(lamp, 12) - reference)
    print(f"{lamp}: 12 Gauss bands against 61: {error:.3f} % RMS")
    assert np.ptp(reference) > np.log(10)  # white to black
    assert error <= 0.3
