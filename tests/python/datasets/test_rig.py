"""Calibration that a data set writes, against OpenCV; RGB film against its own arithmetic."""

import json

import cv2
import numpy as np
import pecs
import pytest
from pecs.datasets import rgb, rig
from pecs.datasets.plan import generator
from pecs.datasets.recipe import Film
from pecs.datasets.table import Value
from scipy.ndimage import map_coordinates

NM = (430.0, 480.0, 530.0, 580.0, 630.0, 690.0)
SIZE = 346, 260


def stack(focus_m=3.0, stop_mm=1.0):
    bands = [{"lambda_nm": nm, "weight_nm": 50.0} for nm in NM]
    lens = {"focus_m": focus_m, "stop_diameter_mm": stop_mm, "focus_bands_nm": NM}
    return {"width": SIZE[0], "height": SIZE[1], "pixel_pitch_m": 18.5e-6, "bands": bands, "lens": lens}


@pytest.fixture(scope="module", params=["cmount_5mm_f2p8", "cmount_8mm_f2p8", "pecs_lab_15mm"])
def optics(request):
    return rig.optics(stack(), request.param)


def test_opencv_projects_as_the_lens_does(optics):
    found = rig.pinhole(optics.directions)
    assert found.error_px < 0.01
    points = optics.directions[::13, ::17].reshape(-1, 3) * np.linspace(0.5, 9, 20 * 21)[:, None]
    pixels, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), found.K, found.distortion)
    v, u = np.mgrid[: SIZE[1] : 13, : SIZE[0] : 17].reshape(2, -1)
    assert np.abs(pixels[:, 0] - np.stack([u, v], -1)).max() < 0.05


def test_rectified_rows_agree_with_opencv(optics):
    """A toed-in pair: points seen by both cameras have one row, by our map and by OpenCV's stereoRectify alone."""
    found = rig.pinhole(optics.directions)
    rig_from_right = rig.rig_from_camera((0.1, 0.004, -0.003), (0.5, -3, 1))
    right_from_rig = np.linalg.inv(rig_from_right)
    pair = np.eye(4), rig_from_right
    R = [axes.T @ place[:3, :3] for axes, place in zip(map(rig.rectified_axes, pair, pair[::-1]), pair, strict=True)]
    K = rig.rectified_K([found.K, found.K], [SIZE, SIZE])
    rng = np.random.default_rng(1)
    points = rng.uniform((-0.5, -0.4, 2), (0.6, 0.4, 6), (300, 3))
    seen = points, points @ right_from_rig[:3, :3].T + right_from_rig[:3, 3]
    places = []
    for camera, rotation in zip(seen, R, strict=True):
        table = rig.rectify_map(optics.directions, rotation, K)
        pixels = optics.pixels(camera) - 0.5
        inside = ((pixels > 1) & (pixels < np.array(SIZE) - 2)).all(1)
        at = [map_coordinates(table[..., i], pixels.T[::-1], order=1) for i in (0, 1)]
        places.append(np.where(inside[:, None], np.stack(at, -1), np.nan))
    rows = places[0][:, 1] - places[1][:, 1]
    both = np.isfinite(rows)
    assert both.sum() > 100 and np.abs(rows[both]).max() < 0.02
    depth = (seen[0] @ R[0].T)[both, 2]
    disparity = places[0][both, 0] - places[1][both, 0]
    baseline = np.linalg.norm(rig_from_right[:3, 3])
    assert np.abs(disparity - K[0, 0] * baseline / depth).max() < 0.03

    r1, r2, p1, p2, *_ = cv2.stereoRectify(
        found.K, found.distortion, found.K, found.distortion, SIZE, right_from_rig[:3, :3], right_from_rig[:3, 3]
    )
    theirs = []
    for camera, r, p in zip(seen, (r1, r2), (p1, p2), strict=True):
        pixels = (optics.pixels(camera) - 0.5)[both]
        theirs.append(cv2.undistortPoints(pixels[:, None], found.K, found.distortion, R=r, P=p)[:, 0])
    assert np.abs(theirs[0][:, 1] - theirs[1][:, 1]).max() < 0.1


@pytest.mark.parametrize(
    ("position", "rotation", "axis"),
    [
        ((0, 0.1, 0), (0, 0, 0), (0, 1, 0)),
        ((0, -0.1, 0), (0, 0, 0), (0, 1, 0)),
        ((-0.1, 0.02, 0), (0, 5, 0), (0.98, -0.2, 0)),
        ((0.1, 0, 0), (0, 0, 180), (1, 0, 0)),  # upside down
    ],
)
def test_a_pair_has_one_rectification(position, rotation, axis):
    """Also one above the other, where the sign of x was each camera's own."""
    pair = np.eye(4), rig.rig_from_camera(position, rotation)
    first, second = rig.rectified_axes(*pair), rig.rectified_axes(*pair[::-1])
    assert np.allclose(first, second, atol=1e-12) and np.allclose(first[:, 0], axis, atol=0.01)
    assert np.allclose(first.T @ first, np.eye(3)) and np.linalg.det(first) > 0 and first[2, 2] > 0.9


