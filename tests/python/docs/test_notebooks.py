"""The notebooks of examples/, cell by cell, and what they find."""

import json
import os

import pytest
from support import ROOT

NOTEBOOKS = ROOT / "examples/notebooks"


def run(name, monkeypatch):
    """The variables at the end; figures are not shown."""
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.setenv("PATH", f"{ROOT}/build/release/bin:{os.environ['PATH']}")
    names = {}
    for cell in json.loads((NOTEBOOKS / f"{name}.ipynb").read_text())["cells"]:
        if cell["cell_type"] == "code":
            assert not cell["outputs"]
            exec("".join(cell["source"]), names)
    return names


def test_slow_pixels_answer_later_than_grey_values(monkeypatch):
    events = run("frames_to_events", monkeypatch)["events"]
    trail = {name: (found["t"] / 500 + 20 - found["x"])[found["p"] == 0].mean() for name, found in events.items()}
    assert trail["pecs"] > trail["v2e"] > trail["esim"] > 0  # frames behind the bar's middle


def test_light_of_the_stack_is_that_of_the_report(monkeypatch):
    names = run("look_at_a_stack", monkeypatch)
    assert names["light"].shape == (3, 64, 96)
    assert names["report"]["results"]["events"] == len(names["events"]) == names["counts"].sum()


def test_comparison_finds_the_threshold(monkeypatch):
    assert run("compare_with_recording", monkeypatch)["best"] == 0.32


def test_windows_hold_all_events(monkeypatch):
    names = run("events_for_pytorch", monkeypatch)
    file = names["windows"].file
    assert tuple(names["batch"].shape) == (4, 5, 120, 160)
    assert sum(len(file.between(20_000 * i, 20_000 * (i + 1))) for i in range(len(names["windows"]))) == len(file)


def test_fit_finds_the_hidden_threshold(monkeypatch):
    names = run("fit_a_chip", monkeypatch)
    value = names["on"].value
    assert value == pytest.approx(0.35, rel=0.05) and names["on"].start == pytest.approx(0.254)


def test_list_of_notebooks_is_complete():
    page = (ROOT / "examples/README.md").read_text()
    assert all(f"notebooks/{path.name}" in page for path in NOTEBOOKS.glob("*.ipynb"))
