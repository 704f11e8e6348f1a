import json
import os
import re
import subprocess

import numpy as np
import pecs
import pytest
from pecs.stack import StackWriter
from support.small_stacks import stack_json

WIDTH, HEIGHT = 64, 36


def events(seed):
    random = np.random.default_rng(seed)
    out = np.zeros(4000, pecs.EVENT_DTYPE)
    out["t"] = np.sort(random.integers(0, 20_000, len(out)))
    out["x"] = random.integers(0, WIDTH, len(out))
    out["y"] = random.integers(0, HEIGHT, len(out))
    out["p"] = random.integers(0, 2, len(out))
    return out


@pytest.fixture
def inputs(tmp_path):
    for name, seed in (("real.raw", 1), ("sim.raw", 2)):
        pecs.write(tmp_path / name, events(seed), WIDTH, HEIGHT)
    stack = stack_json(
        WIDTH,
        HEIGHT,
        [0, 1_000_000],
        bands=[{"lambda_nm": 450.25, "weight_nm": 80.0}, {"lambda_nm": 600.5, "weight_nm": 120.0}],
        lens={"name": "a lens of the test", "fnumber": 2.8, "e0": [1, 1]},
        scene={"name": "a scene", "parameters": {"speed": {"value": 347, "unit": "1/min", "about": "of the disk"}}},
        render={"samples": 8, "chip": "imx636"},
        versions={"renderer": "1.2.3"},
    )
    with StackWriter(tmp_path / "stack", stack) as writer:
        for i in range(2):
            writer.write_frame(i, np.random.default_rng(i).random((2, HEIGHT, WIDTH), dtype=np.float32))
    (tmp_path / "lens.svg").write_text("<svg xmlns='http://www.w3.org/2000/svg'/>")
    return tmp_path


def text_of(path):
    page = path.read_text()
    assert 'src="http' not in page and "href=" not in page
    return re.sub(r"<[^>]*>", " ", page)


def test_everything(pecs_program, inputs):
    result = pecs_program(
        *("report", "--real", "real.raw", "--sim", "sim.raw", "--stack", "stack", "--lens-svg", "lens.svg"),
        *("-o", "report.html", "--json"),
        cwd=inputs,
        check=True,
    )
    page = text_of(inputs / "report.html")
    summary = json.loads(result.stdout)
    direct = pecs.compare(events(1), events(2), width=WIDTH, height=HEIGHT)
    assert summary["compare"]["chamfer"] == direct["chamfer"]
    for wanted in (
        f"{direct['chamfer']:.3f}",
        f"{direct['split_half']['chamfer']:.4f}",
        "Events at the same times",
        "a lens of the test",
        "347 1/min",
        "450.25",
        "imx636",
        "1.2.3",
        "2 of 2",
    ):
        assert wanted in page, wanted
    assert "No stack was given" not in page and "{{" not in page
    assert (inputs / "report.html").read_text().count("data:image/png") == 7  # two by three instants, and the frame
    assert json.loads((inputs / "report.html.run.json").read_text())["results"] == summary


@pytest.mark.parametrize(
    ("step", "say"),
    [(2, "Number of events: 0.50 times the recording's. Too few"), (1, "1.00 times the recording's. Thresholds")],
)
def test_numbers_are_explained(pecs_program, inputs, step, say):
    found = events(2)[::step]
    found["p"] |= found["x"] < WIDTH // 8
    pecs.write(inputs / "sim.raw", found, WIDTH, HEIGHT)
    pecs_program("report", "--real", "real.raw", "--sim", "sim.raw", "-o", "report.html", cwd=inputs, check=True)
    page = re.sub(r"\s+", " ", text_of(inputs / "report.html"))
    assert say in page and "contrast_threshold_on" in page and "ON and OFF shifted alike mean a wrong phase" in page


@pytest.mark.parametrize(
    "given, said",
    [
        (["--sim", "sim.raw"], ["No real recording was given", "No stack was given", "The chip is not known"]),
        (["--real", "real.raw"], ["No simulated events were given", "Needs a real recording"]),
        (["--stack", "stack"], ["Needs a real recording", "No drawing was given"]),
    ],
)
def test_missing_parts_are_said(pecs_program, inputs, given, said):
    pecs_program("report", *given, "-o", "report.html", cwd=inputs, check=True)
    page = text_of(inputs / "report.html")
    for line in said:
        assert line in page


def report_of_a_stack(pecs_program, folder, times_ns, **changes):
    """The page's words about a stack of frames at these times."""
    stack = json.loads((folder / "stack/stack.json").read_text()) | {"times_ns": times_ns} | changes
    with StackWriter(folder / "timed", stack) as writer:
        for i in range(len(times_ns)):
            writer.write_frame(i, np.ones((2, HEIGHT, WIDTH), np.float32))
    pecs_program("report", "--stack", "timed", "-o", "report.html", cwd=folder, check=True)
    return re.sub(r"\s+", " ", text_of(folder / "report.html"))


@pytest.mark.parametrize(
    ("quantity", "words"),
    [("irradiance", "stack.json names no lens."), ("radiance", "The stack was rendered through a pinhole.")],
)
def test_a_stack_without_a_lens(pecs_program, inputs, quantity, words):
    assert words in report_of_a_stack(pecs_program, inputs, [0, 1_000_000], lens=None, quantity=quantity)


