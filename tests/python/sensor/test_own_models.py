"""Pixel models in Python: those of docs/howto/add_pixel_model.md, and what is wrong with others."""

import json
import os
import re
import subprocess
import sys

import numpy as np
import pecs
import pytest
from support import ROOT
from support.small_stacks import write

H, W = 30, 40


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    """The files of the page, and what they define."""
    folder, names = tmp_path_factory.mktemp("models"), {}
    page = (ROOT / "docs/howto/add_pixel_model.md").read_text()
    for name, text in re.findall(r'```python title="([\w.]+)"\n(.*?)```', page, re.DOTALL):
        (folder / name).write_text(text)
        exec(text, names)
    return folder, names


def waves(rate=2e-3, n=40):
    t = np.arange(n) * 1000.0 + 7.3
    y, x = np.mgrid[0:H, 0:W]
    return (0.5 + 0.45 * np.sin(0.3 * x + 0.05 * y - t[:, None, None] * rate)).astype(np.float32), t


def by_pixel(events):
    return np.sort(events, order=["x", "y", "t", "p"])


@pytest.mark.parametrize("chip", ["ideal", "imx636", "davis346"])
def test_esim_of_the_page_is_the_built_in(models, chip):
    noise = np.random.default_rng(1).random((40, H, W)).astype(np.float32)
    noise[5, 3, 4], noise[6, 3, 4] = np.nan, -1
    for frames in (waves()[0], waves(5e-3)[0], noise):
        options = {"chip": chip, "readout": "ideal", "parameters": {"log_eps": 0.01}}
        with np.testing.suppress_warnings() as quiet:
            quiet.filter(UserWarning)
            mine = pecs.simulate(frames, waves()[1], model=models[1]["Esim"], **options)
            theirs = pecs.simulate(frames, waves()[1], model="esim", **options)
        assert len(mine) == len(theirs) > 20_000
        mine, theirs = by_pixel(mine), by_pixel(theirs)
        assert all((mine[key] == theirs[key]).all() for key in "xyp") and abs(mine["t"] - theirs["t"]).max() <= 1


def test_readout_stages_chunks_and_motion_are_those_of_all_models(models):
    frames, t = waves()
    options = {"chip": "davis346", "trail_us": 2000, "roi": [(3, 4, 20, 15)]}
    whole = pecs.simulate(frames, t, model=models[1]["Esim"], threads=1, **options)
    assert len(whole) == pytest.approx(len(pecs.simulate(frames, t, model="esim", **options)), rel=1e-3)
    flow = np.full((2, H, W), 0.3)
    for motion in (None, flow):
        parts = []
        for model in (models[1]["Esim"], "esim"):
            with pecs.Sensor(W, H, model=model, **options) as sensor:
                found = [sensor.push(f, s, motion=motion) for f, s in zip(frames, t, strict=True)] + [sensor.finish()]
            parts.append(np.concatenate(found))
        assert len(parts[0]) == pytest.approx(len(parts[1]), rel=1e-3)
        assert motion is not None or np.array_equal(parts[0], whole)


def test_the_noise_of_the_page_has_the_rate_of_the_chip(models):
    frames, t = np.full((11, H, W), 0.5, np.float32), 1e5 * np.arange(11)
    overrides = {"background_on_hz": 2, "background_off_hz": 5}
    options = {"chip": "imx636", "model": models[1]["Noisy"], "labels": True, "readout": "ideal"}
    first, again, other = (pecs.simulate(frames, t, overrides=overrides, seed=s, **options) for s in (1, 1, 2))
    assert np.array_equal(first, again) and not np.array_equal(first, other)
    assert (first["label"] == pecs.sensor.LABELS.index("noise")).all()
    for p, rate in ((1, 2), (0, 5)):  # over 1 s
        assert abs((first["p"] == p).sum() - rate * H * W) < 5 * np.sqrt(rate * H * W)
    assert len(pecs.simulate(frames, t, noise=False, **options)) == 0
    moving = pecs.simulate(*waves(), photocurrent_a=1e-10, noise=False, **options)
    assert len(moving) > 10_000 and (moving["label"] == 0).all()


