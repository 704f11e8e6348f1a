"""A chip's pixel before a turning disk that is computed, not rendered: what fit_chip.py and fit_lamp.py share.

The disk's light is a map over its regions (pecs.delays), each region's light chosen so that the number of its events
comes out right.
"""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pecs

from .disk import Disk
from .program import ask

CYCLES = 11  # periods of light and dark before anything counts
STEP_US = 500.0


def period_us(disk: Disk) -> float:
    return disk.period_deg / abs(disk.speed_deg_s) * 1e6


def bins_deg(disk: Disk) -> np.ndarray:
    """Edges of the bins of pecs.delays: 1/90 of the period each, from -1/18 to 5/9 of it."""
    return disk.period_deg / 90 * np.arange(-5, 51)


@dataclass(frozen=True)
class Seen:
    """What a recording shows of the disk."""

    delays: dict  # of pecs.delays
    events: int
    background_hz: tuple[float, float]  # ON and OFF, of a pixel beside the disk

    @property
    def regions(self) -> tuple[int, int]:
        return self.delays["regions"]["around"], self.delays["regions"]["along"]

    @property
    def passes(self) -> np.ndarray:
        """[region, ON or OFF, bin]: pixels times passing edges."""
        return np.stack([self.delays[p]["passes"] for p in ("on", "off")], axis=1)

    @property
    def histograms(self) -> tuple[np.ndarray, np.ndarray]:
        return tuple(np.array(self.delays[p]["histogram"]) for p in ("on", "off"))


def look(events: np.ndarray, disk: Disk, width: int, height: int, duration_us: float) -> Seen:
    delays = pecs.delays(events, disk=disk.detected, width=width, height=height, duration_us=round(duration_us))
    assert np.allclose(delays["bin_edges_deg"], bins_deg(disk))
    yy, xx = np.mgrid[0:height, 0:width].astype(float)
    pixels = (disk.polar(xx, yy)[1] > disk.radius_px + 34).sum()
    quiet = disk.polar(events["x"].astype(float), events["y"].astype(float))[1] > disk.radius_px + 34
    seconds = pixels * duration_us * 1e-6
    background = (float((quiet & (events["p"] == p)).sum() / seconds) for p in (1, 0))
    return Seen(delays, len(events), tuple(background))


@dataclass
class Table:
    """The pixel in the disk's steady state, by light: one period."""

    corner_hz: np.ndarray  # of the photoreceptor in white
    on: np.ndarray  # [light, bin], per pixel
    off: np.ndarray


def tabulate(chip: str, overrides: dict, contrast: float, disk: Disk, pixels: int = 1024) -> Table:
    """`pixels` pixels at each light, all at the same place of the disk, over two periods after CYCLES."""
    kappa = profile(chip)["corner_hz_per_a"]
    corner_hz = 0.8 * 17.5 ** (np.arange(41) / 15)  # to 1,650: 250 times the light of R_360_L
    values = np.repeat((corner_hz / kappa)[:, None], pixels, axis=1)  # amperes in white
    values *= 1e15
    sensor = pecs.Sensor(pixels, len(corner_hz), chip, overrides=overrides, photocurrent_a=1e-15, seed=3)
    half_us = period_us(disk) / 2
    steps = int(np.ceil(half_us / STEP_US))
    found = []
    for half in range(2 * (CYCLES + 2)):
        start = half * half_us
        t_us = np.concatenate([[start + 1], start + half_us * np.arange(1, steps + 1) / steps])
        frame = (values if half % 2 == 0 else values / contrast).astype(np.float32)
        found.append(sensor.push(np.broadcast_to(frame, (len(t_us), *frame.shape)), t_us))
    events = np.concatenate([*found, sensor.finish()])
    since_us = events["t"] - CYCLES * period_us(disk)
    keep = (since_us >= 0) & (since_us < 2 * period_us(disk))
    events, since_deg = events[keep], since_us[keep] * abs(disk.speed_deg_s) * 1e-6
    bins, edges, histograms = bins_deg(disk), 2 * pixels, []
    for polarity, after in ((1, 0.0), (0, disk.period_deg / 2)):
        of = events["p"] == polarity
        delay = np.mod(since_deg[of] - after - bins[0], disk.period_deg) + bins[0]
        rows = np.arange(len(corner_hz) + 1) - 0.5
        histograms.append(np.histogram2d(events["y"][of], delay, [rows, bins])[0] / edges)
    return Table(corner_hz, *histograms)


