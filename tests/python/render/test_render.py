"""Rendering with Cycles: geometry, absolute light, and a static scene that stays static. Every job runs in
its own process, as users run it."""

import json

import numpy as np
import pecs
import pytest
from pecs_blender.spectral import spectra
from support import pecs_blender

SCENE = "scenes/rotating_disk"


@pytest.fixture(scope="module")
def render(root):
    def run(output, *args, check=True):
        return pecs_blender("render", root / SCENE, "-o", output, *args, check=check)

    return run


def frames(folder):
    stack = json.loads((folder / "stack.json").read_text())
    with pecs.StackReader(folder) as reader:
        return stack, np.array([reader.read_frame(i) for i in range(len(stack["times_ns"]))])


@pytest.fixture(scope="module")
def disk(render, tmp_path_factory):
    """A quarter-resolution frame through the lab lens, and the same scene through a pinhole of its focal length."""
    folder = tmp_path_factory.mktemp("disk")
    common = ("--bands", 3, "--frames", 1, "--width", 320, "--samples", 4, "--set", "phase_deg=30")
    render(folder / "lens", *common)
    render(folder / "pinhole", *common, "--lens", "none", "--seed", 2)
    return folder


def disk_circle(picture):
    """Centre and radius [pixels, pixel (0, 0) has its centre at (0.5, 0.5)] of a white disk, from the pixels it half
    covers or more: it is about three times as bright as the wall, and its shadow is darker."""
    inside = picture > 2 * np.median(picture[:, : picture.shape[1] // 3])
    rows, columns = np.nonzero(inside)
    return columns.mean() + 0.5, rows.mean() + 0.5, np.sqrt(inside.sum() / np.pi)


def test_the_disk_is_where_the_lab_saw_it(render, tmp_path):
    white = ("--set", "black_reflectance=0.84")
    render(tmp_path / "s", "--bands", 3, "--frames", 1, "--width", 320, *white)
    _, values = frames(tmp_path / "s")
    x, y, radius = disk_circle(values[0].mean(axis=0))
    # Lab: centre (957.3, 361.4), R 303 at 1280x720; here a quarter of it.
    assert abs(x - 957.3 / 4) < 0.5
    assert abs(y - 361.4 / 4) < 0.5
    assert abs(radius - 303 / 4) < 0.5


def test_a_shifted_and_a_tilted_film(render, tmp_path):
    common = ("--bands", 3, "--frames", 1, "--width", 160, "--samples", 16, "--set", "black_reflectance=0.84")
    pitch_mm = 6.2208 / 160
    pictures = {}
    for name, film in (
        ("flat", ()),
        ("shifted", ("--film-shift", -20 * pitch_mm, 5 * pitch_mm)),
        ("tilted", ("--film-tilt", 0, 4)),
    ):
        render(tmp_path / name, *common, *film)
        stack, values = frames(tmp_path / name)
        pictures[name] = values[0].mean(axis=0)
        assert stack["lens"].get("film_tilt_y_deg", 0) == (4 if name == "tilted" else 0)
    # The picture is upside down: a film moved to -x, +y sees what lies further to the right and above.
    x, y, radius = disk_circle(pictures["flat"])
    shifted = disk_circle(pictures["shifted"])
    assert shifted == pytest.approx((x - 20, y - 5, radius), abs=0.5)
    part = pictures["shifted"][:-5, :-20] / pictures["flat"][5:, 20:]
    assert np.median(part) == pytest.approx(1, abs=0.01)  # off the axis too, the light is right
    assert np.median(part[:, :30]) == pytest.approx(1, abs=0.02)
    assert disk_circle(pictures["tilted"]) == pytest.approx((x, y, radius), abs=1.5)
    assert np.median(pictures["tilted"] / pictures["flat"]) == pytest.approx(1, abs=0.02)


def test_lens_and_pinhole_pictures_agree_in_orientation(disk):
    lens = np.log(frames(disk / "lens")[1][0].mean(axis=0) + 1e-30)
    pinhole = np.log(frames(disk / "pinhole")[1][0].mean(axis=0) + 1e-30)
    for turned, floor in ((pinhole, 0.95), (pinhole[::-1], -1), (pinhole[:, ::-1], -1), (pinhole[::-1, ::-1], -1)):
        correlation = np.corrcoef(lens.ravel(), turned.ravel())[0, 1]
        assert correlation > floor
        if floor < 0:
            assert correlation < 0.8


def test_the_light_is_absolute(disk):
    """A Lambertian white of reflectance r under E_v lux: the radiance's luminance is r E_v / pi, and a band has the
    lamp's mean weighted by the chip's response. The picture's white sectors are brighter above and darker below the
    disk's centre, where the illuminance is defined."""
    stack, values = frames(disk / "pinhole")
    edges_nm, chip = stack["render"]["band_edges_nm"], pecs.Chip("imx636")
    lamp, v = spectra.load("led_b3"), spectra.load("photopic")
    grid = np.arange(380, 781.0)
    centre = values[0][:, 88:93, 237:242]
    white = centre.reshape(3, -1).max(axis=1)
    for k in range(3):  # radiance in band k = r/pi * E_v * lamp(k) / (683 integral V lamp)
        nm = np.arange(edges_nm[k] + 0.5, edges_nm[k + 1])
        response = chip.amperes_per_unit([{"lambda_nm": x, "weight_nm": 1.0} for x in nm])
        mean = np.average(lamp(nm), weights=response)
        expected = 0.84 / np.pi * 100 * mean / (683 * np.sum(v(grid) * lamp(grid)))
        assert white[k] == pytest.approx(expected, rel=0.1)


def test_cameras_with_their_own_seeds_see_one_light(disk):
    lens, pinhole = (frames(disk / name)[0]["render"]["radiance_per_relative_power"] for name in ("lens", "pinhole"))
    assert lens == pinhole


def test_film_irradiance_follows_from_the_radiance(disk):
    """E = e0 * L on the axis (docs/reference/exr_stack.md): the wall's irradiance through the lens over its pinhole
    radiance."""
    stack, lens = frames(disk / "lens")
    _, pinhole = frames(disk / "pinhole")
    window = np.s_[0, :, 80:100, 130:160]
    ratio = lens[window].mean(axis=(1, 2)) / pinhole[window].mean(axis=(1, 2))
    assert ratio == pytest.approx(np.array(stack["lens"]["e0"]), rel=0.02)
    assert "focal_mm" not in stack["render"]  # of a pinhole
    # paraxial: E0 = pi sin^2 = pi / (4 N^2 + 1)
    assert stack["lens"]["e0"][1] == pytest.approx(np.pi / (4 * stack["lens"]["fnumber"] ** 2 + 1), rel=0.1)


def test_a_static_scene_is_bit_identical_and_gives_no_events(render, pecs_program, tmp_path):
    render(tmp_path / "s", "--bands", 4, "--frames", 4, "--fps", 1000, "--width", 64, "--samples", 4, "--set", "rpm=0")
    _, values = frames(tmp_path / "s")
    assert values.max() > 0
    assert (values == values[0]).all()
    pecs_program("sense", tmp_path / "s", "-o", tmp_path / "e.csv", "--chip", "imx636", "--no-noise", check=True)
    assert json.loads(pecs_program("info", tmp_path / "e.csv", "--json").stdout)["events"] == 0


@pytest.mark.parametrize(
    "args, code",
    [
        (["--frames", "0"], 2),
        (["--frames", "5:5"], 2),
        (["--frames", "0:4,3:6"], 2),
        (["--fps", "-1"], 2),
        (["--set", "rmp=3"], 2),
        (["--set", "rpm=nan"], 4),
        (["--set", "white_reflectance=snow"], 3),
        (["--frames", "period", "--set", "rpm=0"], 2),
        (["--lens", "no_such_lens"], 3),
        (["--lens", "none", "--focus", "1m"], 2),
        (["--lens", "none", "--film-shift", "0.1", "0"], 2),
        (["--focal", "20mm"], 2),
        (["--chip", "no_such_chip"], 3),
    ],
    ids=lambda v: " ".join(v) if isinstance(v, list) else "",
)
def test_bad_input_is_one_line(render, tmp_path, args, code):
    result = render(tmp_path / "s", "--width", 32, "--samples", 1, *args, check=False)
    assert result.returncode == code, result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert not list(tmp_path.glob("s/frame_*"))


def test_an_unwritable_output_is_one_line(render, tmp_path):
    (tmp_path / "file").write_text("")
    result = render(
        tmp_path / "file" / "s", "--width", 32, "--samples", 1, "--frames", 1, "--lens", "none", check=False
    )
    assert result.returncode == 5, result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
