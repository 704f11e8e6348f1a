"""Tests of pecs.learning that need PyTorch and ONNX Runtime, which .venv-datasets has:
.venv-datasets/bin/python -m pytest tests/python/learning/test_networks.py"""

import dataclasses
import json
import math
import os
import warnings
from functools import partial
from unittest import mock

import cv2
import numpy as np
import pytest

pytest.importorskip("torch", reason="needs .venv-datasets")
pytest.importorskip("lpips", reason="needs .venv-datasets")
import lpips
import onnx
import torch
from pecs import EVENT_DTYPE, PecsError
from pecs._files import write_json
from pecs.datasets.sequence import Camera, sequences
from pecs.learning.clips import Augmentation, ClipConfig, Clips, recordings
from pecs.learning.export import export
from pecs.learning.losses import C1, C2, ssim
from pecs.learning.lpips import Lpips
from pecs.learning.networks import NetworkConfig, RecurrentUNet, start_states
from pecs.learning.procedural import Procedural, ProceduralConfig, light, sequence
from pecs.learning.reconstruct import WEIGHTS, Filter, Network, Window, compressed, late_us
from pecs.learning.train import TrainConfig, _Log, _resume, _save, learn, train, trained
from pecs.representations import voxel_grid
from support import run_module

torch.set_num_threads(1)

PLAIN = ClipConfig(windows=5, chunk=3, crop=48, augmentation=None)
SMALL = dataclasses.replace(PLAIN, crop=32)
SHORT = TrainConfig(NetworkConfig(channels=4, levels=2), SMALL, steps=4, batch=2, decay_steps=2, save_every=2)
DRAWN = ProceduralConfig(count=2, size=48, duration_us=300_000)


def test_states_carry():
    """What was seen before matters, and only through the states."""
    net = RecurrentUNet(SHORT.network)
    planes = torch.randn(2, 6, 16, 24)
    states = start_states(net, 2, 16, 24)
    with torch.no_grad():
        first, after = net(planes, states)
        again, _ = net(planes, states)
        second, _ = net(planes, after)
    assert first.shape == (2, 1, 16, 24) and torch.equal(first, again) and not torch.allclose(first, second)
    assert [a.shape for a in after] == [s.shape for s in states]


def test_small_networks_start_alive():
    """Whatever the seed: the first picture shows the events, so that training can begin."""
    planes = torch.randn(1, 6, 32, 32) * (torch.rand(1, 6, 32, 32) < 0.2)
    for seed in range(8):
        torch.manual_seed(seed)
        net = RecurrentUNet(NetworkConfig(channels=8))
        with torch.no_grad():
            picture, _ = net(planes, start_states(net, 1, 32, 32))
        assert float(picture.std()) > 0.003, (seed, float(picture.std()))


def test_ssim():
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
    assert math.isclose(float(ssim(*pair)), wanted, rel_tol=1e-6)
    assert math.isclose(float(ssim(pair[0], pair[0])), 1, rel_tol=1e-6)
    wide = torch.rand(1, 1, 200, 200, dtype=torch.float64)
    assert 0.05 < float(ssim(wide, (wide + 0.3 * torch.rand_like(wide)).clamp(0, 1))) < 0.99


