"""pecs align against the truth, as JSON: recordings simulated by our sensor (noise on) of boards and disks seen through
three lenses; poses, speeds, phases and clocks drawn at random.

    .venv/bin/python scripts/bench/calibration.py [board|disk|intrinsics ...] [--cases N] [--only I] [--keep FOLDER]

20 boards, 20 disks and 10 cameras make the 50 cases. Pictures of 640 x 360 pixels of 9.72 um: the film of 1280 x 720,
four times as fast. Boards are aligned from the recording alone, except the clock: it is found with the camera's turn
held, corrected by a second simulation of the scene (other noise). Disks are aligned twice, the second time corrected by
a simulation of the first result; `first_` tells the errors before that. Needs libpecs and the program.

--keep holds the recordings, which are made once, and a line of JSON for each case: a cut run goes on where it stopped.
Remove the lines to measure another build on the same recordings, the folder after changes of the sensor.
"""

import contextlib
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pecs
from pecs import program
from pecs_lab.lab_views import Board, Camera, Disk, record, rotation, turn_of
from pecs_lab.measure import command
from scipy.spatial.transform import Rotation

ROOT = Path(__file__).resolve().parents[2]


# Name, focus, stop [mm], distance of the targets [mm], square of the board [mm]
LENSES = [
    ("pecs_lab_15mm", 1.56, 1.0, 1560, 41.7),
    ("cmount_8mm_f2p8", 1.0, None, 1000, 50.0),
    ("cmount_25mm_f2", 2.0, None, 2000, 34.0),
]
WHITE_A = 10e-12  # photocurrent of light 1
SIZE, PITCH_MM = (640, 360), 0.00972


def align(*arguments, cwd):
    """Raises RuntimeError where it fails."""
    result = subprocess.run([program(), "align", *map(str, arguments)], capture_output=True, text=True, cwd=cwd)
    if result.returncode:
        raise RuntimeError(result.stderr.strip())
    return json.loads(result.stdout)


def stop_of(lens):
    return {"stop_diameter_mm": lens[2]} if lens[2] else {}


def camera_of(lens, shift_px=(0.0, 0.0)):
    return Camera(lens[0], lens[1], *SIZE, PITCH_MM, shift_px, **stop_of(lens))


def write_scene(folder: Path, name: str, lens, values: dict) -> Path:
    """scenes/NAME with another lens and other values, ranges open."""
    scene = json.loads((ROOT / "scenes" / name / "scene.json").read_text())
    scene["camera"] = {"lens": lens[0], "focus_m": lens[1], **stop_of(lens)}
    for key, declared in scene["parameters"].items():
        declared.pop("range", None)
        declared["value"] = values.get(key, declared["value"])
    (folder / name).mkdir()
    (folder / name / "scene.json").write_text(json.dumps(scene))
    return folder / name


def turned(random):
    """Blender's rotation of a camera a few degrees off +y."""
    return np.array([90.0, 0.0, 0.0]) + random.uniform(-4, 4, 3)


