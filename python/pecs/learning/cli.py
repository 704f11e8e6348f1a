"""The command line of `pecs.learning`."""

from __future__ import annotations

import argparse
import hashlib
import math
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from .._arguments import SEED, THREADS, Parser, Quantity, Whole
from .._command import answer
from .._errors import PecsNotFoundError, UsageError, optional_module
from .._files import check_outputs, sha256
from .._progress import Line, for_a_program
from ..chip import models
from ..events import EventReader
from .limits import WHOLE, ClipConfig, NetworkConfig, ProceduralConfig, TrainConfig
from .reconstruct import CUTOFF_HZ, METHODS

if TYPE_CHECKING:
    from .clips import SetSequence, Source

NETWORK = "network.onnx"
MOST_PX = 8192
RECONSTRUCT = (
    "pecs reconstruct recording.raw -o video.mp4                         # by the network that PECS includes",
    "pecs reconstruct recording.raw -o video.mp4 --method filter --cutoff 5Hz",
    "pecs reconstruct recording.raw -o slow.mp4 --playback-fps 25",
    "pecs reconstruct recording.raw -o video.mp4 --smooth                # uses the events after each picture",
    "pecs reconstruct recording.raw -o video.mp4 --corner 5Hz            # dim light, in which events come late",
    "pecs reconstruct recording.raw -o video.mp4 --weights out/run/network.onnx",
)
TRAIN = (
    "pecs train -o out/run                     # as the network that PECS includes: 40 minutes of two cores",
    "pecs train -o out/run --model esim        # with events of another pixel model",
    "pecs train out/set -o out/run             # on a data set; continues when run again",
)


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    side = Whole(1, MOST_PX)
    try:
        return side(width), side(height)
    except argparse.ArgumentTypeError:
        raise argparse.ArgumentTypeError(f"got {text!r}, wanted WxH, each from 1 to {MOST_PX}") from None


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 1e-12 <= value <= 1e3:
        raise argparse.ArgumentTypeError(f"got {text}, wanted a number from 1e-12 to 1000")
    return value


def _model(text: str) -> str:
    names = [model["name"] for model in models()]
    if text not in names:
        raise argparse.ArgumentTypeError(f"got {text!r}, wanted one of {', '.join(names)}")
    return text


def _parser() -> Parser:
    parser = Parser(prog="pecs", description="Video from events.", examples=[*RECONSTRUCT, *TRAIN])
    commands = parser.add_commands()
    rate = Quantity("Hz", above=0, below=1e9)
    whole = {key: Whole(*ends) for key, ends in WHOLE.items()}

    about = "video from an event file, by a filter or a network"
    one = commands.add_parser("reconstruct", help=about, description=about, examples=RECONSTRUCT)
    one.add_argument("events", type=Path, help="an event file of any format")
    one.add_argument("-o", "--output", type=Path, required=True, help=".mp4, or a folder for PNG")
    about = "network: a recurrent network; filter: a high-pass filter of each pixel"
    one.add_argument("--method", choices=METHODS, default=METHODS[0], help=about)
    one.add_argument(
        "--weights", type=Path, help="a network (.onnx) of `pecs train` (default: the one that PECS includes)"
    )
    one.add_argument("--fps", type=rate, default=100.0, help="pictures per second of the recording")
    one.add_argument("--playback-fps", type=rate, help="pictures per second of the video (default: as --fps)")
    one.add_argument("--cutoff", type=rate, help=f"cutoff frequency of the filter (default: {CUTOFF_HZ:g}Hz)")
    about = "corner frequency of the photoreceptors in the mean light, as of `pecs chip info` (default: not known)"
    one.add_argument("--corner", type=rate, help=about)
    about = "also use the events after each picture: 2.4 times the time; smears what moves fast over 40 ms"
    one.add_argument("--smooth", action="store_true", help=about)
    one.add_argument("--size", type=_size, metavar="WxH", help="in pixels, for a file that does not state it")
    one.add_argument("--threads", type=THREADS, default=0, help="0: all cores")
    one.set_defaults(run=_reconstruct)

    about = "a network that reconstructs video from events, trained on drawn sequences or on a data set (needs PyTorch)"
    one = commands.add_parser("train", help=about, description=about, examples=TRAIN)
    about = "a data set whose recipe has keep.light (default: sequences of drawn textures in motion)"
    one.add_argument("set", type=Path, nargs="?", help=about)
    one.add_argument("-o", "--output", type=Path, required=True, help="folder of the run; an existing run continues")
    one.add_argument("--split", help="split of the data set's sequences (default: train)")
    one.add_argument(
        "--sequences", type=Whole(1, 100_000), help=f"number of drawn sequences (default: {ProceduralConfig.count})"
    )
    one.add_argument("--model", type=_model, help=f"pixel model of drawn sequences (default: {ProceduralConfig.model})")
    one.add_argument(
        "--channels",
        type=whole["channels"],
        default=NetworkConfig.channels,
        help="channels of each level of the network",
    )
    one.add_argument("--steps", type=whole["steps"], default=TrainConfig.steps, help="steps of training")
    one.add_argument("--batch", type=whole["batch"], default=TrainConfig.batch, help="clips per step")
    one.add_argument("--windows", type=whole["windows"], default=ClipConfig.windows, help="windows of a clip")
    one.add_argument(
        "--crop", type=whole["crop"], default=ClipConfig.crop, help="width and height of a clip, in pixels"
    )
    one.add_argument("--learning-rate", type=_positive, default=TrainConfig.learning_rate, help="learning rate of Adam")
    about = "last steps, with a falling learning rate (default: half of the steps)"
    one.add_argument("--decay-steps", type=whole["decay_steps"], help=about)
    about = "a network (.onnx) of `pecs train`, whose weights are the first ones (default: random ones)"
    one.add_argument("--weights", type=Path, metavar="FILE", help=about)
    about = "weights of LPIPS (.pth): the loss is LPIPS instead of L1, SSIM and correlation"
    one.add_argument("--lpips-weights", type=Path, metavar="FILE", help=about)
    one.add_argument("--seed", type=SEED, default=TrainConfig.seed, help="seed of clips and first weights")
    one.add_argument("--workers", type=Whole(0, 256), default=0, help="processes that read clips; 0: this one")
    one.add_argument("--device", default="cpu", help="device of PyTorch: cpu, cuda")
    one.set_defaults(run=_train)
    return parser


