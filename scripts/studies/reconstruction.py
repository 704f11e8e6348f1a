"""Video from events on real recordings: methods beside the frames of the same camera.

    .venv-datasets/bin/python scripts/studies/reconstruction.py ../shared/data/real [NAME=NETWORK.onnx ...]
        [--window-ms 10 20 40] [-o scripts/studies/reconstruction.json] [--picture docs/studies/reconstruction.png]
        [--look PICTURE] [--train FOLDER]

Methods are the filter, the network that PECS includes (`shipped`) and those that are named, also with `--smooth`.
Windows have each of the lengths; the picture nearest to a frame's time is scored.
    camerashake (DAVIS240C): sharp frames after motion, and in stillness
    cups (DAVIS346): the mean of the pictures in an exposure beside the frame, which motion blurs
    R_360_L: edges of the lab's disk, on every fourth pixel, after the first fifth of the recording, with and
        without the corner frequency of its pixels
--picture shows drawn sequences that no network was trained on, and the disk; --look the recordings, which have no
licence for a page.

--train trains the networks of the comparison of simulators in FOLDER/SIMULATOR-SEED, or continues, and scores these.
Plan, written before the first training (2026-11-29):
    Simulators: pecs (as `pecs train` draws cameras; in two of five sequences the chip takes frames, whose bursts of
        events are simulated), esim (thresholds 0.1 to 1.5, the other polarity: N(1, 0.1) of it, refractory time 1 ms:
        Stoffregen et al., ECCV 2020), v2e (thresholds 0.2 to 0.5, sigma 0.03 to 0.05, a third each ideal, bright and
        dim: the ranges with which its author made training data). The light is the same.
    Noise: each simulator has its own alone, because noise, hot pixels and bursts are a part of what a simulator models,
        and a user of it gets no others. `pecs train` adds noise and bursts to the clips of all models, which hides how
        they differ; so "NAME, added" are networks with these additions (a control: do they make simulators alike?).
    Left out of pecs: latency (white of 4 pA: pixels of 2.5 kHz), noise (with leak and hot pixels), mismatch, the range
        of thresholds (0.2 for all), bursts.
    Training: 48 sequences of 3 s and 112x112 pixels, network, loss and learning rate of `pecs train`, 120 steps of two
        clips of 80x80 pixels and 48 windows; seeds 1 to 3 (the same first weights and clips for all), seed 1 for what
        is left out or added. `pecs train` has 280 sequences, and 28 times as many pixels in 700 steps.
    Measures: correlation on camerashake after motion, in stillness, and on cups, means of windows of 20 and 40 ms; part
        of the disk's edges within 3 px, with its corner frequency (without it all methods have about 0.01), mean of 10
        and 20 ms. MSE and SSIM of the same windows are printed and decide nothing.
    A win in a measure: each of the three seeds is above each of the other simulator's (1 in 20 by chance), and the mean
        is higher by more than two standard errors. pecs beats a simulator with wins in three of four measures. If it
        does not, the part whose absence raises the scores is named, mended if it is a fault, and pecs trained again.
    Written after these: the range of thresholds (0.1 to 1) is that part, so pecs is trained again with v2e's, 0.2 to
        0.5, of both polarities; this drawing was set before its training, and is the only one that is tried.
"""

import argparse
import copy
import csv
import functools
import itertools
import json
import math
from pathlib import Path

import cv2
import numpy as np
import pecs
from pecs.learning import procedural
from pecs.learning.clips import eight_bit
from pecs.learning.limits import Augmentation, ClipConfig, TrainConfig
from pecs.learning.reconstruct import CUTOFF_HZ, WEIGHTS, Filter, Network, Window, late_us
from pecs.learning.smooth import smooth
from pecs_lab import sequences
from pecs_lab.disk import edges
from pecs_lab.report import write
from scipy.ndimage import uniform_filter

PERIOD_US, LAG_US = 138_121.3, -11_000  # of camerashake's frames; frame k at (k - 2) PERIOD_US + LAG_US (README there)
SHARP = {"after motion": (6, 7, 8, 13, 17, 20, 23, 26), "in stillness": (32, 33, 34)}
COARSER, NEAR_PX = 4, 3
DISK_HZ = 2.5  # corner in the mean light: 4.6 Hz in white, and half of the disk is black (docs/studies/accuracy.md)
PICTURED = (8, 20, 33)  # frames
HELD_OUT, SHOWN, AT = 999, (2, 5, 10, 14), 90  # seed, numbers of those with most events of the first 20, window