def board(index: int, keep: Path) -> dict:
    random = np.random.default_rng([1, index])
    lens = LENSES[index % 3]
    camera, rotation_deg = camera_of(lens), turned(random)
    turn = turn_of(rotation_deg)
    distance = lens[3] * random.uniform(0.85, 1.15)
    px = distance / camera.focal_px  # mm in a pixel
    squares = 10
    square = px * SIZE[1] * random.uniform(0.7, 0.8) / squares
    speed = px * random.uniform(350, 700) * random.choice([-1, 1])  # to the left
    duration_s, clock_us = 160 * px / abs(speed), int(random.integers(-20_000, 20_000))
    # In the middle of the picture half way.
    middle = turn.T @ [0, 0, 1.0] * distance + np.append(random.uniform(-15, 15, 2) * px, 0)
    start = middle + np.array([speed * duration_s / 2, 0, 0])
    drawn = Board(turn, tuple(turn @ start), tuple(turn @ [-speed, 0, 0]), squares, squares, square, square)
    truth = {
        "speed_m_per_s": speed / 1000,
        "start_right_mm": start[0],
        "board_up_mm": -start[1],
        "board_distance_mm": start[2],
        "square_mm": square,
        "squares": squares,
    }
    real, sim = keep / f"board{index}_real.npz", keep / f"board{index}_sim.npz"
    if not (real.exists() and sim.exists()):
        times_s = np.arange(0, duration_s, 0.6 / (abs(speed) / px))
        recordings = record(drawn.light(camera), times_s, SIZE, (10 * index, 10 * index + 1), WHITE_A)
        recordings[0]["t"] += clock_us
        for path, events in zip((real, sim), recordings, strict=True):
            pecs.write(path, events, *SIZE)
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        # The scene's own values are off; those of truth.json hold for the clock.
        off = {k: v for k, v in truth.items() if k.startswith("square")} | {"board_distance_mm": lens[3]}
        scene = write_scene(folder, "board", lens, off)
        common = [real, "--scene", scene, "--pixel-pitch", 1000 * PITCH_MM, "--json"]
        found = align(*common, "--views=16", cwd=folder)
        kept = {k: v for k, v in truth.items() if not k.startswith("square")}
        known = {"scene": "board", "camera": {"rotation_deg": list(rotation_deg)}, "parameters": kept}
        (folder / "truth.json").write_text(json.dumps({"pecs_aligned": 1, **known}))
        clock = align(
            *common, "--sim", sim, "--sim-of=truth.json", "--hold-camera", "--clock=offset", "--views=6", cwd=folder
        )
        counts = [f"--columns={squares - 1}", f"--rows={squares - 1}"]
        corners = align("detect", real, "--target=checkerboard", *counts, "--json", cwd=folder)
    errors = [np.array(v["points"]) - drawn.seen(camera, (v["time_us"] - clock_us) * 1e-6) for v in corners["views"]]
    got = found["parameters"]
    return {
        "speed_px_s": speed / px,
        "views": len(corners["views"]),
        "corners_rms_px": float(np.sqrt(np.mean(np.square(errors)))),
        "corner_worst_px": float(np.abs(errors).max()),
        "rotation_error_deg": float(
            np.degrees(Rotation.from_matrix(turn_of(found["camera"]["rotation_deg"]).T @ turn).magnitude())
        ),
        "distance_error_percent": 100 * (got["board_distance_mm"] / truth["board_distance_mm"] - 1),
        "speed_error_percent": 100 * (got["speed_m_per_s"] / truth["speed_m_per_s"] - 1),
        "clock_error_us": clock["clock"]["offset_us"] - clock_us,
    }


