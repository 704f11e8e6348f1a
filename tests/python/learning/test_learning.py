"""pecs.learning without PyTorch: the filter and pictures of event files."""

from functools import partial

import cv2
import numpy as np
import pecs
import pytest
from pecs.learning import smooth
from pecs.learning.filter import HighPass
from pecs.learning.reconstruct import Window, late_us, windows
from pecs.learning.video import Range
from pecs_lab.disk import Disk, edges
from support import run_module

W, H = 96, 72
learning = partial(run_module, "pecs.learning")


def test_the_filter_is_that_of_every_event(recording):
    _, events = recording
    some, cutoff_hz, up, down = events[:3000], 5.0, 0.3, 0.2
    state, last = np.zeros((H, W)), np.zeros((H, W))
    for e in some:  # event by event, as the paper has it
        at = e["y"], e["x"]
        state[at] *= np.exp(-2 * np.pi * cutoff_hz * (e["t"] - last[at]) * 1e-6)
        state[at] += up if e["p"] else -down
        last[at] = e["t"]
    end = float(some["t"][-1] + 500)
    state *= np.exp(-2 * np.pi * cutoff_hz * (end - last) * 1e-6)
    ours = HighPass(W, H, cutoff_hz, up, down)
    for first in range(0, 2500, 500):
        ours.push(some[first : first + 500], float(some["t"][first + 499]))
    np.testing.assert_allclose(ours.push(some[2500:], end), state, rtol=1e-9, atol=1e-12)


def test_windows_hold_every_event_once(recording):
    path, events = recording
    for length_us, after_us in ((700.0, 0.0), (1e6 / 480, 0.0), (33_333.4, 40_000.0), (1e9, 0.0), (20_000.0, 60_000.0)):
        with pecs.EventReader(path) as reader:
            found = list(windows(reader, length_us, after_us))
        np.testing.assert_array_equal(np.concatenate([w.events for w in found]), events)
        assert found[0].begin_us <= events["t"][0] < found[0].end_us
        assert min(abs(w.begin_us - events["t"][0] - after_us) for w in found) < 1e-3
        assert found[-1].begin_us <= events["t"][-1] < found[-1].end_us
        for w, after in zip(found, found[1:], strict=False):
            assert w.end_us == after.begin_us
            assert not len(w.events) or (w.begin_us <= w.events["t"][0] and w.events["t"][-1] < w.end_us)


def test_the_range_follows_slowly():
    shown, rng = Range(), np.random.default_rng(1)
    assert shown(rng.normal(5, 1, (H, W))).mean() == pytest.approx(0.5, abs=0.02)
    assert shown(rng.normal(9, 1, (H, W))).mean() > 0.9  # not yet
    for _ in range(50):
        last = shown(rng.normal(9, 1, (H, W)))
    assert last.mean() == pytest.approx(0.5, abs=0.02)


