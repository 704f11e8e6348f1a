"""The lens camera in Cycles, as JSON: white furnace against quadrature, noise, cost beside the built-in camera, and the
noise of both channel modes at equal time.

    .venv/bin/python scripts/bench/lens_camera.py [furnace|cost|modes ...] [--lens LENS ...] > lens_camera.json

Needs bpy in the interpreter that runs it (it renders in child processes) and libpecs (scripts/setup.sh). Times are wall
times of one rendering thread (another spins in wait for it, which a process' CPU time would count): run it alone.
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pecs

ROOT = Path(__file__).resolve().parents[2]

FULL_FRAME = {  # of those shipped, the lenses that light 36 x 24 mm; the others are used with 6.2208 x 3.4992 mm
    "angenieux_100mm_f1p1",
    "dgauss_50mm_tronnier",
    "double_gauss_100mm_f3p1",
    "retrofocus_35mm_f2p8",
    "singlet_50mm_f5_nbk7",
    "takumar_100mm_f1p4",
    "wide_22mm_f2p7_nakamura",
}
FURNACE_WIDTH, FURNACE_SAMPLES, BINS = 320, 8, 12


def render(**job):
    with tempfile.TemporaryDirectory() as folder:
        job_path, out_path = Path(folder) / "job.json", Path(folder) / "out.npz"
        job_path.write_text(json.dumps(job))
        script = ROOT / "tests/python/support/lens_render.py"
        subprocess.run([sys.executable, script, job_path, out_path], check=True, capture_output=True)
        out = np.load(out_path)
        return out["image"].astype(float), float(out["seconds"]), str(out["blender"])


def film(name):
    return {"film_width_mm": 36.0, "film_height_mm": 24.0} if name in FULL_FRAME else {}


def furnace(name, stop):
    lens = pecs.Lens(name)
    start = time.perf_counter()
    camera = lens.camera(bands_nm=[550], **stop, **film(name))
    seconds = time.perf_counter() - start
    width = FURNACE_WIDTH
    height = round(width * camera.film_height_mm / camera.film_width_mm)
    image = render(osl=camera.osl, scene="white", width=width, height=height, samples=FURNACE_SAMPLES)[0][..., 0]
    rows = lens.pupil(lambda_nm=550, **stop, **film(name))["pupil"]
    y, x = np.indices(image.shape)
    r = np.hypot(((x + 0.5) / width - 0.5) * camera.film_width_mm, ((y + 0.5) / height - 0.5) * camera.film_height_mm)
    ratio = image / np.interp(r, [p["r_mm"] for p in rows], [p["relative_illumination"] for p in rows])
    edges = np.linspace(0, r.max() * (1 + 1e-9), BINS + 1)
    bins = [ratio[(r >= a) & (r < b)] for a, b in zip(edges[:-1], edges[1:], strict=True)]
    worst = max(bins, key=lambda b: abs(b.mean() - 1))
    return {
        "lens": name,
        "fnumber": camera.fnumber,
        "surfaces": lens.info()["surfaces"],
        "acceptance": camera.acceptance,
        "missed_fraction": max(camera.missed_fraction),
        "mean_error": ratio.mean() - 1,
        "worst_bin_error": worst.mean() - 1,
        "worst_bin_standard_error": worst.std() / np.sqrt(worst.size),
        "noise_8spp": ratio.std(),
        "noise_8spp_worst_bin": max(b.std() for b in bins),
        "table_and_shader_s": seconds,
    }


def furnaces(names):
    out = []
    for name in names:
        out.append(furnace(name, {}))
        if out[-1]["fnumber"] < 5.5:
            out.append(furnace(name, {"fnumber": 5.6}))
        print(json.dumps(out[-2:]), file=sys.stderr)
    return out


def cost():
    """ns per camera sample and core in an empty world, from the slope between two sample counts."""
    camera = pecs.Lens("dgauss_50mm_tronnier").camera(bands_nm=[550], film_width_mm=36, film_height_mm=24)
    cameras = {"perspective": None, "dgauss_11_surfaces": camera.osl}
    width, height, few, many = 640, 360, 4, 36
    out = {name: [] for name in cameras}
    for _ in range(5):
        for name, osl in cameras.items():
            job = {"osl": osl, "hfov_deg": 40, "scene": "empty", "width": width, "height": height, "threads": 1}
            seconds = [render(samples=n, **job)[1] for n in (few, many)]
            out[name].append((seconds[1] - seconds[0]) / (width * height * (many - few)) * 1e9)
    return {name: {"ns_per_sample_median": statistics.median(v), "passes": v} for name, v in out.items()}


def modes(names):
    """Noise of a path-traced scene at equal time: three bands traced each at its own wavelength, one per sample,
    against all at their mean; and the colour error that the mean costs."""
    out = []
    job = {"scene": "lit", "width": 320, "height": 180, "threads": 1}
    for name in names:
        for bands in ([540.0, 550.0, 560.0], [450.0, 550.0, 650.0]):
            row = {"lens": name, "bands_nm": bands}
            for mode, tolerance in (("mean", 1e6), ("per_channel", 0)):
                camera = pecs.Lens(name).camera(
                    bands_nm=bands, focus_m=2.0, fnumber=5.6, colour_tolerance_px=tolerance, **film(name)
                )
                assert camera.channel_mode == mode
                few, many = 4, 24
                short = render(osl=camera.osl, samples=few, **job)[1]
                runs = [render(osl=camera.osl, samples=many, seed=seed, **job) for seed in (1, 2, 3)]
                images = np.array([run[0] for run in runs])
                lit = images.mean(axis=0) > 0.02 * images.mean()
                noise = np.sqrt((images.var(axis=0, ddof=1)[lit] / images.mean(axis=0)[lit] ** 2).mean())
                seconds = (statistics.median(run[1] for run in runs) - short) / (many - few) * many
                row[mode] = {"noise": noise, "render_s": seconds, "noise_at_1_s": noise * seconds**0.5}
                row["colour_error_of_mean_px"] = camera.colour_shift_px
            row["noise_at_equal_time_per_channel_over_mean"] = (
                row["per_channel"]["noise_at_1_s"] / row["mean"]["noise_at_1_s"]
            )
            out.append(row)
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", default=["furnace", "cost", "modes"])
    parser.add_argument("--lens", nargs="*")
    arguments = parser.parse_args()
    shipped = sorted(p.stem for p in (ROOT / "lens_data/lenses").glob("*.json"))
    report = {"blender": render(osl=None, hfov_deg=40, scene="empty", width=8, height=8, samples=1)[2]}
    if "furnace" in arguments.parts:
        report["furnace"] = furnaces(arguments.lens or shipped)
    if "cost" in arguments.parts:
        report["cost"] = cost()
    if "modes" in arguments.parts:
        report["modes"] = modes(arguments.lens or ["cmount_8mm_f2p8", "dgauss_50mm_tronnier"])
    json.dump(report, sys.stdout, indent=1)


if __name__ == "__main__":
    main()
