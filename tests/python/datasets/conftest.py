"""Fixtures of the tests of pecs.datasets: the small sequence as each writer exports it, and a small disk."""

import os
import subprocess

import numpy as np
import pytest
from pecs.datasets import writers
from support import HERE, ROOT
from support.faults import mounted


@pytest.fixture(scope="session")
def exported(sequence, tmp_path_factory):
    """exported("dsec") -> (folder, report), written once."""
    done = {}

    def export(name):
        if name not in done:
            folder = tmp_path_factory.mktemp("out") / name
            done[name] = folder, writers.write(name, [sequence], folder)
        return done[name]

    return export


@pytest.fixture(scope="session")
def outside(tmp_path_factory):
    """outside(reader, folder): what a reader of .venv-datasets read."""

    def read(reader, folder):
        python = ROOT / ".venv-datasets" / "bin" / "python"
        assert python.is_file(), "scripts/setup.sh --tests makes .venv-datasets"
        out = tmp_path_factory.mktemp("read") / "out.npz"
        script = HERE / "support/outside_datasets.py"
        path = [ROOT / "python", HERE / "support/outside/evreal"]
        env = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, path))}
        done = subprocess.run([python, script, reader, folder, out], capture_output=True, text=True, env=env)
        assert done.returncode == 0, done.stderr
        return np.load(out)

    return read


@pytest.fixture
def small_disk(tmp_path):
    yield from mounted(tmp_path / "small", 96)
