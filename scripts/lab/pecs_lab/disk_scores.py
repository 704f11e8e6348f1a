"""How near a stream of events of the rotating disk is to a recording's (scripts/studies/fits.py).

Delays are behind the last edge of the event's polarity, in degrees of rotation. The 24 regions are 12 sectors by 2
rings. Intervals (95 %) are of a jackknife, which leaves out one region at a time (a bootstrap draws streams that are
farther apart than the whole ones); those of Chamfer and Gaussian are of `pecs.compare`, a bootstrap over 20 parts of
the time.
"""

from dataclasses import dataclass, replace

import numpy as np
import pecs
from scipy.stats import wasserstein_distance

from .disk import Disk

RING = 0.2, 0.98  # of the radius, as pecs.delays
SECTORS, REGIONS = 12, 24
STRETCHES = np.geomspace(0.4, 2.5, 185)  # of the histogram of the delays; 1 % apart
SIGNED = ("on_share", "light_slope_on", "light_slope_off", "map_correlation")  # may be negative
CELLS_DEG = np.arange(-10, 101, 10)
BINS_DEG = np.arange(-10, 87, 2)  # of pecs.delays; at 90 degrees the next edge ends the delays in any light
MEASURES = {
    "chamfer": "Chamfer (shared normalisation)",
    "gaussian": "Gaussian",
    "earth_mover_on_deg": "delays, ON, earth mover's distance, °",
    "earth_mover_off_deg": "delays, OFF, °",
    "overlap_on": "delays, ON, overlap",
    "overlap_off": "delays, OFF, overlap",
    "light_slope_on": "delays over light, ON, slope",
    "light_slope_off": "delays over light, OFF, slope",
    "light_scatter_on": "delays over light, ON, scatter, ln",
    "light_scatter_off": "delays over light, OFF, scatter, ln",
    "deviance": "deviance per event",
    "events_ratio": "events / recorded",
    "on_share": "share of ON - recorded",
    "rate_rms": "rate over time, RMS / mean",
    "interval_decades": "intervals, decades",
    "map_correlation": "map, correlation",
}
MAP = 16  # blocks across the disk, and down
INT = ("p", "pixel", "block", "sector", "ring")
SEEN = np.dtype([(k, "i8") for k in INT] + [("t", "f8"), ("delay", "f8"), ("gap", "f8")])


def on_grid(events: np.ndarray, coarser: int, offset: int) -> np.ndarray:
    kept = events[(events["x"] % coarser == offset) & (events["y"] % coarser == offset)].copy()
    for axis in "xy":
        kept[axis] //= coarser
    return kept


def between(events: np.ndarray, disk: Disk, begin_us: float, end_us: float) -> tuple[np.ndarray, Disk]:
    """Its events in the ring, from 0 on, and the disk then."""
    radius = disk.polar(events["x"].astype(float), events["y"].astype(float))[1] / disk.radius_px
    inside = (radius > RING[0]) & (radius < RING[1])
    kept = np.sort(events[inside & (events["t"] >= begin_us) & (events["t"] < end_us)], order="t")
    kept["t"] -= round(begin_us)
    turned = disk.speed_deg_s * 1e-6 * round(begin_us)
    return kept, replace(disk, on_edge_deg=disk.on_edge_deg + turned, off_edge_deg=disk.off_deg + turned)


def seen(events: np.ndarray, disk: Disk) -> np.ndarray:
    """Place of each event: block of the map, sector of 12, ring of 4, delay (not a number from 100 degrees on), and
    log10 of the microseconds since the pixel's last one (not a number for its first)."""
    angle, radius = disk.polar(events["x"].astype(float), events["y"].astype(float))
    low, high = (share * disk.radius_px for share in RING)
    out = np.empty(len(events), SEEN)
    out["t"], out["p"], out["pixel"] = events["t"], events["p"], events["y"].astype(int) * 2048 + events["x"]
    across, down = (
        np.clip(((events[axis] + 0.5 - c) / disk.radius_px + 1) * MAP / 2, 0, MAP - 1).astype(int)
        for axis, c in zip("xy", disk.centre_px, strict=True)
    )
    out["block"] = down * MAP + across
    out["sector"] = (angle + 180) // (360 / SECTORS) % SECTORS
    out["ring"] = np.clip((radius - low) / (high - low) * 4, 0, 3.99)
    edge = np.where(out["p"] == 1, disk.on_edge_deg, disk.off_deg)
    delay = np.mod(disk.past_deg(angle, out["t"], edge) + 10, disk.period_deg) - 10
    out["delay"] = np.where(delay < 100, delay, np.nan)
    order = np.lexsort((out["t"], out["pixel"]))
    gap, same = np.diff(out["t"][order]), np.diff(out["pixel"][order]) == 0
    out["gap"] = np.nan
    out["gap"][order[1:][same]] = np.log10(np.maximum(1, gap[same]))
    return out


