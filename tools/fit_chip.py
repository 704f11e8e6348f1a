"""Fits a chip profile to a recording of a turning disk with black and white sectors, or checks how a profile does.

    python tools/fit_chip.py RECORDING [--chip imx636] [--fit] [--write PROFILE.json] [--simulation OUT.raw]

The disk is computed, not rendered: centre, speed and phase come from `pecs align detect`; its light is a map over 24 x
4 regions, each region's light chosen so that the number of its events comes out right. Without --fit nothing but this
map is free. With it, thresholds, mismatch, noise and the disk's contrast are shared by all regions and fitted to the
histograms of the delays behind the edges (Nelder-Mead).

Model and recording then go through the same measures: events per pixel and edge, delays behind the edges (common area
and earth mover's distance of their histograms), standard deviation of an ON event's delay plus that of the OFF event
after it, background outside the disk, and Chamfer and Gaussian distance over the whole recording.
"""

import argparse
import json
import subprocess
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pecs

SIZE = (1280, 720)
REGIONS = (24, 4)  # around, along the radius
BINS_DEG = np.arange(0, 101, 2.0)
CYCLES = 11  # half turns before anything counts
STEP_US = 500.0


@dataclass(frozen=True)
class Disk:
    centre: tuple[float, float]
    radius: float
    speed_deg_s: float
    on_deg: float  # of an edge from black to white at t = 0; the next edges follow every 90 degrees
    off_deg: float
    inner: float = 60  # nearer to the centre edges are too slow to tell one from the other

    @property
    def half_turn_us(self) -> float:
        return 180e6 / self.speed_deg_s

    def polar(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Angle in degrees, counter-clockwise on screen, and radius of pixels."""
        dx, dy = x + 0.5 - self.centre[0], self.centre[1] - (y + 0.5)
        return np.degrees(np.arctan2(dy, dx)), np.hypot(dx, dy)

    def delay_deg(self, angle: np.ndarray, t_us: np.ndarray, edge_deg: float) -> np.ndarray:
        """How far an edge is past the pixel, 0 to 180."""
        return np.mod(edge_deg + self.speed_deg_s * 1e-6 * t_us - angle, 180)

    def region(self, angle: np.ndarray, radius: np.ndarray) -> np.ndarray:
        """Index of a pixel's region; -1 outside."""
        around = np.floor(np.mod(angle, 360) / 360 * REGIONS[0]).astype(int)
        along = np.floor((radius - self.inner) / (self.radius - self.inner) * REGIONS[1]).astype(int)
        return np.where((along >= 0) & (along < REGIONS[1]), around * REGIONS[1] + along, -1)


@dataclass
class Measures:
    """What is told about a recording, real or simulated, in the disk's frame."""

    on: np.ndarray  # events per pixel that passed the bin of delay
    off: np.ndarray
    per_edge: tuple[float, float]
    region_events: np.ndarray
    pair_sd_deg: float
    background_hz: tuple[float, float]
    events: int


def exposures(disk: Disk, width: int, height: int, duration_us: float) -> np.ndarray:
    """[region, ON or OFF, bin]: pixels of the region times the part of a bin of delay that each goes through."""
    yy, xx = np.mgrid[0:height, 0:width].astype(float)
    angle, radius = disk.polar(xx, yy)
    region = disk.region(angle, radius)
    inside = region >= 0
    angle, region = np.round(angle[inside], 1), region[inside]
    out = np.zeros((REGIONS[0] * REGIONS[1], 2, len(BINS_DEG) - 1))
    fine_deg = 0.25
    seen = np.arange(0, duration_us * disk.speed_deg_s * 1e-6, fine_deg)
    for r in range(len(out)):
        values, counts = np.unique(angle[region == r], return_counts=True)
        for k, edge in enumerate((disk.on_deg, disk.off_deg)):
            delay = np.mod(edge - values[:, None] + seen, 180)
            out[r, k] = np.histogram(delay, BINS_DEG, weights=np.broadcast_to(counts[:, None], delay.shape))[0]
    return out * fine_deg / (BINS_DEG[1] - BINS_DEG[0])


def measure(events: np.ndarray, disk: Disk, width: int, height: int, duration_us: float, seen: np.ndarray) -> Measures:
    x, y, t = events["x"].astype(float), events["y"].astype(float), events["t"].astype(float)
    angle, radius = disk.polar(x, y)
    region = disk.region(angle, radius)
    inside, on = region >= 0, events["p"] == 1
    yy, xx = np.mgrid[0:height, 0:width].astype(float)
    pixel_radius = disk.polar(xx, yy)[1]
    regions = REGIONS[0] * REGIONS[1]
    outside = pixel_radius > disk.radius + 40

    histograms, per_edge, delays, region_events = [], [], {}, np.zeros(regions)
    for k, (polarity, edge) in enumerate(((on, disk.on_deg), (~on, disk.off_deg))):
        delays[edge] = disk.delay_deg(angle, t, edge)
        # What is later than 90 belongs to the edge's successor too: the histogram ends soon after.
        early = inside & polarity & (delays[edge] < BINS_DEG[-1])
        h = np.histogram(delays[edge][early], BINS_DEG)[0] / seen[:, k].sum(0)
        region_events += np.bincount(region[early], minlength=regions)
        histograms.append(h)
        per_edge.append(float(h.sum()))

    # Pairs: an ON event, and OFF as the pixel's next event.
    pixel = (events["y"].astype(np.int64) * width + events["x"])[inside]
    order = np.lexsort((t[inside], pixel))
    p, who, r = on[inside][order], pixel[order], region[inside][order]
    d_on, d_off = delays[disk.on_deg][inside][order], delays[disk.off_deg][inside][order]
    pairs = np.flatnonzero((who[1:] == who[:-1]) & p[:-1] & ~p[1:] & (d_on[:-1] < 100) & (d_off[1:] < 100))
    total, of = d_on[pairs] + d_off[pairs + 1], r[pairs]
    n = np.bincount(of, minlength=regions)
    mean = np.bincount(of, total, regions) / np.maximum(n, 1)
    pair_sd = float(np.sqrt(np.sum((total - mean[of]) ** 2) / max(len(total) - np.count_nonzero(n), 1)))

    quiet = radius > disk.radius + 40
    seconds = outside.sum() * duration_us * 1e-6
    return Measures(
        on=histograms[0],
        off=histograms[1],
        per_edge=(per_edge[0], per_edge[1]),
        region_events=region_events,
        pair_sd_deg=pair_sd,
        background_hz=(float((quiet & on).sum() / seconds), float((quiet & ~on).sum() / seconds)),
        events=len(events),
    )


def overlap(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.minimum(a / a.sum(), b / b.sum()).sum())


def earth_mover_deg(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.abs(np.cumsum(a / a.sum() - b / b.sum())).sum() * (BINS_DEG[1] - BINS_DEG[0]))


@dataclass
class Table:
    """The pixel in the disk's steady state, by light: one half turn each way."""

    corner_hz: np.ndarray  # of the photoreceptor in white
    on: np.ndarray  # [light, bin], per pixel
    off: np.ndarray


def tabulate(chip: str, overrides: dict, contrast: float, disk: Disk, pixels: int = 1024) -> Table:
    """`pixels` pixels at each light, all at the same place of the disk, over two half turns after CYCLES."""
    kappa = profile(chip)["corner_hz_per_a"]
    corner_hz = np.geomspace(0.8, 14, 16)
    values = np.repeat((corner_hz / kappa)[:, None], pixels, axis=1)  # amperes in white
    values *= 1e15
    sensor = pecs.Sensor(pixels, len(corner_hz), chip, overrides=overrides, photocurrent_a=1e-15, seed=3)
    quarter_us = disk.half_turn_us / 2
    steps = int(np.ceil(quarter_us / STEP_US))
    found = []
    for quarter in range(2 * (CYCLES + 2)):
        start = quarter * quarter_us
        t_us = np.concatenate([[start + 1], start + quarter_us * np.arange(1, steps + 1) / steps])
        frame = (values if quarter % 2 == 0 else values / contrast).astype(np.float32)
        found.append(sensor.push(np.broadcast_to(frame, (len(t_us), *frame.shape)), t_us))
    events = np.concatenate([*found, sensor.finish()])
    since_us = events["t"] - CYCLES * disk.half_turn_us
    keep = (since_us >= 0) & (since_us < 2 * disk.half_turn_us)
    events, delay = events[keep], np.mod(since_us[keep] * disk.speed_deg_s * 1e-6, 180)
    turns, histograms = 2 * pixels, []
    for polarity, after in ((1, 0.0), (0, 90.0)):
        of = events["p"] == polarity
        histograms.append(
            np.histogram2d(
                events["y"][of], np.mod(delay[of] - after, 180), [np.arange(len(corner_hz) + 1) - 0.5, BINS_DEG]
            )[0] / turns
        )  # fmt: skip
    return Table(corner_hz, *histograms)


def light_map(table: Table, region_events: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """The corner in white that gives each region its number of events."""
    expected = np.einsum("lb,rb->rl", table.on, seen[:, 0]) + np.einsum("lb,rb->rl", table.off, seen[:, 1])
    rising = np.maximum.accumulate(expected, axis=1) + 1e-6 * np.arange(len(table.corner_hz))
    log_corner = np.log(table.corner_hz)
    return np.exp([np.interp(n, r, log_corner) for n, r in zip(region_events, rising, strict=True)])


def predicted(table: Table, corner_hz: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    at = np.interp(np.log(corner_hz), np.log(table.corner_hz), np.arange(len(table.corner_hz)))
    low = np.minimum(at.astype(int), len(table.corner_hz) - 2)
    part = (at - low)[:, None]
    return tuple(
        (((1 - part) * h[low] + part * h[low + 1]) * seen[:, k]).sum(0) / seen[:, k].sum(0)
        for k, h in enumerate((table.on, table.off))
    )


def profile(chip: str) -> dict:
    path = Path(chip) if chip.endswith(".json") else Path(__file__).parents[1] / f"sensor/chips/{chip}.json"
    return {key: v["value"] for key, v in json.loads(path.read_text())["values"].items()}


FITTED = ("contrast_threshold_on", "contrast_threshold_off", "threshold_mismatch", "noise_std")


def fit(chip: str, real: Measures, disk: Disk, seen: np.ndarray, contrast: float, rounds: int) -> tuple[dict, float]:
    from scipy.optimize import minimize

    values = profile(chip)
    start = np.log([values[k] for k in FITTED] + [contrast])

    def loss(x: np.ndarray) -> float:
        chosen = dict(zip(FITTED, np.exp(x[:-1]), strict=True))
        if chosen["threshold_mismatch"] > 0.3:
            return 10.0
        table = tabulate(chip, chosen, float(np.exp(x[-1])), disk, 512)
        on, off = predicted(table, light_map(table, real.region_events, seen), seen)
        miss = sum(np.abs(a - b).sum() for a, b in ((on, real.on), (off, real.off)))
        print(f"  {miss:.4f}  " + "  ".join(f"{v:.4f}" for v in np.exp(x)), flush=True)
        return float(miss)

    simplex = np.vstack([start, start + 0.12 * np.eye(5)])
    best = minimize(loss, start, method="Nelder-Mead", options={"maxfev": rounds, "initial_simplex": simplex})
    *values, contrast = np.exp(best.x).tolist()
    return {k: round(v, 4) for k, v in zip(FITTED, values, strict=True)}, contrast


def simulate(
    chip: str, overrides: dict, disk: Disk, corner_hz: np.ndarray, contrast: float, width: int, height: int,
    duration_us: float, seed: int,
) -> np.ndarray:  # fmt: skip
    """The whole recording: the disk's square after its warm-up, and background everywhere else."""
    kappa = profile(chip)["corner_hz_per_a"]
    half = int(np.ceil(disk.radius)) + 4
    x0, y0 = max(0, int(disk.centre[0]) - half), max(0, int(disk.centre[1]) - half)
    x1, y1 = min(width, int(disk.centre[0]) + half), min(height, int(disk.centre[1]) + half)
    yy, xx = np.mgrid[y0:y1, x0:x1].astype(float)
    angle, radius = disk.polar(xx, yy)

    # The light between the regions' middles, bilinear in angle and radius.
    grid = np.log(corner_hz).reshape(REGIONS)
    u = np.mod(angle, 360) / 360 * REGIONS[0] - 0.5
    v = np.clip((radius - disk.inner) / (disk.radius - disk.inner) * REGIONS[1] - 0.5, 0, REGIONS[1] - 1.001)
    iu, iv = np.floor(u).astype(int), v.astype(int)
    fu, fv = u - iu, v - iv
    iu, ju = iu % REGIONS[0], (iu + 1) % REGIONS[0]
    log_corner = (1 - fu) * ((1 - fv) * grid[iu, iv] + fv * grid[iu, iv + 1])
    log_corner += fu * ((1 - fv) * grid[ju, iv] + fv * grid[ju, iv + 1])
    white_fa = (np.exp(log_corner) / kappa * 1e15).astype(np.float32)
    still = (white_fa / 3).astype(np.float32)

    warmup_us = CYCLES * disk.half_turn_us
    sensor = pecs.Sensor(x1 - x0, y1 - y0, chip, overrides=overrides, photocurrent_a=1e-15, seed=seed)
    t_us = np.arange(0, warmup_us + duration_us + 2 * STEP_US, STEP_US)
    found, chunk = [], 32
    for i in range(0, len(t_us), chunk):
        frames = np.empty((len(t_us[i : i + chunk]), *white_fa.shape), np.float32)
        for frame, t in zip(frames, t_us[i : i + chunk], strict=True):
            past = disk.delay_deg(angle, t - warmup_us, disk.on_deg)
            past_off = disk.delay_deg(angle, t - warmup_us, disk.off_deg)
            white = past < past_off  # the ON edge came last
            np.copyto(frame, np.where(radius > disk.radius, still, np.where(white, white_fa, white_fa / contrast)))
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


def detect(program: str, recording: str) -> Disk:
    done = subprocess.run([program, "align", "detect", recording, "--json"], capture_output=True, text=True, check=True)
    d = json.loads(done.stdout)
    speed, phase_us = d["speed_deg_s"]["value"], d["phase_time_us"]
    return Disk(
        centre=(d["centre_x"]["value"], d["centre_y"]["value"]),
        radius=(d["rim"]["axis_a_px"] + d["rim"]["axis_b_px"]) / 4 - 6,
        speed_deg_s=speed,
        on_deg=d["on_edge_deg"]["value"] - speed * 1e-6 * phase_us,
        off_deg=d["off_edge_deg"]["value"] - speed * 1e-6 * phase_us,
    )


def examine(program: str, recording: str) -> tuple[Disk, np.ndarray, float, np.ndarray, Measures]:
    """The disk, the events and their duration [us], both from the first event on; exposures; what is told of it."""
    disk, events = detect(program, recording), pecs.read(recording)
    turned_deg = disk.speed_deg_s * 1e-6 * float(events["t"][0])
    disk = replace(disk, on_deg=disk.on_deg + turned_deg, off_deg=disk.off_deg + turned_deg)
    events["t"] -= events["t"][0]
    duration_us = float(events["t"][-1]) + 1
    seen = exposures(disk, *SIZE, duration_us)
    return disk, events, duration_us, seen, measure(events, disk, *SIZE, duration_us, seen)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording")
    parser.add_argument("--program", default="build/release/bin/pecs", help="pecs, for the disk's geometry")
    parser.add_argument("--chip", default="imx636")
    parser.add_argument("--contrast", type=float, default=12.0, help="white / black of the disk")
    parser.add_argument("--fit", action="store_true")
    parser.add_argument("--rounds", type=int, default=80, help="of the fit")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--write", type=Path, help="the fitted profile")
    parser.add_argument("--simulation", type=Path, help="the simulated events")
    args = parser.parse_args()

    width, height = SIZE
    disk, events, duration_us, seen, real = examine(args.program, args.recording)
    overrides, contrast = {}, args.contrast
    if args.fit:
        overrides, contrast = fit(args.chip, real, disk, seen, contrast, args.rounds)
    corner_hz = light_map(tabulate(args.chip, overrides, contrast, disk), real.region_events, seen)
    found = simulate(args.chip, overrides, disk, corner_hz, contrast, width, height, duration_us, args.seed)
    sim = measure(found, disk, width, height, duration_us, seen)

    def score(normalisation: str) -> dict:
        d = pecs.compare(events, found, width=width, height=height, normalisation=normalisation, split_half=False)
        return {k: d[k] for k in ("chamfer", "gaussian")}

    report = {
        "chip": args.chip,
        "fitted": overrides,
        "contrast": contrast,
        "corner_hz": {
            "min": float(corner_hz.min()),
            "median": float(np.median(corner_hz)),
            "max": float(corner_hz.max()),
        },
        "events": {"real": real.events, "simulated": sim.events},
        "events_per_edge": {"real": real.per_edge, "simulated": sim.per_edge},
        "delay_overlap": {"on": overlap(real.on, sim.on), "off": overlap(real.off, sim.off)},
        "earth_mover_deg": {"on": earth_mover_deg(real.on, sim.on), "off": earth_mover_deg(real.off, sim.off)},
        "pair_sd_deg": {"real": real.pair_sd_deg, "simulated": sim.pair_sd_deg},
        "background_hz": {"real": real.background_hz, "simulated": sim.background_hz},
        "paper": score("paper"),
        "eq16": score("eq16"),
    }
    print(json.dumps(report, indent=1))
    if args.simulation:
        pecs.write(args.simulation, found, width=width, height=height)
    if args.write:
        name = (
            args.chip if args.chip.endswith(".json") else f"{Path(__file__).parents[1]}/sensor/chips/{args.chip}.json"
        )
        chip = json.loads(Path(name).read_text())
        for key, value in overrides.items():
            chip["values"][key] |= {
                "value": value,
                "source": f"fitted to {Path(args.recording).name} by tools/fit_chip.py",
            }
        args.write.write_text(json.dumps(chip, indent=2) + "\n")


if __name__ == "__main__":
    main()
