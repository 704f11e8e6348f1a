"""Fixtures. `shared` is the folder of recordings and prescriptions next to a developer's checkout; tests that need it
skip on a machine without it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from support import ROOT


@pytest.fixture(scope="session")
def root() -> Path:
    return ROOT


@pytest.fixture(scope="session")
def shared() -> Path:
    folder = Path(os.environ.get("PECS_SHARED", ROOT.parent / "shared"))
    if not folder.is_dir():
        pytest.skip(f"needs {folder}")
    return folder


@pytest.fixture(scope="session")
def pecs_program():
    """Runs the built program: pecs_program("info", path) -> CompletedProcess with text output."""
    candidates = [ROOT / "build" / preset / "bin" / "pecs" for preset in ("release", "dev")]
    program = next((c for c in candidates if c.is_file()), None)
    assert program, "build/release/bin/pecs is missing: scripts/setup.sh builds it"

    def run(*args, check=False, **kwargs):
        result = subprocess.run([program, *map(str, args)], capture_output=True, text=True, **kwargs)
        assert not check or result.returncode == 0, result.stderr
        return result

    return run


@pytest.fixture(scope="session")
def python():
    return sys.executable


@pytest.fixture(scope="session")
def sequence(tmp_path_factory):
    from pecs.datasets import Sequence
    from support import small_sequence

    return Sequence(small_sequence.write(tmp_path_factory.mktemp("set") / "sequences" / "0000"))
