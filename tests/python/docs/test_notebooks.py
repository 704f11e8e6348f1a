"""The notebooks of examples/, cell by cell: what they find, and what their pages show as printed."""

import json
import os

import pytest
from support import ROOT
from support.printed import PRINTED, assert_printed

EXAMPLES = ROOT / "examples"


@pytest.fixture
def run(monkeypatch, capsys):
    """The variables at the end of a notebook; figures are not shown."""
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.setenv("PATH", f"{ROOT}/build/release/bin:{os.environ['PATH']}")

    def run(name):
        names = {}
        for cell in json.loads((EXAMPLES / name / f"{name}.ipynb").read_text())["cells"]:
            if cell["cell_type"] == "code":
                assert not cell["outputs"]
                exec("".join(cell["source"]), names)
        ((_, expected),) = PRINTED.findall((EXAMPLES / name / "README.md").read_text())
        assert_printed(expected, capsys.readouterr().out)
        return names

    return run


def test_slow_pixels_answer_later_than_grey_values(run):
    events = run("frames_to_events")["events"]
    trail = {name: (found["t"] / 500 + 20 - found["x"])[found["p"] == 0].mean() for name, found in events.items()}
    assert trail["pecs"] > trail["v2e"] > trail["esim"] > 0  # frames behind the bar's middle


def test_light_of_the_stack_is_that_of_the_report(run):
    names = run("look_at_a_stack")
    assert names["light"].shape == (3, 64, 96)
    assert names["report"]["results"]["events"] == len(names["events"]) == names["counts"].sum()


def test_comparison_finds_the_threshold(run):
    assert run("compare_with_recording")["best"] == 0.32


def test_windows_hold_all_events(run):
    names = run("events_for_pytorch")
    file = names["windows"].file
    assert tuple(names["batch"].shape) == (4, 5, 120, 160)
    assert sum(len(file.between(20_000 * i, 20_000 * (i + 1))) for i in range(len(names["windows"]))) == len(file)


def test_fit_finds_the_hidden_threshold(run):
    names = run("fit_a_chip")
    value = names["on"].value
    assert value == pytest.approx(0.35, rel=0.05) and names["on"].start == pytest.approx(0.254)