STEPS, BATCH, WINDOWS, CROP = 120, 2, 48, 80  # of the comparison
SEEDS, DRAWN = (1, 2, 3), procedural.ProceduralConfig(count=48, size=112)
MEASURES = ("after motion, correlation", "in stillness, correlation", "blurred, correlation")
MEASURES += ("edges, corner known, within_3_px",)


def pecs_camera(rng: np.random.Generator, thresholds: tuple[float, float] | None = None) -> dict:
    options = procedural.camera(rng)
    if thresholds:
        threshold = rng.uniform(*thresholds)
        options["overrides"] |= {"contrast_threshold_on": threshold, "contrast_threshold_off": threshold}
    return options


def without(part: str, rng: np.random.Generator) -> dict:
    options = pecs_camera(rng)
    values = options["overrides"]
    match part:
        case "latency":
            options["photocurrent_a"] = procedural.WHITE_A[1]
        case "noise":
            silent = ("noise_std", "leak_rate_hz", "background_on_hz", "background_off_hz", "hot_pixel_fraction")
            values |= dict.fromkeys(silent, 0.0)
        case "mismatch":
            values["threshold_mismatch"] = 0.0
        case "range of thresholds":
            values |= {"contrast_threshold_on": 0.2, "contrast_threshold_off": 0.2}
        case "bursts":
            values = {key: value for key, value in values.items() if not key.startswith("frame_")}
            options |= {"chip_frames": False, "overrides": values}
    return options


V2E_THRESHOLDS, AGAIN = (0.2, 0.5), "pecs, thresholds of v2e"


def esim_camera(rng: np.random.Generator) -> dict:
    one = rng.uniform(0.1, 1.5)
    both = rng.permutation([one, np.clip(one * rng.normal(1, 0.1), 0.01, 2)]).tolist()
    values = dict(zip(("contrast_threshold_on", "contrast_threshold_off"), both, strict=True))
    return {"model": "esim", "overrides": values | {"refractory_period_s": 1e-3}}


def v2e_camera(rng: np.random.Generator) -> dict:
    threshold, sigma = rng.uniform(*V2E_THRESHOLDS), rng.uniform(0.03, 0.05)
    cutoff, leak, shot = [((0, 0), 0, (0, 0)), ((80, 120), 0.1, (0.1, 5)), ((20, 60), 0.1, (10, 30))][rng.integers(3)]
    noise = rng.uniform(*shot) / 2
    values = {
        "contrast_threshold_on": threshold,
        "contrast_threshold_off": threshold,
        "threshold_mismatch": sigma / threshold,
        "background_on_hz": noise,
        "background_off_hz": noise,
        "leak_rate_hz": leak,
        "refractory_period_s": 0,
    }
    return {"model": "v2e", "overrides": values, "parameters": {"cutoff_hz": rng.uniform(*cutoff)}}


SIMULATORS = {"pecs": pecs_camera, "esim": esim_camera, "v2e": v2e_camera}
PARTS = ("latency", "noise", "mismatch", "range of thresholds", "bursts")
CAMERAS = SIMULATORS | {f"without {part}": functools.partial(without, part) for part in PARTS}
CAMERAS[AGAIN] = functools.partial(pecs_camera, thresholds=V2E_THRESHOLDS)
ADDED = ", added"
RUNS = [(name, seed) for seed in SEEDS for name in (*SIMULATORS, AGAIN)]
RUNS += [(f"without {part}", SEEDS[0]) for part in PARTS] + [(name + ADDED, SEEDS[0]) for name in SIMULATORS]


def light(number: int, folder: Path) -> np.lib.npyio.NpzFile:
    """A drawn sequence's times and pictures, and its events by each of CAMERAS."""
    path = folder / f"light-{number}.npz"
    if not path.exists():
        rng = np.random.Generator(np.random.Philox(key=[1, number]))
        times_us, planes = procedural.light(rng, DRAWN)
        shown_us = np.arange(0, DRAWN.duration_us + 1, procedural.TRUTH_US)
        made = {"times_us": shown_us, "pictures": eight_bit(planes[np.searchsorted(times_us, shown_us - 1e-6)])}
        mean = float(planes.mean())
        for name, camera in CAMERAS.items():
            options = camera(copy.deepcopy(rng))
            with_frames = options.get("chip_frames", False)
            found = pecs.simulate(planes, times_us, procedural.CHIP, seed=number, readout="ideal", threads=1, **options)
            made[name] = np.asarray(found[0] if with_frames else found)
            made[name + ", Hz"] = corner_hz(options, mean)
        folder.mkdir(parents=True, exist_ok=True)
        np.savez(unfinished := path.with_suffix(".new.npz"), **made)
        unfinished.rename(path)
    return np.load(path)


