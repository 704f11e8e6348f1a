"""Training: runs in a folder, continues what was stopped, and gives the same network for the same seed and threads."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from .._library import PecsError, PecsInputError, PecsOutputError, version
from ..datasets.files import write_json, write_text, write_whole
from .clips import Augmentation, ClipConfig, Clips, Recording
from .losses import ms_ssim, temporal
from .networks import NetworkConfig, network, start_states

CONFIG, CHECKPOINT, LOG = "config.json", "checkpoint.pt", "log.csv"
COLUMNS = ("step", "loss", "l1", "ms_ssim", "temporal")


@dataclass(frozen=True)
class TrainConfig:
    network: NetworkConfig = field(default_factory=NetworkConfig)
    clips: ClipConfig = field(default_factory=ClipConfig)
    steps: int = 500
    batch: int = 4
    learning_rate: float = 1e-3
    decay_steps: int = 0  # the last ones, in which the learning rate falls to 0
    ssim_weight: float = 1.0  # of 1 - MS-SSIM, beside L1
    temporal_weight: float = 1.0
    save_every: int = 50
    seed: int = 1

    def rate(self, step: int) -> float:
        """The learning rate of a step, counted from 0."""
        return self.learning_rate * min(1.0, (self.steps - step) / (self.decay_steps + 1))

    @staticmethod
    def of(values: dict[str, Any]) -> TrainConfig:
        """Of a config.json."""
        values = dict(values)
        clips = dict(values.pop("clips"))
        how = clips.pop("augmentation")
        clips["augmentation"] = Augmentation(**how) if how else None
        return TrainConfig(network=NetworkConfig(**values.pop("network")), clips=ClipConfig(**clips), **values)


@dataclass(frozen=True)
class Losses:
    loss: Tensor
    l1: float
    ms_ssim: float
    temporal: float


def clip_losses(net: Any, item: dict[str, Tensor], config: TrainConfig) -> Losses:
    """Mean over a clip's windows, the network starting from nothing."""
    grid, truth = item["grid"], item["picture"]
    states = start_states(net, len(grid), *grid.shape[-2:])
    l1, similar, moved = [], [], []
    before, truth_before = None, item["before"]
    for k in range(grid.shape[1]):
        picture, states = net(grid[:, k], states)
        l1.append((picture - truth[:, k]).abs().mean())
        similar.append(ms_ssim(picture, truth[:, k]))
        if before is not None and config.temporal_weight:
            moved.append(temporal(picture, before, truth[:, k], truth_before, item["flow_back"][:, k]))
        before, truth_before = picture, truth[:, k]
    parts = [torch.stack(values).mean() if values else grid.new_zeros(()) for values in (l1, similar, moved)]
    loss = parts[0] + config.ssim_weight * (1 - parts[1]) + config.temporal_weight * parts[2]
    return Losses(loss, *(float(p.detach()) for p in parts))


def learn(net: Any, optimiser: Any, item: dict[str, Tensor], config: TrainConfig) -> Losses:
    """One step, if its loss is a number."""
    losses = clip_losses(net, item, config)
    if math.isfinite(float(losses.loss)):
        optimiser.zero_grad()
        losses.loss.backward()
        torch.nn.utils.clip_grad_norm_(net.parameters(), 1.0)
        optimiser.step()
    return losses


