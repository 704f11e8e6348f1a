#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Hashes of the events that a build makes, over chips, models, formats, sources and options. Two builds whose tables
are equal make the same events.

    scripts/studies/event_hashes.py -o new.json [--program build/release/bin/pecs] [--expected old.json]

Python's `pecs` is the one that PYTHONPATH names; the program is --program. A case that a build refuses has its error's
exit code instead. With --expected, rows that differ from that table's are listed and end the command with exit code 1;
the core may refuse pictures and video (exit 6).
"""

import hashlib
import itertools
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
import pecs
from pecs.motion import CHANNELS
from pecs_lab.measure import command
from pecs_lab.scenes import stack_json

ROOT = Path(__file__).resolve().parents[2]
WIDTH, HEIGHT, FRAMES, PERIOD_US = 67, 45, 40, 8000
CHIPS = ("ideal", "imx636", "gen3_vga", "davis346")
MODELS = {m["name"]: m for m in pecs.models()}
NOISY = ("background_on_hz=20", "background_off_hz=30", "hot_pixel_fraction=0.01", "leak_rate_hz=5")


def light(t: float) -> np.ndarray:
    """[3, H, W]: bars of three colours that turn once in a period, t in [0, 1)."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    angle = np.arctan2(y - HEIGHT / 2 + 0.3, x - WIDTH / 2 - 0.2)
    bands = [1.1 + np.tanh(4 * np.sin(n * (angle - 2 * np.pi * t) + n)) for n in (3, 4, 5)]
    return np.array(bands, np.float32)


