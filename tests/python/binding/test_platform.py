"""The halves of pecs/_platform.py: the same functions for each system; the package loads without those of another."""

import inspect
import subprocess
import sys

from pecs import _platform, _platform_unix

AS_ON_WINDOWS = """
import ctypes, importlib, inspect, os, pathlib, pkgutil, signal, subprocess, sys, types, unittest.mock
import numpy
for name in ("fcntl", "grp", "pwd", "resource", "termios"):
    sys.modules[name] = None
sys.modules["msvcrt"] = types.ModuleType("msvcrt")
ctypes.WinDLL, signal.SIGBREAK = unittest.mock.MagicMock(), 21
os.name = "nt"
import pecs._platform as platform
os.name = "posix"
import pecs
for module in pkgutil.walk_packages(pecs.__path__, "pecs.", onerror=lambda name: None):
    if module.name.endswith(("__main__", "_platform_unix")):
        continue
    try:
        importlib.import_module(module.name)
    except ModuleNotFoundError as e:
        assert e.name in ("h5py", "cv2", "pycocotools", "scipy", "torch"), e
assert "pecs._platform_unix" not in sys.modules
for name, f in vars(platform).items():
    if inspect.isfunction(f) and f.__module__ == "pecs._platform_windows" and name[0] != "_":
        print(name, inspect.signature(f))
"""


def test_systems_have_the_same_functions_and_the_package_loads_on_windows():
    result = subprocess.run([sys.executable, "-c", AS_ON_WINDOWS], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    functions = [
        f for f in vars(_platform_unix).values() if inspect.isfunction(f) and f.__module__ == _platform_unix.__name__
    ]
    wanted = {f"{f.__name__} {inspect.signature(f)}" for f in functions if not f.__name__.startswith("_")}
    assert set(result.stdout.splitlines()) == wanted and len(wanted) > 15
    assert _platform.become is _platform_unix.become
