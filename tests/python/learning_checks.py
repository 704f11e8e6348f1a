"""Checks of pecs.learning that need PyTorch and ONNX Runtime: run in .venv-datasets by test_learning.py.

python learning_checks.py SET SCRATCH    SET: of test_learning.py's fixture
"""

import dataclasses
import json
import math
import sys
import traceback
from pathlib import Path

import cv2
import numpy as np
import torch
from pecs import PecsError, PecsInputError, PecsOutputError
from pecs.datasets.sequence import sequences
from pecs.learning.clips import Augmentation, ClipConfig, Clips, recordings
from pecs.learning.export import export
from pecs.learning.losses import C1, C2, ms_ssim, temporal, warped
from pecs.learning.networks import NetworkConfig, network, start_states
from pecs.learning.reconstruct import WEIGHTS, Filter, Network, Window
from pecs.learning.train import TrainConfig, train, trained
from pecs.representations import voxel_grid

PLAIN = ClipConfig(windows=5, crop=48, augmentation=None)
SMALL = dataclasses.replace(PLAIN, crop=32)
SHORT = TrainConfig(NetworkConfig(channels=4), SMALL, steps=4, batch=2, decay_steps=2, save_every=2)
E2VID = NetworkConfig("e2vid", channels=4, levels=2)


def check_parameters(_set, _scratch):
    """As published: 37,777 with 16 channels (Scheerlinck et al. 2020), 9,673 with 8; E2VID 10.7 million (Rebecq)."""
    for config, count in ((NetworkConfig(), 37_777), (NetworkConfig(channels=8), 9_673)):
        assert sum(p.numel() for p in network(config).parameters()) == count
    count = sum(p.numel() for p in network(NetworkConfig("e2vid", channels=32, levels=3)).parameters())
    assert abs(count - 10.7e6) < 0.1e6, count


def check_states_carry(_set, _scratch):
    """What was seen before matters, and only through the states."""
    for config in (NetworkConfig(channels=4), E2VID):
        net = network(config)
        grid = torch.randn(2, 5, 16, 24)
        states = start_states(net, 2, 16, 24)
        with torch.no_grad():
            first, after = net(grid, states)
            again, _ = net(grid, states)
            second, _ = net(grid, after)
        assert first.shape == (2, 1, 16, 24) and torch.equal(first, again) and not torch.allclose(first, second)
        assert [a.shape for a in after] == [s.shape for s in states]


def check_small_networks_start_alive(_set, _scratch):
    """Whatever the seed: the first picture shows the events, so that training can begin."""
    grid = torch.randn(1, 5, 32, 32) * (torch.rand(1, 5, 32, 32) < 0.2)
    for seed in range(8):
        torch.manual_seed(seed)
        net = network(NetworkConfig(channels=8))
        with torch.no_grad():
            picture, _ = net(grid, start_states(net, 1, 32, 32))
        assert float(picture.std()) > 0.003, (seed, float(picture.std()))


def check_ssim(_set, _scratch):
    """One scale, which a small picture has, against OpenCV's Gaussian."""
    rng = np.random.default_rng(1)
    a = cv2.GaussianBlur(rng.random((20, 21)), (0, 0), 1)
    b = np.clip(a + rng.normal(0, 0.05, a.shape), 0, 1)

    def mean(x):
        return cv2.GaussianBlur(x, (11, 11), 1.5)[5:-5, 5:-5]

    ma, mb = mean(a), mean(b)
    va, vb, cov = mean(a * a) - ma**2, mean(b * b) - mb**2, mean(a * b) - ma * mb
    wanted = ((2 * ma * mb + C1) * (2 * cov + C2) / ((ma**2 + mb**2 + C1) * (va + vb + C2))).mean()
    pair = [torch.from_numpy(x)[None, None] for x in (a, b)]
    assert math.isclose(float(ms_ssim(*pair)), wanted, rel_tol=1e-6)
    assert math.isclose(float(ms_ssim(pair[0], pair[0])), 1, rel_tol=1e-6)
    wide = torch.rand(1, 1, 200, 200, dtype=torch.float64)
    assert 0.05 < float(ms_ssim(wide, (wide + 0.3 * torch.rand_like(wide)).clamp(0, 1))) < 0.99


