"""Video from events on real recordings: methods and the frames of the same camera.

    .venv-datasets/bin/python scripts/studies/reconstruction.py ../shared/data/real [NAME=NETWORK.onnx ...]
        [--window-ms 10 20 40] [-o scripts/studies/reconstruction.json] [--picture docs/studies/reconstruction.png]

Methods are the filter, the network that PECS includes (`shipped`) and those that are named, also with `--smooth`.
Windows have each of the lengths; the picture nearest to a frame's time is scored.
    camerashake (DAVIS240C): sharp frames after motion, and in stillness
    cups (DAVIS346): the mean of the pictures in an exposure and the frame, which motion blurs
    R_360_L: edges of the lab's disk, on every fourth pixel, after the first fifth of the recording, with and
        without the corner frequency of its pixels
--picture shows drawn sequences that no network was trained on, since the recordings have no licence for a page.
"""

import csv
import functools
import json
from pathlib import Path

import cv2
import numpy as np
import pecs
from pecs.learning import procedural
from pecs.learning.reconstruct import CUTOFF_HZ, WEIGHTS, Filter, Network, Window, late_us
from pecs.learning.smooth import smooth
from pecs_lab import sequences
from pecs_lab.disk import edges
from pecs_lab.measure import command
from pecs_lab.report import write
from scipy.ndimage import uniform_filter

RESULTS = Path(__file__).with_suffix(".json")
PERIOD_US, LAG_US = 138_121.3, -11_000  # of camerashake's frames; frame k at (k - 2) PERIOD_US + LAG_US (README there)
SHARP = {"after motion": (6, 7, 8, 13, 17, 20, 23, 26), "in stillness": (32, 33, 34)}
COARSER, NEAR_PX = 4, 3
DISK_HZ = 2.5  # corner in the mean light: 4.6 Hz in white, and half of the disk is black (docs/studies/accuracy.md)
HELD_OUT, SHOWN, AT = 999, (2, 5, 10, 14), 181  # seed, numbers of those with most events of the first 20, window


def recording(*paths: Path) -> np.ndarray:
    parts = []
    for path in paths:
        with np.load(path) as file:
            events = np.zeros(len(file["t"]), pecs.EVENT_DTYPE)
            for key in "txyp":
                events[key] = file[key]
        parts.append(events)
    return np.concatenate(parts)


class Smooth(Network):
    """As `--smooth`."""


def video(method, events: np.ndarray, end_us: float, window_us: float) -> tuple[np.ndarray, np.ndarray]:
    """Ends of all windows from 0, and pictures [n, H, W]."""
    ends = np.arange(1, round(end_us / window_us) + 1) * window_us
    cuts = np.searchsorted(events["t"], [0, *ends])
    windows = (Window(end - window_us, end, events[cuts[k] : cuts[k + 1]]) for k, end in enumerate(ends))
    pictures = smooth(method, windows, window_us) if isinstance(method, Smooth) else map(method, windows)
    return ends, np.stack([picture.astype(np.float32) for picture in pictures])


def stretched(picture: np.ndarray) -> np.ndarray:
    low, high = np.percentile(picture, (1, 99))
    return np.clip((picture - low) / max(high - low, 1e-6), 0, 1)


