"""`pecs fit --davis`: recordings of a camera with known values, in each form that is read."""

import json
import shutil
from dataclasses import replace
from functools import partial

import cv2
import numpy as np
import pecs
import pytest
from pecs.fit import Davis, davis_fit, fit_davis
from pecs.fit.davis import measure_moving, unseen
from pecs.fit.davis_recording import DavisEvents, load_davis
from pecs_lab import davis_scene
from support import run_module

SIZE = 96, 72
COLOURS = np.full((*SIZE[::-1], 3), (1, 2, 3), np.uint8)
run = partial(run_module, "pecs.fit", check=False)

VALUES = {
    "contrast_threshold_on": 0.24, "contrast_threshold_off": 0.2, "threshold_mismatch": 0.1, "noise_std": 0.035,
    "background_on_hz": 0.2, "frame_step": 0.12, "frame_step_spread": 0.4, "frame_gain_e": 300,
    "frame_period_s": 0.07, "frame_exposure_s": 0.03, "frame_dead_s": 0.005, "hot_pixel_fraction": 0.004,
    "hot_pixel_hz": 40,
}  # fmt: skip


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("davis") / "recording"
    davis_scene.record(folder, 7, VALUES, size=SIZE, moving_s=1.5, still_s=0.8)
    return folder


@pytest.fixture(scope="module")
def found(recording):
    return fit_davis(Davis(recording), "davis240c", pixels=512)


@pytest.mark.parametrize("key", sorted(VALUES.keys() - {"frame_gain_e", "frame_dead_s"}))
def test_values_are_within_their_intervals(found, key):
    """Within three standard deviations."""
    of = found.values[key]
    low, high = ((3 / 1.96) * (end - of.value) for end in of.interval)
    assert of.fitted and low - 1e-6 <= VALUES[key] - of.value <= high + 1e-6, (VALUES[key], of)


def test_thresholds_are_known_to_a_tenth(found):
    for key in ("contrast_threshold_on", "contrast_threshold_off"):
        assert abs(found.values[key].value / VALUES[key] - 1) < 0.1


def test_the_command_writes_a_profile_that_a_chip_reads(recording, tmp_path):
    out, report, numbers = (tmp_path / name for name in ("my.json", "fit.html", "numbers.json"))
    done = run("--davis", recording, "-o", out, "--chip", "davis240c", "--pixels", 128, "--report", report,
               "--numbers", numbers)  # fmt: skip
    assert "contrast_threshold_on: 0.2" in done.stdout and "leak_rate_hz: kept at 0.037" in done.stdout
    values = json.loads(numbers.read_text())["values"]
    chip = pecs.Chip(out).info["values"]
    for key in ("contrast_threshold_on", "frame_step", "frame_period_s"):
        assert chip[key]["value"] == pytest.approx(values[key]["value"], rel=1e-3)
    assert "moving frames" in report.read_text()


def test_the_starting_profile_is_that_of_the_size():
    assert davis_fit.chip_of((180, 240)) == "davis240c" and davis_fit.chip_of((260, 346)) == "davis346"


def test_exposures_are_found_where_only_instants_are_known(recording, found, tmp_path):
    """Stamps as those of ROS or images.txt, at any place of the exposure: bursts show begin and end."""
    folder = tmp_path / "stamped"
    shutil.copytree(recording, folder)
    table = np.loadtxt(folder / "exposures.csv", delimiter=",", skiprows=1)
    lines = [f"{(row[1] + 21_000) * 1e-6:.6f} frames/{int(row[0]):04}.png\n" for row in table]
    (folder / "exposures.csv").unlink()
    (folder / "images.txt").write_text("".join(lines))
    stamped = fit_davis(Davis(folder), "davis240c", pixels=128)
    assert stamped.values["frame_exposure_s"].value == pytest.approx(0.03, abs=0.0011)
    for key in ("contrast_threshold_on", "contrast_threshold_off"):
        assert stamped.values[key].value == pytest.approx(found.values[key].value, rel=0.04)


def _same(a, b):
    assert (a.events["t"] == b.events["t"]).all() and np.abs(a.frames - b.frames).max() < 0.005


def test_a_bag_is_read_as_the_folder(recording, tmp_path):
    pytest.importorskip("rosbags")
    folder = load_davis(Davis(recording))
    bag, late = tmp_path / "recording.bag", folder.events.copy()
    late[[100, 5000]] = late[[5000, 100]]  # as drivers that lose the order; read as from files
    with pecs.ros.Bag(bag, "ros1") as out:
        for t_ns, data in out.event_messages([late], *folder.shape[::-1], "dvs_msgs", "camera"):
            out.write("/dvs/events", pecs.ros.ARRAYS[0], t_ns, data)
        for picture, begin_us in zip(folder.frames, folder.begin_us, strict=True):
            grey = np.round(255 * picture).astype(np.uint8)
            fields = {"height": grey.shape[0], "width": grey.shape[1], "encoding": "mono8", "is_bigendian": 0}
            header = out.header(int(1000 * begin_us), "camera")
            message = out.message(
                "sensor_msgs/msg/Image", header=header, **fields, step=grey.shape[1], data=grey.ravel()
            )
            out.write("/camera/image_raw", "sensor_msgs/msg/Image", int(1000 * begin_us), out.serialized(message))
    read = load_davis(Davis(bag))
    _same(read, folder)
    assert (read.begin_us == folder.begin_us).all()


