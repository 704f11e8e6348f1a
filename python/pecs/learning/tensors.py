"""Weights from files. Those of `torch.save` are pickles, which may run code when they are loaded."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import torch

from .._errors import bad_input, optional_module
from .reconstruct import network_bytes


def load_tensors(path: Path, wanted: str, device: str = "cpu") -> dict[str, Any]:
    """A dict of tensors and plain values. Raises PecsInputError for everything else, before any of it runs: PyTorch
    before 2.6 runs the code of files that are not archives, also with weights_only (CVE-2025-32434)."""
    try:
        if not zipfile.is_zipfile(path):
            raise ValueError("not an archive of torch.save")
        found = torch.load(path, map_location=device, weights_only=True)
    except Exception as e:  # PyTorch raises many types
        why = " ".join(str(e).split()) or type(e).__name__
        raise bad_input(path, "file", why, wanted) from None
    if not isinstance(found, dict):
        raise bad_input(path, "file", type(found).__name__, wanted)
    return found


def load_network(net: torch.nn.Module, path: Path) -> None:
    """Loads the weights of a network that `pecs train` wrote (.onnx)."""
    onnx, content = optional_module("onnx", "onnx", "--weights", "learning"), network_bytes(path)
    try:
        tensors = onnx.load_from_string(content).graph.initializer
        found = {t.name.removeprefix("net.").removesuffix("_half"): onnx.numpy_helper.to_array(t) for t in tensors}
        net.load_state_dict({name: torch.from_numpy(value.astype(np.float32)) for name, value in found.items()})
    except Exception as e:  # of many kinds
        why = " ".join(str(e).split()) or type(e).__name__
        raise bad_input(path, "network", why[:160], "one of the same channels, of `pecs train`") from None
    if not all(torch.isfinite(value).all() for value in net.parameters()):
        raise bad_input(path, "network", "weights that are not finite", "finite numbers")
