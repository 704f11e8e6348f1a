"""The cost of a band pass over a plain Cycles render of the same scene, instants and samples: scenes/room, no lens.
Plain and banded rounds alternate; seconds are CPU seconds of all threads, which other work disturbs least. Prints JSON.

    .venv/bin/python scripts/bench/render.py [--width 480] [--samples 16] [--frames 5]
"""

import statistics
import time
from pathlib import Path

import bpy
from pecs._platform import resident_mb
from pecs_blender.scene import cycles
from pecs_blender.scene.folder import FolderScene
from pecs_blender.scene.scene_file import load_scene
from pecs_blender.spectral.bands import points
from pecs_blender.spectral.spectra import load
from pecs_blender.spectral.spectral_scene import SpectralScene
from pecs_lab.measure import command

SCENE = Path(__file__).resolve().parents[2] / "scenes" / "room"
PASSES = points([430.0, 480.0, 520.0]), points([560.0, 610.0, 680.0])


def seconds(film) -> float:
    start = time.process_time()
    film.render()
    return time.process_time() - start


def measure(width: int, samples: int, frames: int, banded: bool) -> list[list[float]]:
    """[frames][passes], without the first frame."""
    source = FolderScene(load_scene(SCENE, []))
    sampling = cycles.Sampling(samples=samples, seed=1, bounces=source.bounces)
    cycles.configure(source.scene, width, width * 9 // 16, sampling)
    source.make_camera(5.0, 6.2208)
    spectral = SpectralScene(load("d65"), source.folder) if banded else None
    rows, film = [], cycles.Film(source.scene)
    for frame in range(frames + 1):
        source.set_time(frame * 1e-3)
        row = []
        for bands in PASSES:
            if spectral:
                spectral.set_pass(bands)
            row.append(seconds(film))
        rows.append(row)
    return rows[1:]


def main(*, width: int = 480, samples: int = 16, frames: int = 5, rounds: int = 3) -> dict:
    plain, banded = [], []
    for _ in range(rounds):
        plain += measure(width, samples, frames, False)
        banded += measure(width, samples, frames, True)
    result = {"blender": bpy.app.version_string, "width": width, "samples": samples, "resident_mb": resident_mb()}
    for name, rows in (("plain", plain), ("band", banded)):
        result[f"{name}_s"] = statistics.median(t for row in rows for t in row)
        result[f"{name}_first_of_frame_s"] = statistics.median(row[0] for row in rows)
        result[f"{name}_second_of_frame_s"] = statistics.median(row[1] for row in rows)
    return result | {"overhead": result["band_s"] / result["plain_s"] - 1}


if __name__ == "__main__":
    command(main)
