"""Inputs of the tests of faults, and what they check of an error."""

import os
import stat
import subprocess

import numpy as np
import pytest

from support.small_stacks import stack_json


def events(count=2000, step_us=10, size=(64, 48)):
    rng = np.random.default_rng(1)
    out = np.zeros(count, dtype=[("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")])
    out["t"] = np.arange(count) * step_us
    out["x"], out["y"] = rng.integers(size[0], size=count), rng.integers(size[1], size=count)
    out["p"] = rng.integers(2, size=count)
    return out


def device(path, major, minor):
    try:
        os.mknod(path, 0o666 | stat.S_IFCHR, os.makedev(major, minor))
        os.close(os.open(path, os.O_WRONLY))
    except OSError:
        pytest.skip("no device may be made and opened here")
    return path


def mounted(folder, size_kb):
    """Yields the folder, mounted as a small disk."""
    folder.mkdir()
    if os.geteuid() != 0:
        pytest.skip("needs root to mount a small file system")
    command = ["mount", "-t", "tmpfs", "-o", f"size={size_kb}k", "pecs", folder]
    if subprocess.run(command, capture_output=True).returncode:
        pytest.skip("no file system may be mounted here")
    yield folder
    subprocess.run(["umount", folder], check=True)


def fill(disk, free=0):
    """Writes a file that leaves `free` bytes of a small disk."""
    with (disk / "filler").open("wb", buffering=0) as file:
        with pytest.raises(OSError):
            while True:
                file.write(bytes(4096))
        file.truncate(file.tell() - free)


def refused(result, code, *words):
    assert result.returncode == code, (result.returncode, result.stderr)
    assert len(result.stderr.splitlines()) == 1 and result.stderr.startswith("pecs: "), result.stderr
    for word in words:
        assert word in result.stderr, result.stderr


def raw_text(*lines, body=b""):
    return "".join(f"% {line}\n" for line in [*lines, "end"]).encode("latin-1") + body


def random_stack(folder, frames):
    import pecs

    rng = np.random.default_rng(1)
    times_ns = [i * 1_000_000 for i in range(frames)]
    stack = stack_json(128, 96, times_ns, quantity="radiance", pixel_pitch_m=None)
    with pecs.StackWriter(folder, stack) as writer:
        for i in range(frames):
            writer.write_frame(i, rng.lognormal(0, 1, (1, 96, 128)).astype(np.float32))
