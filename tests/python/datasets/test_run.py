"""A small set from its recipe, rendered, sensed and checked; stopped, in parts, damaged, and of wrong recipes."""

import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from functools import partial

import numpy as np
import pecs
import pytest
from support import ROOT, run_module

pytest.importorskip("bpy", reason="renders with Cycles")

from pecs.datasets import Sequence, writers
from pecs.datasets.rectify import Rectifier
from pecs.datasets.sequence import frames_of

RECIPE = f"""
name = "small"
seed = 5
sequences = 2
duration_s = 0.015
export = ["dsec"]
[about]
licence = "CC0-1.0"
[[scene]]
path = "{ROOT}/scenes/rotating_disk"
[scene.set]
illuminance_lux = {{log = [200, 2000]}}
rpm = [100, 400]
[[scene.place]]
files = "cube.blend"
low_m = [-0.2, 0.8, -0.1]
high_m = [0.2, 1.0, 0.1]
size_m = [0.1, 0.3]
speed_m_s = 1
spin_deg_s = 300
[scene.trajectory]
kind = "hand_held"
speed_m_per_s = 1.0
volume = [[-0.2, -0.1, -0.1], [0.2, 0.1, 0.1]]
yaw_deg = 90
clearance_m = 0.1
[rig.imu]
part = "ideal"
rate_hz = 1000
[[rig.camera]]
name = "left"
kind = "events"
chip = "davis346"
lens = "cmount_5mm_f2p8"
fnumber = 4
focus_m = 2
width = 48
height = 36
partner = "right"
[[rig.camera]]
name = "right"
kind = "events"
chip = "davis346"
lens = "cmount_5mm_f2p8"
fnumber = 4
focus_m = 2
width = 48
height = 36
position_m = [0.06, 0, 0]
partner = "left"
[rig.camera.options]
samples = 16
[[rig.camera]]
name = "film"
kind = "rgb"
pixels_of = "left"
fps = 100
exposure_ms = 4
[render]
bands = 3
samples = 2
fps = 250
[truth]
fps = 100
"""

WIDE_FILM = """lens = "cmount_5mm_f2p8"
fnumber = 4
focus_m = 2
width = 192
height = 144
pixel_pitch_um = 100"""

CUBE = """
import sys, bpy
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.mesh.primitive_cube_add()
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
"""


dataset = partial(run_module, "pecs.datasets")


def read_png(path):
    import cv2

    return cv2.imread(str(path), cv2.IMREAD_GRAYSCALE).astype(float)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("set")
    subprocess.run([sys.executable, "-c", CUBE, folder / "cube.blend"], check=True, capture_output=True)
    (folder / "r.toml").write_text(RECIPE)
    dataset(folder / "r.toml", "-o", folder / "set")
    return folder


def copy(made, folder):
    for name in ("r.toml", "cube.blend"):
        shutil.copy(made / name, folder / name)


def sums(folder):
    return {p.parent.name: json.loads(p.read_text()) for p in sorted(folder.glob("sequences/*/files.json"))}


def test_all_parts_agree(made):
    for name in ("0000", "0001"):
        checks = json.loads((made / "set/sequences" / name / "checks.json").read_text())
        for camera in ("left", "right"):
            flow = checks["cameras"][camera]["flow"]
            assert flow["count"] > 2000 and flow["rms_px"] < 0.01, flow
            moves = checks["cameras"][camera]["scene_flow"]
            assert moves["count"] > 2000 and moves["rms_m"] < 1e-4, moves
            assert checks["cameras"][camera]["boxes"]["p99_px"] < 0.5
            events = checks["cameras"][camera]["events"]
            assert events["count"] > 50 and events["signal_on_motion"] > 0.95
        (stereo,) = checks["stereo"].values()
        assert stereo["count"] > 1000 and stereo["rms_px"] < 0.05 and stereo["same_surface"] > 0.6
        assert checks["imu"] is None or checks["imu"]["worst_m"] < 1e-3


