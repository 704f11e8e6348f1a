"""pecs lens and pecs.Lens from the outside."""

import csv
import io
import json
import math
import re

import numpy as np
import pecs
import pytest

LENS = "dgauss_50mm_tronnier"


def test_info_of_the_lab_lens(pecs_program):
    done = pecs_program("lens", "info", "pecs_lab_15mm", "--stop-diameter", 1, "--focus", 1.56, "--json", check=True)
    info = json.loads(done.stdout)
    assert info["efl_mm"] == pytest.approx(15.02, abs=0.005)
    assert info["bfl_mm"] == pytest.approx(10.24, abs=0.005)
    assert info["fnumber"] == pytest.approx(18.8, abs=0.05)
    assert info["hfov_deg"] == pytest.approx(23.4, abs=0.05)
    assert pecs.Lens("pecs_lab_15mm").info(stop_diameter_mm=1, focus_m=1.56) == info


def test_info_in_words(pecs_program):
    done = pecs_program("lens", "info", LENS, check=True)
    assert "EFL" in done.stdout and "50.358" in done.stdout


def test_trace_a_bundle(pecs_program):
    rays = "x,y,z,dx,dy,dz\n0,0,-10,0,0,1\n0.001,0,-10,0,0,1\n14,0,-10,0,0,1\n0,0,60,0.9,0,-0.4\n"
    done = pecs_program("lens", "trace", LENS, "--wavelength", 587.5618, "--to-z", 68, input=rays, check=True)
    rows = list(csv.DictReader(io.StringIO(done.stdout)))
    assert [row["status"] for row in rows][:3] == ["ok", "ok", "clipped:0"]
    assert rows[3]["status"].split(":")[0] in ("clipped", "missed")
    assert float(rows[0]["x"]) == 0 and float(rows[0]["z"]) == 68
    slope = float(rows[1]["dx"]) / float(rows[1]["dz"])
    assert -0.001 / slope == pytest.approx(50.358, abs=1e-3)


@pytest.mark.parametrize("line", ["1,2,3", "1,2,3,4,5,x", "nan,0,0,0,0,1", "0,0,0,0,0,0"])
def test_trace_refuses_bad_rays(pecs_program, line):
    done = pecs_program("lens", "trace", LENS, "--to-z", 0, input="0,0,-1,0,0,1\n" + line + "\n")
    assert done.returncode == 4
    assert "line 2" in done.stderr and done.stderr.count("\n") == 1


def test_trace_keeps_the_order_of_many(pecs_program):
    count = 150_000  # more than one batch
    lines = [f"{i * 1e-5!r},0,-10,0,0,1" for i in range(count)]
    done = pecs_program("lens", "trace", LENS, "--to-z", -5, "--no-clip", input="\n".join(lines), check=True)
    x = [float(line.split(",", 1)[0]) for line in done.stdout.splitlines()[1:]]
    assert len(x) == count and all(a < b for a, b in zip(x[:-1], x[1:], strict=True))
    lines[140_000] = lines[149_000] = "bad"
    done = pecs_program("lens", "trace", LENS, "--to-z", 0, input="\n".join(lines))
    assert done.returncode == 4 and "line 140001" in done.stderr


def test_draw(pecs_program, tmp_path):
    path = tmp_path / "lens.svg"
    pecs_program("lens", "draw", LENS, "-o", path, check=True)
    svg = path.read_text()
    assert svg.count("<polygon") == 6  # six elements
    assert svg.count("<polyline") == 3 * 3 * 5  # fields x wavelengths x rays
    assert json.loads((tmp_path / "lens.svg.run.json").read_text())["command"] == "lens draw"


@pytest.mark.parametrize("lens", [LENS, "cmount_8mm_f2p8", "fisheye_10mm_f4_muller"])
def test_the_caption_is_below_all_rays(pecs_program, tmp_path, lens):
    pecs_program("lens", "draw", lens, "-o", tmp_path / "lens.svg", check=True)
    svg = (tmp_path / "lens.svg").read_text()
    drawn = " ".join(re.findall('points="([^"]*)"', svg)).split()
    lowest = max(float(point.partition(",")[2]) for point in drawn)
    caption = float(re.search('<text x="[^"]*" y="([^"]*)"', svg)[1])
    assert lowest + 12 < caption < float(re.search('viewBox="0 0 [0-9]+ ([0-9]+)"', svg)[1])


