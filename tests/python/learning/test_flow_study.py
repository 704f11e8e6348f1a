"""scripts/studies/flow.py and its parts, which need PyTorch: .venv-datasets/bin/python -m pytest THIS"""

import json

import numpy as np
import pecs
import pytest

pytest.importorskip("torch", reason="needs .venv-datasets")
import torch
from pecs_lab.disk import Disk
from pecs_lab.flow import FlowConfig, FlowNet, Window, batch_of, end_point_error, rotation, sharpness, turned
from support import ROOT, load_script

torch.set_num_threads(1)


def test_rotation_is_that_of_the_disk():
    """A quarter turn, counter-clockwise on screen: what is on the right goes up."""
    disk = Disk((10.5, 10.5), 9.0, 90.0, 0.0)
    flow = rotation(disk, (21, 21), 1.0)
    assert flow[:, 10, 15] == pytest.approx([-5, -5], abs=1e-5)
    assert flow[:, 5, 10] == pytest.approx([-5, 5], abs=1e-5)
    assert np.isnan(flow[:, 0, 0]).all() and flow[:, 10, 10] == pytest.approx([0, 0], abs=1e-5)


def edge_events(speed_px: float) -> np.ndarray:
    """Of a bar's two edges that move to the right within 1 ms."""
    rows = []
    for start, polarity in ((8, 1), (16, 0)):
        for y in range(32):
            for t in np.arange(0, 1000, 1000 / speed_px):
                rows.append((int(t), int(start + t * speed_px / 1000), y, polarity))
    events = np.zeros(len(rows), pecs.EVENT_DTYPE)
    for name, values in zip(("t", "x", "y", "p"), np.array(rows).T, strict=True):
        events[name] = values
    return events[np.argsort(events["t"], kind="stable")]


def test_events_are_sharper_along_their_flow():
    flow = np.zeros((2, 32, 48), np.float32)
    flow[0] = 6
    window = Window("bar", edge_events(6), 0.0, 1000.0, flow)
    assert sharpness(window, 1.0) > 1.5 > 1 > sharpness(window, -1.0)
    assert sharpness(window, 1.0) > max(sharpness(window, s) for s in (0.5, 1.5))


def test_symmetries_turn_the_flow_with_the_picture():
    """A ramp of time along the motion stays one along the motion."""
    grid = np.broadcast_to(np.arange(8, dtype=np.float32), (5, 8, 8))
    flow = np.stack([np.ones((8, 8), np.float32), np.zeros((8, 8), np.float32)])
    for seed in range(16):
        found, moved = turned(grid, flow, np.random.default_rng(seed))
        rise = np.stack([np.gradient(found[0], axis=1), np.gradient(found[0], axis=0)])
        assert np.allclose(np.abs(rise), np.abs(moved))
        signs = np.sign((rise * moved).sum(0))
        assert (signs == signs[0, 0]).all()  # -1: both polarities were changed


def test_the_error_leaves_out_what_is_unknown():
    flow = torch.zeros(1, 2, 8, 8)
    flow[:, :, 4:] = torch.nan
    found = torch.zeros_like(flow).requires_grad_()
    loss = end_point_error(found + 3, flow)
    loss.backward()
    assert float(loss) == pytest.approx(3 * 2**0.5, abs=1e-4) and torch.isfinite(found.grad).all()
    assert FlowNet()(torch.zeros(1, 5, 24, 32)).shape == (1, 2, 24, 32)


def test_the_study_in_small(trainable, tmp_path):
    """flow.py from light to scores; the same seed gives the same network."""
    study = load_script(ROOT / "scripts/studies/flow.py")
    study.PLAN |= {"camera": "left", "matching": study.PLAN["matching"] | {"every": 1, "tolerance": 0.2}}
    study.PLAN |= {"training": study.PLAN["training"] | {"crop": 32, "batch": 1, "steps": 2, "intervals": [1]}}
    sensors = {key: study.PLAN["test"]["sensors"][key] for key in ("gen3_vga", "esim")}
    test = study.PLAN["test"] | {
        "split": "train",
        "sensors": sensors,
        "first": 0,
        "intervals": 1,
        "step": 1,
        "by_scene": [],
    }
    study.PLAN |= {"test": test}
    study.SHARPER = 0.0
    root = tmp_path / "study"
    root.mkdir()
    (root / "light").symlink_to(trainable)
    study.main(root, only=["pecs", "esim"], seeds=[1], picture=tmp_path / "p.webp")
    results = json.loads((root / "results.json").read_text())["results"]
    assert set(results) == {"pecs", "esim", "zero", "mean", "farneback"} and (tmp_path / "p.webp").is_file()
    assert all(set(row["gen3_vga"][0]) == set(test["metrics"]) for row in results.values())
    assert results["zero"]["gen3_vga"][0]["relative"] == pytest.approx(1)
    views = study.training_views(study.Comparison(root, study.PLAN), "pecs")
    config = FlowConfig(crop=32, intervals=(1,))
    assert torch.equal(batch_of(views, config, 0)[0], batch_of(views, config, 0)[0])
