"""The generated camera inside Cycles: upright, ray by ray as the tracer, and as bright as the quadrature says."""

import csv
import importlib.util
import io
import json
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pecs
import pytest
from support import HERE, ROOT, in_bpy

pytestmark = pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs the bpy wheel")

DGAUSS = {"name": "dgauss_50mm_tronnier", "film_width_mm": 36.0, "film_height_mm": 24.0}
SHIFTED = {"name": "cmount_16mm_f2p1", "film_shift_x_mm": 1.5, "film_shift_y_mm": -0.8, "fnumber": 4, "focus_m": 2.0}
TILTED = {
    "name": "cmount_8mm_f2p8",
    "film_tilt_x_deg": 4.0,
    "film_tilt_y_deg": -6.0,
    "film_shift_x_mm": 0.3,
    "focus_m": 1.0,
}
LAB = {"name": "pecs_lab_15mm", "stop_diameter_mm": 1.0, "focus_m": 1.56}


@pytest.fixture(scope="module")
def render(tmp_path_factory, python):
    """Renders a job of lens_render.py in a process of its own (bpy must be loaded before libpecs)."""

    def run(**job):
        folder = tmp_path_factory.mktemp("job")
        job_path, out_path = folder / "job.json", folder / "out.npz"
        job_path.write_text(json.dumps(job))
        script = HERE / "support/lens_render.py"
        done = subprocess.run([python, script, job_path, out_path], capture_output=True, text=True)
        assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
        return np.load(out_path)["image"].astype(float)

    return run


def camera(setting, bands, **more):
    options = {k: v for k, v in setting.items() if k != "name"} | more
    return pecs.Lens(setting["name"]).camera(bands_nm=bands, **options)


def film_axes(cam):
    """The film's right and up in the lens frame."""
    x, y = np.radians([cam.film_tilt_x_deg, cam.film_tilt_y_deg])
    right = np.array([np.cos(y), 0, -np.sin(y)])
    return right, np.array([np.sin(x) * np.sin(y), np.cos(x), np.sin(x) * np.cos(y)])


def film_points(cam, x, y):
    """Lens-frame points of raster positions in 0..1, y up; the picture lies upside down on the film."""
    right, up = film_axes(cam)
    centre = np.array([cam.film_shift_x_mm, cam.film_shift_y_mm, cam.film_z_mm])
    return (
        centre + ((0.5 - x) * cam.film_width_mm)[..., None] * right + ((0.5 - y) * cam.film_height_mm)[..., None] * up
    )


def traced(pecs_program, name, rays, *more, to_z_mm=0.0):
    """Rows of `pecs lens trace` at 550 nm: points and directions, and which got through."""
    text = "\n".join(",".join(map(repr, map(float, row))) for row in rays)
    done = pecs_program("lens", "trace", name, "--wavelength", 550, "--to-z", to_z_mm, *more, input=text, check=True)
    rows = list(csv.reader(io.StringIO(done.stdout)))[1:]
    return np.array([row[:6] for row in rows], float), np.array([row[6] == "ok" for row in rows])


def centroid(channel):
    assert channel.sum() > 0, "the patch is not in the picture"
    y, x = np.indices(channel.shape)
    return np.array([(x * channel).sum(), (y * channel).sum()]) / channel.sum()


def test_upright_and_not_mirrored(render):
    cam = camera(LAB, [549.0, 550.0, 551.0])
    assert cam.channel_mode == "mean"
    hfov = pecs.Lens("pecs_lab_15mm").info(lambda_nm=550, focus_m=1.56, stop_diameter_mm=1.0)["hfov_deg"]
    job = {"scene": "corner", "width": 160, "height": 90, "samples": 16}
    ours = render(osl=cam.osl, **job)
    builtin = render(osl=None, hfov_deg=hfov, **job)
    for channel in range(3):
        a, b = centroid(ours[..., channel]), centroid(builtin[..., channel])
        assert np.abs(a - b).max() < 1.0, f"channel {channel}: {a} against {b}"