def test_a_camera_has_its_own_options(made):
    files = [made / "set/sequences/0000" / name / "stack/stack.json" for name in ("left", "right")]
    samples = [json.loads(file.read_text())["render"]["samples"] for file in files]
    assert samples == [8, 16]  # 2 for each of 4 subpixels at least


FILM = """
duration_s = 0.06
[[scene]]
path = "ROOT/scenes/rotating_disk"
[scene.set]
rpm = 300
[scene.trajectory]
kind = "still"
position = [0, 0, 0]
yaw_deg = 90
[[rig.camera]]
name = "left"
kind = "events"
chip = "davis346"
frames = true
VIEW
[[rig.camera]]
name = "frame"
kind = "rgb"
EXPOSURES
pixels_of = "left"
[[rig.camera]]
name = "film"
kind = "rgb"
pixel_pitch_um = 88.9  # as wide as the other camera
EXPOSURES
VIEW
[render]
bands = 3
samples = 16
fps = 500
[truth]
fps = 50
"""
VIEW = 'lens = "cmount_5mm_f2p8"\nfnumber = 4\nfocus_m = 2\nwidth = 72\nheight = 54'
EXPOSURES = "fps = 40\nexposure_ms = 3\nphase_ms = 9"


def filled(recipe):
    return recipe.replace("ROOT", str(ROOT)).replace("VIEW", VIEW).replace("EXPOSURES", EXPOSURES)


def test_a_davis_takes_frames_of_the_light_of_its_events(films):
    left = films.cameras["left"]
    frames = left.frames()
    assert [(f.start_us, f.end_us) for f in frames] == [(20_000, 30_000)]  # periods of 40 ms from a warm-up of 20 ms on
    assert frames_of(films, left) == frames
    with pecs.Light(left.stack_folder, "davis346") as light:
        for frame in frames:
            mean_a = light.exposure(frame.start_us, 10_000)[0]
            assert np.corrcoef(mean_a.ravel(), read_png(frame.path).ravel())[0, 1] > 0.9


def test_dsec_has_the_frames_of_a_davis(films, tmp_path):
    """Where no other camera takes pictures."""
    own = tmp_path / "0000"
    shutil.copytree(films.folder, own)
    record = json.loads((own / "sequence.json").read_text())
    record["cameras"] = [camera for camera in record["cameras"] if camera["name"] == "left"]
    (own / "sequence.json").write_text(json.dumps(record))
    writers.write("dsec", [sequence := Sequence(own)], tmp_path / "dsec")
    images = tmp_path / "dsec" / sequence.split / "0000/images"
    assert (images / "timestamps.txt").read_text() == "25000\n"
    assert (images / "left/exposure_timestamps.txt").read_text().endswith("20000, 30000\n")
    camera = sequence.cameras["left"]
    wanted = Rectifier(camera).picture(read_png(camera.frames()[0].path))
    assert np.abs(read_png(images / "left/rectified/000000.png") - wanted).max() <= 0.501  # rounded


@pytest.mark.parametrize("name", ["film", "frame"])  # on its own pixels, and on those of the event camera
def test_light_of_an_rgb_camera_is_rendered_for_its_exposures(films, name):
    """Its pictures show the disk where the light of the event camera shows it, at the same place and times."""
    cameras = films.cameras
    stacks = [json.loads((cameras[n].stack_folder / "stack.json").read_text()) for n in ("left", name)]
    assert all(8_000_000 <= t <= 12_000_000 or 34_000_000 <= t <= 38_000_000 for t in stacks[1]["times_ns"])
    assert stacks[1]["bands"] != stacks[0]["bands"]
    if name == "frame":
        assert stacks[0]["lens"]["film_z_mm"] == pytest.approx(stacks[1]["lens"]["film_z_mm"], abs=1e-9)
    frames = cameras[name].frames()
    pictures = [read_png(frame.sharp_path) for frame in frames]
    with pecs.Chip("davis346") as chip, pecs.Light(cameras["left"].stack_folder, chip) as light:
        whole = light.at([frame.middle_us for frame in frames])[:, 0]
    turned = (
        np.log(pictures[1] / pictures[0]),
        np.log(whole[1] / whole[0]),
    )
    assert np.abs(turned[1]).max() > 1 and np.corrcoef(*map(np.ravel, turned))[0, 1] > 0.95