def test_clips(trainable):
    """Planes are those of the events in the crop; pictures are those at the ends of windows of one length."""
    found = recordings(sequences(trainable))
    clips = Clips(found, PLAIN, 5, seed=3, length=6)
    assert len(found) == 2
    for i in range(len(clips)):
        item = clips[i]
        assert all(torch.equal(item[k], clips[i][k]) for k in item)
        assert item["planes"].shape == (5, 6, 48, 48) and item["picture"].shape == (5, 1, 48, 48)
        assert len(item["planes"][:, 5].unique()) == 1
    recording = found[0]
    events, times = recording.camera.events(), recording.times_us
    whole = Clips([recording], dataclasses.replace(PLAIN, crop=72, windows=5), 5, 1, 1)[0]
    k = 3
    begin, end = times[[k, k + 1]] + late_us(recording.corner_hz)
    there = events[(events["t"] >= begin) & (events["t"] < end)]
    pictures = recording.pictures[k + 1] / np.float32(255)
    for x0 in range(25):
        if np.array_equal(whole["picture"][k, 0], pictures[:, x0 : x0 + 72]):
            break
    kept = there[(there["x"] >= x0) & (there["x"] < x0 + 72)].copy()
    kept["x"] -= x0
    grid = voxel_grid(kept, 72, 72, begin_us=begin, end_us=end)
    length_us = (times[-1] - times[0]) / (len(times) - 1)
    np.testing.assert_allclose(whole["planes"][k], compressed(grid, length_us), atol=1e-6)


def test_clips_of_slow_pixels():
    """Pictures are as much earlier than their windows' ends as events are late."""
    times, pixel = np.arange(101) * 5_000, np.zeros((101, 16, 16), np.uint8)
    pixel += (2 * np.arange(101, dtype=np.uint8))[:, None, None]  # a picture tells its time
    events = np.array([(250_100, 3, 4, 1)], [("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")])
    corner_hz, config = 5.0, ClipConfig(12, 6, 16, None)
    source, seen = Procedural(events, times, pixel, corner_hz), 0
    for item in Clips([source], config, 5, 1, 12):
        ends_us = item["picture"][:, 0, 0, 0].numpy() * 255 / 2 * 5000 + late_us(corner_hz)
        has = np.flatnonzero(item["planes"][:, :5].abs().sum((1, 2, 3)) > 0)
        within = np.flatnonzero((ends_us > 250_100) & (ends_us - np.diff(ends_us)[0] < 250_100))
        np.testing.assert_array_equal(has, within)
        seen += len(has)
    assert seen > 4


@pytest.mark.parametrize(
    ("count", "corner_hz", "wanted"),
    [
        (101, None, "got 10 windows of 10 ms in the longest sequence, wanted 12"),
        (121, 1.0, "got 5 windows of 10 ms in the longest sequence, wanted 12"),  # events are 64 ms late
        (121, None, ""),
    ],
)
def test_windows_of_clips_have_10_to_40_ms(count, corner_hz, wanted):
    source = Procedural(np.zeros(0, EVENT_DTYPE), np.arange(count) * 1000, np.zeros((count, 16, 16), "u1"), corner_hz)
    if wanted:
        with pytest.raises(PecsError, match=wanted):
            Clips([source], ClipConfig(12, 6, 16, None), 5, 1, 1)
        return
    (item,) = Clips([source], ClipConfig(12, 6, 16, None), 5, 1, 1)
    assert float(item["planes"][0, 5, 0, 0]) == pytest.approx(math.log10(10 / 20))


def test_pictures_do_not_depend_on_the_truth(trainable, monkeypatch):
    monkeypatch.setattr(Camera, "truth", None)
    one = recordings(sequences(trainable))[0]
    assert np.array_equal(one.times_us, np.arange(0, 100_001, 10_000)) and len(one.pictures) == 11


def test_faults_of_cameras(trainable):
    """Noise and bursts change planes, not pictures; flips turn both."""
    found = recordings(sequences(trainable))
    plain = Clips(found[:1], dataclasses.replace(PLAIN, crop=72, windows=5), 5, 1, 4)
    faults = dataclasses.replace(plain.config, augmentation=Augmentation(False, 50.0, 1.0))
    noisy = Clips(found[:1], faults, 5, 1, 4)
    turned = Clips(found[:1], dataclasses.replace(faults, augmentation=Augmentation(True, 0, 0)), 5, 1, 4)
    same = 0
    for i in range(4):
        one, other, third = plain[i], noisy[i], turned[i]
        assert torch.equal(one["picture"], other["picture"])
        more = (one["planes"] != other["planes"]).float().mean((0, 2, 3))
        assert (more[:5] > 0).all() and more[:5].mean() > 1e-3 and more[5] == 0, more
        same += torch.equal(one["picture"], third["picture"])
        assert np.isclose(one["planes"].sum(), third["planes"].sum(), rtol=1e-4)
    assert same < 4


