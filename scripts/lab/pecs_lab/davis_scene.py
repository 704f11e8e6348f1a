"""Recordings of a DAVIS whose values are known: texture in motion and then still, with frames and events, as a folder
that `pecs fit --davis` reads. Used by scripts/studies/fit_hidden.py and tests/python/fit/test_davis.py."""

from pathlib import Path

import cv2
import numpy as np
import pecs

TEXTURE_PX, BLOCK = 1400, 100  # side of the texture; frames of a push
STEP_US = 1000


def texture(rng, contrast):
    """Blurred noise of four sizes and boxes with sharp edges; ln contrast is the standard deviation."""
    out = np.zeros((TEXTURE_PX, TEXTURE_PX), np.float32)
    for sigma_px, size in ((2, 0.35), (6, 0.5), (20, 0.7), (60, 0.8)):
        noise = cv2.GaussianBlur(rng.standard_normal(out.shape).astype(np.float32), (0, 0), sigma_px)
        out += size * noise / noise.std()
    for _ in range(250):
        x, y = rng.integers(0, TEXTURE_PX - 100, 2)
        w, h = rng.integers(10, 100, 2)
        out[y : y + h, x : x + w] += rng.normal()
    light = np.exp(contrast * out / out.std())
    return light / np.quantile(light, 0.97)


def _path_px(rng, t_s, moving_s, speed):
    """A hand: five sines, px/s rms; still after moving_s."""
    hz, phase, size = rng.uniform(0.5, 3, 5), rng.uniform(0, 2 * np.pi, 5), rng.uniform(0.5, 1, 5)
    velocity = (size[:, None] * np.cos(2 * np.pi * hz[:, None] * t_s + phase[:, None])).sum(0)
    velocity *= speed / np.sqrt(2) / velocity.std() * np.clip((moving_s - t_s) / 0.1, 0, 1)
    path = np.cumsum(velocity) * STEP_US * 1e-6
    return path - path.mean() + TEXTURE_PX / 2


def record(
    folder, seed, values, *, chip="davis240c", white_a=1e-12, size=(120, 90), moving_s=2.5, still_s=0.9, speed=120
):
    """Writes events.npz, frames/ and exposures.csv into a new folder."""
    rng = np.random.default_rng(seed)
    scene = texture(rng, 0.6)
    t_us = np.arange(0.0, (moving_s + still_s) * 1e6, STEP_US)
    x, y = (_path_px(rng, t_us * 1e-6, moving_s, speed) for _ in range(2))
    events, taken = [], []
    options = {"overrides": values, "seed": seed, "photocurrent_a": white_a, "time_unit": "us"}
    with pecs.Sensor(*size, chip, chip_frames=True, **options) as sensor:
        for i in range(0, len(t_us), BLOCK):
            places = list(zip(x[i : i + BLOCK], y[i : i + BLOCK], strict=True))
            light = np.stack([cv2.getRectSubPix(scene, size, place) for place in places])
            events.append(sensor.push(light, t_us[i : i + BLOCK]))
            taken.append(sensor.take_frames())
        events.append(sensor.finish())
        taken.append(sensor.take_frames())
    folder = Path(folder)
    (folder / "frames").mkdir(parents=True)
    pecs.write(folder / "events.npz", pecs.Events(np.concatenate(events), *size))
    lines = ["frame,begin_us,end_us"]
    for of in taken:
        for picture, begin_us, end_us in zip(of.values, of.begin_us, of.end_us, strict=True):
            number = len(lines) - 1
            cv2.imwrite(str(folder / f"frames/{number:04}.png"), (picture >> (of.bits - 8)).astype(np.uint8))
            lines.append(f"{number},{begin_us},{end_us}")
    (folder / "exposures.csv").write_text("\n".join(lines) + "\n")