@pytest.fixture(scope="module")
def films(tmp_path_factory):
    tmp_path = tmp_path_factory.mktemp("films")
    (tmp_path / "r.toml").write_text(filled(FILM))
    dataset(tmp_path / "r.toml", "-o", tmp_path / "set", "--only", 0)
    return Sequence(tmp_path / "set/sequences/0000")


def test_tracks_of_pixels_are_the_flow(made):
    """From one instant to the next, through the lens of the render; its own pixels again at the same time."""
    camera = Sequence(made / "set/sequences/0000").cameras["left"]
    truth = camera.truth
    grid = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), -1).reshape(-1, 2)
    (here, there), (seen, visible) = camera.tracks(grid, truth.times_us[0], truth.times_us[:2])
    flow = truth.flow(0).reshape(-1, 2)
    known = np.isfinite(there).all(1) & np.isfinite(flow).all(1)
    assert known.mean() > 0.8 and np.abs(here[known] - grid[known]).max() < 1e-3
    assert np.sqrt(np.mean((there - grid - flow)[known] ** 2)) < 0.01
    assert seen[known].all() and np.mean(visible[known] == truth.visible_at(0).ravel()[known]) > 0.99


def test_every_event_has_its_object_to_the_end(made):
    """The drawn 15 ms become 20 ms, two intervals of the truth."""
    sequence = Sequence(made / "set/sequences/0000")
    assert sequence.duration_us == 20_000
    for name in ("left", "right"):
        camera = sequence.cameras[name]
        late = camera.events()["t"] >= 15_000
        assert late.sum() > 20 and (camera.objects()[late] > 0).mean() > 0.9


def test_the_set_has_no_paths_of_this_machine_and_sums_of_all_files(made):
    for folder in sorted((made / "set/sequences").glob("[0-9]*[0-9]")):
        files = {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()}
        listed = set(json.loads((folder / "files.json").read_text()))
        assert {name.rpartition(".")[2] for name in files - listed - {"files.json"}} == {"log"}
        assert {"checks.json", "report.html", "preview.png", "left/events.h5.run.json", "imu_biases.csv"} <= listed
    texts = [p for p in (made / "set").rglob("*") if p.suffix in (".json", ".html", ".md", ".txt", ".csv", ".yaml")]
    assert len(texts) > 30
    assert [p for p in texts if str(ROOT) in p.read_text() or str(made) in p.read_text()] == []


def test_quality_is_in_the_set(made):
    checks = json.loads((made / "set/sequences/0000/checks.json").read_text())
    events = checks["cameras"]["left"]["events"]
    assert events["dropped_share"] == events["dropped"] / max(events["dropped"] + events["count"], 1)
    assert 0 < events["corner_hz_p05"] <= events["corner_hz_median"] <= events["corner_hz_p95"]
    assert 0 <= checks["cameras"]["left"]["not_compared"]["flow_hidden_or_outside"] < 0.6
    assert 0 < checks["motion"]["speed_least_m_s"] <= checks["motion"]["speed_most_m_s"] < 5
    noisy = []
    for k in ("left", "right"):
        own = checks["cameras"][k]["events"]
        noisy += [k] if own["render_noise_share"] > max(0.1, own["camera_noise_share"]) else []
    lines = [line for line in checks["outside_limits"] if "render_noise" in line]
    assert [line.partition(":")[0] for line in lines] == noisy and all("camera's own noise: 0." in x for x in lines)
    assert 0 < events["camera_noise_share"] < 1
    rows = json.loads((made / "set/dataset.json").read_text())["sequences"]
    assert rows[0]["outside_limits"] == checks["outside_limits"]
    row = rows[0]["cameras"]["left"]
    assert (row["events"], row["render_noise_share"]) == (events["count"], events["render_noise_share"])
    flow = np.linalg.norm(Sequence(made / "set/sequences/0000").cameras["left"].truth.flow(0), axis=-1)
    assert 0.2 < row["motion_median_px_s"] * 0.05 / np.nanmedian(flow) < 5  # 20 Hz
    assert rows[0]["speed_m_s"] == checks["motion"]["speed_median_m_s"]
    assert (made / "set/index.html").read_text().count('class="film"') == 2


