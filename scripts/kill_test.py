"""kill -9 at random moments, and when an output appears: what has its name is whole, and what is left disturbs no run.

    .venv/bin/python scripts/kill_test.py [KILLS [render|dataset|disk|sense|convert|align]...]  (20, all)

A killed render or data set is continued: its files must be those of an unbroken run. The others begin again: an output
is there as the unbroken run writes it, or not at all. `disk` (as root): a data set on a disk that is full at first, and
2^(8 / KILLS) times larger in each run.
"""

import json
import random
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pecs
from pecs import program
from pecs_lab.scenes import write_stack

ROOT = Path(__file__).resolve().parents[1]
RENDER = ["--bands", "6", "--fps", "1000", "--frames", "150", "--width", "96", "--samples", "2"]
RECIPE = """
duration_s = 0.03
export = ["dsec"]
[[scene]]
path = "{scene}"
trajectory = {{kind = "hand_held", volume = [[-0.2, -0.1, -0.1], [0.2, 0.1, 0.1]], yaw_deg = 90}}
[[rig.camera]]
name = "left"
kind = "events"
chip = "davis346"
lens = "cmount_5mm_f2p8"
width = 48
height = 36
[[rig.camera]]
name = "film"
kind = "rgb"
pixels_of = "left"
fps = 100
exposure_ms = 4
[render]
bands = 4
samples = 2
fps = 500
[truth]
fps = 200
"""
NOT_THE_SAME = (".log", ".run.json", ".lock")  # of two runs


