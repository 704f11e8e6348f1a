"""A trained network as ONNX, with its record inside."""

from __future__ import annotations

import inspect
import io
import json
import warnings
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch

from .._errors import optional_module
from .._files import write_whole
from .networks import start_states
from .reconstruct import NETWORK_FORMAT, STATE
from .train import trained

TRIED_PX = 32  # side of the picture that the network is traced with; it then accepts all multiples of 2**levels
OPSET = 16


class _Flat(torch.nn.Module):
    """The network with one input and output per state, as ONNX requires."""

    def __init__(self, net: Any):
        super().__init__()
        self.net = net

    def forward(self, grid: torch.Tensor, *states: torch.Tensor) -> tuple[torch.Tensor, ...]:
        picture, after = self.net(grid, list(states))
        return (picture, *after)


def export(run: Path, output: Path) -> dict[str, Any]:
    """Writes the network of a training's folder; returns its record."""
    onnx = optional_module("onnx", "onnx", "export", "learning")
    net, record = trained(run)
    grid = torch.zeros(1, net.config.bins, TRIED_PX, TRIED_PX)
    states = start_states(net, 1, TRIED_PX, TRIED_PX)
    names = [f"{STATE}_{i}_{level}" for i, level in enumerate(net.state_levels)]
    after = [f"next_{name}" for name in names]
    free = {name: {2: f"height_{i}", 3: f"width_{i}"} for i, name in enumerate(["events", *names])}
    options: dict[str, Any] = {"input_names": ["events", *names], "output_names": ["picture", *after]}
    options |= {"dynamic_axes": free, "opset_version": OPSET}
    if "dynamo" in inspect.signature(torch.onnx.export).parameters:
        options["dynamo"] = False  # the other exporter requires further packages
    record = {"network": asdict(net.config), **record}
    traced = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # PyTorch warns of shapes that are constant here
        torch.onnx.export(_Flat(net), (grid, *states), traced, **options)
    model = onnx.load_from_string(traced.getvalue())
    onnx.helper.set_model_props(model, {"pecs_network": NETWORK_FORMAT, "record": json.dumps(record)})
    write_whole(output, model.SerializeToString())
    return record
