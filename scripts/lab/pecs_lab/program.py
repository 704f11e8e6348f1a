"""The pecs program, for what Python cannot ask the library for."""

import json
import os
import subprocess
from pathlib import Path
from typing import Any


def program() -> Path:
    """PECS_PROGRAM, or the checkout's own build."""
    return Path(os.environ.get("PECS_PROGRAM", Path(__file__).resolve().parents[3] / "build/release/bin/pecs"))


def ask(*arguments: object) -> Any:
    """What `pecs ARGUMENTS --json` prints."""
    command = [program(), *map(str, arguments), "--json"]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
