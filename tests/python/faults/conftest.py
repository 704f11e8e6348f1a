"""A small disk, a recording and a stack."""

import os
import subprocess

import pecs
import pytest
from support.faults import events, random_stack

SIZE_KB = 256


@pytest.fixture
def small_disk(tmp_path):
    folder = tmp_path / "small"
    folder.mkdir()
    if os.geteuid() != 0:
        pytest.skip("needs root to mount a small file system")
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={SIZE_KB}k", "pecs", folder], capture_output=True)
    if mounted.returncode:
        pytest.skip("no file system may be mounted here")
    yield folder
    subprocess.run(["umount", folder], check=True)


@pytest.fixture
def recording(tmp_path):
    path = tmp_path / "in.raw"
    pecs.write(path, events(), 64, 48)
    return path


@pytest.fixture
def stack(tmp_path):
    random_stack(tmp_path / "s", 3)
    return tmp_path / "s"