def test_rows_of_pictures_of_two_sizes_match():
    K = [rig.rectified_K([np.eye(3)] * 2, sizes) for sizes in ([(64, 48), (96, 72)], [(96, 72), (64, 48)])]
    assert K[0][1, 2] == K[1][1, 2] and K[0][0, 2] == 31.5 and K[1][0, 2] == 47.5


def test_colours_are_those_of_the_surfaces():
    """sRGB's primaries and grey under d65 come out as they are, with six bands."""
    at, *primaries = pecs.spectrum("basis/srgb")
    info, lamp = stack(), rgb.illuminant({})
    matrix = rgb.colour_matrix(info, lamp)
    filter_nm, qe = rgb.filters()
    power = np.interp(NM, *lamp)
    for colour in np.vstack([np.eye(3), [[1, 1, 1], [0.2, 0.5, 0.1]]]):
        light = power * (np.array([np.interp(NM, at, column) for column in primaries]).T @ colour)
        seen = np.array([np.interp(NM, filter_nm, q) for q in qe.T]) @ (light * NM * 50)
        got = matrix @ seen
        assert np.allclose(got / got.max(), colour / colour.max(), atol=1e-9)


@pytest.mark.parametrize("name", ["blackbody:2856", "led_b1", "own.csv"])
def test_white_is_that_of_the_lamps(name, tmp_path):
    """Grey is neutral under a blackbody, a lamp of the library and one of a file, as stack.json records them."""
    own = tmp_path / "own.csv"
    own.write_text("wavelength_nm,value\n400,0.1  # weak\n700 3\n")
    nm, power = pecs.spectrum(own if name == "own.csv" else name)
    info = stack() | {"render": {"emitters": [name.removesuffix(".csv")], "lamps": np.stack([nm, power], 1).tolist()}}
    matrix = rgb.colour_matrix(info, rgb.illuminant(info))
    filter_nm, qe = rgb.filters()
    light = np.interp(NM, nm, power, left=0, right=0)
    grey = matrix @ (np.array([np.interp(NM, filter_nm, q) for q in qe.T]) @ (light * NM * 50))
    assert np.allclose(grey / grey.max(), 1, atol=1e-9)


def test_two_bands_in_the_visible_give_two_colours():
    """The last of three bands is behind the filters' cut: grey is neutral, red and green are so, and pictures are
    developed."""
    bands = [{"lambda_nm": nm, "weight_nm": of} for nm, of in ((528.2, 156.5), (627.9, 87.8), (721.7, 101.8))]
    nm = np.array([band["lambda_nm"] for band in bands])
    matrix = rgb.colour_matrix({"bands": bands}, pecs.spectrum("blackbody:2856"))
    filter_nm, qe = rgb.filters()
    light = np.interp(nm, *pecs.spectrum("blackbody:2856")) * nm * [band["weight_nm"] for band in bands]
    at, red, green, _ = pecs.spectrum("basis/srgb")

    def filtered(reflectance):
        return np.array([np.interp(nm, filter_nm, q, left=0, right=0) for q in qe.T]) @ (light * reflectance)

    grey, r, g = (matrix @ filtered(of) for of in (np.ones(3), np.interp(nm, at, red), np.interp(nm, at, green)))
    assert np.allclose(grey / grey.max(), 1, atol=1e-9) and r.argmax() == 0 and g[1] > 2 * g[0]
    planes = np.tile(filtered(np.full(3, 0.5))[:, None, None], (1, 8, 8)).astype(np.float32)
    planes *= 3000 * rgb.ELECTRON_C / 5e-3 / planes.max()
    picture = rgb.Developer(film(), 5.0, matrix, [planes], generator(1, 0, "x")).sharp(planes)
    assert np.ptp(picture.astype(int), -1).max() <= 1 and picture.min() > 200


def test_srgb_is_opencolorios():
    import PyOpenColorIO

    config = PyOpenColorIO.Config.CreateFromFile("ocio://cg-config-v2.1.0_aces-v1.3_ocio-v2.3")
    encode = config.getProcessor("Linear Rec.709 (sRGB)", "sRGB - Texture").getDefaultCPUProcessor()
    light = np.repeat(np.linspace(0, 1, 4001)[:, None], 3, axis=1)
    theirs = np.array(encode.applyRGB(light.astype(np.float32).ravel().tolist())).reshape(light.shape)
    assert np.abs(rgb.srgb(light) - 255 * theirs).max() < 0.501


