"""The lab's sequences: scenes/SCENE/sequences/NAME.json, parameters of the scene and how it is rendered and sensed."""

import json
import sys
from dataclasses import dataclass
from pathlib import Path

from pecs._arguments import words

from .disk import Disk

CENTRE_PX, RADIUS_PX = (956.76, 361.68), 303.0  # of R_360_L, by `pecs align detect`
ROOT = Path(__file__).resolve().parents[3]


@dataclass(frozen=True)
class Sequence:
    name: str
    scene: Path
    parameters: dict
    render: dict
    sense: dict
    published: dict  # Table 1 of the paper

    @property
    def disk(self) -> Disk:
        p = self.parameters
        return Disk(CENTRE_PX, RADIUS_PX, 6 * p["rpm"], p["phase_deg"], p["sectors"])


def load(name: str) -> Sequence:
    files = {path.stem: path for path in sorted(ROOT.glob("scenes/*/sequences/*.json"))}
    if name not in files:
        sys.exit(f"sequences: got {name}, wanted all or one of {', '.join(files)}")
    text = json.loads(files[name].read_text())
    keys = ("parameters", "render", "sense", "published")
    return Sequence(name, files[name].parents[1], *(text[key] for key in keys))


def names() -> list[str]:
    return sorted(path.stem for path in ROOT.glob("scenes/*/sequences/*.json"))


def render_arguments(sequence: Sequence, coarser: int, frames: int | None) -> list[str]:
    r = dict(sequence.render)
    r["width"], r["height"], r["fps"] = r["width"] // coarser, r["height"] // coarser, r["fps"] / coarser
    if isinstance(r["frames"], int):
        r["frames"] //= coarser
    if "moving_px" in r:
        left, top, right, bottom = r["moving_px"]
        box = left // coarser, top // coarser, -(-right // coarser), -(-bottom // coarser)
        r["moving_px"] = ":".join(map(str, box))
    if frames:
        r["frames"] = frames
    return words(r) + [f"--set={key}={value}" for key, value in sequence.parameters.items()]


def sense_arguments(sequence: Sequence, frames: int | None) -> list[str]:
    keys = [key for key in sequence.sense if not frames or key == "chip"]  # a part of a period is not looped
    return words({key: sequence.sense[key] for key in keys})
