# SPDX-License-Identifier: GPL-3.0-or-later
"""The part of the live view that needs no Blender: simulates events from frames of linear light, and keeps the time of
each pixel's last event. Row 0 of a frame is at the bottom, as on the GPU; of events, at the top."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pecs

RGB_NM = (610.0, 550.0, 465.0)  # as pecs sense takes R, G and B (docs/reference/sensor.md)
MAX_WALL_S = 0.1  # longer pauses count as this
RATE_S = 0.5  # time constant of the mean event rate
QUICK = "ideal"  # chip without noise, latency or limits
ADJACENT = 0.1  # share of adjacent blocks of one pixel in a coarse picture, whose blocks need not be whole pixels wide
DARK_A = 1e-15  # dark current of QUICK, a thousandth of white, which keeps the logarithm of black finite


def rgba_weights(chip: pecs.Chip) -> np.ndarray:
    """[4] weights of linear RGBA in the photocurrent of the chip; white is 1."""
    amperes = chip.amperes_per_unit([{"lambda_nm": nm, "weight_nm": 1.0} for nm in RGB_NM], "relative")
    return np.array([*(np.array(amperes) / sum(amperes)), 0], np.float32)


def shrink(light: np.ndarray, height: int, width: int) -> np.ndarray:
    """Resamples to [height, width]: box mean, and nearest neighbour where it enlarges."""
    for axis, wanted in enumerate((height, width)):
        size = light.shape[axis]
        if size == wanted:
            continue
        edges = np.arange(wanted + 1) * size // wanted
        sums = np.add.reduceat(light, edges[:-1], axis)  # equal edges: the pixel itself
        counts = np.maximum(np.diff(edges), 1).astype(np.float32)
        light = sums / (counts[:, None] if axis == 0 else counts)
    return light


def is_coarse(light: np.ndarray) -> bool:
    """Whether a picture is plain, as a viewport before its first sample, or consists of blocks of equal pixels, as the
    first samples do: neighbouring columns (and rows) seldom both begin a new value."""
    for axis in (0, 1):
        begins = np.flatnonzero((np.diff(light, axis=axis) != 0).any(axis=1 - axis))
        if len(begins) > 1 and (np.diff(begins) == 1).mean() > ADJACENT:
            return False
    return True


@dataclass
class Step:
    """Step from one frame of the view to the next: scene time, scene frames, and whether subframes can divide it."""

    dt_s: float  # 0: no time has passed
    frames: float = 0.0
    forward: bool = False

    @property
    def backward(self) -> bool:
        """Whether the animation jumped back, as at the end of its range."""
        return self.frames > 0 and not self.forward


class Clock:
    """Time of the live view: scene time during playback, otherwise wall-clock time."""

    def __init__(self) -> None:
        self._last: tuple[float, float, bool] | None = None
        self.dropped = 0  # scene frames that were skipped

    def step(self, frame: float, wall_s: float, playing: bool, fps: float, frames: int) -> Step:
        """frame: current scene frame. frames: length of the scene's range, after which playback wraps around."""
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
            moved += frames  # wrapped around
        moved = abs(moved)
        self.dropped += max(0, round(moved) - 1)
        return Step(moved / fps, moved, forward)


def subframes_that_fit(most: int, cost_s: float, frame_s: float) -> int:
    """Number of subframes (1 to most) of `cost_s` each that fit in half a frame time; the rest is the viewport's."""
    return max(1, min(most, int(0.5 * frame_s / cost_s) if cost_s > 0 else most))


JUMP_FRAMES = 2  # frames whose events are dropped after a jump, since events lag by one frame


class LiveSensor:
    """Simulates events from a sequence of frames.

    last_s [height, width] float32, row 0 at the bottom: time of each pixel's last event in s (from 1 on), negative for
    OFF, 0 for none. Events lag by one frame: they are complete up to `known_s`, the light up to `now_s`. Raises
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
        overrides = {"dark_current_a": DARK_A} if chip == QUICK else {}
        if threshold:
            overrides |= {"contrast_threshold_on": threshold, "contrast_threshold_off": threshold}
        profile = pecs.Chip(chip, overrides=overrides)
        readout = "ideal" if chip == QUICK else "chip"
        self._sensor = pecs.Sensor(width, height, profile, seed=seed, readout=readout, threads=threads)
        self._weights = rgba_weights(profile)
        self.now_s = self.known_s = 1.0
        self.last_s = np.zeros((height, width), np.float32)
        self.rate_hz, self._dropped = 0.0, 0
        self.recording: EventRecording | None = None

    def light(self, rgba: np.ndarray) -> np.ndarray:
        """Light [height, width] from linear RGBA [height, width, 4]; white is 1."""
        light = np.empty(rgba.shape[:2], np.float32)[::-1]  # row 0 last in memory, so that `push` needs no copy
        return np.matmul(rgba, self._weights, out=light)

    def push(self, light: np.ndarray, dt_s: float, jump: bool = False) -> np.ndarray:
        """Adds the light `dt_s` after the previous frame; returns the new events, times in us. jump: the light is not
        that of the time before (the animation begins again), so the change causes no events.

        Raises PecsOutputError if they cannot be recorded, and ends the recording.
        """
        self.known_s = self.now_s
        self.now_s += dt_s
        events = np.asarray(self._sensor.push(light[::-1], self.now_s * 1e6))
        self._dropped = JUMP_FRAMES if jump else max(0, self._dropped - 1)
        if self._dropped:
            events = events[:0]
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
        # Events are sorted by time, so the last one of each pixel remains.
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
        """Starts to write events to a file."""
        height, width = self.last_s.shape
        self.recording = EventRecording(path, width, height)

    def stop_recording(self) -> int:
        """Completes the file; returns its number of events."""
        recording, self.recording = self.recording, None
        if not recording:
            return 0
        recording.finish()
        return recording.count

    def close(self) -> None:
        try:
            self.stop_recording()
        finally:
            self._sensor.close()


class EventRecording(pecs.EventWriter):
    """Events of a file whose time begins with the first of them."""

    def __init__(self, path: Path, width: int, height: int):
        super().__init__(path, width, height)
        self.path, self.count = path, 0
        self._begin_us: int | None = None

    def write(self, events: np.ndarray) -> None:
        if not len(events):
            return
        if self._begin_us is None:
            self._begin_us = int(events["t"][0])
        events = np.array(events)
        events["t"] -= self._begin_us
        super().write(events)
        self.count += len(events)
