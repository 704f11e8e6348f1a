#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Damaged files through the program, as a user would meet them: each run must end within 20 s of CPU time and 2 GiB,
with a result or with one line and the exit code of an input (docs/reference/exit_codes.md).

    scripts/broken_files.py [--count 500] [--seed 2] [--only evt3,chip] [--exr openexr-images/Damaged]

Without --exr: mutants of each event format, of each kind of JSON and lens file, of EXR frames, and of pictures and
video, the same ones for the same seed. With --exr: every file of a folder, alone and as a frame of a stack of ours;
meant for the Damaged folder of https://github.com/AcademySoftwareFoundation/openexr-images. Prints JSON, a row per
kind; files that did badly are kept in out/broken. Exit code 1 if any did.
"""

import argparse
import functools
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pecs
from pecs_blender.render.layers.motion import Motion
from pecs_blender.render.scene_file import load_scene
from pecs_lab.program import program

ROOT = Path(__file__).resolve().parents[1]
KEPT = ROOT / "out/broken"
MOST_CPU_S, MOST_BYTES = 20, 2 << 30
GOOD_CODES = {0, 3, 4, 6}  # ok, not found (a glass that a lens names), bad input, unsupported
EVENTS = {
    "evt3": "evt3.raw", "evt2": "evt2.raw", "evt21": "evt21.raw", "dat": "dat", "aedat4": "aedat4", "npz": "npz",
    "csv": "csv", "e2vid": "e2vid.txt", "v2e": "v2e.txt", "dsec": "h5", "metavision-hdf5": "hdf5",
}  # fmt: skip
# What libpng and libjpeg say before our line, which OpenCV gives no way to keep from them.
DECODERS = ("libpng error", "libpng warning", "Corrupt JPEG", "Premature end of JPEG", "Warning: unknown JFIF")
STRANGE = ["", "\0", "../..", "1e999", "NaN", "-1", "0", "null", "[]", "{}", '""', "true", "1e-300", "9" * 400, "1e308"]
ZEMAX = """MODE SEQ
NAME made
UNIT MM X W X CM MR CPMM
SURF 0
  CURV 0.0
  DISZ INFINITY
SURF 1
  TYPE EVENASPH
  STOP
  CURV 3.87E-002 0 0 0 0 ""
  CONI -0.5
  PARM 2 1e-7
  DISZ 4
  GLAS N-BK7 0 0 1.5168 64.17 0 0 0 0 0 0
  DIAM 12.7 0 0 0 1 ""
SURF 2
  CURV 0.0
  DISZ 47.36
  DIAM 12.7 0 0 0 1 ""
SURF 3
  CURV 0.0
  DISZ 0
