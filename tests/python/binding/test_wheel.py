"""The wheel: one py3-none wheel serves every Python, and works away from the checkout."""

import os
import subprocess
import venv
import zipfile

import pecs
import pytest


def test_tag_and_contents(wheel):
    assert "-py3-none-linux_" in wheel.name
    names = zipfile.ZipFile(wheel).namelist()
    assert [n for n in names if "libpecs" in n] == ["pecs/_lib/libpecs.so"]  # a zip has no links
    data = "pecs/_lib/share/pecs"
    weights = "pecs/learning/firenet.onnx", "pecs/learning/firenet.json"
    for name in (
        *weights,
        "pecs/py.typed",
        f"{data}/sensor/chips/imx636.json",
        f"{data}/lens_data/lenses/pecs_lab_15mm.json",
    ):
        assert name in names
    assert not [n for n in names if n.startswith(("tests/", "include/", "share/"))]


def test_works_away_from_the_checkout(root, wheel, tmp_path):
    venv.create(tmp_path / "v", with_pip=True, system_site_packages=False)
    python = tmp_path / "v" / "bin" / "python"
    subprocess.run([python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", wheel], check=True)
    code = "import pecs; print(pecs.__version__, pecs.__file__); assert len(pecs.bands(n=6)) == 6"
    bare = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PECS_LIBRARY", "PECS_PROGRAM")}
    result = subprocess.run([python, "-c", code], cwd=tmp_path, env=bare, check=True, capture_output=True, text=True)
    version, where = result.stdout.split()
    assert version == wheel.name.split("-")[1]
    assert str(tmp_path) in where
    if "pecs/_lib/bin/pecs" not in zipfile.ZipFile(wheel).namelist():
        pytest.skip("the program needs build/wheel-libraries (scripts/wheel_libraries.sh)")
    libraries = bare | {
        "LD_LIBRARY_PATH": str(root / "build" / "wheel-libraries" / "lib")
    }  # auditwheel puts them inside
    for command in ([tmp_path / "v/bin/pecs"], [python, "-m", "pecs"]):
        answer = subprocess.run([*command, "bands", "-n", "6"], env=libraries, capture_output=True, text=True)
        assert answer.returncode == 0 and "nm" in answer.stdout, answer.stderr
    answer = subprocess.run(
        [tmp_path / "v/bin/pecs", "dataset", "--help"], env=libraries, capture_output=True, text=True
    )
    assert answer.returncode == 0 and "recipe" in answer.stdout, answer.stderr


def test_program(root, monkeypatch):
    monkeypatch.delenv("PECS_PROGRAM", raising=False)
    answer = subprocess.run([pecs.program(), "--version"], capture_output=True, text=True, check=True)
    assert answer.stdout.split() == ["pecs", pecs.__version__]
    monkeypatch.setenv("PECS_PROGRAM", "/elsewhere/pecs")
    assert str(pecs.program()) == "/elsewhere/pecs"