def light_map(table: Table, seen: Seen) -> np.ndarray:
    """The corner in white that gives each region its number of events."""
    passes = seen.passes
    expected = np.einsum("lb,rb->rl", table.on, passes[:, 0]) + np.einsum("lb,rb->rl", table.off, passes[:, 1])
    rising = np.maximum.accumulate(expected, axis=1) + 1e-6 * np.arange(len(table.corner_hz))
    log_corner = np.log(table.corner_hz)
    return np.exp([np.interp(n, r, log_corner) for n, r in zip(seen.delays["regions"]["events"], rising, strict=True)])


def predicted(table: Table, corner_hz: np.ndarray, passes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    at = np.interp(np.log(corner_hz), np.log(table.corner_hz), np.arange(len(table.corner_hz)))
    low = np.minimum(at.astype(int), len(table.corner_hz) - 2)
    part = (at - low)[:, None]
    return tuple(
        (((1 - part) * h[low] + part * h[low + 1]) * passes[:, k]).sum(0) / passes[:, k].sum(0)
        for k, h in enumerate((table.on, table.off))
    )


def chip_file(chip: str) -> Path:
    return Path(chip) if chip.endswith(".json") else pecs.data_dir("sensor/chips") / f"{chip}.json"


def profile(chip: str) -> dict:
    return {key: v["value"] for key, v in json.loads(chip_file(chip).read_text())["values"].items()}


FITTED = ("contrast_threshold_on", "contrast_threshold_off", "threshold_mismatch", "noise_std")


def fit(chip: str, real: Seen, disk: Disk, contrast: float, rounds: int) -> tuple[dict, float]:
    from scipy.optimize import minimize

    values, passes = profile(chip), real.passes
    start = np.log([values[k] for k in FITTED] + [contrast])

    def loss(x: np.ndarray) -> float:
        chosen = dict(zip(FITTED, np.exp(x[:-1]), strict=True))
        if chosen["threshold_mismatch"] > 0.3:
            return 10.0
        table = tabulate(chip, chosen, float(np.exp(x[-1])), disk, 512)
        both = predicted(table, light_map(table, real), passes)
        miss = sum(np.abs(a - b).sum() for a, b in zip(both, real.histograms, strict=True))
        print(f"  {miss:.4f}  " + "  ".join(f"{v:.4f}" for v in np.exp(x)), flush=True)
        return float(miss)

    simplex = np.vstack([start, start + 0.12 * np.eye(5)])
    best = minimize(loss, start, method="Nelder-Mead", options={"maxfev": rounds, "initial_simplex": simplex})
    *values, contrast = np.exp(best.x).tolist()
    return {k: round(v, 4) for k, v in zip(FITTED, values, strict=True)}, contrast


def simulate(
    chip: str, overrides: dict, disk: Disk, corner_hz: np.ndarray, contrast: float, seen: Seen, *, width: int,
    height: int, duration_us: float, seed: int,
) -> np.ndarray:  # fmt: skip
    """The whole recording: the disk's square after its warm-up, and background everywhere else."""
    from scipy.ndimage import map_coordinates

    kappa = profile(chip)["corner_hz_per_a"]
    half = int(np.ceil(disk.radius_px))
    x0, y0 = max(0, int(disk.centre_px[0]) - half), max(0, int(disk.centre_px[1]) - half)
    x1, y1 = min(width, int(disk.centre_px[0]) + half), min(height, int(disk.centre_px[1]) + half)
    yy, xx = np.mgrid[y0:y1, x0:x1].astype(float)
    angle, radius = disk.polar(xx, yy)

    # The light between the regions' middles, bilinear in angle and radius.
    (around, along), of = seen.regions, seen.delays["regions"]
    grid = np.pad(np.log(corner_hz).reshape(around, along), ((1, 1), (0, 0)), "wrap")
    u = (angle / 360 + 0.5) * around + 0.5
    v = (radius - of["inner_px"]) / (of["outer_px"] - of["inner_px"]) * along - 0.5
    log_corner = map_coordinates(grid, [u, v], order=1, mode="nearest")
    white_fa = (np.exp(log_corner) / kappa * 1e15).astype(np.float32)
    still = (white_fa / 3).astype(np.float32)

    warmup_us = CYCLES * period_us(disk)
    sensor = pecs.Sensor(x1 - x0, y1 - y0, chip, overrides=overrides, photocurrent_a=1e-15, seed=seed)
    t_us = np.arange(0, warmup_us + duration_us + 2 * STEP_US, STEP_US)
    found, chunk = [], 32
    for i in range(0, len(t_us), chunk):
        frames = np.empty((len(t_us[i : i + chunk]), *white_fa.shape), np.float32)
        for frame, t in zip(frames, t_us[i : i + chunk], strict=True):
            on, off = (disk.past_deg(angle, t - warmup_us, edge) for edge in (disk.on_edge_deg, disk.off_deg))
            white = on < off  # the ON edge came last
            turning = np.where(white, white_fa, white_fa / contrast)
            frame[:] = np.where(radius > disk.radius_px - 6, still, turning)
        found.append(sensor.push(frames, t_us[i : i + chunk]))
    inner = np.concatenate([*found, sensor.finish()])
    inner["x"] += x0
    inner["y"] += y0
    outer = pecs.simulate(
        np.full((3, height, width), 1.0, np.float32), warmup_us + duration_us * np.array([0, 0.5, 1.1]), chip,
        overrides=overrides | {"noise_std": 0}, photocurrent_a=1e-15, seed=seed + 1,
    )  # fmt: skip
    outside = (outer["x"] < x0) | (outer["x"] >= x1) | (outer["y"] < y0) | (outer["y"] >= y1)
    events = np.concatenate([inner, outer[outside]])
    events["t"] -= round(warmup_us)
    events = events[(events["t"] >= 0) & (events["t"] < duration_us)]
    return events[np.argsort(events["t"], kind="stable")]


def detect(recording: str) -> Disk:
    d = ask("align", "detect", recording)
    value = {key: entry["value"] for key, entry in d.items() if isinstance(entry, dict) and "value" in entry}
    turned_deg = value["speed_deg_s"] * 1e-6 * d["phase_time_us"]
    return Disk(
        (value["centre_x"], value["centre_y"]),
        (d["rim"]["axis_a_px"] + d["rim"]["axis_b_px"]) / 4,
        value["speed_deg_s"],
        value["on_edge_deg"] - turned_deg,
        d["sectors"],
        value["off_edge_deg"] - turned_deg,
    )


def examine(recording: str) -> tuple[Disk, np.ndarray, float, Seen]:
    """The disk, the events (with width and height) and their duration [us], from the first event on; what the
    recording shows of the disk."""
    if not Path(recording).is_file():
        raise SystemExit(f"{recording}: got no recording, wanted R_360_L or its like (docs/studies/validation.md)")
    disk, events = detect(recording), pecs.read(recording)
    turned_deg = disk.speed_deg_s * 1e-6 * float(events["t"][0])
    disk = replace(disk, on_edge_deg=disk.on_edge_deg + turned_deg, off_edge_deg=disk.off_deg + turned_deg)
    events["t"] -= events["t"][0]
    duration_us = float(events["t"][-1]) + 1
    return disk, events, duration_us, look(events, disk, events.width, events.height, duration_us)
