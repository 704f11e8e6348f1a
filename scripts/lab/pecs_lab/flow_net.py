"""A small network for optical flow: voxel grid of a window of events -> displacement over the window. Needs PyTorch."""

import csv
import json
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as functional
from pecs._files import write_json
from torch import Tensor, nn

from .flow_windows import BINS, View, grid_of

SCALE_PX = 4.0  # displacement of an output of 1
FACTOR = 8  # sizes are padded to a multiple of it


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


def trained(run: Path, given: Callable[[], list[View]], config: FlowConfig) -> Path:
    """Trains in the folder `run`, unless it was; its network.pt."""
    path = run / "network.pt"
    if path.exists():
        return path
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
        log.append((step, float(loss.detach())))
        if (step + 1) % 100 == 0:
            mean = np.mean([value for _, value in log[-100:]])
            print(f"{run.name}: {step + 1}/{config.steps}, loss {mean:.3f} px", file=sys.stderr, flush=True)
    with (run / "log.csv").open("w", newline="") as file:
        csv.writer(file).writerows([("step", "loss_px"), *log])
    torch.save(net.state_dict(), path)
    return path


class Method:
    """Flow of a window by a trained network."""

    def __init__(self, weights: Path):
        config = json.loads((weights.parent / "config.json").read_text())
        self.net = FlowNet(config["channels"])
        self.net.load_state_dict(torch.load(weights))
        self.net.eval()

    def __call__(self, events: np.ndarray, shape: tuple[int, int], begin_us: float, end_us: float) -> np.ndarray:
        """[2, H, W] px."""
        height, width = (-(-n // FACTOR) * FACTOR for n in shape)
        grid = torch.from_numpy(grid_of(events, (height, width), begin_us, end_us))[None]
        with torch.no_grad():
            return self.net(grid)[0, :, : shape[0], : shape[1]].numpy()
