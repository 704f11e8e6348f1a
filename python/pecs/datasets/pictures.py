"""Pictures of an RGB camera, and the objects that caused events."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from .._files import write_text, write_whole
from .._pages import png_bytes
from ..chip import Chip
from ..events import read
from ..light import Light
from ..motion import event_labels
from . import rgb, rig
from .files import npy_bytes
from .plan import CameraPlan
from .work import Work

PNG_LEVEL = 6
METERED = 32  # most pictures that determine the gain


def take(work: Work, camera: CameraPlan) -> None:
    """Writes rgb/, sharp/ and rgb.csv of an RGB camera."""
    folder = work.folder / camera.name
    if (folder / "rgb.csv").exists():
        return
    work.say(f"{camera.name}: pictures")
    folder.mkdir(exist_ok=True)
    stack, film, times = work.folder / camera.stack, camera.entry.film, work.plan.exposures_us(camera)
    assert film
    info = rig.stack_json(stack)
    size = (info["width"], info["height"], info["pixel_pitch_m"] * 1e6)
    chips = [rgb.write_chip(folder / f"filter_{c}.json", i, *size, film.peak_qe) for i, c in enumerate("rgb")]
    rows = ["index,start_us,end_us"]
    for name in ("rgb", "sharp"):
        shutil.rmtree(folder / name, ignore_errors=True)
    with Light(stack, [Chip(path) for path in chips]) as light:
        first_us = info["times_ns"][0] * 1e-3
        middles = [(begin + end) / 2 - first_us for begin, end in times]
        developer = rgb.Developer(
            film,
            camera.exposure_ms,
            rgb.colour_matrix(info, rgb.illuminant(info)),
            (light.at(t) for t in middles[:: 1 + len(middles) // METERED] or [0.0]),
            work.plan.rng(f"camera.{camera.name}.film"),
        )
        for index, (begin, end) in enumerate(times):
            first_row = begin - first_us - film.rolled_us(size[1])
            planes = light.exposure(first_row, end - begin, film.rolling_us, film.steps or None)
            name = f"{index:06d}.png"
            write_whole(folder / "rgb" / name, png_bytes(developer.picture(planes), PNG_LEVEL))
            if film.sharp:
                sharp = developer.sharp(light.at(middles[index]))
                write_whole(folder / "sharp" / name, png_bytes(sharp, PNG_LEVEL))
            rows.append(f"{index},{begin},{end}")
    write_text(folder / "rgb.csv", "\n".join(rows) + "\n")


def label_events(work: Work, camera: CameraPlan, folder: Path) -> None:
    """Writes objects.npy: the object at each event's pixel and time."""
    events = read(folder / "events.h5", "dsec")
    if {"objects", "motion"} <= set(work.plan.recipe.truth.layers):
        work.say(f"{camera.name}: objects of events")
        labels = event_labels(events, work.folder / camera.truth)
    else:
        labels = np.zeros(len(events), np.uint16)
    write_whole(folder / "objects.npy", npy_bytes(labels.astype("<u2")))