def disk(index: int, keep: Path) -> dict:
    random = np.random.default_rng([2, index])
    lens = LENSES[index % 3]
    camera, rotation_deg = camera_of(lens), turned(random) * [1, 0, 1]
    turn = turn_of(rotation_deg)
    distance = lens[3] * random.uniform(0.9, 1.1)
    px = distance / camera.focal_px
    radius, sectors = px * random.uniform(90, 140), int(random.choice([4, 6]))
    at = turn.T @ [0, 0, 1.0] * distance + np.append(random.uniform(-30, 30, 2) * px, 0)
    speed, phase = random.uniform(1600, 3000) * random.choice([-1, 1]), random.uniform(0, 720 / sectors)
    white_a = WHITE_A * random.choice([0.1, 1])
    span_s, step_s = 0.06, 0.8 / (np.radians(3000) * radius / px)
    truth = Disk(tuple(at), radius, sectors, speed, phase, turn)

    def write(drawn, path, seed):
        times_s = np.arange(0, span_s + step_s / 2, step_s)
        pecs.write(path, record(drawn.light(camera), times_s, SIZE, [seed], white_a)[0], *SIZE)

    real = keep / f"disk{index}_real.npz"
    if not real.exists():
        write(truth, real, index)
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        values = {"disk_radius_mm": radius, "sectors": sectors, "disk_distance_mm": lens[3]}
        scene = write_scene(folder, "rotating_disk", lens, values)
        common = [real, "--scene", scene, "--pixel-pitch", 1000 * PITCH_MM, "--json"]
        first = align(*common, cwd=folder)
        (folder / "first.json").write_text(json.dumps(first))
        p = first["parameters"]
        place = (p["disk_right_mm"], -p["disk_up_mm"], p["disk_distance_mm"])
        again = turn_of(first["camera"]["rotation_deg"])
        write(Disk(place, radius, sectors, 6 * p["rpm"], p["phase_deg"], again), folder / "sim.npz", 1000 + index)
        second = align(*common, "--sim=sim.npz", "--sim-of=first.json", cwd=folder)

    def errors(found):
        p = found["parameters"]
        centre = turn_of(found["camera"]["rotation_deg"]) @ np.array(
            [p["disk_right_mm"], -p["disk_up_mm"], p["disk_distance_mm"]]
        )
        angle = p["phase_deg"] + 6 * p["rpm"] * span_s / 2 - (phase + speed * span_s / 2)
        period = 720 / sectors
        return {
            "centre_error_px": float(np.hypot(*(camera.pixels(centre) - camera.pixels(turn @ at)))),
            "angular_speed_error_percent": 100 * (6 * p["rpm"] / speed - 1),
            "phase_error_deg": float((angle + period / 2) % period - period / 2),
        }

    before = {f"first_{k}": v for k, v in errors(first).items()}
    return {"sectors": sectors, "speed_deg_s": speed, "white_a": white_a, **errors(second), **before}


def intrinsics(index: int, keep: Path) -> dict:
    """Sixteen short clips of a board that moves; the camera's axis is off the middle."""
    random = np.random.default_rng([3, index])
    lens = LENSES[index % 3]
    width, height = SIZE
    camera = camera_of(lens, random.uniform(-6, 6, 2))
    step_s, worst = 5e-4, []
    with tempfile.TemporaryDirectory() as folder:
        clips = []
        for view in range(16):
            columns, rows = 10, 8
            distance = lens[3] * random.uniform(0.75, 1.0)
            square = 0.75 * height * distance / camera.focal_px / rows
            # Evenly over the picture, tilted to all sides.
            room = np.array([width - 0.9 * height, 0.25 * height]) * distance / camera.focal_px / 2
            at = np.array([[-1, 0, 1, -0.5][view % 4], [-1, 0, 1][view % 3]]) * room * random.uniform(0.8, 1, 2)
            tilt = [(38, 0), (-38, 0), (0, 38), (0, -38), (28, 28), (-28, 28)][view % 6]
            turn = rotation(*(tilt + random.uniform(-5, 5, 2)), random.uniform(-15, 15))
            heading = random.uniform(0, 2 * np.pi)
            speed = 1200 * distance / camera.focal_px  # 1200 px/s
            v = (speed * np.cos(heading), speed * np.sin(heading), 0.0)
            middle_s = 0.01
            start = (*(at - np.array(v[:2]) * middle_s), distance)
            board = Board(turn, start, v, columns, rows, square)
            clips.append(keep / f"intrinsics{index}_{view}.npz")
            if not clips[-1].exists():
                times_s = np.arange(0, 2 * middle_s + step_s / 2, step_s)
                (events,) = record(board.light(camera), times_s, SIZE, [100 * index + view], WHITE_A)
                pecs.write(clips[-1], events, *SIZE)
            if view % 4:
                continue
            counts = ["--target=checkerboard", "--columns=9", "--rows=7", "--views=1"]
            with contextlib.suppress(RuntimeError):
                (found,) = align("detect", clips[-1], *counts, "--json", cwd=folder)["views"]
                seen = board.seen(camera, found["time_us"] * 1e-6)
                worst.append(np.sqrt(np.mean((np.array(found["points"]) - seen) ** 2)))
        result = align(
            "intrinsics", *clips, "--columns=9", "--rows=7", "--views=1", f"--lens={lens[0]}", f"--focus={lens[1]}",
            "--pixel-pitch=9.72", "--json", *([f"--stop-diameter={lens[2]}"] if lens[2] else []), cwd=folder,
        )  # fmt: skip
    fitted = result["camera"]
    # Distortion curve: image radii at the same field angles, the measured focal length scaled to the true one.
    r = np.linspace(5, np.hypot(width, height) / 2 * 0.95, 40)
    along = camera.lens.directions(camera.axis_px + np.outer(r, [1, 0]), **camera.setting)
    x = along[:, 0] / along[:, 2]
    k1, k2, k3 = fitted["radial"]
    m = fitted["focal_px"] * (x + k1 * x**3 + k2 * x**5 + k3 * x**7)
    shape = m * (m @ r) / (m @ m) - r
    return {
        "corners_rms_px": float(np.sqrt(np.mean(np.square(worst)))),
        "focal_error_percent": 100 * ((m @ r) / (r @ r) - 1),
        "principal_error_px": float(np.hypot(*(np.array(fitted["principal_px"]) - camera.axis_px))),
        "distortion_error_px": float(np.abs(shape).max()),
        "rms_px": result["rms_px"],
        "said_focal_percent": 100 * result["deviation"]["focal_px"] / fitted["focal_px"],
    }


