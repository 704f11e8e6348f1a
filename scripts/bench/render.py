"""What a band pass costs over a plain Cycles render of the same scene, instants and samples: scenes/room, no lens.
Plain and banded rounds alternate; seconds are CPU seconds of all threads, which other work disturbs least. Prints JSON.

    .venv/bin/python scripts/bench/render.py [--width 480] [--samples 16] [--frames 5]
"""

import argparse
import json
import statistics
import time
from pathlib import Path

import bpy
from pecs_blender.job.resources import resident_mb
from pecs_blender.scene import cycles
from pecs_blender.scene.folder import FolderScene
from pecs_blender.scene.scene_file import load_scene
from pecs_blender.spectral.bands import points
from pecs_blender.spectral.spectra import load
from pecs_blender.spectral.spectral_scene import SpectralScene

SCENE = Path(__file__).resolve().parents[2] / "scenes" / "room"
PASSES = points([430.0, 480.0, 520.0]), points([560.0, 610.0, 680.0])


def seconds(film) -> float:
    start = time.process_time()
    film.render()
    return time.process_time() - start


def measure(args, banded: bool) -> list[list[float]]:
    """[frames][passes], without the first frame."""
    source = FolderScene(load_scene(SCENE, []))
    cycles.configure(
        source.scene,
        args.width,
        args.width * 9 // 16,
        cycles.Sampling(samples=args.samples, seed=1, bounces=source.bounces),
    )
    source.make_camera(5.0, 6.2208)
    spectral = SpectralScene(load("d65"), source.folder) if banded else None
    rows, film = [], cycles.Film(source.scene)
    for frame in range(args.frames + 1):
        source.set_time(frame * 1e-3)
        row = []
        for bands in PASSES:
            if spectral:
                spectral.set_pass(bands)
            row.append(seconds(film))
        rows.append(row)
    return rows[1:]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--width", type=int, default=480)
    parser.add_argument("--samples", type=int, default=16)
    parser.add_argument("--frames", type=int, default=5)
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args()
    plain, banded = [], []
    for _ in range(args.rounds):
        plain += measure(args, False)
        banded += measure(args, True)
    median = statistics.median
    result = {
        "blender": bpy.app.version_string,
        "width": args.width,
        "samples": args.samples,
        "plain_s": median(t for row in plain for t in row),
        "band_pass_s": median(t for row in banded for t in row),
        "plain_first_s": median(row[0] for row in plain),
        "plain_again_s": median(row[1] for row in plain),
        "band_first_of_frame_s": median(row[0] for row in banded),
        "band_second_of_frame_s": median(row[1] for row in banded),
        "resident_mb": resident_mb(),
    }
    result["overhead"] = result["band_pass_s"] / result["plain_s"] - 1
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