def region(of: np.ndarray) -> np.ndarray:
    return of["ring"] // 2 * SECTORS + of["sector"]


def cells(of: np.ndarray, bins_deg: np.ndarray = CELLS_DEG) -> np.ndarray:
    """Numbers of events by polarity (OFF, ON), region and delay."""
    kept = of[np.isfinite(of["delay"])]
    bins = [np.arange(3), np.arange(REGIONS + 1), bins_deg]
    return np.histogramdd(np.stack([kept["p"], region(kept), kept["delay"]], 1), bins)[0]


@dataclass
class Part:
    """A time of a recording."""

    begin_us: float
    end_us: float

    def cells(self, events: np.ndarray, disk: Disk) -> np.ndarray:
        return cells(seen(*between(events, disk, self.begin_us, self.end_us)))


def deviance(real: np.ndarray, sim: np.ndarray) -> float:
    """Per event, of Poisson numbers `real` where `sim` is expected: that of the shares, and that of the total number.
    Half an event in each cell for what a simulation of this size cannot show; in the total number silence is wrong."""
    if sim.sum() == 0:
        return 100.0
    ratio = sim.sum() / real.sum()
    sim = sim / ratio + 0.5
    misses = np.where(real > 0, real * np.log(np.maximum(real, 1e-9) / sim), 0) - (real - sim)
    return float(2 * misses.sum() / real.sum() + 2 * (ratio - 1 - np.log(ratio)))


def delays_of(of: np.ndarray, polarity: int) -> np.ndarray:
    return of["delay"][(of["p"] == polarity) & np.isfinite(of["delay"])]


def distance(real: np.ndarray, sim: np.ndarray) -> float:
    """Earth mover's."""
    return float(wasserstein_distance(real, sim)) if len(real) and len(sim) else np.nan


def measures(real: np.ndarray, sim: np.ndarray, duration_us: float) -> dict[str, float]:
    """Distances of two streams as `seen` gives them."""
    found = {}
    for p, name in ((1, "on"), (0, "off")):
        both = [delays_of(of, p) for of in (real, sim)]
        found[f"earth_mover_{name}_deg"] = distance(*both)
        shares = [np.histogram(d, np.arange(-10, 101, 2))[0] / max(len(d), 1) for d in both]
        found[f"overlap_{name}"] = float(np.minimum(*shares).sum())
    found["deviance"] = deviance(cells(real), cells(sim))
    found["events_ratio"] = len(sim) / len(real)
    found["on_share"] = float(sim["p"].mean() - real["p"].mean())
    rates = [np.histogram(of["t"], np.arange(0, duration_us, 1000))[0] for of in (real, sim)]
    found["rate_rms"] = float(np.sqrt(np.mean(np.subtract(*rates) ** 2.0)) / rates[0].mean())
    maps = [np.bincount(of["block"], minlength=MAP * MAP) for of in (real, sim)]
    there = maps[0] + maps[1] > 0
    found["map_correlation"] = float(np.corrcoef(maps[0][there], maps[1][there])[0, 1])
    found["interval_decades"] = distance(*(of["gap"][np.isfinite(of["gap"])] for of in (real, sim)))
    return found