def test_drawn_sequences():
    """Light that moves smoothly; the same events whatever else is drawn; all models see the same light."""
    made = sequence(1, 3, DRAWN)
    assert made.pictures.shape == (61, 48, 48) and made.times_us[-1] == DRAWN.duration_us
    np.testing.assert_array_equal(sequence(1, 3, DRAWN).events, made.events)
    other = sequence(1, 3, dataclasses.replace(DRAWN, model="esim"))
    np.testing.assert_array_equal(other.pictures, made.pictures)
    assert len(other.events) != len(made.events) > 100
    assert not np.array_equal(sequence(2, 3, DRAWN).pictures, made.pictures)
    for seed in range(4):
        times_us, planes = light(np.random.default_rng(seed), DRAWN)
        assert (planes > 0).all() and np.percentile(planes, 99) == pytest.approx(1, rel=1e-3)
        assert len(planes) == len(times_us) and np.diff(times_us).max() <= 2000
        assert np.abs(np.diff(planes, axis=0)).mean() < 0.05


def test_training_continues(trainable, tmp_path):
    """Stopped and continued: the same network as in an unbroken run; the loss falls on one clip."""
    rates = [SHORT.rate(step) / SHORT.learning_rate for step in range(4)]
    assert np.allclose(rates, [1 / 30, 2 / 30, 3 / 30, 4 / 30]), rates
    late = dataclasses.replace(SHORT, steps=100, decay_steps=9)
    assert np.allclose([late.rate(step) / late.learning_rate for step in (50, 90, 95, 99)], [1, 1, 0.5, 0.1])
    found = recordings(sequences(trainable))
    whole = train(found, tmp_path / "whole", SHORT)
    with pytest.raises(KeyboardInterrupt):
        train(found, tmp_path / "parts", SHORT, progress=_stop_at(3))
    config = json.loads((tmp_path / "parts/config.json").read_text())
    write_json(tmp_path / "parts/config.json", config | {"versions": {"pecs": "0.0.9"}})
    with pytest.warns(UserWarning, match=r"parts: versions: began with \{'pecs': '0.0.9'\}, continues with"):
        parts = train(found, tmp_path / "parts", SHORT)
    for a, b in zip(whole.parameters(), parts.parameters(), strict=True):
        assert torch.equal(a, b)
    assert (tmp_path / "whole/log.csv").read_text() == (tmp_path / "parts/log.csv").read_text()
    assert len((tmp_path / "whole/log.csv").read_text().splitlines()) == 5
    wrong("seed: got 1, wanted 2", train, found, tmp_path / "whole", dataclasses.replace(SHORT, seed=2))
    steady = dataclasses.replace(SHORT, steps=40, learning_rate=1e-2, clips=dataclasses.replace(SHORT.clips, windows=5))
    losses = []
    train(found[:1], tmp_path / "steady", steady, progress=lambda _, loss: losses.append(loss))
    assert np.mean(losses[-5:]) < 0.8 * np.mean(losses[:3]), losses


def _stop_at(last):
    def progress(step, _loss):
        if step == last:
            raise KeyboardInterrupt

    return progress


def test_bfloat16_has_the_same_losses():
    """Also on CPUs that emulate it, after 24 windows of the state."""
    item = {"planes": torch.rand(1, 24, 6, 32, 32), "picture": torch.rand(1, 24, 1, 32, 32)}
    found = []
    for half in (False, True):
        torch.manual_seed(1)
        net = RecurrentUNet(NetworkConfig(channels=8))
        with mock.patch("pecs.learning.train.cpu_has_bfloat16", lambda half=half: half):
            losses = learn(net, torch.optim.Adam(net.parameters(), 1e-3), item, TrainConfig())
        found.append([*losses.parts.values(), *(w.detach().norm() for w in net.parameters())])
    np.testing.assert_allclose(*found, rtol=0.02, atol=2e-3)
    assert found[0][0] != found[1][0]