SHIPPED = [{"name": p.stem} for p in sorted((ROOT / "lens_data/lenses").glob("*.json"))]
STOP_CUTS = [{"name": str(p)} for p in sorted((ROOT / "tests/lens/lenses").glob("*.json"))]


def setting_name(setting):
    return "-".join(Path(str(value)).stem if key == "name" else str(value) for key, value in setting.items())


SETTINGS = [DGAUSS, SHIFTED, TILTED, *SHIPPED, *STOP_CUTS, {"name": "conics and odd powers"}]
SIZE = {"width": 48, "height": 32}


def odd_lens(folder):
    """The file of a lens of conics and odd powers."""
    air, glass = {"name": "air"}, {"name": "N-BK7", "catalog": "Schott"}
    front = {"type": "asphere", "radius": 12.0, "k": -0.6, "odd_coeffs": {"3": 2e-5, "5": -1e-6}}
    rear = {"type": "asphere", "radius": -30.0, "k": 2.0}
    surfaces = [
        {"type": "stop", "thickness": 1.0, "medium_after": air, "semi_diameter": 3.0},
        front | {"even_coeffs": {"4": -3e-5}, "thickness": 4.0, "medium_after": glass, "semi_diameter": 6.0},
        rear | {"thickness": 15.0, "medium_after": air, "semi_diameter": 6.0},
    ]
    (folder / "odd.json").write_text(json.dumps({"name": "odd", "stop_index": 0, "surfaces": surfaces}))
    return str(folder / "odd.json")


@pytest.fixture(scope="module")
def shown(render, tmp_path_factory):
    """Of each setting: its lens, its camera, and pictures of the same samples: the film point, what the shader aims at,
    where the ray leaves, and its direction. One process renders all."""
    names = [one["name"] for one in SETTINGS[:-1]] + [odd_lens(tmp_path_factory.mktemp("lens"))]
    bands = [549.0, 550.0, 551.0]
    cameras = [camera(s | {"name": n}, bands, colour_tolerance_px=1e3) for s, n in zip(SETTINGS, names, strict=True)]
    sources = []
    for cam in cameras:
        assert "throughput = color(weight);" in cam.osl
        tilted = cam.film_tilt_x_deg != 0
        for value in (
            f"color(fx, fy, {'fz' if tilted else '0'})",
            "color(ex * cosphi - ey * sinphi, ex * sinphi + ey * cosphi, 1)",
            "color(1000 * position[0], 1000 * position[1], 1000 * position[2])",
            "color(direction[0], direction[1], direction[2])",
        ):
            sources.append(cam.osl.replace("throughput = color(weight);", f"throughput = {value};"))
    images = render(osl=sources, scene="white", **SIZE, samples=1)
    return list(zip(names, cameras, images.reshape(len(cameras), 4, -1, 3), strict=True))


@pytest.mark.parametrize("index", range(len(SETTINGS)), ids=map(setting_name, SETTINGS))
def test_ray_by_ray_as_the_tracer(index, shown, pecs_program):
    name, cam, (film, aim, position, direction) = shown[index]
    width, height = SIZE.values()
    passed = aim[:, 2] == 1
    assert passed.mean() > 0.99

    y, x = np.indices((height, width))  # sample 0 lies at the pixel's centre
    film[:, 2] += cam.film_z_mm
    centre = film_points(cam, (x + 0.5).ravel() / width, (y + 0.5).ravel() / height)
    assert np.abs(film - centre)[passed].max() < 1e-3 * cam.film_width_mm / width
    aim[:, 2] = pecs.Lens(name).pupil(lambda_nm=550)["plane_z_mm"]
    rays = np.hstack([film, aim - film])[passed]
    truth, ok = traced(pecs_program, name, rays, "--stop-diameter", cam.stop_diameter_mm)
    assert ok.mean() > 0.999  # float32 may pass a ray that grazes the rim
    film, position, direction = film[passed][ok], position[passed][ok], direction[passed][ok]
    # Camera space looks along +Z, the lens frame along -z.
    direction = direction * [1, 1, -1]
    position = position * [1, 1, -1] + [0, 0, cam.entrance_pupil_z_mm]
    angle = np.linalg.norm(direction - truth[ok, 3:], axis=1).max()
    # The shader's ray traced back to where it came from.
    back, ok = traced(pecs_program, name, np.hstack([position, -direction]), "--no-clip", to_z_mm=cam.film_z_mm)
    assert ok.all()
    back[:, :2] += back[:, 3:5] * ((film[:, 2] - cam.film_z_mm) / back[:, 5])[:, None]
    offset = np.linalg.norm(back[:, :2] - film[:, :2], axis=1).max()
    print(f"{name}: {angle:.2g} rad, {1e3 * offset:.2g} um at the image")
    assert angle < 1e-6
    # mm; float32 rounds a direction by some 1e-7 per surface, and a long lens makes more of it.
    assert offset < max(5e-5, 5.5e-7 * cam.efl_mm)