@pytest.mark.parametrize(
    ("times_ns", "words"),
    [
        ([100_000_000, 101_000_000, 102_000_000], "3 of 3, 100.000 to 102.000 ms"),
        ([100_000_000, 101_000_000, 102_000_000], "frame rate 1000 Hz"),
        ([333_333_333, 333_666_667, 334_000_000, 334_333_333], "frame rate 3000 Hz"),
        ([0, 1_000_000, 5_000_000], "frame intervals 1.000 to 4.000 ms"),
    ],
    ids=["times of a window", "rate of a window", "rounded times", "adaptive keyframes"],
)
def test_the_frame_rate_is_that_of_the_intervals(pecs_program, inputs, times_ns, words):
    page = report_of_a_stack(pecs_program, inputs, times_ns)
    assert words in page and ("frame rate" in page) != ("frame intervals" in page)


def test_the_chip_is_the_run_records(pecs_program, root, inputs):
    """The simulation's own quantum efficiency is drawn, also where a shipped profile has the same name."""
    profile = json.loads((root / "sensor/chips/imx636.json").read_text())
    profile["relative_qe"] |= {"lambda_nm": [300, 500, 900], "value": [0, 1, 0]}
    (inputs / "own.json").write_text(json.dumps(profile))
    sense = ("sense", "stack", "-o", "own.raw", "--chip", "own.json", "--set", "peak_qe=0.5")
    assert pecs_program(*sense, cwd=inputs).returncode == 0
    (inputs / "own.json").unlink()
    curves = []
    for events in ("own.raw", "sim.raw"):
        pecs_program("report", "--sim", events, "--stack", "stack", "-o", "report.html", cwd=inputs)
        curves.append(re.search('class="curve on" d="([^"]*)"', (inputs / "report.html").read_text())[1])
    assert curves[0].count("L") == 2 and curves[1].count("L") > 2


def test_a_chips_name_is_text(pecs_program, root, inputs):
    """Text of a foreign profile: escaped in the page, and without control characters."""
    profile = json.loads((root / "sensor/chips/imx636.json").read_text())
    name = "<script>alert(2)</script>"
    (inputs / "own.json").write_text(json.dumps(profile | {"name": name}))
    sense = ("sense", "stack", "-o", "own.raw", "--chip", "own.json")
    assert pecs_program(*sense, cwd=inputs).returncode == 0
    pecs_program("report", "--sim", "own.raw", "--stack", "stack", "-o", "report.html", cwd=inputs)
    page = (inputs / "report.html").read_text()
    assert name not in page and "relative quantum efficiency, &lt;script&gt;alert(2)" in page
    (inputs / "own.json").write_text(json.dumps(profile | {"name": "a\nb"}))
    result = pecs_program(*sense, cwd=inputs)
    assert result.returncode == 4 and "own.json: name: got " in result.stderr, result.stderr
    assert "wanted text without control characters" in result.stderr and result.stderr.count("\n") == 1


def test_a_recording_is_loaded_once(inputs, root):
    """Peak memory grows by less than three copies of the events."""
    count = 3_000_000
    many = np.zeros(count, pecs.EVENT_DTYPE)
    many["t"] = np.arange(count) // 100
    many["x"], many["y"] = np.arange(count) % WIDTH, np.arange(count) % HEIGHT
    pecs.write(inputs / "many.npz", many, WIDTH, HEIGHT)
    pecs.write(inputs / "few.npz", many[:1000], WIDTH, HEIGHT)
    peak = {}
    for name in ("few", "many"):
        command = [root / "build/release/bin/pecs", "report", "--real", f"{name}.npz", "-o", "report.html"]
        child = subprocess.Popen(command, cwd=inputs)
        _, status, usage = os.wait4(child.pid, 0)
        assert status == 0
        peak[name] = usage.ru_maxrss * 1024
    assert peak["many"] - peak["few"] < 3 * count * many.itemsize


def test_events_of_another_stack_are_noted(pecs_program, inputs):
    record = {"config": {"chip": {"name": "imx636"}}, "inputs": [{"path": "x", "sha256": "0" * 64}]}
    (inputs / "sim.raw.run.json").write_text(json.dumps(record))
    pecs_program("report", "--sim", "sim.raw", "--stack", "stack", "-o", "report.html", cwd=inputs)
    assert "not simulated from this stack" in text_of(inputs / "report.html")


@pytest.mark.parametrize(
    "options, code, line",
    [
        ([], 2, "wanted at least one of --real, --sim, --stack"),
        (["--sim", "gone.raw"], 3, "gone.raw"),
        (["--stack", "gone"], 3, "gone"),
        (["--real", "real.raw", "--sim", "small.raw"], 4, "small.raw: sensor size: got 32x32"),
    ],
)
def test_wrong_use(pecs_program, inputs, options, code, line):
    small = events(1)
    small["x"] //= 2
    small["y"] = np.minimum(small["y"], 31)
    pecs.write(inputs / "small.raw", small, 32, 32)
    result = pecs_program("report", *options, "-o", "report.html", cwd=inputs)
    assert result.returncode == code, result.stderr
    assert line in result.stderr
    assert not (inputs / "report.html").exists()


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("scene", {"name": 3}),
        ("scene", {"name": None, "parameters": [1, 2]}),
        ("scene", {"parameters": {"speed": {"value": 3, "unit": 5, "about": [1]}}}),
        ("render", {"samples": {"value": 8, "unit": None}}),
    ],
)
def test_values_of_any_type_are_shown(pecs_program, inputs, key, value):
    path = inputs / "stack/stack.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {key: value}))
    record = inputs / "sim.raw.run.json"
    for listed in (5, [1, {"sha256": 7}], [{"sha256": None}]):
        record.write_text(json.dumps({"inputs": listed}))
        done = pecs_program(
            "report", "--sim", "sim.raw", "--stack", "stack", "-o", "report.html", cwd=inputs, check=True
        )
        assert "a stack" in done.stderr or "not simulated from this stack" in text_of(inputs / "report.html")
