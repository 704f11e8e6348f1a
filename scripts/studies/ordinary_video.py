#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Ordinary video against the light that it was taken of: `ordinary_video.py FOLDER [RESULT]` (with bpy; half an hour).

Renders eight scenes of 0.4 s (240x180, keyframes with motion; the camera still, panning, driving or held by hand) into
FOLDER, and simulates each stack: the truth. Then the light of the stack at the frames of a video (8-bit PNG, sRGB) is
simulated by `pecs sense` with optical flow and with --no-flow. The chip is davis346 without noise and readout.
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pecs
from pecs._poses import write_tum
from pecs_lab.measure import command, partners
from PIL import Image
from scipy.spatial.transform import Rotation

ROOT = Path(__file__).resolve().parents[2]
FPS = 30, 60, 120, 240
WITHIN_US, BIN_US = 5000, 5000  # of matches; of rates
CHIP = {"chip": "davis346", "noise": False, "readout": "ideal"}
SCENES = {
    "board": ["board", "--set", "speed_m_per_s=0.6"],
    "disk": ["rotating_disk", "--set", "rpm=20"],
    "colorchecker": ["colorchecker_disk", "--set", "rpm=30"],
    "room": ["room"],
    "room, panned": ["room", "--camera-path", "pan"],
    "street, driven": ["street", "--camera-path", "drive"],
    "boxes, by hand": ["boxes", "--camera-path", "hand"],
    "desk, by hand": ["desk", "--camera-path", "hand"],
}


def poses(name: str, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Yaw, pitch, roll [deg] and x, y, z [m] of the camera at times [s]."""
    s, zero = np.sin, 0 * t
    if name == "pan":
        turn = 4 - 30 * t + 0.4 * s(25 * t), 0.6 * s(14 * t), 1.5 * s(9 * t)
        return np.stack(turn), np.stack([0.25 * t, 0.05 * s(11 * t), 0.02 * s(13 * t)])
    if name == "drive":
        turn = 0.5 * s(9 * t) + 0.2 * s(40 * t), 0.6 * s(17 * t), 0.8 * s(11 * t)
        return np.stack(turn), np.stack([zero, 6 * t, 0.02 * s(20 * t)])
    turn = 2.2 * s(8 * t) + 0.5 * s(23 * t), 1.2 * s(11 * t + 1), 2 * s(6 * t)
    return np.stack(turn), np.stack([0.12 * s(5 * t), 0.05 * t, 0.05 * s(7 * t)])


def write_path(file: Path) -> Path:
    """In TUM's format; the scenes' cameras look along +y, z is up."""
    t = np.arange(0, 0.7, 0.001)
    turn, place = poses(file.stem, t)
    turned = Rotation.from_euler("ZXY", turn.T, degrees=True) * Rotation.from_euler("x", -90, degrees=True)
    write_tum(file, t, place.T, turned.as_quat())
    return file


def render(name: str, folder: Path) -> Path:
    out = folder / name.replace(",", "").replace(" ", "_")
    if out.exists():
        return out
    words = list(SCENES[name])
    if "--camera-path" in words:
        words[-1] = str(write_path(folder / f"{words[-1]}.tum"))
    size = ["--width", "240", "--height", "180", "--bands", "2", "--samples", "8"]
    subprocess.run(
        [sys.executable, "-m", "pecs_blender", "render", str(ROOT / "scenes" / words[0]), *words[1:], "-o", str(out)]
        + ["--fps", "1000", "--frames", "0:401", "--time", "adaptive", *size, "--quiet"],
        check=True,
    )
    return out


def score(truth: np.ndarray, found: np.ndarray, unsure: np.ndarray, end_us: float) -> dict[str, float]:
    truth, inside = truth[truth["t"] < end_us], found["t"] < end_us
    found, unsure = found[inside], unsure[inside]
    known, paired = partners(truth, found, WITHIN_US)
    right = np.zeros(len(found), bool)
    right[paired] = True
    bins = np.arange(0, end_us + 1, BIN_US)
    rates = [np.histogram(e["t"], bins)[0] for e in (truth, found)]
    out = {
        "events": len(found) / len(truth),
        "rate_correlation": float(np.corrcoef(*rates)[0, 1]),
        "recall": len(known) / len(truth),
        "precision": right.mean(),
        "unsure": unsure.mean(),
        "precision_sure": right[~unsure].mean(),
        "precision_unsure": right[unsure].mean() if unsure.any() else float("nan"),
    }
    return {key: None if np.isnan(value) else round(float(value), 4) for key, value in out.items()}


def measure(stack: Path) -> list[dict[str, object]]:
    """A row for each rate and way. Files go to the stack's name with .video."""
    folder = stack.with_suffix(".video")
    folder.mkdir(exist_ok=True)
    with pecs.Light(stack, CHIP["chip"]) as light:
        white = float(np.quantile(light.at(0.0), 0.995))
        frames = {}
        for fps in FPS:
            times = np.arange(0, light.end_us, 1e6 / fps)
            linear = np.clip(np.stack([light.at(t)[0] for t in times]) / white, 0, 1)
            srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
            frames[fps] = times, np.round(255 * srgb).astype(np.uint8)
    pecs.sense(stack, folder / "truth.npz", render_noise=0, **CHIP)
    truth = np.asarray(pecs.read(folder / "truth.npz"))
    out: list[dict[str, object]] = []
    for fps, (times, pictures) in frames.items():
        video = folder / f"video_{fps}"
        video.mkdir(exist_ok=True)
        for i, picture in enumerate(pictures):
            Image.fromarray(picture).save(video / f"{i:04}.png")
        for name, words in {"flow": ["--labels", str(folder / f"labels_{fps}.npy")], "no_flow": ["--no-flow"]}.items():
            out_file = folder / f"{name}_{fps}.npz"
            call = [pecs.program(), "sense", str(video), "-o", str(out_file)]
            call += ["--fps", str(fps), "--chip", CHIP["chip"], "--no-noise", "--readout", "ideal", "--quiet"]
            subprocess.run([*call, "--photocurrent", str(white), *words], check=True, stdout=subprocess.DEVNULL)
            found = np.asarray(pecs.read(out_file))
            unsure, row = np.zeros(len(found), bool), {"fps": fps, "way": name}
            if name == "flow":
                unsure = np.load(folder / f"labels_{fps}.npy") == pecs.sensor.LABELS.index("unsure")
                results = json.loads(out_file.with_name(f"{out_file.name}.run.json").read_text())["results"]
                estimate = results["motion_estimate"]
                row["motion_px"] = [round(estimate["median_px"], 2), round(estimate["largest_px"], 1)]
            out.append(row | score(truth, found, unsure, float(times[-1])))
            print(stack.name, json.dumps(out[-1]), flush=True)
    return out


def main(folder: Path, result: Path = ROOT / "scripts/studies/ordinary_video.json", *, only: list[str] = ()) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for name in only or SCENES:
        rows += [{"scene": name, **row} for row in measure(render(name, folder))]
        result.write_text("[\n" + ",\n".join(map(json.dumps, rows)) + "\n]\n")


if __name__ == "__main__":
    command(main)
