"""Fixtures. `shared` is the folder of recordings and prescriptions beside a developer's checkout; tests that need it
skip on a machine without it."""

import importlib.util
import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def root() -> Path:
    return ROOT


def load_script(path: Path):
    """A script of bench/, studies/ or tools/ as a module."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


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

    def run(*args, **kwargs):
        return subprocess.run([program, *map(str, args)], capture_output=True, text=True, **kwargs)

    return run


def run_module(module, *args, check=True):
    """Runs `python -m MODULE`; its text output."""
    command = [sys.executable, "-m", module, *map(str, args)]
    result = subprocess.run(command, capture_output=True, text=True)
    assert not check or result.returncode == 0, result.stderr
    return result


BODY = """
import os, sys, traceback
sys.path.insert(0, sys.argv.pop(1))
try:
    exec(compile(sys.argv.pop(1), "body", "exec"), {"__name__": "__main__"})
    print("all well")
except BaseException:
    traceback.print_exc()
sys.stdout.flush()
sys.stderr.flush()
os._exit(0)  # bpy's own exit may hang
"""


def in_bpy(body, *arguments, check=True, **options):
    """Runs Python code that may import bpy and the modules beside this file, in a process of its own; `arguments` are
    its sys.argv[1:]. Asserts that it comes to its end. Its text output."""
    command = [sys.executable, "-c", BODY, str(ROOT / "tests/python"), body, *map(str, arguments)]
    result = subprocess.run(command, capture_output=True, text=True, **options)
    assert not check or result.stdout.endswith("all well\n"), (result.stdout[-500:] + result.stderr)[-3000:]
    return result


pecs_blender = partial(run_module, "pecs_blender")


@pytest.fixture(scope="session")
def python():
    return sys.executable


@pytest.fixture(scope="session")
def wheel(root, tmp_path_factory):
    """The Python package as users install it; with the program where scripts/wheel_libraries.sh has run."""
    out = tmp_path_factory.mktemp("wheel")
    subprocess.run([sys.executable, root / "scripts/make_wheels.py", "--plain", "-o", out], check=True)
    (path,) = out.glob("*.whl")
    return path