def test_rates_stand_beside_those_of_recorded_sets(made):
    folder = made / "set/sequences/0000"
    checks = json.loads((folder / "checks.json").read_text())
    rates = {name: one["rate_per_pixel_hz"] for name, one in checks["recorded_sets"].items()}
    # 2,233,378,133 events of two cameras of 640x480 in 105 s; 3,631,437,863 of two of 1280x720 in 192 s
    assert rates == pytest.approx({"DSEC": 34.62, "M3ED": 10.26}, rel=1e-3)
    index, page = (made / "set/index.html").read_text(), (folder / "report.html").read_text()
    for one in checks["recorded_sets"].values():
        assert one["source"] in index and one["source"].startswith("https://")
    camera = Sequence(folder).cameras["left"]
    assert f"DSEC ({rates['DSEC'] * camera.width * camera.height / 1e6:.3g} million)" in page
    own = checks["cameras"]["left"]["events"]["rate_per_pixel_hz"]
    assert f"left: {own:.3g} events/s per pixel" in index


def test_croissant_and_datasheet(made):
    found = json.loads((made / "set/croissant.json").read_text())
    assert found["license"] == "https://spdx.org/licenses/CC0-1.0.html"
    (rows,) = found["recordSet"]
    paths = {field["name"]: field["source"]["extract"]["jsonPath"] for field in rows["field"]}
    assert paths["split"] == "$.sequences[*].split"
    (listing,) = [file for file in found["distribution"] if file["@type"] == "cr:FileObject"]
    assert {"pictures", "frames"} <= {file["name"] for file in found["distribution"]}
    assert listing["sha256"] == hashlib.sha256((made / "set/dataset.json").read_bytes()).hexdigest()
    text = (made / "set/datasheet.md").read_text()
    assert (
        "2 simulated sequences of 0.04 s" in text
        and "- left: events, 48 x 36, davis346" in text
        and "At 100 Hz" in text
    )


def test_what_a_reader_gets(made):
    sequence = Sequence(made / "set/sequences/0000")
    assert list(sequence.cameras) == ["left", "right", "film"] and sequence.stereo_pairs()[0][0].name == "left"
    left, film = sequence.cameras["left"], sequence.cameras["film"]
    events = left.events()
    assert len(events) == len(left.causes()) == len(left.objects()) and (left.objects() > 0).mean() > 0.9
    assert len(film.frames()) == 2 and np.array_equal(film.K, left.K)
    assert len(sequence.imu()) == 21 and np.linalg.norm(sequence.imu()["accel"], axis=1).max() < 60
    assert np.isfinite(left.rectify_map()).all()
    assert {o["class"] for o in left.truth.objects} == {None, "cube"}


def test_the_program_hands_over(pecs_program, monkeypatch):
    monkeypatch.setenv("PECS_PYTHON", sys.executable)
    result = pecs_program("dataset", "--help")
    assert result.returncode == 0 and "usage: pecs dataset" in result.stdout
    result = pecs_program("dataset", "no.toml", "-o", "x")
    assert result.returncode == 3 and result.stderr.startswith("pecs: no.toml: ")
    monkeypatch.setenv("PECS_PYTHON", "/no/python")
    result = pecs_program("dataset", "no.toml", "-o", "x")
    assert result.returncode == 3 and "PECS_PYTHON" in result.stderr and result.stderr.count("\n") == 1


