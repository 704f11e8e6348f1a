"""The lens camera in Cycles, as JSON: its cost relative to the built-in camera, and noise of both channel modes at
equal time.

    .venv/bin/python scripts/bench/lens_camera.py [cost|modes ...] [--lens LENS ...]

Needs bpy in the interpreter that runs it (it renders in child processes) and libpecs (scripts/setup.sh). Times are wall
times of one rendering thread (another spins in wait for it, which a process' CPU time would count): run it alone.
"""

import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pecs
from pecs_lab.films import covered
from pecs_lab.measure import command

ROOT = Path(__file__).resolve().parents[2]


def render(**job):
    with tempfile.TemporaryDirectory() as folder:
        job_path, out_path = Path(folder) / "job.json", Path(folder) / "out.npz"
        job_path.write_text(json.dumps(job))
        script = ROOT / "tests/python/support/lens_render.py"
        subprocess.run([sys.executable, script, job_path, out_path], check=True, capture_output=True)
        out = np.load(out_path)
        return out["image"].astype(float), float(out["seconds"]), str(out["blender"])


def film(name):
    return dict(zip(("film_width_mm", "film_height_mm"), covered(name)[0], strict=True))


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


def main(
    parts: list[str] = ("cost", "modes"), *, lens: list[str] = ("cmount_8mm_f2p8", "dgauss_50mm_tronnier")
) -> dict:
    report = {"blender": render(osl=None, hfov_deg=40, scene="empty", width=8, height=8, samples=1)[2]}
    works = {"cost": cost, "modes": lambda: modes(lens)}
    return report | {part: works[part]() for part in parts}


if __name__ == "__main__":
    command(main)