def test_nan_keeps_the_checkpoint(trainable, tmp_path):
    found = recordings(sequences(trainable))
    calls = 0

    def similar(a, b):
        nonlocal calls
        calls += 1
        return ssim(a, b) * (math.nan if calls > 3 * 2 else 1)

    with mock.patch("pecs.learning.train.ssim", similar):
        wrong("step 3: loss: got nan, wanted a number; ", train, found, tmp_path / "nan", SHORT)
    there = torch.load(tmp_path / "nan/checkpoint.pt")
    assert there["step"] == 2 and all(torch.isfinite(v).all() for v in there["network"].values())
    train(found, tmp_path / "nan", SHORT)  # goes on from there
    wild = dataclasses.replace(SHORT, save_every=1, clips=dataclasses.replace(SMALL, chunk=5))
    with mock.patch.object(TrainConfig, "rate", lambda self, step: math.inf):
        wrong("step 1: weight down.0.weight: got", train, found, tmp_path / "wild", wild)
    assert not (tmp_path / "wild/checkpoint.pt").exists()


def wrong(words, call, *given):
    """The one line that it stops with."""
    with pytest.raises(PecsError) as e:
        call(*given)
    assert words in str(e.value) and "\n" not in str(e.value), e.value


def weights_of_lpips(scratch, trunk):
    """Random ones of a trunk, the published linear layers; as the package writes them."""
    path = scratch / f"{trunk}.pth"
    if not path.exists():
        torch.manual_seed(1)
        warnings.simplefilter("ignore")  # of torchvision, about its old names
        torch.save(lpips.LPIPS(net=trunk, pnet_rand=True, verbose=False).state_dict(), path)
    return path


def test_lpips_is_its_authors(tmp_path):
    """The package lpips gives the same distances."""
    for trunk, sizes in (("alex", ((64, 50), (31, 31))), ("vgg", ((48, 40),))):
        path = weights_of_lpips(tmp_path, trunk)
        theirs = lpips.LPIPS(net=trunk, pnet_rand=True, verbose=False)
        theirs.load_state_dict(torch.load(path))
        for size in sizes:
            a = torch.rand(2, 1, *size)
            b = (a + 0.2 * torch.randn_like(a)).clamp(0, 1)
            with torch.no_grad():
                wanted = theirs(*((2 * x - 1).repeat(1, 3, 1, 1) for x in (a, b))).flatten()
            assert float(wanted.min()) > 1e-3
            assert torch.allclose(Lpips(path)(a, b), wanted, rtol=1e-5, atol=0)
    black = torch.zeros(1, 1, 64, 64, requires_grad=True)
    Lpips(weights_of_lpips(tmp_path, "alex"))(black, torch.zeros(1, 1, 64, 64)).sum().backward()
    assert torch.isfinite(black.grad).all()


def test_wrong_weights_of_lpips(trainable, tmp_path):
    values = torch.load(weights_of_lpips(tmp_path, "alex"))
    for name, content, words in (
        ("no_linear", {k: v for k, v in values.items() if not k.startswith("lin")}, "Missing key(s) ..."),
        ("linear", {k: v for k, v in values.items() if k.startswith("lin")}, "Missing key(s) ..."),
        ("shape", values | {"net.slice2.3.weight": torch.zeros(192, 64, 3, 3)}, "file: got Error(s) in loading"),
        (
            "nan",
            values | {"lin2.model.1.weight": torch.full((1, 384, 1, 1), math.nan)},
            "lin2.model.1.weight: got values that are not finite",
        ),
        ("list", [1, 2], "wanted a state dict of lpips.LPIPS"),
    ):
        torch.save(content, tmp_path / f"{name}.pth")
        wrong(words, Lpips, tmp_path / f"{name}.pth")
    wrong("file: got", Lpips, trainable / "other.onnx")
    wrong("nothing.pth: no such file", Lpips, tmp_path / "nothing.pth")


