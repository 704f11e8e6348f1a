"""Optical flow of scripts/studies/flow.py: windows of events with their flow, of a data set and of the lab's turning
disk; a small network, from the voxel grid of a window to the displacement over it. Needs PyTorch."""

import json
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
import pecs
import torch
import torch.nn.functional as functional
from pecs._files import write_json
from pecs.datasets.sequence import Camera
from torch import Tensor, nn

from . import sequences
from .disk import Disk

BINS = 5
SCALE_PX = 4.0  # displacement of an output of 1
FACTOR = 8  # sizes are padded to a multiple of it


def grid_of(events: np.ndarray, shape: tuple[int, int], begin_us: float, end_us: float) -> np.ndarray:
    return pecs.voxel_grid(events, shape[1], shape[0], BINS, begin_us, end_us, normalise=True)


class Flows:
    """True flows of a camera, read once: px from instant i to i + length."""

    def __init__(self, camera: Camera):
        self.camera, self.times_us = camera, camera.truth.times_us
        self.name = camera.folder.parent.name  # of the sequence
        self.shape = camera.height, camera.width
        self._known: dict[tuple[int, int], np.ndarray] = {}

    def __call__(self, i: int, length: int) -> np.ndarray:
        """[2, H, W]; NaN unknown."""
        if (i, length) not in self._known:
            flow = self.camera.truth.flow(i, i + length)
            self._known[i, length] = np.moveaxis(flow, -1, 0).astype(np.float16)
        return self._known[i, length].astype(np.float32)


@dataclass(frozen=True)
class Window:
    """Events of [begin_us, end_us) and the displacement [2, H, W] over it of what each pixel sees at its begin, px."""

    name: str
    events: np.ndarray
    begin_us: float
    end_us: float
    flow: np.ndarray

    @property
    def shape(self) -> tuple[int, int]:
        return self.flow.shape[1:]

    @cached_property
    def has_events(self) -> np.ndarray:
        """[H, W], pixels with an event and a known flow."""
        out = np.zeros(self.shape, bool)
        out[self.events["y"], self.events["x"]] = True
        return out & self.known

    @cached_property
    def known(self) -> np.ndarray:
        return np.isfinite(self.flow).all(0)


class View:
    """The events that a sensor made of a camera's light."""

    def __init__(self, flows: Flows, events: Path):
        self.flow, self.shape, self.intervals = flows, flows.shape, len(flows.times_us) - 1
        self.events = np.asarray(pecs.read(events, "dsec"))
        self._first = np.searchsorted(self.events["t"], flows.times_us)

    def grid(self, i: int, length: int) -> np.ndarray:
        return grid_of(self._cut(i, length), self.shape, *self.flow.times_us[[i, i + length]])

    def _cut(self, i: int, length: int) -> np.ndarray:
        return self.events[self._first[i] : self._first[i + length]]

    def windows(self, first: int, length: int, step: int) -> list[Window]:
        """From instant `first` on, `step` instants apart."""
        out = []
        for i in range(first, self.intervals - length + 1, step):
            begin, end = self.flow.times_us[[i, i + length]]
            out.append(Window(self.flow.name, self._cut(i, length), begin, end, self.flow(i, length)))
        return out


def coarse_disk(name: str, factor: int) -> Disk:
    """On a grid whose pixels are factor x factor of the sensor's."""
    disk = sequences.load(name).disk
    return replace(disk, centre_px=tuple(c / factor for c in disk.centre_px), radius_px=disk.radius_px / factor)


