"""Studies that train one network on the events of several simulators: the same light, another sensor; thresholds for
equal numbers of events; kept scores; tables and pictures of seeds."""

import json
import math
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from pecs import Chip, Light, sense
from pecs._files import write_json
from pecs.datasets.sequence import Camera, Sequence
from pecs.learning.clips import WHITE_PERCENTILE

from . import report

OURS = "pecs"
TITLE_PX = 22  # of the head of a picture


def log_uniform(key: list[int], low: float, high: float) -> float:
    """A number that depends on the two integers of the key alone."""
    return math.exp(np.random.Generator(np.random.Philox(key=key)).uniform(math.log(low), math.log(high)))


def chip_of(camera: Camera) -> str:
    return str(camera.info["chip"])


def overrides_of(how: dict, threshold: float | None) -> dict[str, float]:
    out = dict(how.get("overrides", {}))
    return out if threshold is None else out | {f"contrast_threshold_{p}": threshold for p in ("on", "off")}


def sensed(
    sequence: Sequence, camera: Camera, output: Path, how: dict, threshold: float | None, light: float, seed: int
) -> int:
    """Number of events of a simulator: `model` or `preset`, and, where given, `chip`, `noise`, `overrides`. Models that
    take pictures see white where the networks are shown it. light: share of it, behind a neutral filter."""
    name = how.get("chip", chip_of(camera))
    overrides = overrides_of(how, threshold) | {"peak_qe": light * Chip(name).peak_qe}
    given = {key: how[key] for key in ("model", "preset") if key in how}
    given |= {"chip": name, "overrides": overrides, "noise": how.get("noise", True)}
    if how.get("model") != OURS:
        chip = Chip(name, overrides={"peak_qe": overrides["peak_qe"]})
        with Light(camera.folder / "stack", chip, threads=1) as stack:
            values = stack.at(camera.truth.times_us[::10])
        given |= {"white_a": float(np.percentile(values, WHITE_PERCENTILE)), "readout": "ideal"}
    output.parent.mkdir(parents=True, exist_ok=True)
    more = {"format": "dsec", "duration_us": sequence.duration_us, "threads": 1}
    more |= {key: how[key] for key in ("warmup_us",) if key in how}
    record = sense(camera.folder / "stack", output, seed=seed, **given, **more)
    return int(record["results"]["events"])


def matched(path: Path, ours: Callable[[], int], count: Callable[[float], int], tolerance: float) -> float:
    """The threshold with which `count` is near that of ours: the secant method on logarithms of both; kept."""
    if not path.exists():
        wanted = ours()
        tried: list[tuple[float, int]] = []
        value = 0.3
        while not tried or abs(tried[-1][1] / wanted - 1) > tolerance:
            got = count(value)
            tried.append((value, got))
            print(f"{path}: threshold {value:.4f}: {got} events, wanted {wanted}", file=sys.stderr, flush=True)
            slope = -1.0
            if len(tried) > 1:
                slope = math.log(tried[-1][1] / tried[-2][1]) / math.log(tried[-1][0] / tried[-2][0])
            value *= (wanted / got) ** (1 / min(slope, -0.3))
        path.parent.mkdir(parents=True, exist_ok=True)
        write_json(path, {"threshold": tried[-1][0], "tried": tried, "wanted": wanted})
    return float(json.loads(path.read_text())["threshold"])


def mean_scores(rows: list[dict[str, float]]) -> dict[str, float]:
    return {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}


def kept(path: Path, make: Callable[[], dict]) -> dict:
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_json(path, make())
    return json.loads(path.read_text())


def table(
    results: dict[str, dict[str, list[dict[str, float]]]],
    keys: list[tuple[str, str]],
    baselines: tuple[str, ...] = (),
) -> str:
    """keys: (tested on, metric), one column each. Mean ± standard deviation over seeds; in brackets the mean of the
    paired differences to ours ± its standard error."""
    lines = []
    for name, row in results.items():
        cells = [name]
        for on, metric in keys:
            values = np.array([r[metric] for r in row[on]])
            ours = np.array([r[metric] for r in results.get(OURS, {}).get(on, [])])
            cell = f"{values.mean():.3f}" + (f" ± {values.std(ddof=1):.3f}" if len(values) > 1 else "")
            if name not in (OURS, *baselines) and len(values) == len(ours) > 1:
                apart = values - ours
                cell += f" ({apart.mean():+.3f} ± {apart.std(ddof=1) / math.sqrt(len(apart)):.3f})"
            cells.append(cell)
        lines.append(cells)
    return report.table(["trained on", *(f"{on}: {metric}" for on, metric in keys)], lines)


def titled(shown: np.ndarray, titles: list[str]) -> np.ndarray:
    """With a title above each of its columns; grey or colour."""
    head = np.full((TITLE_PX, *shown.shape[1:]), 255, np.uint8)
    for k, title in enumerate(titles):
        at = k * shown.shape[1] // len(titles) + 4, TITLE_PX - 7
        cv2.putText(head, title, at, cv2.FONT_HERSHEY_SIMPLEX, 0.42, (0, 0, 0), 1, cv2.LINE_AA)
    return np.vstack([head, shown])
