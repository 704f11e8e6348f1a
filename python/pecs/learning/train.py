"""Training in a folder. A stopped training continues; the same seed and number of threads give the same network."""

from __future__ import annotations

import csv
import io
import json
import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from .._config import Fields, read_json
from .._errors import PecsError, PecsInputError, PecsOutputError, UsageError, bad_input, existing
from .._files import lock_file, read_text, sha256, write_json, write_text, write_whole
from .._library import version
from .._platform import cpu_has_bfloat16
from .clips import Clips, Source
from .limits import TrainConfig
from .losses import correlation, l1, ssim, stretched_mse
from .lpips import Lpips
from .networks import RecurrentUNet, start_states
from .tensors import load_network, load_tensors

CONFIG, CHECKPOINT, LOG = "config.json", "checkpoint.pt", "log.csv"
BLIND = 1  # windows at the begin of a clip
MOST_LOG = 1 << 30  # bytes


@dataclass(frozen=True)
class Losses:
    """parts: l1, ssim, correlation, stretched_mse, and lpips if it is used."""

    loss: Tensor
    parts: dict[str, float]


def losses_of(pictures: Tensor, truth: Tensor, config: TrainConfig, lpips: Lpips | None = None) -> Losses:
    """The losses of pictures [N, 1, H, W]."""
    parts = {"l1": l1(pictures, truth), "ssim": ssim(pictures, truth)}
    parts |= {"correlation": correlation(pictures, truth), "stretched_mse": stretched_mse(pictures, truth)}
    if lpips:
        parts["lpips"] = lpips(pictures, truth).mean()
    alike = config.ssim_weight * (1 - parts["ssim"]) + config.correlation_weight * (1 - parts["correlation"])
    alike = alike + config.stretched_weight * parts["stretched_mse"]
    loss = parts["lpips"] if lpips else parts["l1"] + alike
    return Losses(loss, {name: float(value.detach()) for name, value in parts.items()})


def learn(net: Any, optimiser: Any, item: dict[str, Tensor], config: TrainConfig, lpips: Lpips | None = None) -> Losses:
    """One step: the windows of the clips in chunks, whose gradients change the network, and which hand the state on.
    The first windows of a clip, before anything is known, do not count. Returns the losses of the last chunk.
    Raises FloatingPointError, before the network changes, if the loss or its gradient is not finite."""
    planes, truth = item["planes"], item["picture"]
    states = start_states(net, len(planes), *planes.shape[-2:])
    losses, chunk = None, config.clips.chunk
    half = planes.device.type == "cpu" and cpu_has_bfloat16()  # a step takes less time; other CPUs emulate it slowly
    for first in range(0, planes.shape[1], chunk):
        pictures = []
        with torch.autocast(planes.device.type, torch.bfloat16, enabled=half):
            for k in range(first, min(first + chunk, planes.shape[1])):
                picture, states = net(planes[:, k], states)
                pictures.append(picture)
        skip = 0 if first else min(BLIND, len(pictures) - 1)
        wanted = truth[:, first + skip : first + len(pictures)].transpose(0, 1)
        losses = losses_of(torch.cat(pictures[skip:]), wanted.flatten(0, 1), config, lpips)
        if not math.isfinite(float(losses.loss)):
            raise FloatingPointError(f"loss: got {float(losses.loss)}")
        optimiser.zero_grad()
        losses.loss.backward()
        norm = float(torch.nn.utils.clip_grad_norm_(net.parameters(), 1.0))
        if not math.isfinite(norm):
            raise FloatingPointError(f"gradient of the loss: got {norm}")
        optimiser.step()
        states = [state.detach() for state in states]
    assert losses
    return losses


