"""`pecs demo`: its pixels against the known truth, and every file it promises."""

import pecs
import pytest
from pecs import demo


@pytest.fixture(scope="module")
def made(pecs_program, python, tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PECS_PYTHON", python)
        answer = pecs_program("demo", "-o", folder)
    assert answer.returncode == 0, answer.stderr
    return folder, answer.stdout


def test_esim_is_the_ideal_pixel(made):
    """ESIM has thresholds alone; the others have more, and are late."""
    folder, _ = made
    ideal = demo.ideal_pixel(pecs.Chip(demo.CHIP))
    *counts, delay_ms = demo.measured(pecs.read(folder / "esim.raw"))
    assert counts == pytest.approx(ideal[:2], abs=0.5)  # whole numbers in a turn, whose mean over turns is the ideal
    assert delay_ms == pytest.approx(ideal[2], abs=0.1)  # a quarter of a frame
    on, off, delay_ms = demo.measured(pecs.read(folder / "pecs.raw"))
    assert (on, off) == pytest.approx(ideal[:2], rel=0.2) and delay_ms > ideal[2]


def test_files(made):
    folder, said = made
    for model in pecs.models():
        assert len(pecs.read(folder / f"{model['name']}.raw")) > 10_000
    assert len(pecs.read(folder / "pecs.aedat4")) == len(pecs.read(folder / "pecs.raw"))
    for name, begins in (("pecs.png", b"\x89PNG"), ("pecs.html", b"<!"), ("report.html", b"<!")):
        assert (folder / name).read_bytes().startswith(begins)
    assert (folder / "pecs.mp4").read_bytes()[4:8] == b"ftyp"
    assert "Next:" in said and "pecs sense" in said


def test_wrong_usage(pecs_program, python, monkeypatch):
    monkeypatch.setenv("PECS_PYTHON", python)
    answer = pecs_program("demo", "--bogus")
    assert answer.returncode == 2 and answer.stderr.startswith("pecs: demo: ")