@dataclass
class Slowness:
    """Local light, from events alone: how far the delays of a region are those of the whole disk, stretched. The
    stretch is of the greatest likelihood of the events' delays, given how often each delay was there to be seen; the
    number of events does not count."""

    shapes: np.ndarray  # [polarity, stretch, bin]: of the recording's delays
    local: np.ndarray  # [region]: ln of the whole recording's stretch, mean of both polarities

    @classmethod
    def measure(cls, events: np.ndarray, disk: Disk, width: int, height: int, duration_us: float) -> "Slowness":
        delays = pecs.delays(events, disk=disk.detected(), width=width, height=height, duration_us=round(duration_us))
        at = BINS_DEG[:-1] + 1
        histograms = [np.array(delays[p]["histogram"])[: len(at)] for p in ("off", "on")]
        shapes = np.array([[np.interp(at / s, at, h) for s in STRETCHES] for h in histograms])
        slow = cls(np.maximum(shapes, 1e-6), np.zeros(REGIONS))
        inside, _ = between(events, disk, 0, duration_us)
        slow.local = slow.logs(seen(inside, disk), exposed(delays)).mean(0)
        return slow

    def logs(self, of: np.ndarray, exposure: np.ndarray) -> np.ndarray:
        """[polarity, region]: ln of the stretch; not a number with less than 20 events."""
        counts = cells(of, BINS_DEG)
        shares = exposure[:, :, None] * self.shapes[:, None]  # [polarity, region, stretch, bin]
        shares /= np.maximum(shares.sum(-1, keepdims=True), 1e-12)
        likelihood = (counts[:, :, None] * np.log(np.maximum(shares, 1e-9))).sum(-1)
        return np.where(counts.sum(-1) >= 20, np.log(STRETCHES)[likelihood.argmax(-1)], np.nan)


def exposed(delays: dict) -> np.ndarray:
    """[polarity, region, bin]: pixels times passing edges, of the regions of pecs.delays (24 around x 4 along)."""
    passes = np.array([delays[p]["passes"] for p in ("off", "on")])[..., : len(BINS_DEG) - 1]
    each = passes.reshape(2, SECTORS, 2, 2, 2, -1).sum((2, 4))  # [polarity, sector, ring pair, bin]
    return each.transpose(0, 2, 1, 3).reshape(2, REGIONS, -1)


def against_light(local: np.ndarray, logs: np.ndarray) -> dict[str, float]:
    """Slope of a stream's stretches on the recording's, and how far they scatter about the line (ln)."""
    found = {}
    for of, name in zip(logs, ("off", "on"), strict=True):
        there = np.isfinite(of) & np.isfinite(local)
        if there.sum() < 3 or not np.ptp(local[there]):
            found |= {f"light_slope_{name}": np.nan, f"light_scatter_{name}": np.nan}
            continue
        slope, offset = np.polyfit(local[there], of[there], 1)
        found[f"light_slope_{name}"] = round(float(slope), 9) + 0.0  # no -0
        found[f"light_scatter_{name}"] = round(float((of - slope * local - offset)[there].std()), 9)
    return found


@dataclass
class Scored:
    """The target of simulations: a part of a recording, on a coarser grid."""

    events: np.ndarray
    disk: Disk
    width: int
    height: int
    duration_us: float
    slowness: Slowness

    def __post_init__(self):
        self.seen = seen(self.events, self.disk)
        size = {"width": self.width, "height": self.height, "duration_us": round(self.duration_us)}
        self.exposure = exposed(pecs.delays(self.events, disk=self.disk.detected(), **size))

    def scores(self, events: np.ndarray, disk: Disk | None = None) -> dict:
        """Score of each measure [value, ends of its interval]; without ends where there is no interval. `disk`: where
        it is in `events`, if not where it is in the recording."""
        size = {"width": self.width, "height": self.height, "origin": "zero", "split_half": False}
        shared = pecs.compare(self.events, events, **size)
        found = {k: [shared[k], *(shared[f"{k}_interval"] or ())] for k in ("chamfer", "gaussian")}
        sim = seen(events, disk or self.disk)
        logs, local = self.slowness.logs(sim, self.exposure), self.slowness.local

        def of(regions: np.ndarray) -> dict[str, float]:
            kept = [s[np.isin(region(s), regions)] for s in (self.seen, sim)]
            return measures(*kept, self.duration_us) | against_light(local[regions], logs[:, regions])

        every = np.arange(REGIONS)
        without = [of(np.delete(every, r)) for r in every]
        for key, value in of(every).items():
            spread = np.array([w[key] for w in without]).std() * np.sqrt(REGIONS - 1)
            low = value - 1.96 * spread if key in SIGNED else max(0.0, value - 1.96 * spread)
            ends = [low, value + 1.96 * spread] if np.isfinite(value) and np.isfinite(spread) else []
            found[key] = [value if np.isfinite(value) else None, *ends]
        return found
