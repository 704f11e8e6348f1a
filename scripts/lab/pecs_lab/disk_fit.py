"""A chip's pixel before a turning disk that is computed, not rendered: what fit_chip.py and fit_lamp.py share.

The disk's light is a map over its regions (pecs.delays), each region's light chosen so that the number of its events
comes out right.
"""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pecs

from .program import ask

CYCLES = 11  # periods of light and dark before anything counts
STEP_US = 500.0


@dataclass(frozen=True)
class Disk:
    """Equal black and white sectors; angles at t = 0."""

    centre: tuple[float, float]
    radius: float  # rim
    sectors: int  # black and white ones together
    speed_deg_s: float  # positive: counter-clockwise on screen
    on_deg: float  # an edge that brightens the pixel; the next one follows after period_deg
    off_deg: float

    @property
    def period_deg(self) -> float:
        return 720 / self.sectors

    @property
    def period_us(self) -> float:
        return self.period_deg / abs(self.speed_deg_s) * 1e6

    @property
    def bins_deg(self) -> np.ndarray:
        """Edges of the bins of pecs.delays: 1/90 of the period each, from -1/18 to 5/9 of it."""
        return self.period_deg / 90 * np.arange(-5, 51)

    @property
    def detected(self) -> dict:
        """As `pecs align detect --json` prints it."""
        values = {"centre_x": self.centre[0], "centre_y": self.centre[1], "speed_deg_s": self.speed_deg_s}
        values |= {"on_edge_deg": self.on_deg, "off_edge_deg": self.off_deg}
        rim = {"axis_a_px": 2 * self.radius, "axis_b_px": 2 * self.radius}
        return {k: {"value": v} for k, v in values.items()} | {
            "sectors": self.sectors, "phase_time_us": 0, "rim": rim,
        }  # fmt: skip

    def polar(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Angle in degrees, counter-clockwise on screen, and radius of pixels."""
        dx, dy = x + 0.5 - self.centre[0], self.centre[1] - (y + 0.5)
        return np.degrees(np.arctan2(dy, dx)), np.hypot(dx, dy)

    def past_deg(self, angle: np.ndarray, t_us: float, edge_deg: float) -> np.ndarray:
        """How far an edge is past the pixel, in [0, period_deg)."""
        ahead = edge_deg + self.speed_deg_s * 1e-6 * t_us - angle
        return np.mod(ahead * np.sign(self.speed_deg_s), self.period_deg)


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
    def region_events(self) -> np.ndarray:
        return np.array(self.delays["regions"]["events"])

    @property
    def passes(self) -> np.ndarray:
        """[region, ON or OFF, bin]: pixels times passing edges."""
        return np.stack([self.delays[p]["passes"] for p in ("on", "off")], axis=1)

    @property
    def histograms(self) -> tuple[np.ndarray, np.ndarray]:
        return tuple(np.array(self.delays[p]["histogram"]) for p in ("on", "off"))


def look(events: np.ndarray, disk: Disk, width: int, height: int, duration_us: float) -> Seen:
    delays = pecs.delays(events, disk=disk.detected, width=width, height=height, duration_us=round(duration_us))
    assert np.allclose(delays["bin_edges_deg"], disk.bins_deg)
    yy, xx = np.mgrid[0:height, 0:width].astype(float)
    pixels = (disk.polar(xx, yy)[1] > disk.radius + 34).sum()
    quiet = disk.polar(events["x"].astype(float), events["y"].astype(float))[1] > disk.radius + 34
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
    corner_hz = np.geomspace(0.8, 14, 16)
    values = np.repeat((corner_hz / kappa)[:, None], pixels, axis=1)  # amperes in white
    values *= 1e15
    sensor = pecs.Sensor(pixels, len(corner_hz), chip, overrides=overrides, photocurrent_a=1e-15, seed=3)
    half_us = disk.period_us / 2
    steps = int(np.ceil(half_us / STEP_US))
    found = []
    for half in range(2 * (CYCLES + 2)):
        start = half * half_us
        t_us = np.concatenate([[start + 1], start + half_us * np.arange(1, steps + 1) / steps])
        frame = (values if half % 2 == 0 else values / contrast).astype(np.float32)
        found.append(sensor.push(np.broadcast_to(frame, (len(t_us), *frame.shape)), t_us))
    events = np.concatenate([*found, sensor.finish()])
    since_us = events["t"] - CYCLES * disk.period_us
    keep = (since_us >= 0) & (since_us < 2 * disk.period_us)
    events, since_deg = events[keep], since_us[keep] * abs(disk.speed_deg_s) * 1e-6
    bins, edges, histograms = disk.bins_deg, 2 * pixels, []
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
    return np.exp([np.interp(n, r, log_corner) for n, r in zip(seen.region_events, rising, strict=True)])


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
    kappa = profile(chip)["corner_hz_per_a"]
    half = int(np.ceil(disk.radius))
    x0, y0 = max(0, int(disk.centre[0]) - half), max(0, int(disk.centre[1]) - half)
    x1, y1 = min(width, int(disk.centre[0]) + half), min(height, int(disk.centre[1]) + half)
    yy, xx = np.mgrid[y0:y1, x0:x1].astype(float)
    angle, radius = disk.polar(xx, yy)

    # The light between the regions' middles, bilinear in angle and radius.
    (around, along), of = seen.regions, seen.delays["regions"]
    grid = np.log(corner_hz).reshape(around, along)
    u = (angle / 360 + 0.5) * around - 0.5
    v = (radius - of["inner_px"]) / (of["outer_px"] - of["inner_px"]) * along - 0.5
    v = np.clip(v, 0, along - 1.001)
    iu, iv = np.floor(u).astype(int), v.astype(int)
    fu, fv = u - iu, v - iv
    iu, ju = iu % around, (iu + 1) % around
    log_corner = (1 - fu) * ((1 - fv) * grid[iu, iv] + fv * grid[iu, iv + 1])
    log_corner += fu * ((1 - fv) * grid[ju, iv] + fv * grid[ju, iv + 1])
    white_fa = (np.exp(log_corner) / kappa * 1e15).astype(np.float32)
    still = (white_fa / 3).astype(np.float32)

    warmup_us = CYCLES * disk.period_us
    sensor = pecs.Sensor(x1 - x0, y1 - y0, chip, overrides=overrides, photocurrent_a=1e-15, seed=seed)
    t_us = np.arange(0, warmup_us + duration_us + 2 * STEP_US, STEP_US)
    found, chunk = [], 32
    for i in range(0, len(t_us), chunk):
        frames = np.empty((len(t_us[i : i + chunk]), *white_fa.shape), np.float32)
        for frame, t in zip(frames, t_us[i : i + chunk], strict=True):
            past = disk.past_deg(angle, t - warmup_us, disk.on_deg)
            past_off = disk.past_deg(angle, t - warmup_us, disk.off_deg)
            white = past < past_off  # the ON edge came last
            np.copyto(frame, np.where(radius > disk.radius - 6, still, np.where(white, white_fa, white_fa / contrast)))
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
    speed, phase_us = d["speed_deg_s"]["value"], d["phase_time_us"]
    return Disk(
        centre=(d["centre_x"]["value"], d["centre_y"]["value"]),
        radius=(d["rim"]["axis_a_px"] + d["rim"]["axis_b_px"]) / 4,
        sectors=d["sectors"],
        speed_deg_s=speed,
        on_deg=d["on_edge_deg"]["value"] - speed * 1e-6 * phase_us,
        off_deg=d["off_edge_deg"]["value"] - speed * 1e-6 * phase_us,
    )


def examine(recording: str) -> tuple[Disk, np.ndarray, float, Seen]:
    """The disk, the events (with width and height) and their duration [us], from the first event on; what the
    recording shows of the disk."""
    disk, events = detect(recording), pecs.read(recording)
    turned_deg = disk.speed_deg_s * 1e-6 * float(events["t"][0])
    disk = replace(disk, on_deg=disk.on_deg + turned_deg, off_deg=disk.off_deg + turned_deg)
    events["t"] -= events["t"][0]
    duration_us = float(events["t"][-1]) + 1
    return disk, events, duration_us, look(events, disk, events.width, events.height, duration_us)
