"""The generated camera inside Cycles: upright, ray by ray as the tracer, and as bright as the quadrature says."""

import csv
import importlib.util
import io
import json
import subprocess
from pathlib import Path

import numpy as np
import pecs
import pytest

pytestmark = pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs the bpy wheel")

DGAUSS = {"name": "dgauss_50mm_tronnier", "film_width_mm": 36.0, "film_height_mm": 24.0}
LAB = {"name": "pecs_lab_15mm", "stop_diameter_mm": 1.0, "focus_m": 1.56}


@pytest.fixture
def render(tmp_path, python):
    """Renders a job of lens_render.py in a process of its own (bpy must be loaded before libpecs)."""

    def run(**job):
        job_path, out_path = tmp_path / "job.json", tmp_path / "out.npz"
        job_path.write_text(json.dumps(job))
        script = Path(__file__).with_name("lens_render.py")
        done = subprocess.run([python, script, job_path, out_path], capture_output=True, text=True)
        assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
        return np.load(out_path)["image"].astype(float)

    return run


def camera(setting, bands, **more):
    options = {k: v for k, v in setting.items() if k != "name"} | more
    return pecs.Lens(setting["name"]).camera(bands_nm=bands, **options)


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


@pytest.mark.parametrize("setting", [DGAUSS, LAB], ids=lambda s: s["name"])
def test_ray_by_ray_as_the_tracer(setting, render, pecs_program):
    cam = camera(setting, [549.0, 550.0, 551.0], colour_tolerance_px=1e3)
    width, height = 48, 32
    assert "throughput = color(weight);" in cam.osl
    # The same samples four times: the film point, what the shader aims at, where the ray leaves, and its direction.
    shown = {
        "film": "color(fx, fy, 1)",
        "aim": "color(ex * cosphi - ey * sinphi, ex * sinphi + ey * cosphi, 1)",
        "position": "color(1000 * position[0], 1000 * position[1], 1000 * position[2])",
        "direction": "color(direction[0], direction[1], direction[2])",
    }
    images = {}
    for what, value in shown.items():
        osl = cam.osl.replace("throughput = color(weight);", f"throughput = {value};")
        images[what] = render(osl=osl, scene="white", width=width, height=height, samples=1).reshape(-1, 3)
    passed = images["film"][:, 2] == 1
    assert passed.mean() > 0.99

    y, x = np.indices((height, width))  # sample 0 lies at the pixel's centre; row 0 is the bottom, the film upside down
    film = np.column_stack([images["film"][:, :2], np.full(x.size, cam.film_z_mm)])
    centre = np.column_stack(
        [(0.5 - (x + 0.5).ravel() / width) * cam.film_width_mm, (0.5 - (y + 0.5).ravel() / height) * cam.film_height_mm]
    )
    assert np.abs(film[passed, :2] - centre[passed]).max() < 1e-3 * cam.film_width_mm / width
    plane = pecs.Lens(setting["name"]).pupil(lambda_nm=550)["plane_z_mm"]
    aim = np.column_stack([images["aim"][:, :2], np.full(x.size, plane)])
    rays = np.hstack([film, aim - film])[passed]
    done = pecs_program(
        "lens", "trace", setting["name"], "--lambda-nm", 550, "--to-z-mm", 0,
        *(["--stop-diameter-mm", cam.stop_diameter_mm]),
        input="\n".join(",".join(map(repr, map(float, row))) for row in rays),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    rows = list(csv.DictReader(io.StringIO(done.stdout)))
    ok = np.array([row["status"] == "ok" for row in rows])
    assert ok.mean() > 0.999  # float32 may pass a ray that grazes the rim
    truth = np.array([[float(row[k]) for k in ("x", "y", "z", "dx", "dy", "dz")] for row in rows])[ok]
    direction = images["direction"][passed][ok] * [1, 1, -1]  # camera space looks along +Z, the lens frame along -z
    position = images["position"][passed][ok]
    assert np.linalg.norm(direction - truth[:, 3:], axis=1).max() < 1e-6  # rad
    # The ray's line, on the plane z = 0 of the lens frame: camera z = entrance pupil z - lens z.
    z = cam.entrance_pupil_z_mm - position[:, 2]
    on_plane = position[:, :2] - direction[:, :2] * (z / direction[:, 2])[:, None]
    assert np.abs(on_plane - truth[:, :2]).max() < 2e-5  # mm


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