@pytest.mark.parametrize("what", ["draw", "chart", "pupil"])
def test_pictures_as_png(what, pecs_program, tmp_path):
    path = tmp_path / "lens.png"
    pecs_program("lens", what, "cmount_8mm_f2p8", "-o", path, "--width", 800, check=True)
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert int.from_bytes(data[16:20]) == 800 and len(data) > 10_000  # not an empty sheet
    assert pecs_program("lens", what, "cmount_8mm_f2p8", "-o", tmp_path / "lens.gif").returncode == 2


def test_every_shipped_lens_is_on_the_page_of_charts(root):
    page = (root / "docs/reference/lenses.md").read_text()
    for path in (root / "lens_data/lenses").glob("*.json"):
        assert f"\n## {path.stem}\n" in page and (root / f"docs/reference/lenses/{path.stem}.svg").is_file(), (
            "run scripts/docs/lens_charts.py"
        )
        efl = pecs.Lens(path.stem).info()["efl_mm"]
        assert f"| [{path.stem}](#{path.stem}) | {efl:.3f} |" in page, "run scripts/docs/lens_charts.py"


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["info", "no_such_lens"], 3, "dgauss_50mm_tronnier"),
        (["info", LENS, "--fnumber", 1.0], 4, "f-number"),
        (["info", LENS, "--wavelength", 50000], 4, "50000"),
        (["info", LENS, "--focus", 0.01], 4, "focus"),
        (["info", LENS, "--fnumber", 4, "--stop-diameter", 3], 2, "excludes"),
        (["info"], 2, "LENS"),
    ],
)
def test_wrong_uses(pecs_program, arguments, code, words):
    done = pecs_program("lens", *arguments)
    assert done.returncode == code, done.stderr
    assert words in done.stderr + done.stdout


def test_draw_in_python(pecs_program, tmp_path):
    """The program's drawing, as text."""
    options = ("--stop-diameter", 1, "--focus", 1.56, "--film-width", 4, "--film-height", 3)
    pecs_program("lens", "draw", LENS, *options, "-o", tmp_path / "x.svg")
    drawn = pecs.Lens(LENS).draw(stop_diameter_mm=1, focus_m=1.56, film_width_mm=4, film_height_mm=3)
    assert drawn == (tmp_path / "x.svg").read_text()


def test_axes_of_a_chart_have_round_numbers(pecs_program, tmp_path):
    pecs_program("lens", "chart", LENS, "--film-width", 36, "--film-height", 1, "-o", tmp_path / "x.svg", check=True)
    numbers = re.findall(r'font-size="10"[^>]*>(-?[\d.]+)(?: um)?<', (tmp_path / "x.svg").read_text())
    assert len(numbers) > 40 and all(float(f"{float(n):.2g}") == float(n) for n in numbers), numbers


def test_camera_report():
    camera = pecs.Lens(LENS).camera(bands_nm=[450, 550, 650], focus_m=2, fnumber=4)
    assert camera.fnumber == pytest.approx(4, rel=2e-3)
    # E0 = pi / (4 N'^2) with the working f-number of the focus distance, to the aplanatic approximation.
    assert camera.e0[1] == pytest.approx(math.pi / (4 * (4 * 2 / (2 - 0.05)) ** 2), rel=0.02)
    assert len(camera.sha256) == 64 and "shader pecs_lens" in camera.osl


def test_a_narrow_pass_is_traced_at_its_mean():
    lens = pecs.Lens(LENS)
    assert lens.camera(bands_nm=[549, 550, 551], fnumber=8).channel_mode == "mean"
    wide = lens.camera(bands_nm=[450, 550, 650], fnumber=8)
    assert wide.channel_mode == "per_channel" and wide.colour_shift_px > 0.1


@pytest.mark.parametrize(("spread", "mode"), [(0.0, "mixed"), (0.05, "mixed"), (0.5, "per_channel")])
def test_bands_share_rays_if_colours_move_by_less_than_the_tolerance(spread, mode):
    options = {"bands_nm": [450, 550, 650], "fnumber": 8, "band_shares": [0.2, 0.3, 0.5]}
    camera = pecs.Lens(LENS).camera(**options, share_spreads=[spread, spread])
    assert camera.channel_mode == mode and camera.colour_shift_px > 0.1
    assert (camera.mixed_shift_px <= 0.1) == (mode == "mixed")
    assert ("throughput = color(weight);" in camera.osl) == (mode == "mixed")