def test_bands_that_share_rays_have_the_image_of_their_sum(render):
    bands, shares = [450.0, 550.0, 650.0], np.array([0.5, 0.2, 0.3])
    width, height, pitch_mm = 64, 48, 0.004
    setting = {"fnumber": 4, "focus_m": 1.0, "pixel_pitch_mm": pitch_mm}
    film = {"film_width_mm": width * pitch_mm, "film_height_mm": height * pitch_mm, "film_shift_x_mm": 2.5}
    through = {"name": "cmount_8mm_f2p8"} | setting | film
    apart = camera(through, bands, colour_tolerance_px=0)
    mixed = camera(through, bands, colour_tolerance_px=0, band_shares=shares, share_spreads=[0, 0])
    mean = camera(through, bands, colour_tolerance_px=1e3)
    assert [one.channel_mode for one in (apart, mixed, mean)] == ["per_channel", "mixed", "mean"]
    assert mixed.mixed_shift_px == 0 and mixed.colour_shift_px == apart.colour_shift_px > 0.3

    lens = pecs.Lens(through["name"])
    x, y, z = lens.directions(
        [[width / 2, height / 2]], width=width, height=height, film_shift_mm=(2.5, 0.0), **setting
    )[0]
    job = {"scene": "dots", "dots": [[x / z, -y / z, 1.0]], "dot_radius": 0.007, "samples": 1024}
    sources = [one.osl for one in (apart, mixed, mean)]
    image, grey, plain = render(osl=sources, width=width, height=height, **job)
    assert np.ptp(grey, axis=-1).max() == 0
    truth = image @ shares
    assert truth.max() > 0.5
    errors = [np.abs(one[..., 0] - truth).max() for one in (grey, plain)]
    print("mixed {:.3g}, mean {:.3g}".format(*errors))
    assert errors[0] < 0.05 < errors[1]


def test_furnace_of_a_tilted_film(render, pecs_program):
    cam = camera(TILTED, [549.0, 550.0, 551.0], colour_tolerance_px=1e3)
    assert max(cam.missed_fraction) < 1e-4
    width, height = 192, 108
    image = render(osl=cam.osl, scene="white", width=width, height=height, samples=64)[..., 1]
    plane = pecs.Lens(TILTED["name"]).pupil(lambda_nm=550)["plane_z_mm"]
    normal = np.cross(*film_axes(cam))
    # Irradiance = integral of cos(film) cos(plane) / d^2 over the plane of the rear vertex, by a grid of traced rays.
    n, reach = 240, 6.0
    grid = (np.arange(n) + 0.5) / n * 2 * reach - reach
    ax, ay = (a.ravel() for a in np.meshgrid(grid, grid))
    for i, j in ((20, 12), (96, 54), (170, 90), (20, 90), (170, 20)):
        film = film_points(cam, np.array(i / width), np.array(j / height))
        way = np.column_stack([ax, ay, np.full(ax.size, plane)]) - film
        _, ok = traced(pecs_program, TILTED["name"], np.hstack([np.tile(film, (ax.size, 1)), way]))
        d2 = (way**2).sum(axis=1)
        expected = ((way @ -normal) * -way[:, 2] / d2**2)[ok].sum() * (2 * reach / n) ** 2 / cam.e0[1]
        seen = image[j - 6 : j + 6, i - 6 : i + 6].mean()
        assert seen == pytest.approx(expected, rel=3e-3), (i, j)