def main(argv: list[str]) -> int:
    return answer(_parser(), lambda args: args.run(args), argv)


def _reconstruct(args: argparse.Namespace) -> None:
    from .reconstruct import reconstruct

    line = Line(100, task="reconstruct", quiet=args.quiet, verbose=args.verbose)
    total = _windows(args.events, args.fps) if for_a_program() else 0
    done = reconstruct(
        args.events,
        args.output,
        method=args.method,
        weights=args.weights,
        fps=args.fps,
        playback_fps=args.playback_fps,
        cutoff_hz=args.cutoff,
        corner_hz=args.corner,
        smooth=args.smooth,
        size=args.size,
        threads=args.threads,
        progress=lambda n: line(f"reconstruct: {n} pictures", n, total),
    )
    line.end()
    print(f"{args.output}: {done['pictures']} pictures of {done['width']} x {done['height']}, by {done['method']}")


def _windows(path: Path, fps: float) -> int:
    with EventReader(path) as reader:
        ends_us = [(int(block["t"][0]), int(block["t"][-1])) for block in reader]
    return int((ends_us[-1][1] - ends_us[0][0]) * fps * 1e-6) + 1 if ends_us else 0


def _train(args: argparse.Namespace) -> None:
    for name, package in (("torch", "PyTorch"), ("onnx", "onnx")):
        optional_module(name, package, "training", "learning")
    from .export import export
    from .train import train

    for name in ("sequences", "model") if args.set else ("split",):
        if getattr(args, name) is not None:
            raise UsageError(f"train: --{name} {'does not go with' if args.set else 'requires'} a data set")
    given = {"count": args.sequences, "model": args.model}
    drawn = ProceduralConfig(**{name: value for name, value in given.items() if value is not None})
    if not args.set and args.crop > drawn.size:
        raise UsageError(f"train: --crop: got {args.crop}, wanted at most {drawn.size}, the side of drawn sequences")
    config = TrainConfig(
        NetworkConfig(channels=args.channels),
        ClipConfig(args.windows, min(ClipConfig.chunk, args.windows), args.crop),
        args.steps,
        args.batch,
        args.learning_rate,
        args.steps // 2 if args.decay_steps is None else args.decay_steps,
        seed=args.seed,
        data=_set_of(args) if args.set else f"{drawn.count} drawn, {drawn.model}",
    )
    check_outputs([args.set] if args.set else [], [args.output])
    line = Line(50, task="train", quiet=args.quiet, verbose=args.verbose)
    net = train(
        partial(_rendered, args) if args.set else partial(_drawn, args.seed, drawn, line),
        args.output,
        config,
        weights=args.weights,
        lpips_weights=args.lpips_weights,
        workers=args.workers,
        device=args.device,
        progress=lambda step, loss: line(f"train: {step}/{args.steps}, loss {loss:.4f}", step, args.steps),
    )
    line.end()
    export(args.output, args.output / NETWORK)
    parameters = sum(p.numel() for p in net.parameters())
    print(f"{args.output / NETWORK}: {parameters} parameters, {args.steps} steps")


def _sequences(args: argparse.Namespace) -> Sequence[SetSequence]:
    from ..datasets.sequence import sequences

    split = args.split or "train"
    if not (found := sequences(args.set, split)):
        raise PecsNotFoundError(f"{args.set}: no sequences of split {split!r}")
    return found


def _set_of(args: argparse.Namespace) -> str:
    """A hash of the checksums of the sequences' files."""
    files = [(one.name, one.folder / "files.json") for one in _sequences(args)]
    text = "\n".join(f"{name} {sha256(file) if file.exists() else ''}" for name, file in files)
    return f"{len(files)} of a set, {hashlib.sha256(text.encode()).hexdigest()}"


def _rendered(args: argparse.Namespace) -> Sequence[Source]:
    from .clips import recordings

    return recordings(_sequences(args))


def _drawn(seed: int, config: ProceduralConfig, line: Line) -> Sequence[Source]:
    from .procedural import sequences

    return sequences(seed, config, lambda n: line(f"train: sequence {n} of {config.count}", n, config.count))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