def write_stacks(folder: Path) -> None:
    bands = pecs.bands("imx636", 3)
    for name, quantity, scale in (("film", "irradiance", 2e-4), ("scene", "radiance", 0.02)):
        times_ns = [i * PERIOD_US * 1000 // FRAMES for i in range(FRAMES)]
        more = {"quantity": quantity, "bands": bands, "period_ns": PERIOD_US * 1000}
        stack = stack_json(WIDTH, HEIGHT, times_ns, **more)
        with pecs.StackWriter(folder / name, stack) as writer:
            for i in range(FRAMES):
                writer.write_frame(i, light(i / FRAMES) * np.float32(scale))
    (folder / "pictures").mkdir()
    video = cv2.VideoWriter(str(folder / "video.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 500, (WIDTH, HEIGHT))
    for i in range(FRAMES):
        picture = np.clip(light(i / FRAMES).transpose(1, 2, 0) * 110, 0, 255).astype(np.uint8)
        cv2.imwrite(str(folder / "pictures" / f"{i}.png"), picture)
        video.write(picture)
    video.release()


def cases():
    """Names and arguments of `pecs sense`."""
    for chip, model, noise in itertools.product(CHIPS, MODELS, ("", "--no-noise")):
        yield f"{chip} {model} {noise}".strip(), ["film", "--chip", chip, "--model", model, *noise.split()]
    noisy = [f"--set={item}" for item in NOISY]
    for chip in CHIPS:
        yield f"{chip} noisy", ["film", "--chip", chip, *noisy]
        yield f"{chip} noisy labels", ["film", "--chip", chip, *noisy, "--labels", "labels.npy"]
        yield f"{chip} loops", ["film", "--chip", chip, "--warmup-loops", "2"]
        yield f"{chip} loops noisy labels", [
            "film", "--chip", chip, *noisy, "--labels", "labels.npy", "--warmup-loops", "1", "--duration", "20001",
        ]  # fmt: skip
        yield f"{chip} ideal readout", ["film", "--chip", chip, *noisy, "--readout", "ideal"]
    slow = [
        "--set=readout_rate_hz=3e5",
        "--set=readout_row_s=2e-7",
        "--set=timestamp_s=5e-6",
        "--set=clock_jitter_s=3e-6",
    ]
    yield "slow readout", ["film", "--chip", "imx636", *slow]
    yield "slow readout, loops", ["film", "--chip", "imx636", *slow, "--warmup-loops", "3", "--start", "1234"]
    yield "refractory", ["film", "--chip", "ideal", "--set=refractory_period_s=3e-4"]
    yield "window", ["film", "--start", "1500", "--warmup-loops", "0", "--seed", "7"]
    yield "radiance", ["scene", "--fnumber", "4"]
    yield "radiance, window of one loop", ["scene", "--gain", "1e-14", "--start", "2000", "--duration", "3000"]
    yield "mc", ["film", "--bands", "mc:4", "--seed", "3"]
    yield "mc, loops", ["film", "--bands", "mc:2", "--warmup-loops", "1"]
    yield "long loops", ["film", "--warmup-loops", "1", "--duration", "200000", "--chip", "davis346"]
    for model in MODELS:
        yield f"pictures {model}", ["pictures", "--fps", "4000", "--model", model]
        yield f"video {model}", ["video.avi", "--model", model]
        if not MODELS[model]["takes_light"]:
            yield f"white {model}", ["film", "--model", model, "--white", "3e-13"]


def digest(*parts: bytes) -> str:
    return hashlib.sha256(b"".join(parts)).hexdigest()[:16]


def of_events(events) -> str:
    return f"{len(events)} {digest(*(np.ascontiguousarray(events[k]).tobytes() for k in 'txyp'))}"


def sensed(program: Path, folder: Path) -> dict[str, str]:
    table = {}
    for name, arguments in cases():
        for file in (folder / "labels.npy", folder / "out.npz"):
            file.unlink(missing_ok=True)
        for threads in ("1", "0"):
            command = [program, "sense", *arguments, "-o", "out.npz", "--threads", threads, "--quiet"]
            result = subprocess.run(command, cwd=folder, capture_output=True, text=True)
            key = f"{name} | {threads}"
            if result.returncode:
                table[key] = f"exit {result.returncode}"
                continue
            table[key] = of_events(pecs.read(folder / "out.npz"))
            if "--labels" in arguments:
                table[key] += " " + digest(np.load(folder / "labels.npy").tobytes())
    return table


def written(program: Path, folder: Path) -> dict[str, str]:
    """The events read back from a file of each format."""
    table = {}
    subprocess.run([program, "sense", "film", "-o", "all.csv", "--quiet"], cwd=folder, check=True)
    for name, extension in [(f["name"], f["extensions"][0]) for f in pecs.event_formats() if f["writes"]]:
        output = f"{name}{extension}"
        command = [program, "convert", "all.csv", output, "--format", name, "--quiet"]
        result = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        table[f"file {name}"] = (
            f"exit {result.returncode}" if result.returncode else of_events(pecs.read(folder / output))
        )
    return table


def pushed() -> dict[str, str]:
    """The sensor on frames in memory, in uneven steps and batches."""
    frames = np.array([light(i / FRAMES)[0] for i in range(FRAMES)])
    t_us = np.cumsum(np.random.default_rng(1).uniform(50, 400, FRAMES))
    table = {}
    for chip, model in itertools.product(CHIPS, MODELS):
        sensor = pecs.Sensor(WIDTH, HEIGHT, chip, model=model, seed=5)
        parts = [sensor.push(frames[a:b], t_us[a:b]) for a, b in ((0, 1), (1, 9), (9, 40))]
        table[f"push {chip} {model}"] = of_events(np.concatenate([*parts, sensor.finish()]))
    return table


def warmed_up(program: Path, folder: Path) -> dict[str, str]:
    """Warm-up of light that rises, over threads: frames alone, a motion layer of zeros, above 4.2 million pixels.
    The hashes of a stack are equal, and so are those of `frames` and `motion`."""
    table = {}
    still = np.zeros((len(CHANNELS), HEIGHT, WIDTH), np.float32)
    still[[name.removeprefix("back_") in ("z", "z_end") for name in CHANNELS]] = 1
    layer = {"name": "motion", "channels": list(CHANNELS), "unit": "px", "at": "interval", "files": "motion_%06d.exr"}
    for name, width, height, frames in (
        ("frames", WIDTH, HEIGHT, 20), ("motion", WIDTH, HEIGHT, 20), ("large", 2100, 2100, 3),
    ):  # fmt: skip
        layers = [layer] if name == "motion" else []
        stack = stack_json(width, height, [i * 1_000_000 for i in range(frames)], layers=layers)
        with pecs.StackWriter(folder / f"rising_{name}", stack) as writer:
            for i in range(frames):
                if name == "motion" and i + 1 < frames:
                    writer.write_layer("motion", i, still)
                writer.write_frame(i, np.full((1, height, width), 1e-4 * np.exp(0.02 * i), np.float32))
        for chip, threads in itertools.product(
            ("imx636", "ideal") if name != "large" else ("ideal",), ("1", "2", "16")
        ):
            command = [program, "sense", f"rising_{name}", "-o", "out.npz", "--threads", threads, "--quiet"]
            result = subprocess.run([*command, "--chip", chip, "--warmup", "2000"], cwd=folder, capture_output=True)
            events = None if result.returncode else of_events(pecs.read(folder / "out.npz"))
            table[f"warm-up {name} {chip} | {threads}"] = events or f"exit {result.returncode}"
    return table


def main(*, output: Path, program: Path = ROOT / "build/release/bin/pecs", expected: Path | None = None) -> None:
    program = program.resolve()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        write_stacks(folder)
        table = sensed(program, folder) | written(program, folder) | pushed() | warmed_up(program, folder)
    output.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
    refused = sum(value.startswith("exit") for value in table.values())
    print(f"{len(table)} cases, {refused} refused, all: {digest(json.dumps(table).encode())}")
    if expected:
        core = {name for name in table if name.startswith(("pictures", "video")) and table[name] == "exit 6"}
        old = json.loads(expected.read_text(encoding="utf-8"))
        names = (old.keys() | table.keys()) - core
        differ = [name for name in names if old.get(name) != table.get(name)]
        print(f"{len(names) - len(differ)} equal, {len(differ)} differ, {len(core)} not in the core")
        sys.exit("\n".join(sorted(differ)) or None)


if __name__ == "__main__":
    command(main)