def test_video_and_pictures(recording, tmp_path):
    path, events = recording
    count = int((events["t"][-1] - events["t"][0]) // 10_000) + 1
    learning("reconstruct", path, "-o", tmp_path / "v.mp4", "--method", "filter")
    video = cv2.VideoCapture(str(tmp_path / "v.mp4"))
    assert (video.get(cv2.CAP_PROP_FRAME_WIDTH), video.get(cv2.CAP_PROP_FRAME_HEIGHT)) == (W, H)
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == count and video.get(cv2.CAP_PROP_FPS) == 100
    line = events[(events["y"] == 0) & (events["x"] < W - 1)]
    pecs.write(tmp_path / "line.raw", line, W - 1, 1)  # encoders take even sizes: the last row and column appear twice
    learning("reconstruct", tmp_path / "line.raw", "-o", tmp_path / "v.mp4", "--method", "filter")
    assert cv2.VideoCapture(str(tmp_path / "v.mp4")).read()[1].shape == (2, W, 3)
    learning("reconstruct", path, "-o", tmp_path / "p", "--fps", 100, "--method", "filter")
    pictures = [cv2.imread(str(p), cv2.IMREAD_UNCHANGED) for p in sorted((tmp_path / "p").iterdir())]
    assert len(pictures) == count and all(p.shape == (H, W) and p.dtype == np.uint8 for p in pictures)
    assert sorted(p.name for p in tmp_path.iterdir() if not p.name.startswith("line")) == ["p", "v.mp4"]


def test_pictures_of_dim_light_are_earlier(recording, tmp_path):
    """A picture shows what the events after it say: those of a fast pixel, `late_us` later."""
    path, events = recording
    late = round(late_us(5.0))
    assert 10_000 < late < 15_000 and late_us(None) == 0
    later = events.copy()
    later["t"][1:] += late  # the first event gives the time
    pecs.write(tmp_path / "late.raw", later, W, H)
    for file, name, more in ((path, "p", ()), (tmp_path / "late.raw", "q", ("--corner", 5))):
        words = file, "-o", tmp_path / name, "--fps", 50, "--method", "filter", "--cutoff", "0.01Hz", *more
        learning("reconstruct", *words)
    shown, again = ([cv2.imread(str(p), 0).astype(float) for p in sorted((tmp_path / n).iterdir())] for n in "pq")
    assert len(again) == len(shown) == 14
    apart = [np.abs(a - b).mean() for a, b in zip(shown[-3:], again[-3:], strict=True)]
    assert max(apart) < 4, apart  # the range of grey values follows slowly
    words = (path, "-o", tmp_path / "x.mp4", "--method", "filter", "--corner", 0.1)
    assert "events are late (--corner)" in learning("reconstruct", *words, check=False).stderr


class Count:
    """A network whose picture is the number of ON minus that of OFF events of all windows so far."""

    size = 1, 2
    windows = []

    def __init__(self):
        self.sum = 0.0

    def __call__(self, window):
        t = window.events["t"]
        assert not len(t) or (window.begin_us <= t[0] and t[-1] < window.end_us and (np.diff(t) >= 0).all())
        self.windows.append((window.begin_us, window.end_us))
        self.sum = self.sum + 2.0 * window.events["p"].sum() - len(t)
        return np.array([[-1.0, 1.0]]) + self.sum


@pytest.mark.parametrize(("length_us", "several"), [(100_000.0, 1), (40_000.0, 1), (20_000.0, 2), (13_333.4, 3)])
def test_smooth_pictures_know_before_and_after(monkeypatch, length_us, several):
    """Windows of 40 ms or of a picture, in turn, each event once in each turn and direction; blocks end anywhere."""
    rng, n = np.random.default_rng(2), 23
    events = np.zeros(4000, pecs.EVENT_DTYPE)
    events["t"], events["p"] = np.sort(rng.integers(0, int(n * length_us), 4000)), rng.random(4000) < 0.7
    cuts = np.searchsorted(events["t"], np.arange(n + 1) * length_us)
    made = [Window(k * length_us, (k + 1) * length_us, events[cuts[k] : cuts[k + 1]]) for k in range(n)]
    summed = np.array([0, *np.cumsum([2.0 * w.events["p"].sum() - len(w.events) for w in made])])

    def shown():
        return [picture.mean() for picture in smooth.smooth(Count(), iter(made), length_us)]

    def forward(k):
        return summed[k + 1]  # windows of a turn follow each other

    def backward(k, end):
        return summed[k + 1] - summed[end]

    def steady(values):
        weights = {1: [1], 2: [0.25, 0.5, 0.25], 3: [1 / 3] * 3}[several]
        return np.convolve(np.pad(values, len(weights) // 2, mode="edge"), weights, "valid")

    whole = shown()  # one block
    wanted = [(forward(k) + backward(k, n)) / 2 for k in range(n - 1)]
    np.testing.assert_allclose(whole, steady([*wanted, forward(n - 1)]), rtol=1e-6)
    assert {round(end - begin) for begin, end in Count.windows} == {round(several * length_us)}
    for block, ahead in ((4, 2), (7, 3), (1, 1)):
        monkeypatch.setattr(smooth, "BLOCK_US", block * length_us)
        monkeypatch.setattr(smooth, "AHEAD_US", ahead * length_us)
        reach = max(several, min(ahead, block // 2))
        wanted = []
        for k in range(n - 1):
            end = min(k - k % block + block + reach, n)
            wanted.append((forward(k) + backward(k, end)) / 2 if k + 1 < end else forward(k))
        np.testing.assert_allclose(shown(), steady([*wanted, forward(n - 1)]), rtol=1e-6, err_msg=f"{block} {ahead}")
    assert len(list(smooth.smooth(Count(), iter(made[:1]), length_us))) == 1
    assert not list(smooth.smooth(Count(), iter(()), length_us))
    Count.windows.clear()


def test_what_is_wrong_is_one_line(recording, tmp_path):
    path, events = recording
    pecs.write(tmp_path / "none.raw", events[:0], W, H)
    pecs.write(tmp_path / "bare.csv", events)
    by_pixel = events[np.lexsort((events["t"], events["x"]))]
    np.savez(tmp_path / "by_pixel.npz", **{name: by_pixel[name] for name in "txyp"}, width=W, height=H)
    (tmp_path / "text.onnx").write_text("no network")
    (tmp_path / "there").mkdir()
    for words, code, line in (
        ((tmp_path / "no.raw", "-o", "x.mp4"), 3, "no.raw"),
        ((tmp_path / "text.onnx", "-o", tmp_path / "x.mp4"), 4, "text.onnx"),
        ((tmp_path / "none.raw", "-o", tmp_path / "x.mp4", "--method", "filter"), 4, "the file has no events"),
        ((tmp_path / "by_pixel.npz", "-o", tmp_path / "x.mp4", "--method", "filter"), 4, "an event earlier than one"),
        ((path, "-o", tmp_path / "x.avi", "--method", "filter"), 5, "wanted .mp4"),
        ((path, "-o", tmp_path / "no/x.mp4", "--method", "filter"), 5, "cannot be written"),
        ((path, "-o", tmp_path / "there", "--method", "filter"), 5, "exists"),
        ((path, "-o", tmp_path / "x.mp4", "--fps", 0), 2, "--fps"),
        (
            (path, "-o", tmp_path / "x.mp4", "--playback-fps", 1e-9, "--method", "filter"),
            5,
            f"no video encoder could be opened for {W}x{H} at 1e-09 Hz",
        ),
        ((tmp_path / "bare.csv", "-o", tmp_path / "x.mp4", "--size", "40x30", "--method", "filter"), 4, "inside 40x30"),
        ((path, "-o", tmp_path / "x.mp4", "--size", "640x480", "--method", "filter"), 4, "as the file states"),
        ((path, "-o", tmp_path / "x.mp4", "--weights", tmp_path / "no.onnx"), 3, "no.onnx"),
        ((path, "-o", tmp_path / "x.mp4", "--weights", tmp_path / "no.onnx", "--method", "filter"), 2, "no weights"),
        ((path, "-o", tmp_path / "x.mp4", "--cutoff", "5Hz"), 2, "no cutoff frequency"),
        ((path, "-o", tmp_path / "x.mp4", "--smooth", "--method", "filter"), 2, "no later events"),
    ):
        result = learning("reconstruct", *words, check=False)
        said = result.stderr.strip().splitlines()
        assert result.returncode == code and len(said) == 1 and line in said[0], (words, result.stderr)
    assert {p.suffix for p in tmp_path.glob("x*")} <= {".partial"}


def test_edges_of_a_drawn_disk():
    """Drawn with its edges 3 px behind, and blurred: found there, as wide; nothing is found in noise."""
    disk = Disk((61.3, 58.8), 50.0, 2000.0, 20.0, 4)
    at_us, behind_px = 7000.0, 3.0
    y, x = (np.mgrid[:960, :960] + 0.5) / 8  # eight samples a pixel
    right, up = x - disk.centre_px[0], disk.centre_px[1] - y
    behind_deg = np.degrees(behind_px / np.maximum(np.hypot(right, up), 1))
    turned = np.degrees(np.arctan2(up, right)) - disk.on_edge_deg - disk.speed_deg_s * at_us * 1e-6 + behind_deg
    sharp = (np.floor(turned / 90) % 2).astype(np.float32)  # behind a leading edge it is white
    picture = cv2.resize(sharp, (120, 120), interpolation=cv2.INTER_AREA)
    blurred = cv2.GaussianBlur(picture, (0, 0), 2.0)
    for seen, wide in ((picture, 1.3), (blurred, 2.56 * 2)):  # of a pixel between pixels; 10 to 90 % of a Gaussian
        ahead, width = edges(seen, disk, at_us)
        assert ahead.shape == (4, len(ahead[0])) and np.isfinite(ahead).all()
        np.testing.assert_allclose(ahead, -behind_px, atol=0.4)
        assert np.median(width) == pytest.approx(wide, rel=0.3, abs=0.3)
    for nothing in (1 - picture, np.random.default_rng(1).random((120, 120))):
        assert np.isfinite(edges(nothing, disk, at_us)[0]).mean() < 0.05