def train(
    sources: Sequence[Source] | Callable[[], Sequence[Source]],
    run: Path,
    config: TrainConfig,
    *,
    weights: Path | None = None,
    lpips_weights: Path | None = None,
    workers: int = 0,
    device: str = "cpu",
    progress: Callable[[int, float], None] | None = None,
) -> Any:
    """Trains in folder `run` (config.json, checkpoint.pt, log.csv; TensorBoard's events where it is installed); returns
    the network. A run that is there continues; one of another config is refused. weights: a network (.onnx), with whose
    weights the training starts. lpips_weights: as `Lpips` reads them; with them the loss is LPIPS. device: of PyTorch.
    progress: step, loss. sources: or a function that makes them, which is called when all else is known to work."""
    _check_device(device)
    lpips = Lpips(lpips_weights, device) if lpips_weights else None
    if lpips and config.clips.crop < lpips.least_px:
        wanted = f"{lpips.least_px} or more, for LPIPS by {lpips.kind}"
        raise UsageError(f"clips: got {config.clips.crop} px, wanted {wanted}")
    torch.manual_seed(config.seed)
    net = RecurrentUNet(config.network)
    if weights:
        load_network(net, weights)
        config = replace(config, weights_sha256=sha256(weights))
    config = replace(config, lpips_sha256=lpips.sha256 if lpips else None)
    net = net.to(device, memory_format=torch.channels_last)
    with _claimed(run, config):
        return _train(net, sources() if callable(sources) else sources, run, config, lpips, workers, progress)


def _train(
    net: Any,
    sources: Sequence[Source],
    run: Path,
    config: TrainConfig,
    lpips: Lpips | None,
    workers: int,
    progress: Callable[[int, float], None] | None,
) -> Any:
    device = next(net.parameters()).device
    optimiser = torch.optim.Adam(net.parameters(), config.learning_rate)
    step = _resume(run, net, optimiser, str(device))
    # Items depend on their number alone, so that a continued run uses the same ones as an uninterrupted run.
    clips = Clips(sources, config.clips, config.network.bins, config.seed, config.steps * config.batch)
    left = torch.utils.data.Subset(clips, range(step * config.batch, len(clips)))
    loader = torch.utils.data.DataLoader(left, config.batch, num_workers=workers, pin_memory=device.type != "cpu")
    log, saved = _Log(run, step), step
    for item in loader:
        optimiser.param_groups[0]["lr"] = config.rate(step)
        item = {name: value.to(device) for name, value in item.items()}
        try:
            losses = learn(net, optimiser, item, config, lpips)
            step += 1
            log.add(step, losses)
            if step % config.save_every == 0 or step == config.steps:
                _check_weights(net)
                log.flush()
                _save(run, net, optimiser, step)
                saved = step
        except FloatingPointError as e:
            kept = f"; {run / CHECKPOINT} is of step {saved}" if saved else ""
            raise PecsError(f"{run}: step {step}: {e}, wanted a number{kept}") from None
        if progress:
            progress(step, float(losses.loss))
    return net


def _check_weights(net: Any) -> None:
    for name, values in net.named_parameters():
        bad = values[~torch.isfinite(values)]
        if len(bad):
            raise FloatingPointError(f"weight {name}: got {float(bad[0])}")


def _check_device(name: str) -> None:
    try:
        torch.empty(1, device=name)
    except Exception as e:  # PyTorch raises many types
        why = str(e).splitlines()[0]
        raise UsageError(f"--device: got {name!r}, wanted cpu, or cuda where PyTorch has a GPU: {why}") from None


@contextmanager
def _claimed(run: Path, config: TrainConfig) -> Iterator[None]:
    """The folder, for this process alone; config.json is written. Raises PecsOutputError for a run of another one."""
    try:
        run.mkdir(parents=True, exist_ok=True)
    except OSError as e:
        raise PecsOutputError(f"{run}: cannot be written: {e.strerror}") from None
    with lock_file(run / ".lock", run, PecsOutputError(f"{run}: another process is training in it")):
        _claim(run, config)
        yield


