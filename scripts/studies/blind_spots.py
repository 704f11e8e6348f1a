"""Which errors of a simulation each measure of `pecs compare` detects: one known error at a time.

    .venv/bin/python scripts/studies/blind_spots.py [--picture docs/studies/metrics.svg] > table.md

The recording is a simulated one: the lab's disk in dim light (320 x 180, imx636 with its noise, slow pixels as in
R_360_L). Five other recordings of the same scene with other seeds give the spread of each measure by chance; then one
of them, or the scene, is altered. The table lists the measures, the picture their distance from the mean of the five
in standard deviations of the five. Requires libpecs.
"""

from pathlib import Path

import numpy as np
import pecs
from pecs_lab import lab_views
from pecs_lab.disk import Disk
from pecs_lab.measure import command
from pecs_lab.report import table

SIZE, PITCH_MM = (320, 180), 0.01944
WHITE_A, WARM_UP_S, SPAN_S = 1.9e-15, 0.9, 0.0545
SEEDS = 6  # the first is the recording
DISK = {"at_mm": (0.0, 0.0, 1560.0), "radius_mm": 130.0, "speed_deg_s": 2098.0, "phase_deg": 20.0}


def recordings(seeds: list[int], white_a: float = WHITE_A, black: float = lab_views.BLACK) -> list[np.ndarray]:
    camera = lab_views.Camera("pecs_lab_15mm", 1.56, *SIZE, PITCH_MM, stop_diameter_mm=1.0)
    drawn = lab_views.Disk(**DISK, black=black).light(camera)
    times = np.concatenate([np.arange(-WARM_UP_S, 0, 1.5e-3), np.arange(0, SPAN_S, 1.2e-4)])
    return [e[e["t"] < SPAN_S * 1e6] for e in lab_views.record(drawn, times, SIZE, seeds, white_a)]


def detected() -> dict:
    """The disk as `pecs align detect` prints it, but the truth."""
    camera = lab_views.Camera("pecs_lab_15mm", 1.56, *SIZE, PITCH_MM, stop_diameter_mm=1.0)
    x, y = camera.pixels(np.array(DISK["at_mm"]))
    diameter = 2 * DISK["radius_mm"] / DISK["at_mm"][2] * camera.focal_px
    return Disk((float(x), float(y)), diameter / 2, DISK["speed_deg_s"], DISK["phase_deg"]).detected


