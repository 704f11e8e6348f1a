"""Cost and loss of rendering at keyframes against uniform steps, for the same events: CPU seconds, and recall,
precision and time error of events against a reference: keyframes 6 pixels apart, pictures between at steps of a quarter
pixel, many samples, no denoising. "ceiling" is a second reference with another seed. noise_events is the share that
`pecs sense` estimates from the stack alone. Prints JSON.

    .venv/bin/python scripts/bench/motion.py out/motion [--scenes room shadow …] [--samples 8] [--variants …]

The scenes are those of motion_scenes.py and two of the lab's; pixels are ideal (no noise, threshold 0.2). Stacks that
are there are taken as they are.
"""

import shutil
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pecs
from pecs_lab.measure import answer, command, measured, partners

ROOT = Path(__file__).resolve().parents[2]
REFERENCE_SAMPLES = 128
THRESHOLDS = {"contrast_threshold_on": 0.2, "contrast_threshold_off": 0.2}
SENSOR = THRESHOLDS | {"corner_hz_per_a": 1e18, "amplifier_cutoff_hz": 0}


VARIANTS = {
    "uniform": (),
    "seed": ("--seed", 2),
    "adaptive": ("--time", "adaptive"),
    "no denoise": ("--time", "adaptive", "--no-denoise"),
    "step 6": ("--time", "adaptive", "--step", 6),
    "step 12": ("--time", "adaptive", "--step", 12),
    "step 32": ("--time", "adaptive", "--step", 32),
    "step 64": ("--time", "adaptive", "--step", 64),
    "no subpixels": ("--time", "adaptive", "--subpixels", 1),
    "4 subpixels": ("--time", "adaptive", "--subpixels", 4),
}


@dataclass(frozen=True)
class Scene:
    """fps: one pixel per step at the fastest place."""

    name: str
    fps: float
    seconds: float
    arguments: tuple = ()


PINHOLE = ("--lens", "none", "--focal", 15.02, "--width", 96)
BLENDS = ("room", "shadow", "mirror", "glass", "flicker", "character")
SCENES = [Scene(name, 1000, 0.063) for name in BLENDS]
SCENES += [Scene("rotating_disk", 875, 0.0731, PINHOLE), Scene("board", 150, 0.4266, PINHOLE)]


def render(scene: Scene, folder: Path, scenes: Path, fps: float, *options) -> float | None:
    """CPU seconds; None if it was there."""
    seconds_file = folder.parent / f"{folder.name}.seconds"
    if seconds_file.is_file():
        return float(seconds_file.read_text())
    path = ROOT / "scenes" / scene.name if scene.arguments else scenes / f"{scene.name}.blend"
    command = [sys.executable, "-m", "pecs_blender", "render", path, "-o", folder, "--bands", 3, *scene.arguments]
    command += ["--fps", fps, "--frames", round(scene.seconds * fps) + 1, *options]
    shutil.rmtree(folder, ignore_errors=True)
    run = measured(command)
    if run.exit:
        sys.exit(run.errors)
    seconds_file.write_text(f"{run.cpu_s}")
    return run.cpu_s


def simulated(folder: Path, **options) -> tuple[np.ndarray, float | None]:
    """Events, and the share of noise events."""
    out = folder.parent / f"{folder.name}.npz"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of the share
        report = pecs.sense(folder, out, fnumber=2.0, noise=False, readout="ideal", overrides=SENSOR, **options)
    return pecs.read(out), report["results"].get("render_noise", {}).get("share")


def events(folder: Path, **options) -> np.ndarray:
    return simulated(folder, **options)[0]


def reference_events(scene: Scene, output: Path, scenes: Path, seed: int = 77) -> np.ndarray:
    folder = output / f"ref_{seed}" / scene.name
    options = ["--time", "adaptive", "--step", 6, "--samples", REFERENCE_SAMPLES, "--no-denoise"]
    render(scene, folder, scenes, 4 * scene.fps, *options, "--seed", seed)
    return events(folder)


def score(reference: np.ndarray, found: np.ndarray, window_us: float) -> dict:
    """Events are paired that are nearest to each other, of one pixel and polarity, within the window."""
    known, right = partners(reference, found, window_us)
    error = found["t"][right] - reference["t"][known]
    return {
        "events": len(found),
        "recall": len(error) / len(reference),
        "precision": len(error) / len(found),
        "median_us": float(np.median(np.abs(error))),
        "p90_us": float(np.percentile(np.abs(error), 90)),
    }


def main(
    output: Path, *, scenes: list[str] = (), samples: int | None = None, variants: list[str] = ("uniform", "adaptive")
) -> dict:
    made = output / "scenes"
    if not made.is_dir():
        answer(sys.executable, ROOT / "scripts/bench/motion_scenes.py", made)
    results = {}
    for scene in (s for s in SCENES if not scenes or s.name in scenes):
        step_us = 1e6 / scene.fps
        truth = reference_events(scene, output, made)
        rows = results[scene.name] = {"step_us": step_us, "events": len(truth)}
        rows["ceiling"] = score(truth, reference_events(scene, output, made, seed=78), step_us)
        for variant in variants:
            folder = output / variant / scene.name
            options = [*(["--samples", samples] if samples else []), *VARIANTS[variant]]
            seconds = render(scene, folder, made, scene.fps, *options)
            found, share = simulated(folder)
            rows[variant] = {"cpu_s": seconds, "noise_events": share, **score(truth, found, step_us)}
            print(scene.name, variant, rows[variant], file=sys.stderr, flush=True)
    return {"samples": samples, "scenes": results}


if __name__ == "__main__":
    command(main)