# What a model returns for light from 1000 to 2000 us -> the error.
WRONG = {
    "event 0 of 1000 to 2000 us: t: got 999.5, wanted a number in [1000, 12000]": ([999.5], [1], [1], [1]),
    "event 1 of 1000 to 2000 us: t: got 12000.5, wanted": ([1000, 12000.5], [1, 1], [1, 1], [1, 1]),
    "t: got nan, wanted": ([np.nan], [1], [1], [1]),
    f"x: got {W}, wanted a whole number in [0, {W - 1}]": ([1500], [W], [0], [1]),
    "x: got -1, wanted": ([1500], [-1], [0], [1]),
    "y: got 65536, wanted": ([1500], [0], [65536], [1]),
    "y: got 0.5, wanted": ([1500], [0], [0.5], [1]),
    "p: got -1, wanted a whole number in [0, 1]": ([1500], [0], [0], [-1]),
    "got None, wanted t, x, y, p": None,
    "got 5 arrays, wanted t, x, y, p": ([1500], [0], [0], [1], [2]),
    "x: got shape (2,), wanted (1,) as t": ([1500], [0, 1], [0], [1]),
    "Cannot cast": (["1500"], [0], [0], [1]),
    "t: got float32, wanted float64": (np.float32([1500]), [0], [0], [1]),
}


@pytest.mark.parametrize("line", WRONG)
def test_wrong_events_are_errors(line):
    def model(setup):
        return lambda planes, t_us: WRONG[line]

    with pytest.raises((ValueError, TypeError), match=re.escape(line)):
        pecs.simulate(waves()[0][:2], [1000, 2000], model=model)


class Fails:
    def __init__(self, setup, at=0.0):
        if at < 0:
            raise KeyError("no such thing")
        self.at = at

    def __call__(self, planes, t_us):
        if t_us[0] >= self.at:
            raise ZeroDivisionError("here")
        return [t_us[1] + 1e4], [0], [0], [1]


def test_exceptions_of_a_model_come_back(tmp_path):
    frames, t = waves()
    with pytest.raises(ZeroDivisionError, match="here") as error:
        pecs.simulate(frames, t, model=Fails, parameters={"at": 5000})
    assert error.traceback[-1].name == "__call__" and error.traceback[-1].path.name == "test_own_models.py"
    with pytest.raises(KeyError, match="no such thing"):
        pecs.Sensor(W, H, model=Fails, parameters={"at": -1})
    with pytest.raises(TypeError, match="unexpected keyword argument 'nope'"):
        pecs.Sensor(W, H, model=Fails, parameters={"nope": 1})
    with pytest.raises(pecs.PecsInputError, match="--labels: got model Fails"):
        pecs.Sensor(W, H, model=Fails, labels=True)
    with pytest.raises(pecs.PecsInputError, match="--model is Fails; leave one out"):
        pecs.Sensor(W, H, model=Fails, preset="v2e_noisy")
    write(tmp_path / "stack")
    with pytest.raises(ZeroDivisionError):
        pecs.sense(tmp_path / "stack", tmp_path / "out.raw", model=Fails)
    assert not (tmp_path / "out.raw").exists()
    with pecs.Sensor(W, H, model=Fails) as sensor:  # what it would give from now on is not known
        with pytest.raises(ZeroDivisionError):
            sensor.push(frames, t)
        with pytest.raises(pecs.PecsInputError, match="model Fails: it failed before"):
            sensor.push(frames, t + 1e6)
    late = pecs.simulate(frames, t, model=Fails, parameters={"at": 1e9}, readout="ideal")  # also after the last frame
    assert np.array_equal(late["t"], np.round(t[1:] + 1e4))


@pytest.fixture
def sense(models, tmp_path):
    write(tmp_path / "stack")

    def run(*words, **options):
        command = [pecs.program(), "sense", "stack", "-o", "out.raw", *words]
        environment = os.environ | {"PECS_PYTHON": sys.executable}
        return subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, **options)

    return run


