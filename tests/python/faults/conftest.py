"""A small disk, a recording and a stack."""

import pecs
import pytest
from support.faults import events, mounted, random_stack


@pytest.fixture
def small_disk(tmp_path):
    yield from mounted(tmp_path / "small", 256)


@pytest.fixture
def recording(tmp_path):
    path = tmp_path / "in.raw"
    pecs.write(path, events(), 64, 48)
    return path


@pytest.fixture
def stack(tmp_path):
    random_stack(tmp_path / "s", 3)
    return tmp_path / "s"