def test_aedat4_of_dv_processing_is_read_as_the_folder(recording, tmp_path):
    """Written by the library of the cameras' maker."""
    dv = pytest.importorskip("dv_processing")
    folder, path = load_davis(Davis(recording)), str(tmp_path / "recording.aedat4")
    config = dv.io.MonoCameraWriter.DAVISConfig("DAVIS240C_TEST", SIZE)
    with_events = dv.EventStore()
    for t, x, y, p in folder.events.tolist():
        with_events.push_back(t, x, y, bool(p))
    out = dv.io.MonoCameraWriter(path, config)
    out.writeEvents(with_events)
    for picture, begin_us, end_us in zip(folder.frames, folder.begin_us, folder.end_us, strict=True):
        grey = np.round(255 * picture).astype(np.uint8)
        out.writeFrame(dv.Frame(int(begin_us), int(end_us - begin_us), 0, 0, grey, dv.FrameSource.SENSOR))
    del out
    read = load_davis(Davis(path))
    _same(read, folder)
    assert (read.begin_us == folder.begin_us).all() and (read.end_us == folder.end_us).all()


def _shift(path, by_us):
    events = pecs.read(path)
    events["t"] += by_us
    pecs.write(path, events)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: (f / "exposures.csv").unlink(), "got no times of frames"),
        (lambda f: (f / "frames/0003.png").unlink(), "got no frame 3"),
        (lambda f: (f / "exposures.csv").write_text("frame,begin_us,end_us\n0,1,x\n"), "got no table of 3 columns"),
        (lambda f: (f / "exposures.csv").write_text("frame,begin_s,end_s\n0,1,2\n"), 'got the header "frame,begin_s'),
        (lambda f: (f / "exposures.csv").write_text("0,1,2\n1,3,4\n"), 'got the header "0,1,2", wanted frame,begin'),
        (
            lambda f: ((f / "exposures.csv").unlink(), (f / "images.txt").write_text("nan frames/0000.png\n" * 9)),
            "frames whose times do not rise",
        ),
        (lambda f: cv2.imwrite(str(f / "frames/0003.png"), COLOURS), "in colours"),
        (lambda f: pecs.write(f / "events.npz", pecs.Events(pecs.read(f / "events.npz")[:0], *SIZE)), "got 0 events"),
        (lambda f: (f / "events.raw").write_bytes(b""), "got 2 files events.*"),
        (
            lambda f: _shift(f / "events.npz", 10**9),
            "frames from 0 to .* us and events from 10",
        ),
    ],
)
def test_what_is_no_recording_with_frames_is_refused(recording, tmp_path, change, message):
    folder = tmp_path / "broken"
    shutil.copytree(recording, folder)
    change(folder)
    with pytest.raises(pecs.PecsInputError, match=message):
        load_davis(Davis(folder))


def test_events_that_do_not_follow_the_frames_are_refused(recording, tmp_path):
    folder = tmp_path / "other"
    shutil.copytree(recording, folder)
    events = pecs.read(folder / "events.npz")
    events["y"] = SIZE[1] - 1 - events["y"]
    pecs.write(folder / "events.npz", events)
    with pytest.raises(pecs.PecsInputError, match="wanted at least 0.5"):
        fit_davis(Davis(folder), "davis240c", pixels=128)


def test_frames_that_were_darkened_have_a_value_without_light_below_0(recording):
    of = load_davis(Davis(recording))
    dark = measure_moving(replace(of, frames=np.maximum(of.frames - 0.1, 0)), 0.0)
    whole = measure_moving(of, 0.0)
    assert whole.black > 0 and dark.black == pytest.approx(whole.black - 0.1, abs=0.02)
    assert dark.threshold_on[0] == pytest.approx(whole.threshold_on[0], rel=0.05)


def test_a_recording_with_events_during_exposures_alone_is_noted(recording):
    of = load_davis(Davis(recording))
    after = np.searchsorted(of.begin_us, of.events["t"], "right") - 1
    kept = (after >= 0) & (of.events["t"] < of.end_us[after])
    cut = replace(of, events=pecs.Events(np.asarray(of.events)[kept], *SIZE))
    assert unseen(of) == 0 and unseen(cut) == pytest.approx(4 / 7, abs=0.01)


def test_other_recordings_beside_it_and_chips_without_frames_are_refused(recording, tmp_path):
    for more, message in (
        (("--still", "a.raw=0"), "wanted --davis alone"),
        (("--chip", "imx636"), "got a chip without frames"),
        (("--keep", "nothing"), "got nothing, wanted one of"),
    ):
        done = run("--davis", recording, "-o", tmp_path / "x.json", *more)
        assert done.returncode == 2 and message in done.stderr and not (tmp_path / "x.json").exists()


def test_few_events_do_not_make_all_pixels_hot():
    """The number of hot pixels is not extrapolated from one that has as few events as the least that is found."""
    events = pecs.Events(np.zeros(8, pecs.EVENT_DTYPE), 100, 100)
    events["t"], events["p"] = 20_000 + np.arange(8) * 10_000, 1  # between the exposures
    begin_us = np.array([0.0, 100_000.0])
    of = DavisEvents("made", events, np.zeros((2, 100, 100), np.float32), begin_us, begin_us + 10_000)
    base = {"hot_pixel_fraction": 0.0, "hot_pixel_hz": 10.0}
    found = davis_fit._of_hot_pixels(of, np.array([0]), base)
    assert not found["hot_pixel_fraction"].fitted and found["hot_pixel_fraction"].value == 0
