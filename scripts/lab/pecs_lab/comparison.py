"""Studies that train one network on the events of several simulators: the same light, another sensor; thresholds for
equal numbers of events; kept scores; tables and pictures of seeds."""

import json
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from pecs import Chip, Light, sense
from pecs._files import write_json
from pecs.datasets.sequence import Camera, Sequence, sequences
from pecs.learning.clips import WHITE

from . import report

OURS = "pecs"
TITLE_PX = 22  # of the head of a picture


def kept(path: Path, make: Callable[[], dict]) -> dict:
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_json(path, make())
    return json.loads(path.read_text())


@dataclass(frozen=True, eq=False)
class Comparison:
    """root: of light, events, runs, scores. plan: camera, simulators, matching, draws."""

    root: Path
    plan: dict

    def chosen(self, only: list[str]) -> list[str]:
        """Simulators; all of the plan, without `only`."""
        if unknown := set(only) - set(self.plan["simulators"]):
            sys.exit(f"--only: got {', '.join(unknown)}, wanted some of {', '.join(self.plan['simulators'])}")
        return list(only) or [name for name, how in self.plan["simulators"].items() if not how.get("later")]

    def camera(self, sequence: Sequence) -> Camera:
        return sequence.cameras[self.plan["camera"]]

    def sequences(self, split: str) -> list[Sequence]:
        return sequences(self.root / "light", split)

    def sensed(
        self, sequence: Sequence, output: Path, how: dict, threshold: float | None, light: float = 1.0, draw: int = 0
    ) -> int:
        """Number of events of a simulator: `model` or `preset`, and, where given, `chip`, `noise`, `overrides`. Models
        that take pictures see white where the networks are shown it. light: share of it, behind a neutral filter."""
        camera = self.camera(sequence)
        name, overrides = how.get("chip", str(camera.info["chip"])), dict(how.get("overrides", {}))
        overrides |= {f"contrast_threshold_{p}": threshold for p in ("on", "off") if threshold is not None}
        overrides["peak_qe"] = light * Chip(name).peak_qe
        given = {key: how[key] for key in ("model", "preset", "warmup_us") if key in how}
        given |= {"chip": name, "overrides": overrides, "noise": how.get("noise", True)}
        if how.get("model") != OURS:
            chip = Chip(name, overrides={"peak_qe": overrides["peak_qe"]})
            with Light(camera.folder / "stack", chip, threads=1) as stack:
                values = stack.at(camera.truth.times_us[::10])
            given |= {"white_a": float(np.percentile(values, WHITE)), "readout": "ideal"}
        output.parent.mkdir(parents=True, exist_ok=True)
        more = {"format": "dsec", "duration_us": sequence.duration_us, "threads": 1}
        seed = 1 + 100 * draw + int(sequence.name)
        record = sense(camera.folder / "stack", output, seed=seed, **given, **more)
        return int(record["results"]["events"])

    def threshold(self, name: str) -> float | None:
        """With which there are as many events as ours are, in all of the light; else the plan's."""
        how = self.plan["simulators"]
        path, matching = self.root / "events" / name / "threshold.json", self.plan["matching"]
        if not how[name].get("matched"):
            return self.plan.get("threshold")
        some = self.sequences(matching["split"])[:: matching["every"]]

        def count(of: str, threshold: float | None) -> int:
            return sum(self.sensed(s, path.with_name("try.h5"), how[of], threshold) for s in some)

        return kept(path, lambda: matched(name, count, self.plan.get("threshold"), matching["tolerance"]))["threshold"]

    def events(self, name: str, sequence: Sequence, draw: int = 0) -> Path:
        """In a share of the light that is drawn, the same for all simulators; so is a factor on the threshold, where
        the plan has one."""
        path = self.root / "events" / name / f"{sequence.name}_{draw}.h5"
        if not path.exists():
            how, draws, key = self.plan["simulators"][name], self.plan["draws"], 1000 * draw + int(sequence.name)
            light, threshold = log_uniform([1, key], *draws["light"]), self.threshold(name)
            if "threshold" in draws:
                threshold *= log_uniform([2, key], *draws["threshold"])
            self.sensed(sequence, path, how, threshold, how.get("light", light), draw)
        return path

    def scored(self, names: list[str], others: tuple[str, ...], seeds: list[int], tests: dict[str, Callable]) -> dict:
        """Scores [name][test], one for each seed; one alone for the other methods. A test has the name and the seed."""

        def each(name: str, on: str, make: Callable) -> list[dict]:
            path = self.root / "scores"
            of = [0] if name in others else seeds
            return [kept(path / f"{name}_{seed}_on_{on}.json", partial(make, name, seed)) for seed in of]

        return {name: {on: each(name, on, make) for on, make in tests.items()} for name in (*names, *others)}


def log_uniform(key: list[int], low: float, high: float) -> float:
    """A number that depends on the two integers of the key alone."""
    return math.exp(np.random.Generator(np.random.Philox(key=key)).uniform(math.log(low), math.log(high)))


def matched(name: str, count: Callable, ours: float | None, tolerance: float) -> dict:
    """The threshold with which `count` is near that of ours: the secant method on logarithms of both."""
    wanted, tried, value = count(OURS, ours), [], 0.3
    while not tried or abs(tried[-1][1] / wanted - 1) > tolerance:
        got = count(name, value)
        tried.append((value, got))
        print(f"{name}: threshold {value:.4f}: {got} events, wanted {wanted}", file=sys.stderr, flush=True)
        slope = -1.0
        if len(tried) > 1:
            slope = math.log(tried[-1][1] / tried[-2][1]) / math.log(tried[-1][0] / tried[-2][0])
        value *= (wanted / got) ** (1 / min(slope, -0.3))
    return {"threshold": tried[-1][0], "tried": tried, "wanted": wanted}


def mean_scores(rows: list[dict[str, float]]) -> dict[str, float]:
    return {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}


def table(results: dict[str, dict[str, list[dict[str, float]]]], keys: list[tuple[str, str]]) -> str:
    """keys: (tested on, metric), one column each. Mean ± standard deviation over seeds; in brackets the mean of the
    paired differences to ours ± its standard error. Methods without training have one score."""
    lines = []
    for name, row in results.items():
        cells = [name]
        for on, metric in keys:
            values = np.array([r[metric] for r in row[on]])
            ours = np.array([r[metric] for r in results.get(OURS, {}).get(on, [])])
            cell = f"{values.mean():.3f}" + (f" ± {values.std(ddof=1):.3f}" if len(values) > 1 else "")
            if name != OURS and len(values) == len(ours) > 1:
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