def check_warp(_set, _scratch):
    picture = torch.rand(1, 1, 8, 9, dtype=torch.float64)
    flow = torch.zeros(1, 2, 8, 9, dtype=torch.float64)
    flow[:, 0], flow[:, 1] = 2, -1
    flow[0, :, 5, 5] = math.nan
    out, known = warped(picture, flow)
    assert torch.allclose(out[0, 0, 1:, :7][known[0, 0, 1:, :7]], picture[0, 0, :-1, 2:][known[0, 0, 1:, :7]])
    assert not known[0, 0, 0].any() and not known[0, 0, :, 7:].any() and not known[0, 0, 5, 5]
    loss = temporal(out, picture, out, picture, flow)
    assert float(loss) < 1e-12 < float(temporal(out + 0.1, picture, out, picture, flow))


def check_clips(set_, _scratch):
    """A clip's picture, carried along its flow, is the next one's; grids are those of the events in the crop."""
    found = recordings(sequences(set_))
    clips = Clips(found, PLAIN, seed=3, length=6)
    assert len(found) == 2
    for i in range(len(clips)):
        item = clips[i]
        assert all(torch.equal(item[k], clips[i][k]) or k == "flow_back" for k in item)
        assert item["grid"].shape == (5, 5, 48, 48) and item["picture"].shape == (5, 1, 48, 48)
        before = torch.cat([item["before"][None], item["picture"][:-1]])
        came, known = warped(before, item["flow_back"])
        other, there = warped(before, -item["flow_back"])
        errors = [(x - item["picture"])[where].abs().median() for x, where in ((came, known), (other, there))]
        assert errors[0] < 0.02 and errors[0] < 0.5 * errors[1], errors  # textures of a few pixels between pixels
    recording = found[0]
    events, times = recording.camera.events(), recording.times_us
    whole = Clips([recording], dataclasses.replace(PLAIN, crop=72, windows=len(times) - 1), 1, 1)[0]
    k = 3
    there = events[(events["t"] >= times[k]) & (events["t"] < times[k + 1])]
    grids = []
    for x0 in range(25):
        kept = there[(there["x"] >= x0) & (there["x"] < x0 + 72)].copy()
        kept["x"] -= x0
        grids.append(voxel_grid(kept, 72, 72, begin_us=times[k], end_us=times[k + 1], normalise=True))
    assert any(np.array_equal(whole["grid"][k], g) for g in grids)


def check_augmentation(set_, _scratch):
    """Flips turn flow with the picture; pauses repeat pictures."""
    found = recordings(sequences(set_))
    clips = Clips(found, ClipConfig(5, 48, augmentation=Augmentation(True, 0.5, 0.1, 0.25, 0.001)), 1, 12)
    paused = 0
    for i in range(len(clips)):
        item = clips[i]
        before = torch.cat([item["before"][None], item["picture"][:-1]])
        came, known = warped(before, item["flow_back"])
        assert (came - item["picture"]).abs()[known].median() < 0.02
        paused += sum(torch.equal(a, b) for a, b in zip(before, item["picture"], strict=True))
    assert 12 < paused < 48


def check_training_continues(set_, scratch):
    """Stopped and continued: the same network as of an unbroken run; the loss falls on one clip."""
    rates = [SHORT.rate(step) / SHORT.learning_rate for step in range(4)]
    assert np.allclose(rates, [1, 1, 2 / 3, 1 / 3]), rates
    found = recordings(sequences(set_))
    whole = train(found, scratch / "whole", SHORT)
    try:
        train(found, scratch / "parts", SHORT, progress=_stop_at(3))
    except KeyboardInterrupt:
        pass
    parts = train(found, scratch / "parts", SHORT)
    for a, b in zip(whole.parameters(), parts.parameters(), strict=True):
        assert torch.equal(a, b)
    assert (scratch / "whole/log.csv").read_text() == (scratch / "parts/log.csv").read_text()
    assert len((scratch / "whole/log.csv").read_text().splitlines()) == 5
    try:
        train(found, scratch / "whole", dataclasses.replace(SHORT, seed=2))
        raise AssertionError("another config")
    except PecsOutputError as e:
        assert "seed: got 1, wanted 2" in str(e)
    learnt = dataclasses.replace(SHORT, steps=30, learning_rate=1e-2, clips=dataclasses.replace(SHORT.clips, windows=9))
    losses = []
    train(found[:1], scratch / "learnt", learnt, progress=lambda _, loss: losses.append(loss))
    assert np.mean(losses[-5:]) < 0.8 * np.mean(losses[:3]), losses