LIMITS = {
    "corners_rms_px": 0.25,
    "focal_error_percent": 0.3,
    "principal_error_px": 1.5,
    "distortion_error_px": 0.3,
    "rotation_error_deg": 0.1,
    "distance_error_percent": 0.2,
    "speed_error_percent": 0.2,
    "clock_error_us": 50,
    "centre_error_px": 0.15,
    "angular_speed_error_percent": 0.1,
    "phase_error_deg": 0.15,
}


def cases_of(kind: str, cases: list[int], keep: Path) -> dict:
    lines = keep / f"{kind}.jsonl"
    done = [json.loads(line) for line in lines.read_text().splitlines()] if lines.exists() else []
    rows = [row for row in done if row["case"] in cases]
    for i in sorted(set(cases) - {row["case"] for row in rows}):
        rows.append({"case": i, "lens": LENSES[i % 3][0]})
        try:
            rows[-1] |= KINDS[kind][0](i, keep)
        except RuntimeError as e:
            rows[-1]["failed"] = str(e)
        print(json.dumps(rows[-1]), file=sys.stderr, flush=True)
        with lines.open("a") as out:
            out.write(json.dumps(rows[-1]) + "\n")
    worst = {}
    for key, limit in LIMITS.items():
        if values := [abs(row[key]) for row in rows if key in row]:
            within = f"{sum(v <= limit for v in values)}/{len(rows)}"
            worst[key] = {"median": float(np.median(values)), "worst": max(values), "within": within}
    return {"summary": worst, "failed": sum("failed" in row for row in rows), "cases": rows}


KINDS = {"board": (board, 20), "disk": (disk, 20), "intrinsics": (intrinsics, 10)}


def main(
    kinds: list[str] = tuple(KINDS), *, cases: int | None = None, only: int | None = None, keep: Path | None = None
) -> dict:
    report = {"limits": LIMITS, "white_photocurrent_a": WHITE_A}
    with tempfile.TemporaryDirectory() as scratch:
        folder = (keep or Path(scratch)).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        for kind in kinds:
            some = [only] if only is not None else list(range(cases or KINDS[kind][1]))
            report[kind] = cases_of(kind, some, folder)
    return report


if __name__ == "__main__":
    command(main)