def test_training_by_lpips(trainable, tmp_path):
    """The loss is LPIPS, falls, and belongs to the run's configuration."""
    found, weights = recordings(sequences(trainable)), weights_of_lpips(tmp_path, "alex")
    config = dataclasses.replace(SHORT, steps=8, learning_rate=1e-2, decay_steps=0)
    train(found[:1], tmp_path / "by_lpips", config, lpips_weights=weights)
    rows = np.genfromtxt(tmp_path / "by_lpips/log.csv", delimiter=",", names=True)
    assert np.allclose(rows["loss"], rows["lpips"], rtol=1e-4)
    assert rows["lpips"][-3:].mean() < 0.95 * rows["lpips"][0], rows["lpips"]
    assert trained(tmp_path / "by_lpips")[1]["config"]["lpips_sha256"] == Lpips(weights).sha256
    wrong("lpips_sha256: got", train, found, tmp_path / "by_lpips", config)
    tiny = dataclasses.replace(config, clips=dataclasses.replace(SMALL, crop=24))
    wrong("got 24 px, wanted 31 or more", lambda: train(found, tmp_path / "tiny", tiny, lpips_weights=weights))


def test_another_device_is_refused(trainable, tmp_path):
    """In one line, before anything is written."""
    found = recordings(sequences(trainable))
    for device in ("nothing", *([] if torch.cuda.is_available() else ["cuda"])):
        wrong(f"--device: got '{device}'", lambda device=device: train(found, tmp_path / "d", SHORT, device=device))
    assert not (tmp_path / "d").exists()