@pytest.mark.parametrize(
    "options",
    [
        {"bands_nm": []},
        {"bands_nm": [1, 2, 3, 4]},
        {"bands_nm": [550], "fnumber": 0},
        {"bands_nm": [450, 550], "band_shares": [1], "share_spreads": [0]},
        {"bands_nm": [450, 550], "band_shares": [0.5, 0.6], "share_spreads": [0]},
        {"bands_nm": [450, 550], "band_shares": [0.5, 0.5]},
        {"bands_nm": [450, 550], "share_spreads": [0]},
    ],
)
def test_camera_refuses_bad_options(options):
    with pytest.raises(pecs.PecsInputError):
        pecs.Lens(LENS).camera(**options)


def test_arguments_are_named():
    with pytest.raises(pecs.PecsInputError, match="no_such: got an unknown key"):
        pecs.Lens(LENS).camera(bands_nm=[550], no_such=1)
    with pytest.raises(TypeError, match="bands_nm"):
        pecs.Lens(LENS).camera()


def test_a_closed_lens_raises():
    lens = pecs.Lens(LENS)
    lens.close()
    lens.close()
    size = {"width": 64, "height": 48}
    for call in (
        lens.info,
        lens.pupil,
        lens.draw,
        lambda: lens.camera(bands_nm=[550]),
        lambda: lens.pixels([0, 0, 1], **size),
        lambda: lens.directions([1, 2], **size),
        lens.__enter__,
    ):
        with pytest.raises(ValueError, match="this Lens is closed"):
            call()


PICTURE = {"width": 64, "height": 36, "pixel_pitch_mm": 0.0972, "focus_m": 2.0}


def test_directions_and_pixels():
    with pecs.Lens("cmount_8mm_f2p8") as lens:
        y, x = np.mgrid[0:36, 0:64] + 0.5
        pixels = np.stack([x, y], axis=-1)
        directions = lens.directions(pixels, **PICTURE)
        assert directions.shape == (36, 64, 3)
        assert np.linalg.norm(directions, axis=-1) == pytest.approx(1)
        assert directions[0, 0, 0] < 0 and directions[0, 0, 1] < 0 and (directions[..., 2] > 0).all()
        assert lens.pixels(3 * directions, **PICTURE) == pytest.approx(pixels, abs=1e-6)
        # The chief rays of `info`, along the film radius.
        rows = lens.info(lambda_nm=550, focus_m=2.0, field_rows=6)["field"]
        along = [[32 + row["r_mm"] / 0.0972, 18] for row in rows]
        angle = [math.degrees(math.atan2(d[0], d[2])) for d in lens.directions(along, **PICTURE)]
        assert angle == pytest.approx([row["angle_deg"] for row in rows], abs=1e-5)


def test_directions_end_where_the_lens_does():
    lens = pecs.Lens("cmount_8mm_f2p8")
    wide = PICTURE | {"width": 640, "height": 360}
    assert np.isnan(lens.directions([0, 0], **wide)).all()
    assert np.isnan(lens.pixels([[0, 0, -1], [np.nan, 0, 1]], **wide)).all()
    assert lens.directions(np.empty((0, 2)), **PICTURE).shape == (0, 3)


@pytest.mark.parametrize("more", [{"width": 0}, {"focus_m": -1}, {"fnumber": 0.5}, {"film_tilt_deg": (60, 0)}])
def test_directions_refuse_bad_settings(more):
    with pytest.raises(pecs.PecsError, match="got"):
        pecs.Lens(LENS).directions([1, 1], **(PICTURE | more))


def test_directions_refuse_bad_arrays():
    with pytest.raises(ValueError, match="wanted"):
        pecs.Lens(LENS).directions([[1, 2, 3]], **PICTURE)


@pytest.mark.parametrize(
    "name", ["a\n#define camera_shader_random_sample() vector(0.999, 0.5, 0)\n//", "a\x1b[31m", "a\0"]
)
def test_a_name_cannot_end_its_comment_in_the_shader(pecs_program, root, name, tmp_path):
    """A lens of others: its name goes into the OSL camera and into pages."""
    lens = json.loads((root / "lens_data/lenses/cmount_8mm_f2p8.json").read_text())
    (tmp_path / "lens.json").write_text(json.dumps(lens | {"name": name}))
    result = pecs_program("lens", "info", tmp_path / "lens.json")
    assert result.returncode == 4 and "lens.json: name: got " in result.stderr, result.stderr
    assert "text without control characters" in result.stderr and result.stderr.count("\n") == 1
