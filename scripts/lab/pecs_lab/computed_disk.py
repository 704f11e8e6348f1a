"""A chip's pixels before a turning disk that is computed, not rendered.

The light is a map over the disk's regions (pecs.delays); `pecs fit --disk` estimates it from a recording.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pecs
from pecs.fit import Disk as Recording
from pecs.fit.disk import light_map, load_disk
from pecs.fit.model import Model
from pecs.fit.profile import read

from .disk import Disk
from .measure import ask

WARM_UP = 25  # periods of white and black before a recording: where few edges make events, pixels need 20 to forget
COARSER = 8  # steps of the warm-up, but not of its last period, relative to those of the recording
RING = 0.2, 0.98  # of the radius, as pecs.delays
STILL_PX = 6.0  # outermost part of the disk, which does not turn
WALL = 1 / 3  # light next to the disk / in white
MARGIN_PX = 60  # around a disk whose background is to be seen: with it, noise is also simulated there


def period_us(disk: Disk) -> float:
    return disk.period_deg / abs(disk.speed_deg_s) * 1e6


def profile(chip: str) -> dict:
    return {key: v["value"] for key, v in read(chip)["values"].items()}


def corner_map(recording: str, chip: str, contrast: float) -> np.ndarray:
    """The photoreceptor's corner in white, Hz [around, along], with which each region has its number of events."""
    of, model = load_disk(Recording(recording, contrast)), Model(chip, pixels=1024)
    model.focus(of, {})
    return light_map(of, model.turning(of, {})).reshape(of.regions)


def simulate(
    chip: str, overrides: dict, disk: Disk, corner_hz: np.ndarray, contrast: float, *, width: int, height: int,
    duration_us: float, seed: int, step_us: float = 150.0, margin_px: int = 0,
) -> np.ndarray:  # fmt: skip
    """The whole recording: after a warm-up the square of the disk and `margin_px` around it, and background alone
    outside."""
    from scipy.ndimage import map_coordinates

    kappa = {**profile(chip), **overrides}["corner_hz_per_a"]
    half = int(np.ceil(disk.radius_px)) + margin_px
    x0, y0 = max(0, int(disk.centre_px[0]) - half), max(0, int(disk.centre_px[1]) - half)
    x1, y1 = min(width, int(disk.centre_px[0]) + half), min(height, int(disk.centre_px[1]) + half)
    yy, xx = np.mgrid[y0:y1, x0:x1].astype(float)
    angle, radius = disk.polar(xx, yy)

    # The light between the regions' middles, bilinear in angle and radius.
    around, along = corner_hz.shape
    grid = np.pad(np.log(corner_hz), ((1, 1), (0, 0)), "wrap")
    u = (angle / 360 + 0.5) * around + 0.5
    v = (radius / disk.radius_px - RING[0]) / (RING[1] - RING[0]) * along - 0.5
    log_corner = map_coordinates(grid, [u, v], order=1, mode="nearest")
    white_fa = (np.exp(log_corner) / kappa * 1e15).astype(np.float32)

    warm_up_us, last_us = WARM_UP * period_us(disk), period_us(disk)
    coarse = np.arange(0, warm_up_us - last_us, COARSER * step_us)
    t_us = np.concatenate([coarse, np.arange(warm_up_us - last_us, warm_up_us + duration_us + 2 * step_us, step_us)])
    sensor = pecs.Sensor(x1 - x0, y1 - y0, chip, overrides=overrides, photocurrent_a=1e-15, seed=seed)
    found, chunk = [], 32
    for i in range(0, len(t_us), chunk):
        frames = np.empty((len(t_us[i : i + chunk]), *white_fa.shape), np.float32)
        for frame, t in zip(frames, t_us[i : i + chunk], strict=True):
            on, off = (disk.past_deg(angle, t - warm_up_us, edge) for edge in (disk.on_edge_deg, disk.off_deg))
            turning = np.where(on < off, white_fa, white_fa / contrast)  # the ON edge came last
            frame[:] = np.where(radius > disk.radius_px - STILL_PX, WALL * white_fa, turning)
        found.append(sensor.push(frames, t_us[i : i + chunk]))
    inner = np.concatenate([*found, sensor.finish()])
    inner["x"] += x0
    inner["y"] += y0
    outer = pecs.simulate(
        np.full((3, height, width), 1.0, np.float32), warm_up_us + duration_us * np.array([0, 0.5, 1.1]), chip,
        overrides=overrides | {"noise_std": 0}, photocurrent_a=1e-15, seed=seed + 1,
    )  # fmt: skip
    outside = (outer["x"] < x0) | (outer["x"] >= x1) | (outer["y"] < y0) | (outer["y"] >= y1)
    events = np.concatenate([inner, outer[outside]])
    events["t"] -= round(warm_up_us)
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


def examine(recording: str) -> tuple[Disk, np.ndarray, float]:
    """The disk, the events (with width and height) and their duration [us], from the first event on."""
    if not Path(recording).is_file():
        raise SystemExit(f"{recording}: got no recording, wanted R_360_L or its like (docs/studies/validation.md)")
    disk, events = detect(recording), pecs.read(recording)
    turned_deg = disk.speed_deg_s * 1e-6 * float(events["t"][0])
    disk = replace(disk, on_edge_deg=disk.on_edge_deg + turned_deg, off_edge_deg=disk.off_deg + turned_deg)
    events["t"] -= events["t"][0]
    return disk, events, float(events["t"][-1]) + 1