def _claim(run: Path, config: TrainConfig) -> None:
    wanted = json.loads(json.dumps(asdict(config)))
    TrainConfig.read(Fields(wanted, "train"))
    now = {"pecs": version(), "torch": torch.__version__}
    if (run / CONFIG).exists():
        top = _config(run)
        there = asdict(TrainConfig.read(top.table("config")))
        for key in wanted:
            if there[key] != wanted[key]:
                got = f"{key}: got {there[key]!r}, wanted {wanted[key]!r}"
                raise PecsOutputError(f"{run / CONFIG}: {got}, or another folder")
        if (began := top.content.get("versions")) != now:
            warnings.warn(
                f"{run}: versions: began with {began}, continues with {now}: no repeatable training", stacklevel=2
            )
        return
    write_json(run / CONFIG, {"config": wanted, "versions": now})


def _config(run: Path) -> Fields:
    """config.json of a run."""
    path = run / CONFIG
    return Fields(read_json(existing(path, "a folder of training")), path)


def _resume(run: Path, net: Any, optimiser: Any, device: str) -> int:
    if not (run / CHECKPOINT).exists():
        return 0
    found = _load(run / CHECKPOINT, device, net)
    try:
        optimiser.load_state_dict(optimiser.state_dict() | {"state": found["optimiser"]})
        for weights, state in optimiser.state.items():
            if float(state["step"]) < 0 or {state[k].shape for k in ("exp_avg", "exp_avg_sq")} != {weights.shape}:
                raise ValueError("averages of other weights")
    except Exception as e:  # of many kinds
        raise bad_input(run / CHECKPOINT, "optimiser", _why(e), "that of this network") from None
    step: int = found["step"]
    return step


def _load(path: Path, device: str, net: Any) -> dict[str, Any]:
    """Contents of a checkpoint; loads its weights into the network."""
    found = load_tensors(existing(path, "a checkpoint of training"), "a checkpoint of training", device)
    try:
        net.load_state_dict(found["network"])
        if type(step := found["step"]) is not int or step < 0 or not isinstance(found["optimiser"], dict):
            raise ValueError(f"step {step!r}")
    except Exception as e:  # of many kinds
        wanted = f"a checkpoint of the network that {CONFIG} says"
        raise PecsInputError(f"{path}: {_why(e)}, wanted {wanted}") from None
    return found


def _why(error: Exception) -> str:
    why = " ".join(str(error).split()) or type(error).__name__
    return why if len(why) < 160 else why[:157] + "..."


def _save(run: Path, net: Any, optimiser: Any, step: int) -> None:
    content = io.BytesIO()
    # Tensors and whole numbers: PyTorch 1.13 loads no other numbers without running code.
    torch.save({"network": net.state_dict(), "optimiser": optimiser.state_dict()["state"], "step": step}, content)
    write_whole(run / CHECKPOINT, content.getvalue())


def trained(run: Path) -> tuple[Any, dict[str, Any]]:
    """The trained network of a folder, and its record."""
    top = _config(run)
    net = RecurrentUNet(TrainConfig.read(top.table("config")).network)
    found = _load(run / CHECKPOINT, "cpu", net)
    return net.eval(), top.content | {"step": found["step"]}


class _Log:
    """log.csv, cut after the checkpoint's step; also TensorBoard's log if it is installed."""

    def __init__(self, run: Path, step: int):
        self._path, self._rows = run / LOG, []
        self._columns: tuple[str, ...] = ()
        if step and self._path.exists():
            rows = list(csv.reader(read_text(self._path, MOST_LOG).splitlines()))
            if any(not row or not row[0].isdecimal() or len(row) != len(rows[0]) for row in rows[1:]):
                raise bad_input(self._path, "", "a row without its step and losses", "the log of this run")
            self._rows = [row for row in rows[1:] if int(row[0]) <= step]
        try:
            from torch.utils.tensorboard import SummaryWriter
        except ImportError:
            self._board = None
        else:
            self._board = SummaryWriter(str(run / "tensorboard"), purge_step=step + 1)

    def add(self, step: int, losses: Losses) -> None:
        values = {"loss": float(losses.loss)} | losses.parts
        self._columns = ("step", *values)
        self._rows.append([str(step), *(f"{v:.6g}" for v in values.values())])
        if self._board:
            for name, value in values.items():
                self._board.add_scalar(name, value, step)

    def flush(self) -> None:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([self._columns, *self._rows])
        write_text(self._path, text.getvalue())