def _stop_at(last):
    def progress(step, _loss):
        if step == last:
            raise KeyboardInterrupt

    return progress


def check_nan_keeps_the_checkpoint(set_, scratch):
    found = recordings(sequences(set_))
    config = dataclasses.replace(SHORT, learning_rate=math.inf)
    try:
        train(found, scratch / "nan", dataclasses.replace(config, save_every=1))
        raise AssertionError("a NaN")
    except PecsError as e:
        assert "loss: got nan" in str(e) and "\n" not in str(e) and "checkpoint.pt is of step 1" in str(e), e
    assert (scratch / "nan/checkpoint.pt").is_file()


def check_onnx_is_the_network(set_, scratch):
    """Window after window, on a picture that is no multiple of what E2VID halves."""
    rng = np.random.default_rng(1)
    for config in (SHORT, dataclasses.replace(SHORT, network=E2VID)):
        run, file = scratch / f"{config.network.kind} run", scratch / f"{config.network.kind}.onnx"
        train(recordings(sequences(set_)), run, dataclasses.replace(config, steps=2))
        export(run, file)
        width, height = 50, 37
        ours, (net, _) = Network(file, width, height), trained(run)
        high, wide = (-(-n // 4) * 4 for n in (height, width))
        states = start_states(net, 1, high, wide)
        for k in range(4):
            events = np.zeros(500, [("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")])
            events["t"] = np.sort(rng.integers(1000 * k, 1000 * (k + 1), 500))
            events["x"], events["y"] = rng.integers(0, width, 500), rng.integers(0, height, 500)
            events["p"] = rng.integers(0, 2, 500)
            window = Window(1000 * k, 1000 * (k + 1), events)
            grid = voxel_grid(events, width, height, 5, window.begin_us, window.end_us, normalise=True)
            if config.network.kind == "e2vid":
                grid = np.pad(grid, ((0, 0), (0, high - height), (0, wide - width)))
            else:
                states = [s[..., :height, :width] for s in states]
            with torch.no_grad():
                picture, states = net(torch.from_numpy(grid)[None], states)
            error = np.abs(ours(window) - picture[0, 0, :height, :width].numpy().clip(0, 1)).max()
            assert error < 1e-4, (config.network.kind, k, error)
    try:
        Network(set_ / "other.onnx", 8, 8)
        raise AssertionError("not a network")
    except PecsInputError as e:
        assert "other.onnx" in str(e) and "\n" not in str(e)


def check_the_network_that_ships(set_, _scratch):
    """Small, with its record, and better than the filter on a scene that it never saw."""
    assert WEIGHTS.stat().st_size < 200_000
    record = json.loads(WEIGHTS.with_suffix(".json").read_text())
    errors = []
    for recording in recordings(sequences(set_)):
        size = recording.camera.width, recording.camera.height
        methods = Network(WEIGHTS, *size), Filter(*size, 1.0)
        assert methods[0].record["config"] == record["run"]["config"]
        for k in range(recording.windows):
            window = Window(*map(float, recording.times_us[k : k + 2]), np.asarray(recording.window(k)))
            shown = [method(window) for method in methods]
            if k >= 3:
                errors.append([((picture - recording.pictures[k + 1] / 255) ** 2).mean() for picture in shown])
    ours, theirs = np.mean(errors, 0)
    assert ours < 0.8 * theirs, (ours, theirs)


def main(set_, scratch):
    failed = False
    for name, check in list(globals().items()):
        if name.startswith("check_"):
            try:
                check(set_, scratch)
                print(f"{name}: passed", flush=True)
            except Exception:
                failed = True
                print(f"{name}: failed\n{traceback.format_exc()}", flush=True)
    return int(failed)


if __name__ == "__main__":
    torch.set_num_threads(1)
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))
