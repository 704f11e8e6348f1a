"""A trained network as ONNX, with its record inside."""

from __future__ import annotations

import inspect
import io
import json
import warnings
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch

from .._errors import optional_module
from .._files import write_whole
from .networks import start_states
from .reconstruct import NETWORK_FORMAT, STATE
from .train import trained

TRIED_PX = 32  # side of the picture that the network is traced with; it then accepts all multiples of 2**levels
OPSET = 16
MOST_KEPT = 64  # values of a tensor that is stored in single precision


class _Flat(torch.nn.Module):
    """The network with one input and output per state, as ONNX requires."""

    def __init__(self, net: Any):
        super().__init__()
        self.net = net

    def forward(self, planes: torch.Tensor, *states: torch.Tensor) -> tuple[torch.Tensor, ...]:
        picture, after = self.net(planes, list(states))
        return (picture, *after)


def _halve(onnx: Any, graph: Any) -> None:
    """Stores weights in half precision; the network still computes in single precision."""
    casts = []
    for tensor in graph.initializer:
        values = onnx.numpy_helper.to_array(tensor)
        if tensor.data_type == onnx.TensorProto.FLOAT and values.size > MOST_KEPT:
            name = tensor.name
            tensor.CopyFrom(onnx.numpy_helper.from_array(values.astype(np.float16), f"{name}_half"))
            casts.append(onnx.helper.make_node("Cast", [f"{name}_half"], [name], to=onnx.TensorProto.FLOAT))
    nodes = [*casts, *graph.node]
    del graph.node[:]
    graph.node.extend(nodes)


def export(run: Path, output: Path) -> dict[str, Any]:
    """Writes the network of a training's folder; returns its record."""
    onnx = optional_module("onnx", "onnx", "export", "learning")
    net, record = trained(run)
    planes = torch.zeros(1, net.config.bins + 1, TRIED_PX, TRIED_PX)
    states = start_states(net, 1, TRIED_PX, TRIED_PX)
    names = [f"{STATE}_{i}_{level}" for i, level in enumerate(net.state_levels)]
    after = [f"next_{name}" for name in names]
    free = {name: {2: f"height_{i}", 3: f"width_{i}"} for i, name in enumerate(["planes", *names])}
    options: dict[str, Any] = {"input_names": ["planes", *names], "output_names": ["picture", *after]}
    options |= {"dynamic_axes": free, "opset_version": OPSET}
    if "dynamo" in inspect.signature(torch.onnx.export).parameters:
        options["dynamo"] = False  # the other exporter requires further packages
    record = {"network": asdict(net.config), **record}
    traced = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # PyTorch warns of shapes that are constant here
        torch.onnx.export(_Flat(net), (planes, *states), traced, **options)
    model = onnx.load_from_string(traced.getvalue())
    _halve(onnx, model.graph)
    onnx.helper.set_model_props(model, {"pecs_network": NETWORK_FORMAT, "record": json.dumps(record)})
    write_whole(output, model.SerializeToString())
    return record