"""
ALIGNED = {
    "pecs_aligned": 1, "scene": "board", "camera": {"rotation_deg": [90.0, 0.1, -0.2]},
    "parameters": {"speed_m_per_s": 0.9, "board_distance_mm": 1600.0}, "clock": {"offset_us": 12.0, "rate": 1.0},
    "warnings": [],
}  # fmt: skip


def places(tree: Any) -> list[tuple[Any, Any]]:
    pairs = list(tree.items() if isinstance(tree, dict) else enumerate(tree)) if isinstance(tree, dict | list) else []
    return [(tree, key) for key, _ in pairs] + [place for _, value in pairs for place in places(value)]


def strange_value(data: bytes, rng: random.Random) -> bytes:
    """JSON with another value somewhere; what is no JSON stays."""
    try:
        tree = json.loads(data)
    except ValueError:
        return data
    if found := places(tree):
        holder, key = rng.choice(found)
        holder[key] = "@@"
    return json.dumps(tree).replace('"@@"', rng.choice(STRANGE)).encode()


def mutant(data: bytes, rng: random.Random, is_json: bool) -> bytes:
    """One to four changes, half of them in the first quarter, where headers are."""
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(max(1, len(data) // rng.choice((1, 4))))
        kind = rng.randrange(12 if is_json else 7)
        if kind == 0:
            data = data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)] if data[at:] else []) + data[at + 1 :]
        elif kind == 1:
            data = data[:at] + bytes(rng.randrange(256) for _ in range(rng.randint(1, 8))) + data[at + 8 :]
        elif kind == 2:
            data = data[:at] + data[at + rng.randint(1, 64) :]
        elif kind == 3:
            data = data[:at] + data[at : at + rng.randint(1, 64)] + data[at:]
        elif kind == 4 and rng.randrange(4) == 0:
            data = data[:at]
        elif kind == 5:
            value = rng.choice((0, 1, 2**15, 2**16 - 1, 2**31 - 1, 2**32 - 1, 2**63 - 1, 2**64 - 1))
            size = rng.choice((2, 4, 8))
            data = data[:at] + (value % 2 ** (8 * size)).to_bytes(size, "little") + data[at + size :]
        elif kind == 6:
            data = data[:at] + rng.choice(STRANGE).encode() + data[at + rng.randint(0, 8) :]
        elif kind > 6:
            data = strange_value(data, rng)
    return data or b" "


def stack_json(times: int = 2) -> dict[str, Any]:
    return {
        "pecs_stack": 1, "quantity": "irradiance", "width": 32, "height": 24, "pixel_pitch_m": 4.86e-6,
        "bands": [{"lambda_nm": 480.5, "weight_nm": 80}, {"lambda_nm": 620.0, "weight_nm": 70}],
        "times_ns": [i * 1_000_000 for i in range(times)], "period_ns": None, "lens": {"name": "pecs_lab_15mm"},
        "scene": {"name": "board"}, "render": {"samples": 4}, "versions": {"pecs": "0"},
    }  # fmt: skip


def events() -> np.ndarray:
    rng = np.random.default_rng(1)
    out = np.zeros(400, pecs.EVENT_DTYPE)
    out["t"] = np.cumsum(rng.integers(0, 300, len(out)))
    out["x"], out["y"] = rng.integers(640, size=len(out)), rng.integers(480, size=len(out))
    out["p"] = rng.integers(2, size=len(out))
    return out


class Kind:
    """A good file, and what reads its mutants: a Python function, arguments of the program, or both."""

    def __init__(self, file: Path, *arguments: object, read: Callable[[], object] | None = None):
        self.file, self.good = file, file.read_bytes()
        self.arguments, self.read = [str(a) for a in arguments], read


def said_in_python(read: Callable[[], object]) -> tuple[str, str]:
    """What happened in a word, and the line that says it."""
    try:
        read()
    except pecs.PecsError as e:
        good = e.code in GOOD_CODES and len(str(e).splitlines()) == 1 and len(str(e)) < 1000
        return ("refused" if good else f"wrong words, code {e.code}"), str(e)
    except MemoryError as e:
        return "memory", repr(e)
    except OtherEvents:
        return "other events", ""
    except Exception as e:
        return "traceback", repr(e)
    return "taken", ""


def in_python(kind: Kind, inputs: list[bytes]) -> Iterator[tuple[str, str]]:
    """In a child process, which a crash or a hang ends; the next one goes on behind that input."""
    done = 0
    while done < len(inputs):
        inward, outward = os.pipe()
        child = os.fork()
        if child == 0:
            for data in inputs[done:]:
                kind.file.write_bytes(data)
                signal.setitimer(signal.ITIMER_PROF, MOST_CPU_S)  # ends the process
                os.write(outward, (json.dumps(said_in_python(kind.read)) + "\n").encode())
            os._exit(0)
        os.close(outward)
        with open(inward) as lines:
            for line in lines:
                done += 1
                yield tuple(json.loads(line))
        _, status, used = os.wait4(child, 0)
        if status:
            done += 1
            yield ("hang" if os.WTERMSIG(status) == signal.SIGPROF else "crash"), f"status {status}"
        if used.ru_maxrss << 10 > MOST_BYTES:
            yield "memory", f"{used.ru_maxrss} KiB"


def limits() -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_CPU_S, MOST_CPU_S + 1))
    resource.setrlimit(resource.RLIMIT_AS, (2 * MOST_BYTES, 2 * MOST_BYTES))


def in_program(kind: Kind, data: bytes) -> tuple[str, str]:
    kind.file.write_bytes(data)
    with tempfile.TemporaryFile() as stderr:
        process = subprocess.Popen(
            [program(), *kind.arguments], stdout=subprocess.DEVNULL, stderr=stderr, preexec_fn=limits
        )
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = code = os.waitstatus_to_exitcode(status)
        stderr.seek(0)
        lines = stderr.read().decode(errors="replace").splitlines()
        said = "\n".join(line for line in lines if not line.startswith(DECODERS))
    if code in (-signal.SIGXCPU, -signal.SIGKILL):
        return "hang", said
    if code < 0 or code in (134, 139):
        return "crash", said
    if code == 7 or used.ru_maxrss << 10 > MOST_BYTES:
        return "memory", said
    if code not in GOOD_CODES:
        return f"exit code {code}", said
    if code and (len(said.splitlines()) != 1 or not said.startswith("pecs: ") or len(said) > 1000):
        return "wrong words", said
    return ("refused" if code else "taken"), said


GOOD = {"taken", "refused"}


class OtherEvents(Exception):
    """Where every byte has a check sum."""


def same_events(file: Path) -> None:
    if not np.array_equal(pecs.read(file), events()):
        raise OtherEvents


def try_all(name: str, kind: Kind, inputs: list[bytes]) -> dict[str, Any]:
    """What Python can read, in Python, and one of 20 by the program too; the rest by the program."""
    seen: Counter[str] = Counter()

    def count(i: int, word: str, said: str) -> None:
        seen[word] += 1
        if word not in GOOD:
            KEPT.mkdir(parents=True, exist_ok=True)
            (KEPT / f"{name}-{i}").write_bytes(inputs[min(i, len(inputs) - 1)])
            print(f"{name}-{i}: {word}: {said[:300]}", file=sys.stderr)

    if kind.read:
        for i, (word, said) in enumerate(in_python(kind, inputs)):
            count(i, word, said)
    if kind.arguments:
        for i in range(0, len(inputs), 20 if kind.read else 1):
            count(i, *in_program(kind, inputs[i]))
    kind.file.write_bytes(kind.good)
    return {"kind": name, "files": len(inputs), **seen}


def stacks(folder: Path) -> tuple[Path, Path]:
    """A stack of ours, and a folder of one of its frames without stack.json."""
    own, foreign = folder / "own", folder / "foreign"
    with pecs.StackWriter(own, stack_json()) as writer:
        for i in range(2):
            writer.write_frame(i, np.random.default_rng(i).random((2, 24, 32), np.float32))
    foreign.mkdir()
    shutil.copy(own / "frame_000000.exr", foreign / "a.exr")
    (foreign / "b.exr").symlink_to("a.exr")  # a stack has two frames
    return own, foreign


def first_frame(folder: Path, fps: float | None = None) -> None:
    with pecs.StackReader(folder, fps) as reader:
        reader.read_frame(0)


def frames(own: Path, foreign: Path, output: Path) -> dict[str, Kind]:
    words = ("-o", output / "o.raw", "--gain", "1e-9", "--quiet")
    return {
        "frame": Kind(own / "frame_000000.exr", "sense", own, *words[:2], "--quiet", read=lambda: first_frame(own)),
        "frame alone": Kind(
            foreign / "a.exr", "sense", foreign, *words, "--fps", "100", read=lambda: first_frame(foreign, 100)
        ),
    }


def moving(folder: Path, output: Path) -> dict[str, Kind]:
    """What lies beside the light of a stack: motion, and a picture between two frames."""
    said = {"name": Motion.name, "channels": Motion.channels, "unit": Motion.unit, "at": Motion.at}
    layer = said | {"files": f"{Motion.name}_%06d.exr"}
    rng = np.random.default_rng(3)
    with pecs.StackWriter(folder, stack_json() | {"layers": [layer], "between": True}) as writer:
        for i in range(2):
            writer.write_frame(i, rng.random((2, 24, 32), np.float32))
        writer.write_layer("motion", 0, 4 * rng.random((12, 24, 32), np.float32))
        writer.write_between(0, 5, 400_000, rng.random((2, 24, 32), np.float32))
    words = ("sense", folder, "-o", output / "o.raw", "--quiet")
    return {name: Kind(next(folder.glob(f"{name}_*.exr")), *words) for name in ("motion", "between")}


def pictures(folder: Path, output: Path) -> dict[str, Kind]:
    kinds = {}
    rows = np.random.default_rng(4).integers(256, size=(24, 32, 3), dtype=np.uint8)
    words = ("-o", output / "o.raw", "--fps", "100", "--photocurrent", "1e-11", "--quiet")
    for ending in ("png", "jpg", "tiff", "webp", "ppm", "bmp"):
        good = folder / ending
        good.mkdir(parents=True)
        for name in "ab":
            cv2.imwrite(str(good / f"{name}.{ending}"), rows)
        kinds[ending] = Kind(good / f"a.{ending}", "sense", good, *words)
    video = cv2.VideoWriter(str(folder / "a.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 100, (32, 24))
    for i in range(4):
        video.write(np.roll(rows, i, 0))
    video.release()
    kinds["mp4"] = Kind(folder / "a.mp4", "sense", folder / "a.mp4", *words)
    return kinds


def all_kinds(folder: Path) -> dict[str, Kind]:
    kinds, output = {}, folder / "to"
    output.mkdir()
    for name, ending in EVENTS.items():
        file = folder / f"in.{ending}"
        pecs.write(file, events(), 640, 480, format=name)
        read = functools.partial(same_events if name == "npz" else pecs.read, file)
        kinds[name] = Kind(file, "convert", file, output / "o.csv", "--format", "csv", "--quiet", read=read)
    own, foreign = stacks(folder)
    kinds |= frames(own, foreign, output) | moving(folder / "moving", output) | pictures(folder / "pictures", output)
    kinds["stack.json"] = Kind(
        own / "stack.json", "sense", own, "-o", output / "o.raw", "--quiet", read=lambda: first_frame(own)
    )

    chips, lenses = ROOT / "sensor/chips", ROOT / "lens_data/lenses"
    chip = json.loads((chips / "imx636.json").read_text())
    rates = {"on_hz": [0.1, 0.2] * 4, "off_hz": [0.3] * 8}
    table = {"pecs_noise_table": 1, "source": "made", **rates}
    (folder / "table.json").write_text(json.dumps(table))
    (folder / "chip.json").write_text(json.dumps(chip | {"noise_table": "table.json"}))
    for name in ("chip", "table"):
        words = ("sense", own, "-o", output / "o.raw", "--quiet", "--chip", folder / "chip.json")
        kinds[name] = Kind(folder / f"{name}.json", *words, read=lambda: pecs.Chip(folder / "chip.json").close())
    shutil.copy(lenses / "pecs_lab_15mm.json", folder / "lens.json")
    lens = folder / "lens.json"
    kinds["lens"] = Kind(lens, "lens", "info", lens, read=lambda: pecs.Lens(lens).info())
    (folder / "lens.zmx").write_text(ZEMAX)
    pbrt = ("lens", "convert", "double_gauss_100mm_f3p1", "-o", folder / "lens.dat")
    subprocess.run([program(), *pbrt], check=True, capture_output=True)
    for name, ending in (("zemax", "zmx"), ("pbrt", "dat")):
        file = folder / f"lens.{ending}"
        read = functools.partial(pecs.Lens, file)
        kinds[name] = Kind(file, "lens", "convert", file, "-o", output / "lens.json", read=read)

    scene = Path(shutil.copytree(ROOT / "scenes/board", folder / "board"))
    (folder / "aligned.json").write_text(json.dumps(ALIGNED, indent=1))
    shutil.copy(folder / "in.evt3.raw", folder / "real.raw")
    align = ("align", folder / "real.raw", "--scene", scene, "-o", output / "aligned.json")
    again = ("--sim", folder / "real.raw", "--sim-of", folder / "aligned.json")
    kinds["scene.json"] = Kind(scene / "scene.json", *align)
    kinds["aligned.json"] = Kind(folder / "aligned.json", *align, *again)
    kinds["scene.json to render"] = Kind(scene / "scene.json", read=lambda: load_scene(scene, []))
    overrides = [f"@{folder / 'aligned.json'}"]
    kinds["aligned.json to render"] = Kind(folder / "aligned.json", read=lambda: load_scene(scene, overrides))
    return kinds


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=500, help="mutants of each kind")
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--only", help="kinds, divided by commas")
    parser.add_argument("--exr", type=Path, help="folder whose files are read as EXR")
    a = parser.parse_args()
    bad = 0
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        if a.exr:
            (folder / "to").mkdir()
            kinds = frames(*stacks(folder), folder / "to")
            whole = [p.read_bytes() for p in sorted(a.exr.rglob("*")) if p.is_file() and p.suffix != ".rst"]
        else:
            kinds = all_kinds(folder)
        for name, kind in kinds.items():
            if a.only and name not in a.only.split(","):
                continue
            for word, said in [*in_python(kind, [kind.good])] if kind.read else []:
                if word != "taken":
                    sys.exit(f"{name}: the good file is {word}: {said}")
            rng = random.Random(f"{name} {a.seed}")
            is_json = kind.file.suffix == ".json"
            row = try_all(name, kind, whole if a.exr else [mutant(kind.good, rng, is_json) for _ in range(a.count)])
            bad += sum(row[word] for word in row.keys() - GOOD - {"kind", "files"})
            print(json.dumps(row), flush=True)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