def test_onnx_is_the_network(run, tmp_path):
    """Window after window, on a picture whose sides the levels cannot halve; weights are stored in half precision."""
    rng, file = np.random.default_rng(1), tmp_path / "n.onnx"
    export(run, file)
    width, height = 50, 37
    ours, (net, _) = Network(file, width, height), trained(run)
    high, wide = (-(-n // 4) * 4 for n in (height, width))
    states = start_states(net, 1, high, wide)
    for k in range(4):
        events = np.zeros(500, [("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")])
        events["t"] = np.sort(rng.integers(10_000 * k, 10_000 * (k + 1), 500))
        events["x"], events["y"] = rng.integers(0, width, 500), rng.integers(0, height, 500)
        events["p"] = rng.integers(0, 2, 500)
        window = Window(10_000 * k, 10_000 * (k + 1), events)
        grid = voxel_grid(events, width, height, 5, window.begin_us, window.end_us)
        planes = compressed(np.pad(grid, ((0, 0), (0, high - height), (0, wide - width))), 10_000)
        with torch.no_grad():
            picture, states = net(torch.from_numpy(planes)[None], states)
        error = np.abs(ours(window) - picture[0, 0, :height, :width].numpy().clip(0, 1)).max()
        assert error < 2e-3, (k, error)
    theirs = onnx.load(str(file))
    del theirs.metadata_props[:]
    onnx.save(theirs, str(tmp_path / "theirs.onnx"))
    wrong("pecs_network: got null, wanted 2: a network of `pecs train`", Network, tmp_path / "theirs.onnx", 8, 8)


def test_training_starts_with_a_network(trainable, tmp_path):
    """Its weights, to half precision, are there after a step that changes them little; it belongs to the run."""
    found, file = recordings(sequences(trainable)), tmp_path / "n.onnx"
    first = train(found, tmp_path / "first", SHORT)
    export(tmp_path / "first", file)
    config = dataclasses.replace(SHORT, steps=1, learning_rate=1e-6, seed=2)
    net = train(found, tmp_path / "on", config, weights=file)
    for ours, theirs in zip(net.parameters(), first.parameters(), strict=True):
        assert torch.allclose(ours, theirs, rtol=1e-3, atol=1e-4)
    wrong("weights_sha256: got", train, found, tmp_path / "on", config)
    wider = dataclasses.replace(config, network=NetworkConfig(channels=6, levels=2))
    wrong("n.onnx: network: got", lambda: train(found, tmp_path / "w", wider, weights=file))
    wrong("no.onnx: no such file", lambda: train(found, tmp_path / "w", config, weights=tmp_path / "no.onnx"))
    assert not (tmp_path / "w").exists()


def test_a_checkpoint_of_another_network(trainable, tmp_path):
    """Is refused and kept, when training continues and when it is exported."""
    found, run = recordings(sequences(trainable)), tmp_path / "swapped"
    train(found, tmp_path / "wider", dataclasses.replace(SHORT, network=NetworkConfig(channels=6), steps=1))
    train(found, run, dataclasses.replace(SHORT, steps=1))
    content = (tmp_path / "wider/checkpoint.pt").read_bytes()
    for there in (content, b"no checkpoint"):
        (run / "checkpoint.pt").write_bytes(there)
        words = "wanted a checkpoint of "
        wrong(words, train, found, run, dataclasses.replace(SHORT, steps=1))
        wrong(words, export, run, tmp_path / "swapped.onnx")
        assert (run / "checkpoint.pt").read_bytes() == there


def test_the_network_that_ships():
    """Small, with its record, and better than the filter on drawn sequences that it never saw."""
    assert WEIGHTS.stat().st_size < 400_000
    errors = []
    for number in (2, 10, 14):  # those with most events of the first 20
        made = sequence(number, 999, ProceduralConfig(duration_us=1_000_000))
        side = made.pictures.shape[1]
        methods = Network(WEIGHTS, side, side), Filter(side, side, 1.0)
        assert methods[0].record["config"]["seed"] != 999
        for k in range(4, len(made.times_us), 4):
            begin, end = map(float, made.times_us[[k - 4, k]])
            events = made.events[slice(*np.searchsorted(made.events["t"], (begin, end)))]
            shown = [method(Window(begin, end, events)) for method in methods]
            if k >= 80:
                errors.append([((picture - made.pictures[k] / 255) ** 2).mean() for picture in shown])
    ours, theirs = np.mean(errors, 0)
    assert ours < 0.25 * theirs, (ours, theirs)


def test_train_and_reconstruct_as_commands(trainable, recording, tmp_path):
    def run(*words, code=0):
        done = run_module("pecs.learning", *words, check=False, env=os.environ | {"OMP_NUM_THREADS": "1"})
        assert done.returncode == code, done.stderr
        return done.stdout + done.stderr

    small = ("--channels", 4, "--steps", 2, "--batch", 1, "--windows", 3, "--crop", 32)
    assert "2 steps" in run("train", trainable, "-o", tmp_path / "run", *small)
    assert "2 steps" in run("train", "-o", tmp_path / "drawn", "--sequences", 1, "--model", "esim", *small)
    for other in (("--sequences", 2, "--model", "esim"), ("--sequences", 1)):  # a run of other sequences
        said = run("train", "-o", tmp_path / "drawn", *other, *small, code=5)
        assert "config.json: data: got '1 drawn, esim', wanted " in said
    assert "data: got '1 drawn, esim', wanted '1 of a set" in run(
        "train", trainable, "-o", tmp_path / "drawn", *small, code=5
    )
    # before any of 100,000 sequences is drawn
    assert "wanted a multiple of 16" in run(
        "train", "-o", tmp_path / "r7", "--sequences", 100_000, "--crop", 17, code=4
    )
    assert "wanted at most 160" in run("train", "-o", tmp_path / "r7", "--sequences", 100_000, "--crop", 176, code=2)
    none = ("reconstruct", recording[0], "-o", tmp_path / "n.mp4", "--weights", tmp_path / "no.onnx")
    assert "no.onnx: no such file or folder, wanted a network" in run(*none, code=3)
    network = tmp_path / "run/network.onnx"
    assert "pictures" in run("reconstruct", recording[0], "-o", tmp_path / "v.mp4", "--weights", network)
    count = run("reconstruct", recording[0], "-o", tmp_path / "s.mp4").partition(": ")[2]
    assert ", by network" in count
    assert count == run("reconstruct", recording[0], "-o", tmp_path / "t.mp4", "--smooth").partition(": ")[2]
    assert ", by filter" in run("reconstruct", recording[0], "-o", tmp_path / "f.mp4", "--method", "filter")
    assert "--sequences does not go" in run("train", trainable, "-o", tmp_path / "r6", "--sequences", 3, code=2)
    assert "--split requires" in run("train", "-o", tmp_path / "r6", "--split", "val", code=2)
    assert "no sequences of split 'test'" in run("train", trainable, "-o", tmp_path / "r2", "--split", "test", code=3)
    assert "--device: got 'gpu'" in run("train", trainable, "-o", tmp_path / "r4", "--device", "gpu", code=2)
    other = ("train", trainable, "-o", tmp_path / "r5", "--lpips-weights", tmp_path / "no.pth")
    assert "no.pth: no such file or folder, wanted weights of LPIPS" in run(*other, code=3)
    assert "wanted 80 px" in run("train", trainable, "-o", tmp_path / "r3", "--crop", 80, code=4)


class Mark:
    """Makes a file when it is unpickled."""

    def __init__(self, path):
        self.path = str(path)

    def __reduce__(self):
        return open, (self.path, "w")


@pytest.fixture
def run(tmp_path):
    """A folder of training after its last step, without the training."""
    net = RecurrentUNet(SHORT.network)
    (tmp_path / "run").mkdir()
    _save(tmp_path / "run", net, torch.optim.Adam(net.parameters()), 4)
    write_json(tmp_path / "run/config.json", {"config": dataclasses.asdict(SHORT), "versions": {}})
    return tmp_path / "run"


@pytest.mark.parametrize("legacy", [False, True])
def test_the_code_of_a_checkpoint_does_not_run(run, legacy, tmp_path):
    content = {"network": Mark(tmp_path / "ran"), "optimiser": {}, "step": 1}
    torch.save(content, run / "checkpoint.pt", _use_new_zipfile_serialization=not legacy)
    wrong("checkpoint.pt: file: got", trained, run)
    torch.save(content, tmp_path / "lpips.pth", _use_new_zipfile_serialization=not legacy)
    wrong("lpips.pth: file: got", Lpips, tmp_path / "lpips.pth")
    assert not (tmp_path / "ran").exists()


def edited(**values):
    config = dataclasses.asdict(SHORT)
    for key, value in values.items():
        (config if key in config else config["clips"] if key in config["clips"] else config["network"])[key] = value
    return json.dumps({"config": config}).encode()


DAMAGED = {
    "config.json": (b"", b"[]", b"null", b"[" * 100_000, b"\xff", b"{}", b'{"config": {"x": 1}}', edited(crop=1))
    + (edited(channels=10**6), edited(seed=10**20), edited(levels=2.5), edited(learning_rate="x")),
    "log.csv": (b"\xff", b"step,loss\nx,1\n", b"step,loss\n1\n"),
}


@pytest.mark.parametrize(("name", "content"), [(name, content) for name, all_ in DAMAGED.items() for content in all_])
def test_a_damaged_run_is_one_line(run, name, content):
    (run / name).write_bytes(content)
    wrong(name, trained if name == "config.json" else partial(_Log, run), *([run] if name == "config.json" else [4]))


def test_a_damaged_checkpoint_is_one_line(run):
    net = RecurrentUNet(SHORT.network)
    optimiser, other = torch.optim.Adam(net.parameters()), torch.ones(1)
    averages = {"step": torch.tensor(1.0), "exp_avg": other, "exp_avg_sq": other}
    states = [("optimiser", {0: {"x": 1}}), ("optimiser", {0: averages}), ("optimiser", {99: averages})]
    for key, value in (("step", None), ("step", "x"), ("step", -1), ("optimiser", [1]), *states):
        content = {"network": net.state_dict(), "optimiser": {}, "step": 1} | {key: value}
        torch.save(content, run / "checkpoint.pt")
        wrong("checkpoint.pt", _resume, run, net, optimiser, "cpu")


def external(model):
    """A model whose answer is the beginning of a file of the system."""
    tensor = onnx.TensorProto(name="o", data_type=onnx.TensorProto.FLOAT, dims=[1, 1, 1, 5], data_location=1)
    for key, value in (("location", "/etc/passwd"), ("offset", "0"), ("length", "20")):
        tensor.external_data.add(key=key, value=value)
    model.graph.initializer.append(tensor)


def answering(value, shape=(), kind=onnx.TensorProto.FLOAT):
    """The answer is a constant of a shape, or the first bin times a number."""

    def change(model):
        graph = model.graph
        states = [(i.name, o.name) for i, o in zip(graph.input[1:], graph.output[1:], strict=True)]
        del graph.node[:]
        if shape:
            graph.initializer.append(onnx.helper.make_tensor("own", kind, shape, [value] * math.prod(shape)))
            graph.node.append(onnx.helper.make_node("Identity", ["own"], ["picture"]))
            graph.output[0].type.CopyFrom(onnx.helper.make_tensor_type_proto(kind, None))
        else:
            one = [("zero", [0]), ("one", [1])]
            for name, at in one:
                graph.initializer.append(onnx.helper.make_tensor(name, onnx.TensorProto.INT64, [1], at))
            graph.initializer.append(onnx.helper.make_tensor("factor", onnx.TensorProto.FLOAT, [], [value]))
            graph.node.append(onnx.helper.make_node("Slice", ["planes", "zero", "one", "one"], ["bin"]))
            graph.node.append(onnx.helper.make_node("Mul", ["bin", "factor"], ["picture"]))
        graph.node.extend(onnx.helper.make_node("Identity", [a], [b]) for a, b in states)

    return change


def recorded(text=None, **values):
    """Another record."""

    def change(model):
        props = {p.key: p.value for p in model.metadata_props}
        record = json.loads(props["record"])
        record["network"].update(values)
        onnx.helper.set_model_props(model, props | {"record": json.dumps(record) if text is None else text})

    return change


def renamed(model):
    model.graph.input[0].name = "x"
    for node in model.graph.node:
        node.input[:] = ["x" if name == "planes" else name for name in node.input]


NETWORKS = [
    (external, "weights in another file"),
    (answering(math.nan), "answer: got nan, wanted finite numbers"),
    (answering(0.5, (1, 1, 2, 2)), "answer: got float32 [1, 1, 2, 2], wanted float32 [1, 1, 24, 32]"),
    (answering(b"x", (1, 1, 24, 32), onnx.TensorProto.STRING), "answer: got"),
    (renamed, "inputs: got"),
    *((recorded(text), "record") for text in ("hello", "[]", "[" * 100_000, "{}")),
    *((recorded(levels=value), "record.network.levels: got") for value in (40, 10**6, -1, "x")),
    *((recorded(bins=value), "record.network.bins: got") for value in (0, -3, 10**9)),
    (recorded(kind="<script>"), "record.network.kind: "),
]


@pytest.mark.parametrize(("change", "words"), NETWORKS)
def test_a_wrong_network_is_one_line(run, change, words, tmp_path, capfd):
    export(run, tmp_path / "n.onnx")
    model = onnx.load(tmp_path / "n.onnx", load_external_data=False)
    change(model)
    (tmp_path / "n.onnx").write_bytes(model.SerializeToString())
    events = np.zeros(4, [("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")])
    wrong(words, lambda: Network(tmp_path / "n.onnx", 32, 24)(Window(0.0, 1.0, events)))
    assert "onnxruntime" not in capfd.readouterr().err