def test_the_filters_chip_weighs_as_the_matrix_does(tmp_path):
    """Amperes per band of the chip that pecs reads, over those of rgb.filters: one constant."""
    filter_nm, qe = rgb.filters()
    currents, weights = [], []
    for i in range(3):
        path = rgb.write_chip(tmp_path / f"{i}.json", i, *SIZE, 18.5, 0.6)
        with pecs.Chip(path) as chip:
            amperes = np.array(chip.amperes_per_unit(stack()["bands"]))
        weights.append(np.interp(NM, filter_nm, qe[:, i]) * NM)
        currents.append(amperes)
    scale = np.sum(currents) / np.sum(weights)
    assert np.allclose(np.array(currents), scale * np.array(weights), rtol=1e-4, atol=0)
    assert json.loads((tmp_path / "0.json").read_text())["values"]["width"]["value"] == SIZE[0]


def film(**changes):
    fixed = Value("fixed", (5.0,))
    values = {"fps": 20.0, "exposure_ms": fixed, "peak_qe": 0.6, "full_well_e": 10000.0, "read_noise_e": 0.0,
              "bayer": "none", "rolling_us": 0.0, "phase_ms": fixed, "sharp": True, "steps": 8}  # fmt: skip
    return Film(**values | changes)


def test_shot_noise_is_that_of_the_electrons():
    """Grey light of 500 electrons: variance 500 in linear light, whatever the gain."""
    electrons = 500.0
    planes = np.full((3, 200, 200), electrons * rgb.ELECTRON_C / 5e-3, np.float32)
    developer = rgb.Developer(film(), 5.0, np.eye(3), [planes], generator(1, 0, "x"))
    picture = developer.picture(planes).astype(float) / 255
    linear = ((picture + 0.055) / 1.055) ** 2.4 / rgb.WHITE_SHARE * electrons
    assert abs(linear.mean() / electrons - 1) < 0.01 and abs(linear.std() / np.sqrt(electrons) - 1) < 0.05
    again = rgb.Developer(film(), 5.0, np.eye(3), [planes], generator(1, 0, "x")).picture(planes)
    assert np.array_equal(again, rgb.Developer(film(), 5.0, np.eye(3), [planes], generator(1, 0, "x")).picture(planes))


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "grbg", "gbrg"])
def test_a_bayer_pattern_gives_its_colours_back(pattern):
    planes = np.empty((3, 64, 64), np.float32)
    planes[:] = np.array([3000, 1500, 700])[:, None, None] * rgb.ELECTRON_C / 5e-3
    noisy = rgb.Developer(film(bayer=pattern), 5.0, np.eye(3), [planes], generator(1, 0, "x")).picture(planes)
    clean = rgb.Developer(film(), 5.0, np.eye(3), [planes], generator(1, 0, "x")).sharp(planes)
    assert np.abs(noisy[8:-8, 8:-8].mean((0, 1)) - clean[8:-8, 8:-8].mean((0, 1))).max() < 2


def test_too_much_light_is_filtered_and_white_stays_white():
    """A thousand times the well, with a tenfold brighter spot: no colour, no overflow but in the spot."""
    matrix = rgb.colour_matrix(stack(), rgb.illuminant({}))
    white = np.linalg.inv(matrix).sum(1)
    planes = np.tile((white / white.max() * 1e7)[:, None, None], (1, 60, 60)) * rgb.ELECTRON_C / 5e-3
    planes[:, :3, :3] *= 10
    picture = rgb.Developer(film(), 5.0, matrix, [planes], generator(1, 0, "x")).sharp(planes.astype(np.float32))
    assert np.ptp(picture.astype(int), -1).max() <= 1
    assert picture[:3, :3].min() >= 245 and 235 < picture[30:, 30:].mean() < 250


def test_exposures_lie_within_the_sequence():
    """All rows of them."""
    assert rgb.frame_times_us(film(), 100, 200_000, 5.0, 2.0)[0] == (2000, 7000)
    assert len(rgb.frame_times_us(film(), 100, 200_000, 5.0, 2.0)) == 4
    assert len(rgb.frame_times_us(film(), 100, 200_000, 50.0, 2.0)) == 3
    rolled = rgb.frame_times_us(film(rolling_us=100.0), 101, 200_000, 5.0, 2.0)
    assert rolled[0] == (52_000, 57_000) and len(rolled) == 3