def train(
    sources: list[Recording],
    run: Path,
    config: TrainConfig,
    *,
    workers: int = 0,
    device: str = "cpu",
    progress: Callable[[int, float], None] | None = None,
) -> Any:
    """Trains in folder `run` (config.json, checkpoint.pt, log.csv; TensorBoard's events where it is installed); returns
    the network. A run that is there continues; one of another config is refused. progress: step, loss."""
    _claim(run, config)
    torch.manual_seed(config.seed)
    net = network(config.network).to(device)
    optimiser = torch.optim.Adam(net.parameters(), config.learning_rate)
    step = _resume(run, net, optimiser, device)
    # Items are keyed by their number, so that what is left is what an unbroken run would see.
    clips = Clips(sources, config.clips, config.seed, config.steps * config.batch)
    left = torch.utils.data.Subset(clips, range(step * config.batch, len(clips)))
    loader = torch.utils.data.DataLoader(left, config.batch, num_workers=workers, pin_memory=device != "cpu")
    log = _Log(run, step)
    for item in loader:
        optimiser.param_groups[0]["lr"] = config.rate(step)
        losses = learn(net, optimiser, {name: value.to(device) for name, value in item.items()}, config)
        if not math.isfinite(float(losses.loss)):
            kept = f"; {run / CHECKPOINT} is of step {step - step % config.save_every}" if step else ""
            raise PecsError(f"{run}: step {step}: loss: got {float(losses.loss)}, wanted a number{kept}", 1)
        step += 1
        log.add(step, losses)
        if step % config.save_every == 0 or step == config.steps:
            log.flush()
            _save(run, net, optimiser, step)
        if progress:
            progress(step, float(losses.loss))
    return net


def _claim(run: Path, config: TrainConfig) -> None:
    wanted = json.loads(json.dumps(asdict(config)))
    if (run / CONFIG).exists():
        there = asdict(TrainConfig.of(json.loads((run / CONFIG).read_text())["config"]))
        for key in wanted:
            if there[key] != wanted[key]:
                got = f"{key}: got {there[key]!r}, wanted {wanted[key]!r}"
                raise PecsOutputError(f"{run / CONFIG}: {got}, or another folder", 5)
        return
    write_json(run / CONFIG, {"config": wanted, "versions": {"pecs": version(), "torch": torch.__version__}})


def _resume(run: Path, net: Any, optimiser: Any, device: str) -> int:
    if not (run / CHECKPOINT).exists():
        return 0
    found = _load(run / CHECKPOINT, device)
    net.load_state_dict(found["network"])
    optimiser.load_state_dict(found["optimiser"])
    step: int = found["step"]
    return step


def _load(path: Path, device: str) -> dict[str, Any]:
    try:
        found: dict[str, Any] = torch.load(path, map_location=device)
        return found
    except FileNotFoundError:
        raise PecsInputError(f"{path}: no such file, wanted a checkpoint of training", 3) from None
    except Exception as e:  # of many kinds
        raise PecsInputError(f"{path}: {str(e).splitlines()[0]}, wanted a checkpoint of training", 4) from None


def _save(run: Path, net: Any, optimiser: Any, step: int) -> None:
    content = io.BytesIO()
    torch.save({"network": net.state_dict(), "optimiser": optimiser.state_dict(), "step": step}, content)
    write_whole(run / CHECKPOINT, content.getvalue())


def trained(run: Path) -> tuple[Any, dict[str, Any]]:
    """The network of a run, and its record."""
    try:
        record = json.loads((run / CONFIG).read_text())
    except OSError:
        raise PecsInputError(f"{run / CONFIG}: no such file, wanted a folder of training", 3) from None
    config = TrainConfig.of(record["config"])
    net, found = network(config.network), _load(run / CHECKPOINT, "cpu")
    net.load_state_dict(found["network"])
    return net.eval(), record | {"step": found["step"]}


class _Log:
    """log.csv, cut to what the checkpoint knows; TensorBoard's where it is installed."""

    def __init__(self, run: Path, step: int):
        self._path, self._rows = run / LOG, []
        if step and self._path.exists():
            with self._path.open(newline="") as file:
                self._rows = [row for row in list(csv.reader(file))[1:] if int(row[0]) <= step]
        try:
            from torch.utils.tensorboard import SummaryWriter
        except ImportError:
            self._board = None
        else:
            self._board = SummaryWriter(str(run / "tensorboard"), purge_step=step + 1)

    def add(self, step: int, losses: Losses) -> None:
        values = (float(losses.loss), losses.l1, losses.ms_ssim, losses.temporal)
        self._rows.append([str(step), *(f"{v:.6g}" for v in values)])
        if self._board:
            for name, value in zip(COLUMNS[1:], values, strict=True):
                self._board.add_scalar(name, value, step)

    def flush(self) -> None:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([COLUMNS, *self._rows])
        write_text(self._path, text.getvalue())
