"""Files of `torch.save`. They are pickles, which may run code when they are loaded."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import torch

from .._errors import bad_input


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
