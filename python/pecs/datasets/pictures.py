"""The light of a stack as an RGB camera takes it, and the objects that events come from."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..chip import Chip
from ..events import read
from ..light import Light
from ..motion import event_labels
from . import rgb
from ._check import library
from .files import write_array, write_text
from .recipe import CameraEntry

if TYPE_CHECKING:
    from .run import Work

METERED = 32  # pictures that the gain is taken from, at most


def take(work: Work, entry: CameraEntry) -> None:
    """rgb/, sharp/ and rgb.csv of an RGB camera."""
    folder = work.folder / entry.name
    if (folder / "rgb.csv").exists():
        return
    work.say(f"{entry.name}: pictures")
    folder.mkdir(exist_ok=True)
    stack, film, drawn = work.stack(entry), entry.film, work.drawn["cameras"][entry.name]
    assert film
    info = json.loads((stack / "stack.json").read_text())
    size = (info["width"], info["height"], info["pixel_pitch_m"] * 1e6)
    chips = [rgb.write_chip(folder / f"filter_{c}.json", i, *size, film.peak_qe) for i, c in enumerate("rgb")]
    times = rgb.frame_times_us(film, size[1], work.duration_us, drawn["exposure_ms"], drawn["phase_ms"])
    rows = ["index,start_us,end_us"]
    for name in ("rgb", "sharp"):
        shutil.rmtree(folder / name, ignore_errors=True)
    with Light(stack, [Chip(path) for path in chips]) as light:
        middles = [(begin + end) / 2 for begin, end in times]
        developer = rgb.Developer(
            film,
            drawn["exposure_ms"],
            rgb.colour_matrix(info, rgb.illuminant(info)),
            (light.at(t) for t in middles[:: 1 + len(middles) // METERED] or [0.0]),
            work.recipe.rng(work.index, f"camera.{entry.name}.film"),
        )
        for index, (begin, end) in enumerate(times):
            first_row = begin - film.rolling_us * (size[1] - 1) / 2
            planes = light.exposure(first_row, end - begin, film.rolling_us, film.steps or None)
            _save(folder / "rgb" / f"{index:06d}.png", developer.picture(planes))
            if film.sharp:
                _save(folder / "sharp" / f"{index:06d}.png", developer.sharp(light.at(middles[index])))
            rows.append(f"{index},{begin},{end}")
    write_text(folder / "rgb.csv", "\n".join(rows) + "\n")


def _save(path: Path, picture: np.ndarray[Any, Any]) -> None:
    cv2 = library("cv2", "opencv-python-headless", "pictures")
    from .files import write_whole

    done, png = cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_PNG_COMPRESSION, 6])
    assert done
    write_whole(path, png.tobytes())


def label_events(work: Work, entry: CameraEntry, folder: Path) -> None:
    """objects.npy: the object that each event's pixel saw at the event's time."""
    events = read(folder / "events.h5", "dsec")
    if {"objects", "motion"} <= set(work.recipe.truth["layers"]):
        work.say(f"{entry.name}: objects of events")
        labels = event_labels(events, work.truth(entry))
    else:
        labels = np.zeros(len(events), np.uint16)
    write_array(folder / "objects.npy", labels.astype("<u2"))