@pytest.mark.parametrize("setting", [DGAUSS, LAB], ids=lambda s: s["name"])
def test_white_furnace_meets_the_quadrature(setting, render):
    cam = camera(setting, [549.0, 550.0, 551.0], colour_tolerance_px=1e3)
    options = {k: v for k, v in setting.items() if k != "name"}
    table = pecs.Lens(setting["name"]).pupil(lambda_nm=550, **options)
    width, height = 192, 128
    image = render(osl=cam.osl, scene="white", width=width, height=height, samples=8)[..., 1]
    y, x = np.indices(image.shape)
    r = np.hypot(((x + 0.5) / width - 0.5) * cam.film_width_mm, ((y + 0.5) / height - 0.5) * cam.film_height_mm)
    rows = table["pupil"]
    expected = np.interp(r, [p["r_mm"] for p in rows], [p["relative_illumination"] for p in rows])
    ratio = image / expected
    assert abs(ratio.mean() - 1) < 5e-4
    for lower in np.linspace(0, r.max(), 9)[:-1]:
        ring = (r >= lower) & (r < lower + r.max() / 8)
        error = ratio[ring].std() / np.sqrt(ring.sum())
        assert abs(ratio[ring].mean() - 1) < 1.5e-3 + 4 * error
    assert ratio.std() < 0.016  # the lens' own noise at 8 samples a pixel


def dots_through(render, cam, dots, width, height, near=None):
    """Centroids in pixels (x right, y down, pixel centres at .5) of discs at `dots`, [x, y, distance] in metres, looked
    for by the focal length, or `near` these pixels."""
    job = {"scene": "dots", "dot_radius": 0.006, "width": width, "height": height, "samples": 16}
    image = render(osl=cam.osl, dots=[list(dot) for dot in dots], **job)[::-1, :, 1]
    scale = cam.efl_mm / cam.film_width_mm * width
    found = []
    if near is None:
        near = [(0.5 * width + scale * x / z, 0.5 * height - scale * y / z) for x, y, z in dots]
    for (x, y, z), (u, v) in zip(dots, near, strict=True):
        left, top = int(u) - 12, int(v) - 12
        window = image[top : top + 25, left : left + 25]
        assert window.max() > 0.3, f"dot {x}, {y}, {z} is not in the picture"
        found.append(centroid(window) + [left + 0.5, top + 0.5])
    return np.array(found)


@pytest.mark.parametrize(
    "film", [{}, {"film_shift_mm": (0.35, -0.2), "film_tilt_deg": (2.0, -3.0)}], ids=["square", "tilted"]
)
def test_the_picture_is_where_the_image_map_says(render, film):
    lens = pecs.Lens("cmount_8mm_f2p8")
    width, height = 640, 360
    state = {"focus_m": 2.0, "fnumber": 16, "pixel_pitch_mm": 6.2208 / width}
    shift, tilt = film.get("film_shift_mm", (0, 0)), film.get("film_tilt_deg", (0, 0))
    placed = {
        "film_shift_x_mm": shift[0],
        "film_shift_y_mm": shift[1],
        "film_tilt_x_deg": tilt[0],
        "film_tilt_y_deg": tilt[1],
    }
    cam = lens.camera(bands_nm=[550], **state, **placed)
    slopes = [(u, v) for u in np.linspace(-0.33, 0.33, 7) for v in np.linspace(-0.17, 0.17, 5)]
    dots = [(float(2 * u), float(2 * v), 2.0) for u, v in slopes]
    state |= {"width": width, "height": height, "film_shift_mm": shift, "film_tilt_deg": tilt}
    expected = lens.pixels([(x, -y, z) for x, y, z in dots], **state)
    seen = dots_through(render, cam, dots, width, height, near=expected)
    # The dots' discs are 6 mm in radius; a chief ray misses the origin by the pupil's aberration.
    assert np.abs(seen - expected).max() < 0.1