def corner_hz(options: dict, mean: float) -> float:
    """In the mean light; 0: none."""
    if "photocurrent_a" in options:
        with pecs.Chip(procedural.CHIP) as chip:
            return chip.corner_hz_per_a * options["photocurrent_a"] * mean
    return options.get("parameters", {}).get("cutoff_hz", 0) * (255 * mean + 20) / 275  # of v2e


def simulated(name: str, folder: Path) -> list[procedural.Procedural]:
    files = [light(number, folder) for number in range(DRAWN.count)]
    return [
        procedural.Procedural(file[name], file["times_us"], file["pictures"], float(file[name + ", Hz"]) or None)
        for file in files
    ]


def trained(name: str, seed: int, folder: Path) -> Path:
    network = folder / f"{name}-{seed}/network.onnx"
    if not network.exists():
        from pecs.learning.export import export
        from pecs.learning.train import train

        how = Augmentation() if name.endswith(ADDED) else Augmentation(noise_hz=0, bursts=0)
        clips = ClipConfig(windows=WINDOWS, chunk=WINDOWS // 3, crop=CROP, augmentation=how)
        data, length = f"{DRAWN.count} drawn, {name}", {"steps": STEPS, "decay_steps": STEPS // 2, "batch": BATCH}
        config = TrainConfig(clips=clips, **length, data=data, seed=seed)
        train(lambda: simulated(name.removesuffix(ADDED), folder), network.parent, config)
        export(network.parent, network)
    return network


def measured(network: Path, real: Path) -> dict[str, float]:
    """Means over the lengths of windows of the plan."""
    make, found = functools.partial(Network, network), {}
    tests = [camerashake(make, real / "camerashake", us)[0] for us in (20e3, 40e3)]
    tests += [cups(make, real / "cups", us)[0] for us in (20e3, 40e3)]
    tests += [disk(make, real / "R_360_L.hdf5", us, DISK_HZ)[0] for us in (10e3, 20e3)]
    for test, measures in ((test, measures) for one in tests for test, measures in one.items()):
        for measure, value in measures.items():
            found.setdefault(f"{test}, {measure}", []).append(np.nan if value is None else value)
    return {name: round(float(np.mean(values)), 4) for name, values in found.items()}


def wins(ours: list[float], others: list[float]) -> bool:
    error = math.hypot(np.std(ours, ddof=1), np.std(others, ddof=1)) / math.sqrt(len(ours))
    return min(ours) > max(others) and np.mean(ours) - np.mean(others) > 2 * error


def comparison(folder: Path, real: Path) -> dict[str, dict[str, list[float]]]:
    """Scores of each network of RUNS: [name][measure][seed]."""
    found: dict[str, dict[str, list[float]]] = {}
    for name, seed in RUNS:
        measures = measured(trained(name, seed, folder), real)
        print(f"{name}, seed {seed}", json.dumps(measures), flush=True)
        for measure, value in measures.items():
            found.setdefault(name, {}).setdefault(measure, []).append(value)
    for one, other in itertools.permutations((*SIMULATORS, AGAIN), 2):
        print(one, "wins against", other, [m for m in MEASURES if wins(found[one][m], found[other][m])])
    return found


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


def camerashake(make, folder: Path, window_us: float) -> tuple[dict, list[np.ndarray]]:
    events = recording(folder / "events.npz", folder / "still.npz")
    ends, shown = video(make(240, 180), events, 33 * PERIOD_US, window_us)

    def at(number: int) -> np.ndarray:
        return shown[np.abs(ends - (number - 2) * PERIOD_US - LAG_US).argmin()]

    found = {name: scores([(at(k), frame(folder, k)) for k in numbers]) for name, numbers in SHARP.items()}
    return found, [at(k) for k in PICTURED]


def cups(make, folder: Path, window_us: float) -> tuple[dict, list[np.ndarray]]:
    ends, shown = video(make(346, 260), recording(folder / "events.npz"), 1.82e6, window_us)
    with (folder / "exposures_us.csv").open() as file:
        exposures = [{key: int(value) for key, value in row.items()} for row in csv.DictReader(file)]
    pairs = []
    for row in exposures[2:]:  # the first ones have no past
        inside = (ends > row["begin_us"]) & (ends <= row["end_us"])
        pairs.append((shown[inside].mean(0), frame(folder, row["frame"])))
    return {"blurred": scores(pairs)}, [pairs[-1][0]]


def disk(make, path: Path, window_us: float, corner_hz: float | None) -> tuple[dict, list[np.ndarray]]:
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
        return {}, [shown[-1]]
    ahead = np.stack([edges(picture, of, t)[0] for t, picture in zip(times[inside], shown[inside], strict=True)])
    near = float((np.abs(ahead) <= NEAR_PX).mean())
    median = float(np.nanmedian(np.abs(ahead))) if np.isfinite(ahead).any() else None
    found = {"found": float(np.isfinite(ahead).mean()), f"within_{NEAR_PX}_px": near, "median_error_px": median}
    name = "edges, corner known" if corner_hz else "edges"
    return {name: {key: value and round(value, 3) for key, value in found.items()}}, [shown[-1]]


def scored(make, real: Path, window_us: float) -> tuple[dict, list[np.ndarray]]:
    shake, shown = camerashake(make, real / "camerashake", window_us)
    blur, mean = cups(make, real / "cups", window_us)
    turn, last = disk(make, real / "R_360_L.hdf5", window_us, None)
    known, _ = disk(make, real / "R_360_L.hdf5", window_us, DISK_HZ)
    return shake | blur | turn | known, [*shown, *mean, *last]


def drawn(methods: dict, number: int) -> list[np.ndarray]:
    """By each method at the end of a drawn sequence, and its light."""
    made = procedural.sequence(number, HELD_OUT, procedural.ProceduralConfig())
    size = made.pictures.shape[2], made.pictures.shape[1]
    rows = [video(make(*size), made.events, 2e6, 20e3)[1][AT] for make in methods.values()]
    return [*rows, made.pictures[4 * AT + 4] / 255]


def labelled(picture: np.ndarray, text: str, height: int = 180) -> np.ndarray:
    width = round(picture.shape[1] * height / picture.shape[0])
    grey = cv2.resize((255 * stretched(picture)).astype(np.uint8), (width, height), interpolation=cv2.INTER_AREA)
    return cv2.putText(grey, text, (4, 12), cv2.FONT_HERSHEY_SIMPLEX, 0.4, 255, 1, cv2.LINE_AA)


def strip(pictures: list[np.ndarray], text: str) -> np.ndarray:
    return np.hstack([labelled(picture, "" if i else text) for i, picture in enumerate(pictures)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("networks", nargs="*", metavar="NAME=NETWORK.onnx")
    parser.add_argument("--window-ms", type=float, nargs="+", default=[10, 20, 40])
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).with_suffix(".json"))
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--look", type=Path)
    parser.add_argument("--train", type=Path, metavar="FOLDER")
    args = parser.parse_args()
    middle_ms = args.window_ms[len(args.window_ms) // 2]
    networks = {"shipped": WEIGHTS} if WEIGHTS.is_file() else {}
    networks |= {name: Path(path) for name, path in (text.split("=", 1) for text in args.networks)}
    methods = {"filter": lambda w, h: Filter(w, h, CUTOFF_HZ)}
    for name, path in networks.items():
        methods |= {name: functools.partial(Network, path), f"{name}, smooth": functools.partial(Smooth, path)}
    real, results, strips = args.data, json.loads(args.output.read_text()) if args.output.exists() else {}, []
    if args.train:
        results["simulators"] = comparison(args.train, real)
        networks = {f"{name}, seed {SEEDS[-1]}": trained(name, SEEDS[-1], args.train) for name in SIMULATORS}
        methods = {name: functools.partial(Network, path) for name, path in networks.items()}
    for name, make in methods.items():
        for window_ms in [middle_ms] if args.train else args.window_ms:
            found, pictures = scored(make, real, 1e3 * window_ms)
            print(name, f"{window_ms:g} ms", json.dumps(found), flush=True)
            if not args.train:
                results[f"{name}, {window_ms:g} ms"] = found
            if window_ms == middle_ms:
                strips.append(strip(pictures, name))
    write(args.output, results)
    if args.look:
        true = [*(frame(real / "camerashake", k) for k in PICTURED), frame(real / "cups", 24), np.zeros((180, 320))]
        cv2.imwrite(str(args.look), np.vstack([*strips, strip(true, "frames")]))
    if args.picture:
        columns = [drawn(methods, number) for number in SHOWN]
        names = [*methods, "light"]
        rows = [np.hstack([labelled(column[i], name) for column in columns]) for i, name in enumerate(names)]
        cv2.imwrite(str(args.picture), np.vstack(rows), [cv2.IMWRITE_WEBP_QUALITY, 75])


if __name__ == "__main__":
    main()