def ssim(a: np.ndarray, b: np.ndarray) -> float:
    """Structural similarity (Wang et al. 2004) with a uniform window of 7 pixels, as scikit-image's default."""

    def mean(x: np.ndarray) -> np.ndarray:
        return uniform_filter(x, 7)[3:-3, 3:-3]

    def covariance(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return (mean(x * y) - mean(x) * mean(y)) * 49 / 48

    light = (2 * mean(a) * mean(b) + 1e-4) / (mean(a) ** 2 + mean(b) ** 2 + 1e-4)
    return float((light * (2 * covariance(a, b) + 9e-4) / (covariance(a, a) + covariance(b, b) + 9e-4)).mean())


def scores(pairs: list[tuple[np.ndarray, np.ndarray]]) -> dict[str, float]:
    """Means over pairs of picture and frame. MSE and SSIM of both stretched to their 1 to 99 %."""
    rows = []
    for picture, frame in pairs:
        a, b = stretched(picture), stretched(frame)
        rows.append((((a - b) ** 2).mean(), ssim(a, b), np.corrcoef(picture.ravel(), frame.ravel())[0, 1]))
    return dict(zip(("mse", "ssim", "correlation"), np.round(np.mean(rows, 0), 3).tolist(), strict=True))


def frame(folder: Path, number: int) -> np.ndarray:
    return cv2.imread(str(folder / f"frames/{number:04d}.png"), cv2.IMREAD_GRAYSCALE).astype(np.float64) / 255


def camerashake(make, folder: Path, window_us: float) -> dict:
    events = recording(folder / "events.npz", folder / "still.npz")
    ends, shown = video(make(240, 180), events, 33 * PERIOD_US, window_us)

    def at(number: int) -> np.ndarray:
        return shown[np.abs(ends - (number - 2) * PERIOD_US - LAG_US).argmin()]

    return {name: scores([(at(k), frame(folder, k)) for k in numbers]) for name, numbers in SHARP.items()}


def cups(make, folder: Path, window_us: float) -> dict:
    ends, shown = video(make(346, 260), recording(folder / "events.npz"), 1.82e6, window_us)
    with (folder / "exposures_us.csv").open() as file:
        exposures = [{key: int(value) for key, value in row.items()} for row in csv.DictReader(file)]
    pairs = []
    for row in exposures[2:]:  # the first ones have no past
        inside = (ends > row["begin_us"]) & (ends <= row["end_us"])
        pairs.append((shown[inside].mean(0), frame(folder, row["frame"])))
    return {"blurred": scores(pairs)}


def disk(make, path: Path, window_us: float, corner_hz: float | None) -> dict:
    events = pecs.read(path)
    kept = events[(events["x"] % COARSER == COARSER // 2) & (events["y"] % COARSER == COARSER // 2)].copy()
    kept["x"], kept["y"] = kept["x"] // COARSER, kept["y"] // COARSER
    end_us, of = float(kept["t"][-1]), sequences.load("R_360_L").disk.coarser(COARSER)
    late = late_us(corner_hz)
    more = -late % window_us  # so that windows end `late` after multiples of their length
    kept["t"] += round(more)
    ends, shown = video(make(320, 180), kept, end_us + more, window_us)
    times, last_us = ends - more - late, end_us - late  # of whole windows
    inside = (times > end_us / 5) & (times <= last_us)
    if not inside.any():
        return {}
    ahead = np.stack([edges(picture, of, t)[0] for t, picture in zip(times[inside], shown[inside], strict=True)])
    near = float((np.abs(ahead) <= NEAR_PX).mean())
    median = float(np.nanmedian(np.abs(ahead))) if np.isfinite(ahead).any() else None
    found = {"found": float(np.isfinite(ahead).mean()), f"within_{NEAR_PX}_px": near, "median_error_px": median}
    name = "edges, corner known" if corner_hz else "edges"
    return {name: {key: value and round(value, 3) for key, value in found.items()}}


def scored(make, real: Path, window_us: float) -> dict:
    found = camerashake(make, real / "camerashake", window_us) | cups(make, real / "cups", window_us)
    for corner_hz in (None, DISK_HZ):
        found |= disk(make, real / "R_360_L.hdf5", window_us, corner_hz)
    return found


def drawn(methods: dict, number: int) -> list[np.ndarray]:
    """By each method at the end of a drawn sequence, and its light."""
    made = procedural.sequence(number, HELD_OUT, procedural.ProceduralConfig())
    size = made.pictures.shape[2], made.pictures.shape[1]
    rows = [video(make(*size), made.events, 2e6, 10e3)[1][AT] for make in methods.values()]
    return [*rows, made.pictures[2 * AT + 2] / 255]


def labelled(picture: np.ndarray, text: str, height: int = 180) -> np.ndarray:
    width = round(picture.shape[1] * height / picture.shape[0])
    grey = cv2.resize((255 * stretched(picture)).astype(np.uint8), (width, height), interpolation=cv2.INTER_AREA)
    return cv2.putText(grey, text, (4, 12), cv2.FONT_HERSHEY_SIMPLEX, 0.4, 255, 1, cv2.LINE_AA)


def main(
    data: Path, networks: list[str] = (), *, window_ms: list[float] = (10, 20, 40),
    output: Path = RESULTS, picture: Path | None = None,
) -> None:  # fmt: skip
    paths = {"shipped": WEIGHTS} if WEIGHTS.is_file() else {}
    paths |= {name: Path(path) for name, path in (text.split("=", 1) for text in networks)}
    methods = {"filter": lambda w, h: Filter(w, h, CUTOFF_HZ)}
    for name, path in paths.items():
        methods |= {name: functools.partial(Network, path), f"{name}, smooth": functools.partial(Smooth, path)}
    results = json.loads(output.read_text()) if output.exists() else {}
    for name, make in methods.items():
        for length_ms in window_ms:
            found = scored(make, data, 1e3 * length_ms)
            print(name, f"{length_ms:g} ms", json.dumps(found), flush=True)
            results[f"{name}, {length_ms:g} ms"] = found
    write(output, results)
    if picture:
        columns = [drawn(methods, number) for number in SHOWN]
        names = [*methods, "light"]
        rows = [np.hstack([labelled(column[i], name) for column in columns]) for i, name in enumerate(names)]
        cv2.imwrite(str(picture), np.vstack(rows), [cv2.IMWRITE_WEBP_QUALITY, 75])


if __name__ == "__main__":
    command(main)
