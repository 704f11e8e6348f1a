"""Helpers of the tests, importable as `support` (pyproject.toml puts tests/python on the path)."""

import importlib.util
import os
import subprocess
import sys
from functools import partial
from pathlib import Path

from pecs._arguments import latest

ROOT = Path(__file__).resolve().parents[3]
HERE = ROOT / "tests/python"


def load_script(path: Path):
    """Imports a script by its path."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = sys.modules[path.stem] = importlib.util.module_from_spec(spec)  # dataclasses look it up there
    spec.loader.exec_module(module)
    return module


def run_module(module, *args, check=True, **options):
    """Runs `python -m MODULE`; returns the process with its text output. Of a render's options set twice, the last."""
    args = latest(args) if module == "pecs_blender" else map(str, args)
    command = [sys.executable, "-m", module, *args]
    result = subprocess.run(command, capture_output=True, text=True, **options)
    assert not check or result.returncode == 0, result.stderr
    return result


pecs_blender = partial(run_module, "pecs_blender")


def growing_pecs_blender(*args):
    """Runs `pecs_blender` with a limit of memory growth that the first frame exceeds: the process restarts once.
    Returns the process with its text output."""
    body = "import sys\nfrom pecs_blender import cli\nfrom pecs_blender.job import resources\n"
    body += "resources.RESTART_GROWTH_MB = -1\nsys.exit(cli.main(sys.argv[1:]))"
    result = subprocess.run([sys.executable, "-c", body, *latest(args)], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    return result


def run_support(name, *args):
    """Runs support/NAME.py as a module of its own process."""
    path = [str(HERE), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
    return run_module(f"support.{name}", *args, env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, path))})


def make_blends(kind, folder, *names):
    """Writes all or the named .blend files of support/blend_KIND.py to `folder`, and returns it."""
    run_support(f"blend_{kind}", folder, *names)
    return folder


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


BODY = """
import os, sys, traceback
sys.path.insert(0, sys.argv.pop(1))
try:
    exec(compile(sys.argv.pop(1), "body", "exec"), {"__name__": "__main__"})
    print("body finished")
except BaseException:
    traceback.print_exc()
sys.stdout.flush()
sys.stderr.flush()
os._exit(0)  # bpy's own exit may hang
"""


def in_bpy(body, *arguments, check=True, **options):
    """Runs Python code that may import bpy and `support` in a process of its own; `arguments` are its sys.argv[1:].
    Asserts that the code finished. Returns the process with its text output."""
    command = [sys.executable, "-c", BODY, str(HERE), body, *map(str, arguments)]
    result = subprocess.run(command, capture_output=True, text=True, **options)
    assert not check or result.stdout.endswith("body finished\n"), (result.stdout[-500:] + result.stderr)[-3000:]
    return result