def test_pages_and_exports(made):
    for name in ("index.html", "datasheet.md", "croissant.json", "dataset.json", "exports/dsec"):
        assert (made / "set" / name).exists(), name
    assert "left: events, 48 x 36" in (made / "set/sequences/0001/report.html").read_text()
    plan = dataset(made / "r.toml", "-o", made / "set", "--plan").stdout
    assert "2 sequences, 3 stacks each: ground truth at 12 instants" in plan and "measured on 2" in plan
    plan = dataset(made / "r.toml", "-o", made / "set", "--plan", "--sequences", 100).stdout
    assert "measured on 2 existing sequences of rotating_disk" in plan and "98 left" in plan
    assert dataset(made / "r.toml", "-o", made / "set", "--sequences", 0, check=False).returncode == 2


def test_exports_are_of_the_sequences_that_there_are(made, tmp_path):
    shutil.copytree(made / "set", tmp_path / "set")
    copy(made, tmp_path)
    words, path = (tmp_path / "r.toml", "-o", tmp_path / "set"), tmp_path / "set/exports/dsec/export.json"
    whole = path.read_bytes()
    now = json.loads(whole)
    assert set(now["made_of"]) == {"0000", "0001"}
    now["made_of"].pop("0001")  # the set had one sequence, and grew
    path.write_text(json.dumps(now))
    dataset(*words)
    assert path.read_bytes() == whole
    result = dataset(*words, "--sequences", 1, check=False)
    assert result.returncode == 5 and "sequences/0001: the recipe has 1 sequences" in result.stderr


def test_an_estimate_is_measured_on_a_few_frames(films, tmp_path):
    """Of one camera."""
    recipe = FILM.split('[[rig.camera]]\nname = "frame"')[0] + "[render]" + FILM.split("[render]")[1]
    (tmp_path / "r.toml").write_text(filled(recipe).replace("frames = true", ""))
    said = dataset(tmp_path / "r.toml", "-o", tmp_path / "none", "--estimate", "--sequences", 20).stdout
    assert "measured on the renders of a few frames of rotating_disk\nrotating_disk, 0.06 s: about " in said, said
    one, all_ = (float(re.search(form, said)[1]) for form in (r"about (\S+) events", r"time, and (\S+) events"))
    left = films.cameras["left"]
    made = np.count_nonzero(left.causes() != 6)  # bursts of its frames
    assert abs(one / made - 1) < 0.3 and all_ == pytest.approx(20 * one, rel=0.05), (said, made)
    assert "20 left: 0." in said
    assert float(re.search(r" h of this machine as loaded \(([\d.]+) hours of one core\)", said)[1]) > 0, said
    assert not (tmp_path / "none").exists()


def test_a_stopped_sequence_gives_an_estimate(made, tmp_path):
    copy(made, tmp_path)
    assert "--estimate measures time and size" in dataset(tmp_path / "r.toml", "-o", tmp_path, "--plan").stdout
    shutil.copytree(made / "set/sequences/0000", tmp_path / "sequences/0000.partial")
    for done in tmp_path.glob("sequences/0000.partial/*/stack/done"):
        done.unlink()
    # Made from 0 to 100 s, stopped, and continued at 500 s.
    (tmp_path / "sequences/0000.partial/runs.log").write_text("1e9\n1000000500\n")
    for file in tmp_path.glob("sequences/**/*"):
        os.utime(file, (1e9 + 100, 1e9 + 100))
    shares = []
    for name, until_s in (("left", 1000), ("right", 3000)):
        done = tmp_path / f"sequences/0000.partial/{name}/stack/done"
        done.write_bytes(b"")
        os.utime(done, (1e9 + until_s, 1e9 + until_s))
        plan = dataset(tmp_path / "r.toml", "-o", tmp_path, "--plan").stdout
        shares.append(float(re.search("measured on (.+) existing", plan)[1]))
        hours = float(re.search("2 left: (.+) h", plan)[1])
        seconds = 100 + until_s - 500
        assert hours == pytest.approx((2 - shares[-1]) / shares[-1] * seconds / 3600, abs=0.02), name
    assert shares[1] == pytest.approx(2 * shares[0], rel=0.05) and 0.33 < shares[0] < 0.5


