"""The lens camera in Cycles, as JSON: white furnace against quadrature, noise, and cost beside the built-in camera.

    .venv/bin/python bench/lens_camera.py [LENS ...] > lens_camera.json

Needs bpy in the interpreter that runs it (it renders in child processes) and libpecs (scripts/setup.sh).
"""

import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "python"))
import pecs  # noqa: E402

FULL_FRAME = {"dgauss_50mm_tronnier", "retrofocus_35mm_f2p8", "wide_22mm_f2p7_nakamura"}


def render(**job):
    with tempfile.TemporaryDirectory() as folder:
        job_path, out_path = Path(folder) / "job.json", Path(folder) / "out.npz"
        job_path.write_text(json.dumps(job))
        script = ROOT / "tests/python/lens_render.py"
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
    width = 320
    height = round(width * camera.film_height_mm / camera.film_width_mm)
    image = render(osl=camera.osl, scene="white", width=width, height=height, samples=8)[0][..., 0]
    rows = lens.pupil(lambda_nm=550, **stop, **film(name))["pupil"]
    y, x = np.indices(image.shape)
    r = np.hypot(((x + 0.5) / width - 0.5) * camera.film_width_mm, ((y + 0.5) / height - 0.5) * camera.film_height_mm)
    ratio = image / np.interp(r, [p["r_mm"] for p in rows], [p["relative_illumination"] for p in rows])
    edges = np.linspace(0, r.max() * (1 + 1e-9), 13)
    bins = [ratio[(r >= a) & (r < b)] for a, b in zip(edges[:-1], edges[1:], strict=True)]
    return {
        "lens": name,
        "fnumber": camera.fnumber,
        "acceptance": camera.acceptance,
        "missed_fraction": max(camera.missed_fraction),
        "mean_error": ratio.mean() - 1,
        "worst_bin_error": max((b.mean() - 1 for b in bins), key=abs),
        "noise_8spp": ratio.std(),
        "noise_8spp_corner": bins[-2].std(),
        "table_and_shader_s": seconds,
    }


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


def main():
    names = sys.argv[1:] or sorted(p.stem for p in (ROOT / "lens_data/lenses").glob("*.json"))
    version = render(osl=None, hfov_deg=40, scene="empty", width=8, height=8, samples=1)[2]
    report = {"blender": version, "furnace": [], "cost": cost()}
    for name in names:
        report["furnace"].append(furnace(name, {}))
        if report["furnace"][-1]["fnumber"] < 5.5:
            report["furnace"].append(furnace(name, {"fnumber": 5.6}))
    json.dump(report, sys.stdout, indent=1)


if __name__ == "__main__":
    main()
