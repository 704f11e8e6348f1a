"""The pecs program, for what Python cannot ask the library for."""

import json
import subprocess
from typing import Any

from pecs import program


def ask(*arguments: object) -> Any:
    """What `pecs ARGUMENTS --json` prints."""
    command = [program(), *map(str, arguments), "--json"]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
