# SPDX-License-Identifier: GPL-3.0-or-later
"""The live view's part that needs no Blender: pictures of linear light become events, and the time of each pixel's last
one. Pictures have their row 0 at the bottom, as the GPU gives them; events at the top."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import pecs

RGB_NM = (610.0, 550.0, 465.0)  # as pecs sense takes R, G and B (docs/reference/sensor.md)
MAX_WALL_S = 0.1  # a pause is no slow motion
RATE_S = 0.5  # over which the rate is averaged
QUICK = "ideal"  # the chip without noise, delay or limits
DARK_A = 1e-15  # its dark current here, a thousandth of white: nobody can take the logarithm of black


def rgba_weights(chip: pecs.Chip) -> np.ndarray:
    """[4] What a pixel of the chip makes of linear RGBA; white is 1."""
    amperes = chip.amperes_per_unit([{"lambda_nm": nm, "weight_nm": 1.0} for nm in RGB_NM], "relative")
    return np.array([*(np.array(amperes) / sum(amperes)), 0], np.float32)


def shrink(light: np.ndarray, height: int, width: int) -> np.ndarray:
    """[height, width] from any other size: means of the pixels that fall into each; the nearest where there is none."""
    for axis, wanted in enumerate((height, width)):
        size = light.shape[axis]
        if size == wanted:
            continue
        edges = np.arange(wanted + 1) * size // wanted
        sums = np.add.reduceat(light, edges[:-1], axis)  # where two edges meet: the pixel itself
        counts = np.maximum(np.diff(edges), 1).astype(np.float32)
        light = sums / (counts[:, None] if axis == 0 else counts)
    return light


@dataclass
class Step:
    """From one picture to the next: time, the frames it covers, and whether it can be divided."""

    dt_s: float  # 0: no time has passed
    frames: float = 0.0
    forward: bool = False


class Clock:
    """Time of the live view: the scene's while the animation plays, else the clock on the wall."""

    def __init__(self) -> None:
        self._last: tuple[float, float, bool] | None = None
        self.dropped = 0  # frames that were not shown

    def step(self, frame: float, wall_s: float, playing: bool, fps: float, frames: int) -> Step:
        """frame: the scene's; frames: of its range, after which a playing animation begins again."""
        if self._last is None:
            self._last = (frame, wall_s, playing)
            return Step(0.0)
        old_frame, old_wall_s, was_playing = self._last
        self._last = (frame, wall_s, playing)
        if not (playing and was_playing):
            return Step(min(max(wall_s - old_wall_s, 0.0), MAX_WALL_S))
        moved = frame - old_frame
        forward = moved > 0
        if moved < 0 and moved + frames < -moved:
            moved += frames  # began again
        moved = abs(moved)
        self.dropped += max(0, round(moved) - 1)
        return Step(moved / fps, moved, forward)


def instants_that_fit(most: int, cost_s: float, frame_s: float) -> int:
    """How many pictures of `cost_s` each fill half a frame, 1 ... most: the other half is the viewport's own."""
    return max(1, min(most, int(0.5 * frame_s / cost_s) if cost_s > 0 else most))


class LiveSensor:
    """Pictures [height, width] or [height, width, 4] (RGBA), one after the other, into events.

    last_s [height, width] float32, row 0 at the bottom: when (in s, from 1 on) each pixel last fired, negative for OFF,
    0 for never. Events come one picture late, so these times reach to `known_s`, light to `now_s`. Raises
    pecs.PecsError as pecs.Sensor does.
    """

    def __init__(
        self,
        width: int,
        height: int,
        chip: str = QUICK,
        threshold: float | None = None,
        seed: int = 1,
        threads: int = 1,
    ):
        import pecs

        overrides = {"dark_current_a": DARK_A} if chip == QUICK else {}
        if threshold:
            overrides |= {"contrast_threshold_on": threshold, "contrast_threshold_off": threshold}
        profile = pecs.Chip(chip, overrides=overrides)
        readout = "ideal" if chip == QUICK else "chip"
        self._sensor = pecs.Sensor(width, height, profile, seed=seed, readout=readout, threads=threads)
        self._weights = rgba_weights(profile)
        self.now_s = self.known_s = 1.0
        self.last_s = np.zeros((height, width), np.float32)
        self.rate_hz = 0.0
        self.recording: Recording | None = None

    def light(self, rgba: np.ndarray) -> np.ndarray:
        """[height, width] of linear RGBA [height, width, 4]; white is 1."""
        light = np.empty(rgba.shape[:2], np.float32)[::-1]  # row 0 last in memory: `push` takes it without a copy
        return np.matmul(rgba, self._weights, out=light)

    def push(self, light: np.ndarray, dt_s: float) -> np.ndarray:
        """`light` as it is `dt_s` after the last one (the first: when it begins). The new events, times in us.

        Raises PecsOutputError when they cannot be recorded; the recording has then ended.
        """
        self.known_s = self.now_s
        self.now_s += dt_s
        events = np.asarray(self._sensor.push(light[::-1], self.now_s * 1e6))
        if len(events):
            self._keep_times(events)
        if dt_s > 0:
            share = -np.expm1(-dt_s / RATE_S)
            self.rate_hz += float(share * (len(events) / dt_s - self.rate_hz))
        if self.recording:
            self._record(events)
        return events

    def _keep_times(self, events: np.ndarray) -> None:
        height, width = self.last_s.shape
        index = (height - 1 - events["y"].astype(np.int32)) * width
        index += events["x"]
        # The events are in order: a pixel's last one stays.
        signed_s = events["t"].astype(np.float32) * (events["p"].astype(np.float32) * 2e-6 - 1e-6)
        self.last_s.reshape(-1)[index] = signed_s

    def _record(self, events: np.ndarray) -> None:
        try:
            self.recording.write(events)
        except Exception:
            self.recording.close()
            self.recording = None
            raise

    def record(self, path: Path) -> None:
        """From here on events also go to a file, whose time begins with the first of them."""
        height, width = self.last_s.shape
        self.recording = Recording(path, width, height)

    def stop_recording(self) -> int:
        """Completes the file; how many events it has."""
        recording, self.recording = self.recording, None
        return recording.finish() if recording else 0

    def close(self) -> None:
        try:
            self.stop_recording()
        finally:
            self._sensor.close()


class Recording:
    """Events on their way to a file: FILE.partial until it is whole."""

    def __init__(self, path: Path, width: int, height: int):
        import pecs

        self.path, self.count = path, 0
        self._begin_us: int | None = None
        self._writer = pecs.EventWriter(path, width, height)

    def write(self, events: np.ndarray) -> None:
        if not len(events):
            return
        if self._begin_us is None:
            self._begin_us = int(events["t"][0])
        events = np.array(events)
        events["t"] -= self._begin_us
        self._writer.write(events)
        self.count += len(events)

    def finish(self) -> int:
        self._writer.finish()
        return self.count

    def close(self) -> None:
        self._writer.close()