def spoiled(events: np.ndarray) -> dict[str, np.ndarray]:
    random = np.random.default_rng(1)

    def changed(**columns) -> np.ndarray:
        out = events.copy()
        for key, value in columns.items():
            out[key] = value
        inside = (out["t"] >= 0) & (out["t"] < SPAN_S * 1e6)
        return np.sort(out[inside], order="t", kind="stable")

    n, (width, height) = len(events), SIZE
    x, y, t = (events[k].astype(np.int64) for k in "xyt")
    noise = np.zeros(n // 20, events.dtype)
    for key, end in (("x", width), ("y", height), ("t", SPAN_S * 1e6), ("p", 2)):
        noise[key] = random.integers(0, end, len(noise))
    stray = np.zeros(2, events.dtype)
    stray["x"], stray["y"], stray["t"] = (0, width - 1), (0, height - 1), (0, SPAN_S * 1e6 - 1)
    return {
        "3 ms late": changed(t=t + 3000),
        "5 % slower": changed(t=t * 1.05),
        "4 px to the right": changed(x=np.minimum(x + 4, width - 1)),
        "half the size": changed(x=width // 4 + x // 2, y=height // 4 + y // 2),
        "5 % noise events": np.sort(np.concatenate([events, noise]), order="t", kind="stable"),
        "2 stray events in the corners": np.sort(np.concatenate([events, stray]), order="t", kind="stable"),
        "half the events dropped": events[random.random(n) < 0.5],
        "every event twice": np.repeat(events, 2),
        "time stamps jittered by 5 ms (sd)": changed(t=t + random.normal(0, 5000, n)),
        "ON and OFF swapped": changed(p=1 - events["p"]),
    }


MEASURES = [
    "Chamfer, shared", "Chamfer, eq16", "Chamfer, paper", "Gaussian, shared", "Gaussian, paper", "event ratio",
    "ON fraction", "rate correlation", "map correlation", "interval distance", "delay overlap", "delay EMD, deg",
    "ON + OFF pairs, sd deg",
]  # fmt: skip


def measured(real: np.ndarray, sim: np.ndarray, disk: dict, origin: str = "zero") -> np.ndarray:
    def compare(normalisation: str) -> dict:
        return pecs.compare(
            real, sim, width=SIZE[0], height=SIZE[1], normalisation=normalisation, window_us=round(SPAN_S * 1e6),
            origin=origin, split_half=False, disk=disk,
        )  # fmt: skip

    shared, eq16, paper = (compare(n) for n in ("shared", "eq16", "paper"))
    delays = shared["delays"]

    def mean(key: str) -> float:  # not a number where there are no events near the edges
        return np.mean([np.nan if delays[p][key] is None else delays[p][key] for p in ("on", "off")])

    values = [
        shared["chamfer"], eq16["chamfer"], paper["chamfer"], shared["gaussian"], paper["gaussian"],
        shared["event_ratio"], shared["sim"]["on_fraction"], shared["rate_correlation"], shared["map_correlation"],
        shared["interval_distance_decades"], mean("overlap"), mean("earth_mover_deg"), delays["pair_sd_deg"]["sim"],
    ]  # fmt: skip
    return np.array(values, float)


def draw(path: Path, rows: list[str], deviations: np.ndarray) -> None:
    """A field per row and measure: white within what chance does, dark a thousand times that."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    plt.rcParams["svg.fonttype"] = "none"
    figure, axes = plt.subplots(figsize=(10, 0.27 * len(rows) + 1.5), layout="constrained")
    strength = np.clip(np.log10(np.maximum(deviations, 1e-9) / 3) / 2.5, 0, 1)
    axes.imshow(np.nan_to_num(strength, nan=1), cmap="Blues", vmin=0, vmax=1, aspect="auto")
    axes.set_xticks(range(len(MEASURES)), MEASURES, rotation=50, ha="left")
    axes.set_yticks(range(len(rows)), rows)
    axes.xaxis.tick_top()
    for (i, k), d in np.ndenumerate(deviations):
        text = "none" if np.isnan(d) else f"{d:.0f}" if d < 1000 else f"{d / 1000:.0f}k"
        axes.text(k, i, text, ha="center", va="center", fontsize=8, color="white" if d > 50 or np.isnan(d) else "black")
    figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)


def main(*, picture: Path | None = None) -> None:
    real, *others = recordings(list(range(1, SEEDS + 1)))
    disk = detected()
    chance = np.array([measured(real, other, disk) for other in others])
    rows = {"(another recording: mean)": chance.mean(axis=0)}
    changes = spoiled(others[0])
    for name, sim in changes.items():
        rows[name] = measured(real, sim, disk)
    late = changes["3 ms late"]
    rows["3 ms late, times from the first event"] = measured(real, late, disk, "first-event")
    rows["black sectors 3 times as bright"] = measured(real, recordings([7], black=3 * lab_views.BLACK)[0], disk)
    rows["a third of the light"] = measured(real, recordings([7], white_a=WHITE_A / 3)[0], disk)

    shown = [[name, *(f"{v:.3g}" for v in values)] for name, values in rows.items()]
    shown.append(["(standard deviation by chance)", *(f"{v:.1g}" for v in chance.std(axis=0, ddof=1))])
    print(table(["", *MEASURES], shown))
    if picture:
        names = list(rows)[1:]
        away = np.abs(np.array([rows[n] for n in names]) - chance.mean(axis=0)) / chance.std(axis=0, ddof=1)
        draw(picture, names, away)


if __name__ == "__main__":
    command(main)