def test_parts_threads_and_a_kill_give_the_same_set(made, tmp_path):
    """Sequence 0 alone, on one thread, killed when its terminal shows how far a camera is; continued by the run of the
    whole set, of which sequence 1 is there."""
    copy(made, tmp_path)
    shutil.copytree(made / "set/sequences/0001", tmp_path / "set/sequences/0001")
    command = [sys.executable, "-m", "pecs.datasets", tmp_path / "r.toml", "-o", tmp_path / "set", "--only", "0"]
    command += ["--threads", "1"]
    terminal, stderr = os.openpty()
    process = subprocess.Popen(list(map(str, command)), stderr=stderr, start_new_session=True)
    os.close(stderr)
    shown = b""
    while not re.search(rb"sequence 0000, left: light \d+/\d+, \d+ s left", shown):
        shown += os.read(terminal, 4096)  # fails when the process ends
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    os.close(terminal)
    assert list((tmp_path / "set/sequences/0000.partial/left/stack").glob("frame_*.exr"))
    assert not (tmp_path / "set/dataset.json").exists()
    dataset(tmp_path / "r.toml", "-o", tmp_path / "set")
    ours, theirs = sums(tmp_path / "set"), sums(made / "set")
    assert [(s, f) for s in theirs for f in theirs[s] | ours[s] if ours[s].get(f) != theirs[s].get(f)] == []
    assert (tmp_path / "set/dataset.json").read_bytes() == (made / "set/dataset.json").read_bytes()


def test_damage_is_named_and_mended(made, tmp_path):
    shutil.copytree(made / "set", tmp_path / "set")
    copy(made, tmp_path)
    words = (tmp_path / "r.toml", "-o", tmp_path / "set")
    assert "2 sequences, whole" in dataset(*words, "--check").stdout
    data = bytearray((tmp_path / "set/sequences/0001/left/events.h5").read_bytes())
    data[len(data) // 2] ^= 1
    (tmp_path / "set/sequences/0001/left/events.h5").write_bytes(data)
    shutil.rmtree(tmp_path / "set/sequences/0000")
    result = dataset(*words, "--check", check=False)
    assert result.returncode == 4 and "left/events.h5: got other content" in result.stdout
    assert "got 1 damaged (0001), 1 absent (0000), of 2, wanted" in result.stderr


def test_a_finished_set_is_left_alone(made):
    before = sums(made / "set")
    assert "2 sequences" in dataset(made / "r.toml", "-o", made / "set").stdout
    assert before == sums(made / "set")


def test_another_recipe_does_not_mix(made, tmp_path):
    copy(made, tmp_path)
    (tmp_path / "r.toml").write_text(RECIPE.replace("exposure_ms = 4", "exposure_ms = 5"))
    result = dataset(tmp_path / "r.toml", "-o", made / "set", check=False)
    assert (
        result.returncode == 5
        and "drawn (cameras) changed since it was made" in result.stderr
        and result.stderr.count("pecs: ") == 1
    )


@pytest.mark.parametrize(
    ("old", "new", "code", "line"),
    [
        ("[[-0.2, -0.1, -0.1], [0.2, 0.1, 0.1]]", "[[90, 90, 90], [91, 91, 91]]\ntries = 5", 4, "hand_held"),
        ('pixels_of = "left"', WIDE_FILM, 4, "film.lens: got cmount_5mm_f2p8, which does not illuminate 4 pixels"),
    ],
)
def test_what_is_wrong_is_one_line(made, tmp_path, old, new, code, line):
    copy(made, tmp_path)
    (tmp_path / "r.toml").write_text(RECIPE.replace(old, new))
    result = dataset(tmp_path / "r.toml", "-o", tmp_path / "set", "--only", 0, check=False)
    said = [text for text in result.stderr.splitlines() if not text.startswith("dataset: ")]
    assert result.returncode == code and len(said) == 1 and line in said[0], result.stderr


def test_a_folder_that_is_not_writable(made, tmp_path):
    (tmp_path / "file").write_text("")
    result = dataset(made / "r.toml", "-o", tmp_path / "file" / "set", "--only", 0, check=False)
    assert result.returncode == 5 and result.stderr.count("\n") == 1, result.stderr
