#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""docs/reference/motion.png: keyframes, warped light, frames rendered between them and wrong events, from the stacks of
scripts/bench/motion.py.

.venv/bin/python scripts/bench/motion.py -o out/motion
.venv/bin/python scripts/pictures/motion.py out/motion -o docs/reference/motion.png
"""

import argparse
from pathlib import Path

import numpy as np
import pecs
from figures import plt, save

SCENES = ("room", "shadow", "mirror", "character")
TITLES = (
    "keyframe",
    "next keyframe",
    "warped to the middle",
    "rendered in the middle",
    "frames between",
    "wrong events, uniform",
    "wrong events, adaptive",
)


def shown(light: np.ndarray, white: float) -> np.ndarray:
    return np.clip(light / white, 0, 1) ** (1 / 2.2)


def events_per_pixel(folder: Path, shape: tuple[int, int]) -> np.ndarray:
    """[2, h, w]: OFF and ON."""
    events = pecs.read(folder.parent / f"{folder.name}.npz")
    count = np.zeros((2, *shape), int)
    np.add.at(count, (events["p"], events["y"], events["x"]), 1)
    return count


def row(folder: Path, scene: str, interval: int) -> list[tuple[np.ndarray, str]]:
    with (
        pecs.StackReader(folder / "adaptive" / scene) as stack,
        pecs.StackReader(folder / "uniform" / scene) as uniform,
    ):
        times, side = stack.info["times_ns"], stack.info["subpixels"]
        first, second = (stack.read_frame(interval + k).mean(0) for k in (0, 1))
        warped = pecs.carry(first, second, stack.read_layer("motion", interval), 0.5)
        middle = np.argmin(np.abs(np.array(uniform.info["times_ns"]) - (times[interval] + times[interval + 1]) / 2))
        true = uniform.read_frame(int(middle)).mean(0)
        rendered = np.zeros(first.shape)
        for i in range(len(times) - 1):
            for k in range(len(stack.between_ns(i))):
                rendered += np.isfinite(stack.read_between(i, k)[0])
    white, shape = np.percentile(true, 99.5), true.shape
    coarse = [p.reshape(shape[0], side, shape[1], side).mean((1, 3)) for p in (first, second, warped)]
    truth = events_per_pixel(folder / "ref_77" / scene, shape)
    wrong = [np.abs(events_per_pixel(folder / kind / scene, shape) - truth).sum(0) for kind in ("uniform", "adaptive")]
    return [
        *((shown(p, white), "gray") for p in (*coarse, true)),
        (rendered / 64, "magma"),
        *((np.clip(w / 40, 0, 1), "magma") for w in wrong),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="where scripts/bench/motion.py wrote its stacks")
    parser.add_argument("-o", "--output", type=Path, required=True)
    args = parser.parse_args()
    figure, axes = plt.subplots(len(SCENES), len(TITLES), figsize=(16, 1.45 * len(SCENES) + 0.3), squeeze=False)
    for line, scene in zip(axes, SCENES, strict=True):
        for axis, (picture, colours), title in zip(line, row(args.folder, scene, 1), TITLES, strict=True):
            axis.imshow(picture, cmap=colours, vmin=0, vmax=1, interpolation="nearest")
            axis.set_xticks([])
            axis.set_yticks([])
            if scene == SCENES[0]:
                axis.set_title(title, fontsize=9)
        line[0].set_ylabel(scene, fontsize=9)
    figure.tight_layout(pad=0.4)
    save(figure, args.output, dpi=100)


if __name__ == "__main__":
    main()