def test_the_program_runs_a_file(models, sense, tmp_path):
    file = models[0] / "esim.py"
    done = sense("--model", f"{file}:Esim", "--param", "log_eps=0.01", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["events"] > 0
    mine = pecs.read(tmp_path / "out.raw")
    record = json.loads((tmp_path / "out.raw.run.json").read_text())
    assert record["config"]["model"]["name"] == f"{file}:Esim"
    assert record["config"]["model"]["parameters"] == {"log_eps": 0.01}
    assert str(file) in json.dumps(record["inputs"])
    pecs.sense(tmp_path / "stack", tmp_path / "mine.raw", model=models[1]["Esim"], parameters={"log_eps": 0.01})
    assert np.array_equal(pecs.read(tmp_path / "mine.raw"), mine)


FILES = {
    "Causes": (0, "begins"),
    "Model": (2, "--labels: got model model.py:Model, wanted pecs"),
    "Nothing": (2, "--model: got model.py:Nothing, wanted one of model.py's Model, Bad, Ends, Exits, Asks, Causes"),
    "Bad": (4, "model.py: line 12: ZeroDivisionError: division by zero"),
    "Ends": (3, "--model model.py:Ends: "),
    "Exits": (4, "model.py: line 19: SystemExit: 0"),
    "Asks": (4, "model.py: line 22: EOFError: "),
}


def test_what_is_wrong_with_a_file_is_one_line(sense, tmp_path):
    (tmp_path / "model.py").write_text(
        """print("to stderr")
class Model:
    def __init__(self, setup):
        print("begins")
    def __call__(self, planes, t_us):
        return [], [], [], []


class Bad(Model):
    def __call__(self, planes, t_us):
        a = 0
        return 1 / a
class Ends(Model):
    def __call__(self, planes, t_us):
        import os
        os._exit(0)
class Exits(Model):
    def __call__(self, planes, t_us):
        raise SystemExit(0)
class Asks(Model):
    def __call__(self, planes, t_us):
        return input()
class Causes(Model):
    tells_causes = True
    def __call__(self, planes, t_us):
        return [t_us[1]] * 4, range(4), [0] * 4, [1] * 4, range(4)
"""
    )
    for name, (code, line) in FILES.items():
        done = sense(
            "--model", f"model.py:{name}", *(["--labels", "causes.npy"] if name in ("Model", "Causes") else [])
        )
        lines = [text for text in done.stderr.splitlines() if text.startswith("pecs: ")]
        assert done.returncode == code and len(lines) == (code > 0), done.stderr
        assert line in done.stderr and "Traceback" not in done.stderr and "begins" not in done.stdout
        assert (tmp_path / "out.raw").exists() == (code == 0)
        (tmp_path / "out.raw").unlink(missing_ok=True)
    assert set(np.load(tmp_path / "causes.npy")) == {0, 1, 2, 3}
    assert "Traceback" in sense("--model", "model.py:Bad", "--verbose").stderr
    (tmp_path / "typo.py").write_text("class Model\n")
    done = sense("--model", "typo.py:Model")
    assert done.returncode == 4 and "pecs: typo.py: line 1: SyntaxError" in done.stderr
    done = sense("--model", "missing.py:Model")
    assert done.returncode == 3 and "missing.py: no such file" in done.stderr
    done = sense("--model", "model.py:Model", "-o", "model.py", "--format", "csv")
    assert done.returncode == 2 and (tmp_path / "model.py").read_text().startswith("print")


def test_no_data_can_name_a_file(tmp_path):
    """The command line alone: no option of the library, which recipes and panel use, runs one."""
    (tmp_path / "model.py").write_text("open('ran', 'w')\nclass Model: pass\n")
    for name in ("model.py:Model", f"{tmp_path}/model.py:Model"):
        with pytest.raises(pecs.PecsInputError, match="wanted one of pecs, esim"):
            pecs.Sensor(W, H, model=name)
    preset = json.loads((ROOT / "sensor/presets/v2e_noisy.json").read_text()) | {"model": f"{tmp_path}/model.py:Model"}
    (tmp_path / "mine.json").write_text(json.dumps(preset))
    with pytest.raises(pecs.PecsInputError, match="model: got"):
        pecs.Sensor(W, H, preset=tmp_path / "mine.json")
    assert not list(tmp_path.rglob("ran"))
