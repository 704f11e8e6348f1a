# SPDX-License-Identifier: GPL-3.0-or-later
"""What the renderer asks of a chip profile."""

from __future__ import annotations

import json
from pathlib import Path


def chip_threshold(name_or_path: str) -> float:
    """The smaller contrast threshold, natural log."""
    import pecs

    path = Path(name_or_path)
    if path.suffix != ".json":
        path = pecs.data_dir("sensor/chips") / f"{name_or_path}.json"
    chip = json.loads(path.read_text())["values"]
    return min(chip["contrast_threshold_on"]["value"], chip["contrast_threshold_off"]["value"])