def test_the_picture_has_the_prescriptions_distortion(render):
    lens = pecs.Lens("cmount_8mm_f2p8")
    width, height = 640, 360
    state = {"focus_m": 2.0, "fnumber": 8}
    cam = lens.camera(bands_nm=[550], pixel_pitch_mm=6.2208 / width, **state)
    # A grid in the picture, its dots at three distances, so that focal length and distance come apart.
    slopes = [(u, v) for u in np.linspace(-0.36, 0.36, 11) for v in np.linspace(-0.195, 0.195, 7)]
    depths = [(1.7, 2.0, 2.4)[i % 3] for i in range(len(slopes))]
    dots = [(float(u * z), float(v * z), z) for (u, v), z in zip(slopes, depths, strict=True)]
    seen = dots_through(render, cam, dots, width, height)

    world = (np.array(dots) * [1, -1, 1]).astype(np.float32)  # OpenCV: y down, z ahead
    guess = np.array([[820.0, 0, width / 2], [0, 820.0, height / 2], [0, 0, 1]])
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_PRINCIPAL_POINT
    flags |= cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_ZERO_TANGENT_DIST
    rms, matrix, k, _, at = cv2.calibrateCamera(
        [world], [seen.astype(np.float32)], (width, height), guess, None, flags=flags
    )
    assert rms < 0.1  # pixels
    assert np.abs(at[0]).max() < 0.01  # metres: the camera stands at the entrance pupil

    # The fitted model against the prescription's own chief rays, over the film radius.
    rows = lens.info(lambda_nm=550, field_rows=12, **state)["field"]
    radius = np.array([row["r_mm"] for row in rows]) / (6.2208 / width)
    slope = np.tan(np.radians([row["angle_deg"] for row in rows]))
    points = np.column_stack([slope, 0 * slope, 1 + 0 * slope])
    model, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, k)
    reached = radius < np.linalg.norm(seen - [width / 2, height / 2], axis=1).max()
    error = model[reached, 0, 0] - matrix[0, 2] - radius[reached]
    assert np.sqrt((error**2).mean()) < 0.1, f"pixels: {error}"


def test_a_scenes_stop_gives_way_to_the_lens():
    """One that is asked for does not."""
    in_bpy("""
from pathlib import Path
from types import SimpleNamespace
from pecs_blender.camera import lens
from pecs._errors import UsageError
film = {"film_width_mm": 6.2, "film_shift_mm": (0, 0), "film_tilt_deg": (0, 0), "size": (1280, 720)}
unset = film | dict.fromkeys(("lens", "fnumber", "stop_diameter_mm", "focus_m", "focus_bands_nm"))
own = {"lens": "pecs_lab_15mm", "focus_m": 1.5, "stop_diameter_mm": 50.0}
for own["stop_diameter_mm"], stop_mm in ((50.0, 4.54), (1.0, 1.0), (None, None)):
    source = SimpleNamespace(lens=own, folder=Path("."))
    setting = lens.choose(source, SimpleNamespace(**unset)).setting
    assert setting == {"focus_m": 1.5, "stop_diameter_mm": stop_mm, "fnumber": None}, setting
for asked, line in (
    ({"fnumber": 2.0}, "--fnumber: got 2, wanted at least f/4.15, where pecs_lab_15mm is wide open"),
    ({"stop_diameter_mm": 50.0}, "--stop-diameter: got 50, wanted at most 4.54mm, where pecs_lab_15mm is wide open"),
):
    try:
        lens.choose(source, SimpleNamespace(**unset | asked))
        raise AssertionError(asked)
    except UsageError as e:
        assert (e.code, str(e)) == (2, line), str(e)
""")
