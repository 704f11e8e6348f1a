"""Networks of the studies: trained once, and the method that a file of weights means."""

import sys
from pathlib import Path

from pecs.learning.clips import Recording
from pecs.learning.export import export
from pecs.learning.reconstruct import Filter, Network
from pecs.learning.train import TrainConfig, train


def learnt(run: Path, sources: list[Recording], config: TrainConfig, device: str = "cpu") -> Path:
    """Trains in the folder `run`; its network.onnx."""

    def say(step: int, loss: float) -> None:
        if step % 50 == 0:
            print(f"{run.name}: {step}/{config.steps}, loss {loss:.4f}", file=sys.stderr, flush=True)

    train(sources, run, config, device=device, progress=say)
    export(run, run / "network.onnx")
    return run / "network.onnx"


def method_of(weights: Path | None, size: tuple[int, int]) -> Filter | Network:
    return Network(weights, *size, threads=1) if weights else Filter(*size, 1.0)