def start(words: Iterable[object]) -> subprocess.Popen[bytes]:
    return subprocess.Popen([str(w) for w in words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def to_the_end(words: Iterable[object]) -> float:
    """Seconds that it took."""
    began = time.monotonic()
    if start(words).wait() != 0:
        sys.exit(f"failed: {' '.join(map(str, words))}")
    return time.monotonic() - began


def killed(words: Iterable[object], after_s: float, watch: Path | None = None) -> bool:
    """`watch`: a folder; the run ends at the latest when something else than it held appears there."""
    before, process = list(watch.iterdir()) if watch else [], start(words)
    end = time.monotonic() + after_s
    while process.poll() is None and time.monotonic() < end:
        if watch and list(watch.iterdir()) != before:
            break
        time.sleep(0.0005 if watch else 0.01)
    if process.poll() is not None:
        return False
    process.kill()
    process.wait(timeout=60)
    return True


def dataset(folder: Path) -> list[object]:
    recipe = folder / "recipe.toml"
    recipe.write_text(RECIPE.format(scene=ROOT / "scenes/rotating_disk"))
    return [sys.executable, "-m", "pecs.datasets", recipe]


def fill_disk(folder: Path, sizes: int) -> bool:
    """Each run ends with one line and exit code 5, or is the last."""
    whole, disk, job = folder / "whole disk", folder / "disk", dataset(folder)
    to_the_end([*job, "-o", whole])
    disk.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "pecs", disk], check=True)
    wrong, full = [], 0
    try:
        room = 2**16
        while room < 2**30:
            room = int(room * 2 ** (8 / sizes))
            subprocess.run(["mount", "-o", f"remount,size={room}", disk], check=True)
            words = [str(w) for w in [*job, "-o", disk / "set"]]
            ended = subprocess.run(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
            if ended.returncode == 0:
                break
            full += 1
            said = re.search("\npecs: .*(No space left|disk: got)", ended.stderr)
            if ended.returncode != 5 or not said or "Traceback" in ended.stderr:
                wrong.append(f"{room} bytes: {ended.returncode}: {ended.stderr[-200:]}")
        wrong += differing(whole, disk / "set")
    finally:
        subprocess.run(["umount", disk], check=True)
    print(f"disk: full {full} times, wrong: {wrong or 'none'}")
    return not wrong


def kill_and_continue(kind: str, folder: Path, kills: int, starts_s: float, job: list[object]) -> bool:
    whole, broken = folder / f"whole {kind}", folder / f"broken {kind}"
    longest_s = starts_s + to_the_end([*job, "-o", whole]) / kills  # about one run in all, starts included
    rng, ended, left = random.Random(1), 0, []
    for _ in range(kills):
        ended += killed([*job, "-o", broken], rng.uniform(0, longest_s))
        left.append(len(list(broken.rglob("*.exr"))))
    to_the_end([*job, "-o", broken])
    wrong = differing(whole, broken)
    print(f"{kind}: killed {ended} times of {kills}, pictures after each: {left}, wrong: {wrong or 'none'}")
    return not wrong


def differing(whole: Path, broken: Path) -> list[str]:
    """Files that are not the same in both."""
    names, again = ({p.relative_to(f) for p in f.rglob("*") if p.is_file()} for f in (whole, broken))
    other = [n for n in names & again if (whole / n).read_bytes() != (broken / n).read_bytes()]
    return [str(n) for n in [*(names ^ again), *other] if not n.name.endswith(NOT_THE_SAME)]


def stack(folder: Path) -> Path:
    x = np.arange(320) / 320 - np.arange(100)[:, None, None] / 100
    return write_stack(folder, 1e-6 * (2 + np.sin(16 * np.pi * x)) * np.ones((180, 1)), 1000)


def disk_events(count: int) -> np.ndarray:
    """Events of a disk of four sectors on 320 x 240 pixels, 2000 deg/s, shortly behind their edges."""
    rng, events = np.random.default_rng(1), np.zeros(count, pecs.EVENT_DTYPE)
    t, edge = np.sort(rng.integers(0, 600_000, count)), rng.integers(0, 4, count)
    angle, radius = np.radians(90 * edge + 2000e-6 * t - 3 * rng.random(count)), 100 * np.sqrt(rng.random(count))
    events["t"], events["p"] = t, edge % 2
    events["x"], events["y"] = 160 + radius * np.cos(angle), 120 - radius * np.sin(angle)
    return events


def jobs_of(kind: str, folder: Path, output: Path) -> list[list[Path | str]]:
    """Command lines, their outputs in `output`."""
    if kind == "sense":
        source = folder / "s" if (folder / "s").exists() else stack(folder / "s")
        return [["sense", source, "-o", output / f"o.{e}", "--labels", output / f"{e}.npy"] for e in ("raw", "h5")]
    recording = folder / "in.npz"
    if not recording.exists():
        pecs.write(recording, disk_events(300_000), 320, 240)
    if kind == "convert":
        names = [(f["name"], f["extensions"][0]) for f in pecs.event_formats() if f["writes"]]
        return [["convert", recording, output / f"{name}{ending}", "--format", name] for name, ending in names]
    scene = ROOT / "scenes/rotating_disk"
    given = [recording, "--scene", scene, "--pixel-pitch", "19.44", "-o", output / "a.json"]
    return [["align", *given, "--picture", output / "a.png"]]


def kill_program(kind: str, folder: Path, kills: int) -> bool:
    """`kills` in all, in turn over the kind's jobs."""
    rng, ended, seen, wrong = random.Random(kind), 0, 0, []
    whole, broken = folder / f"whole {kind}", folder / f"broken {kind}"
    whole.mkdir()
    broken.mkdir()
    pairs = list(zip(jobs_of(kind, folder, whole), jobs_of(kind, folder, broken), strict=True))
    longest_s = [to_the_end([program(), *job]) for job, _ in pairs]
    good = {p.name: p.read_bytes() for p in whole.iterdir()}

    def check(there: set[str]) -> None:
        for name in there:
            data = (broken / name).read_bytes()
            if name.endswith(".run.json"):
                json.loads(data)  # names its own command
            elif good[name] != data:
                wrong.append(name)

    for i in range(kills):
        which = i % len(pairs)
        for path in broken.iterdir():
            if i % 4 == 0 or not path.name.endswith(".partial"):  # three of four begin over what a killed one left
                path.unlink()
        words = [program(), *pairs[which][1]]
        if i // len(pairs) % 2:
            ended += killed(words, 10 * longest_s[which], watch=broken)
        else:
            ended += killed(words, rng.uniform(0, 1.1 * longest_s[which]))
        there = {p.name for p in broken.iterdir() if not p.name.endswith(".partial")}
        seen += len(there)
        check(there)
    for _, job in pairs:
        to_the_end([program(), *job])
    left = {p.name for p in broken.iterdir()}
    check(left & good.keys())
    if left != good.keys():
        wrong.append(f"at the end {sorted(left ^ good.keys())}")
    print(f"{kind}: killed {ended} times of {kills}, {seen} outputs were there, wrong: {wrong or 'none'}")
    return not wrong


def main(kills: int, kinds: list[str]) -> int:
    with tempfile.TemporaryDirectory() as folder:
        do: dict[str, Callable[[], bool]] = {}
        render = [sys.executable, "-m", "pecs_blender", "render", ROOT / "scenes/rotating_disk", *RENDER]
        do["render"] = lambda: kill_and_continue("render", Path(folder), kills, 2.5, render)
        do["dataset"] = lambda: kill_and_continue("dataset", Path(folder), kills, 15, dataset(Path(folder)))
        do["disk"] = lambda: fill_disk(Path(folder), kills)
        for kind in ("sense", "convert", "align"):
            do[kind] = lambda kind=kind: kill_program(kind, Path(folder), kills)
        return 0 if all([do[kind]() for kind in kinds or do]) else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 20, sys.argv[2:]))