def rotation(disk: Disk, shape: tuple[int, int], seconds: float) -> np.ndarray:
    """Displacement [2, H, W] of the disk's points in that time, px; NaN beyond its rim."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    angle, radius = disk.polar(x, y)
    before, after = np.radians(angle), np.radians(angle + disk.speed_deg_s * seconds)
    moved = radius * np.stack([np.cos(after) - np.cos(before), np.sin(before) - np.sin(after)])
    return np.where(radius <= disk.radius_px, moved, np.nan).astype(np.float32)


def real_windows(recording: Path, plan: dict) -> list[Window]:
    """plan: "real" of flow.json. All events of factor x factor pixels are those of one; cut to the
    disk's box."""
    factor, window_us = plan["coarser"], plan["window_us"]
    sequence = sequences.load(plan["sequence"])
    left, top, right, bottom = (v // factor for v in sequence.render["moving_px"])
    disk = coarse_disk(plan["sequence"], factor).moved(-left, -top)
    events = np.asarray(pecs.read(recording)).copy()
    x, y = events["x"].astype(int) // factor - left, events["y"].astype(int) // factor - top
    inside = (x >= 0) & (x < right - left) & (y >= 0) & (y < bottom - top)
    events = events[inside]
    events["x"], events["y"] = x[inside], y[inside]
    flow = rotation(disk, (bottom - top, right - left), window_us * 1e-6)
    starts = np.arange(plan["begin_us"], plan["end_us"] - window_us + 1, plan["step_us"])
    bounds = [np.searchsorted(events["t"], [t, t + window_us]) for t in starts]
    return [
        Window(plan["sequence"], events[a:b], float(t), float(t + window_us), flow)
        for t, (a, b) in zip(starts, bounds, strict=True)
    ]


def disk_speed(recording: Path, plan: dict) -> tuple[float, float]:
    """Speed of the recording's disk by its events alone, deg/s: that with which the events' polarities, turned back by
    it, have most of the disk's pattern (the harmonic of its sectors). Then the speed that it has."""
    disk = coarse_disk(plan["sequence"], 1)
    events = np.asarray(pecs.read(recording))
    angle, radius = disk.polar(events["x"].astype(float), events["y"].astype(float))
    on = (radius < 0.95 * disk.radius_px) & (radius > 0.1 * disk.radius_px)
    turn = np.radians(angle[on]) * disk.sectors / 2
    seconds, polarity = events["t"][on] * 1e-6 * np.radians(1) * disk.sectors / 2, np.where(events["p"][on] > 0, 1, -1)
    tried = np.arange(-4000, 4001, 20)
    power = [abs(np.sum(polarity * np.exp(1j * (turn - speed * seconds)))) for speed in tried]
    return float(tried[int(np.argmax(power))]), disk.speed_deg_s


def sharpness(window: Window, sign: float) -> float:
    """Variance of the image of events (ON 1, OFF -1) that are carried back to the window's begin along sign times the
    flow, over that of the events as they are. Events of pixels without a known flow do not count."""
    events = window.events[window.known[window.events["y"], window.events["x"]]]
    late = sign * (events["t"] - window.begin_us) / (window.end_us - window.begin_us)
    x, y, polarity = events["x"].astype(float), events["y"].astype(float), np.where(events["p"] > 0, 1.0, -1.0)
    dx, dy = window.flow[:, events["y"], events["x"]]
    carried = _variance(x - late * dx, y - late * dy, polarity, window.shape)
    return carried / _variance(x, y, polarity, window.shape)


def _variance(x: np.ndarray, y: np.ndarray, polarity: np.ndarray, shape: tuple[int, int]) -> float:
    """Contrast of the image to which each event adds its polarity, shared by the four pixels about it; with a Gaussian
    of 1 px, so that whole positions have no advantage."""
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    image = np.zeros(shape)
    for dx in (0, 1):
        for dy in (0, 1):
            weight = np.abs(1 - dx - (x - x0)) * np.abs(1 - dy - (y - y0)) * polarity
            inside = (x0 + dx >= 0) & (x0 + dx < shape[1]) & (y0 + dy >= 0) & (y0 + dy < shape[0])
            np.add.at(image, ((y0 + dy)[inside], (x0 + dx)[inside]), weight[inside])
    return float(cv2.GaussianBlur(image, (0, 0), 1.0).var())


@dataclass(frozen=True)
class FlowConfig:
    channels: int = 16
    intervals: tuple[int, ...] = (1, 2, 3, 4)  # lengths of windows, of which one is drawn for each
    crop: int = 96
    mosaic: float = 0.5  # share of pictures that are four squares of other windows
    batch: int = 4
    steps: int = 1500
    learning_rate: float = 1e-3
    decay_steps: int = 500  # last steps, over which the learning rate falls to 0
    seed: int = 1

    def rate(self, step: int) -> float:
        return self.learning_rate * min(1.0, (self.steps - step) / (self.decay_steps + 1))


def _conv(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    layer = nn.Conv2d(inputs, outputs, 3, stride, 1)
    nn.init.kaiming_normal_(layer.weight, 0.1)
    nn.init.zeros_(layer.bias)
    return nn.Sequential(layer, nn.LeakyReLU(0.1))


class FlowNet(nn.Module):
    """A U-Net of three levels with two residual layers, after EV-FlowNet (Zhu et al., RSS 2018); its output has half
    the resolution and is interpolated."""

    def __init__(self, channels: int = 16):
        super().__init__()
        one, two, four = channels, 2 * channels, 4 * channels
        self.down = nn.ModuleList([_conv(BINS, one, 2), _conv(one, two, 2), _conv(two, four, 2)])
        self.middle = nn.ModuleList([_conv(four, four), _conv(four, four)])
        self.up = nn.ModuleList([_conv(four + two, two), _conv(two + one, one)])
        self.out = nn.Conv2d(one, 2, 3, 1, 1)
        nn.init.normal_(self.out.weight, std=0.01)
        nn.init.zeros_(self.out.bias)

    def forward(self, grid: Tensor) -> Tensor:
        """[n, BINS, H, W], both sizes multiples of FACTOR -> [n, 2, H, W], x and y in px."""
        half = self.down[0](grid)
        quarter = self.down[1](half)
        x = self.down[2](quarter)
        for layer in self.middle:
            x = x + layer(x)
        for layer, skip in zip(self.up, (quarter, half), strict=True):
            x = layer(torch.cat([_doubled(x), skip], 1))
        return SCALE_PX * _doubled(self.out(x))


def _doubled(x: Tensor) -> Tensor:
    return functional.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False)


def turned(grid: np.ndarray, flow: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """One of the 8 symmetries of the square, and one of both polarities."""
    for axis in (-1, -2):
        if rng.random() < 0.5:
            sign = np.array([-1, 1] if axis == -1 else [1, -1], np.float32)[:, None, None]
            grid, flow = np.flip(grid, axis), np.flip(flow, axis) * sign
    if rng.random() < 0.5:
        grid, flow = grid.swapaxes(-1, -2), flow[::-1].swapaxes(-1, -2)
    return (grid if rng.random() < 0.5 else -grid), flow


def piece(views: list[View], config: FlowConfig, side: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """grid, flow: a square of a window."""
    view = views[rng.integers(len(views))]
    length = int(rng.choice(config.intervals))
    i = int(rng.integers(view.intervals - length + 1))
    y, x = (int(rng.integers(n - side + 1)) for n in view.shape)
    box = np.s_[:, y : y + side, x : x + side]
    return turned(view.grid(i, length)[box], view.flow(i, length)[box], rng)


def batch_of(views: list[View], config: FlowConfig, step: int) -> tuple[Tensor, Tensor]:
    """grid, flow; keyed by the seed and the step, so that all simulators' networks see the same windows. A share of
    them are four squares of other windows, since the flow of a whole picture is mostly that of the camera."""
    rng = np.random.Generator(np.random.Philox(key=[config.seed, step]))
    grids, flows = [], []
    for _ in range(config.batch):
        if rng.random() < config.mosaic:
            four = [piece(views, config, config.crop // 2, rng) for _ in range(4)]
            grid, flow = (
                np.concatenate([np.concatenate([four[k][part], four[k + 1][part]], -1) for k in (0, 2)], -2)
                for part in (0, 1)
            )
        else:
            grid, flow = piece(views, config, config.crop, rng)
        grids.append(np.ascontiguousarray(grid))
        flows.append(np.ascontiguousarray(flow))
    return torch.from_numpy(np.stack(grids)), torch.from_numpy(np.stack(flows))


def end_point_error(found: Tensor, flow: Tensor) -> Tensor:
    """Mean over the pixels whose flow is known, px."""
    known = torch.isfinite(flow).all(1)
    apart = (found - torch.nan_to_num(flow)).square().sum(1)
    return torch.sqrt(apart + 1e-6)[known].mean()


def trained(run: Path, given: Callable[[], list[View]], config: FlowConfig) -> None:
    """Trains in the folder `run`, unless it was: network.pt."""
    if (run / "network.pt").exists():
        return
    views = given()
    run.mkdir(parents=True, exist_ok=True)
    write_json(run / "config.json", asdict(config))
    torch.manual_seed(config.seed)
    net, log = FlowNet(config.channels), []
    optimiser = torch.optim.Adam(net.parameters(), config.learning_rate)
    for step in range(config.steps):
        optimiser.param_groups[0]["lr"] = config.rate(step)
        grid, flow = batch_of(views, config, step)
        loss = end_point_error(net(grid), flow)
        if not torch.isfinite(loss):
            raise FloatingPointError(f"{run}: step {step}: loss: got {float(loss)}")
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(net.parameters(), 1.0)
        optimiser.step()
        log.append(float(loss.detach()))
        if (step + 1) % 100 == 0:
            print(f"{run.name}: {step + 1}/{config.steps}, loss {np.mean(log[-100:]):.3f} px", file=sys.stderr)
    torch.save(net.state_dict(), run / "network.pt")


class Method:
    """Flow of a window by a trained network."""

    def __init__(self, run: Path):
        self.net = FlowNet(json.loads((run / "config.json").read_text())["channels"])
        self.net.load_state_dict(torch.load(run / "network.pt"))
        self.net.eval()

    def __call__(self, window: Window) -> np.ndarray:
        """[2, H, W] px."""
        height, width = window.shape
        size = -(-height // FACTOR) * FACTOR, -(-width // FACTOR) * FACTOR
        grid = torch.from_numpy(grid_of(window.events, size, window.begin_us, window.end_us))[None]
        with torch.no_grad():
            return self.net(grid)[0, :, :height, :width].numpy()
