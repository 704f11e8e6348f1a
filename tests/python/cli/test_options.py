"""Every option of the commands that read events and frames changes the result, or is refused, on each kind of input."""

import re

import cv2
import numpy as np
import pecs
import pytest
from support.small_stacks import write

# Of pictures with --times, only what reads times: the others are those of pictures with --fps.
TIMED = {"--fps", "--time-unit", "--start", "--duration", "--warmup", "--rolling-shutter"}
# Options that change no result by their nature.
NEUTRAL = {"--help", "--quiet", "--verbose", "--threads"}
# Options that ask for what the input lacks anyway: the result is the one that was asked for.
HARMLESS = {
    ("sense", "--no-motion"), ("sense", "--render-noise"), ("sense", "--bands"),  # one band, no motion, no noise
    ("sense", "--afk"), ("convert", "--afk"),  # nothing flickers
    ("sense", "--readout"),  # no two pixels wait for each other
    ("sense", "--window"),  # tests/python/sensor/test_inputs.py
}  # fmt: skip
# Options of inputs or other options that are not here: tests of each.
ELSEWHERE = {
    ("convert", "--topic"), ("convert", "--afk-counts"), ("convert", "--dropped"), ("info", "--fps"),
    ("compare", "--disk"), ("sense", "--warmup-loops"), ("sense", "--afk-counts"), ("sense", "--dropped"),
    ("sense", "--frames"), ("sense", "--param"), ("sense", "--fnumber"), ("sense", "--ocio"), ("sense", "--white"),
}  # fmt: skip
FORMATS = {"e.raw": "evt3", "e.txt": "v2e", "bare.txt": "v2e", "e.npz": "npz", "bare.npz": "npz", "e.csv": "csv"}
EVENTS = [*FORMATS]
STAGES = {
    "--roi": ["0,0,20,20"], "--mask": ["mask.txt"], "--afk-pass": ["50:520"],
    "--afk-counts": ["6:4"], "--trail": ["5ms"], "--stc": ["5ms"], "--stc-keep": ["5ms"], "--erc": ["10kHz"],
    "--dropped": ["d.npy"],
}  # fmt: skip
WINDOW = {"--from": ["3ms"], "--to": ["9ms"]}
COMMANDS = {
    "convert": (
        [["convert", name, "o.csv"] for name in EVENTS],
        {
            "--format": ["npz"], "--input-format": ["evt3", "evt2", "npz", "csv", "e2vid", "v2e"], "--t-start": ["3ms"],
            "--t-end": ["9ms"], "--rezero": [], "--decimate": ["2"], "--size": ["80", "60"], "--time-unit": ["ns"],
            "--late": ["sort", "drop"], "--topic": ["/a"], "--json": [],
        } | STAGES,
    ),
    "info": (
        [["info", name] for name in [*EVENTS, "stack"]],
        {"--format": ["evt3", "v2e"], "--size": ["80", "60"], "--time-unit": ["ns"], "--fps": ["500"], "--json": []},
    ),
    "view": (
        [["view", "e.raw", "-o", "o.png"], ["view", "e.raw", "-o", "o.html"],  # and two videos of few frames
         ["view", "e.raw", "-o", "o.mp4", "--slow-motion", "20"], ["view", "e.raw", "-o", "o.mp4", "--fps", "2"]],
        WINDOW | {
            "--window": ["500us"], "--count": ["2"], "--slow-motion": ["3"], "--fps": ["7"], "--limit": ["50"],
            "--theme": ["dark"], "--json": [], "--output": ["p.png"],
        },
    ),
    "sense": (
        [["sense", "stack", "-o", "o.csv"], ["sense", "pictures", "-o", "o.csv", "--fps", "1000"],
         ["sense", "pictures", "-o", "o.csv", "--times", "times.txt"]],
        {
            "--output": ["p.csv"], "--format": ["npz"], "--chip": ["davis346"], "--set": ["contrast_threshold_on=0.1"],
            "--bias": ["diff_on=-20"], "--bias-file": ["b.bias"], "--no-noise": [], "--seed": ["2"],
            "--preset": ["v2e_noisy"], "--model": ["esim"], "--param": ["threshold_on=0.3"], "--white": ["1pA"],
            "--labels": ["l.npy"], "--frames": ["f"], "--fps": ["900"], "--times": ["times.txt"],
            "--time-unit": ["ms"], "--crop": ["0,0,16,16"], "--size": ["20x15"], "--no-flow": [],
            "--rolling-shutter": ["800us"], "--colorspace": ["linear"], "--ocio": ["c.ocio"], "--photocurrent": ["3pA"],
            "--fnumber": ["4"], "--gain": ["1e-15"], "--warmup-loops": ["1"], "--warmup": ["20ms"],
            "--start": ["3ms"], "--duration": ["9ms"], "--view": [], "--json": [],
        } | STAGES,
    ),
    "compare": (
        [["compare", "e.raw", "f.raw"], ["compare", "e.raw", "f.raw", "--window", "9ms"]],
        {
            "--window": ["8ms"], "--origin": ["zero"], "--normalisation": ["eq16", "paper"], "--seed": ["2"],
            "--disk": ["find"], "--realism": [], "--picture": ["p.svg"], "--json": [],
        },
    ),
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("in")
    rng = np.random.default_rng(1)
    events = np.zeros(2000, pecs.EVENT_DTYPE)
    events["t"] = 1000 + np.sort(rng.integers(0, 20_000, 2000))
    for name, top in (("x", 64), ("y", 48), ("p", 2)):
        events[name] = rng.integers(0, top, 2000)
    events["t"][700:] += 3000
    for name in ("e.raw", "e.npz", "e.csv"):
        pecs.write(out / name, events, 64, 48)
    pecs.write(out / "e.txt", events, 64, 48, "v2e")
    pecs.write(out / "f.raw", events[200:], 64, 48)
    columns = {name: events[name] for name in "txyp"}
    np.savez(out / "bare.npz", **columns)
    (out / "bare.txt").write_text("".join(f"{t / 1e6:.6f} {x} {y} {p}\n" for t, x, y, p in events.tolist()))
    write(out / "stack", level=1e-3)
    (out / "pictures").mkdir()
    x = np.arange(40)
    for i in range(24):
        frame = np.uint8(40 + 160 * np.exp(4 * np.cos(2 * np.pi * (x / 40 - i / 24)) - 4))
        cv2.imwrite(str(out / f"pictures/{i}.png"), np.broadcast_to(frame[None, :, None], (30, 40, 3)).copy())
    (out / "times.txt").write_text("".join(f"{1000 * i + 3 * i * i}\n" for i in range(24)))
    (out / "mask.txt").write_text("row 3\n")
    (out / "b.bias").write_text("-20 % bias_diff_on\n")
    (out / "c.ocio").write_text("no config")
    return out


def outcome(program, inputs, target, words):
    """What a command prints and writes, or its refusal."""
    target.mkdir()
    for path in inputs.iterdir():
        (target / path.name).symlink_to(path)
    given = set(target.iterdir())
    done = program(*words, cwd=target)
    if done.returncode:
        assert len(done.stderr.splitlines()) == 1 and done.returncode in (2, 3, 4, 6), (words, done.stderr)
        return None
    files = {p.name: p.read_bytes() for p in set(target.iterdir()) - given if not p.name.endswith(".run.json")}
    return done.stdout, done.stderr, files


@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_changes_the_result_or_is_refused(tmp_path, pecs_program, folder, command):
    bases, options = COMMANDS[command]
    listed = set(re.findall(r"^ +(?:-\w, *)?(--[a-z-]+)", pecs_program(command, "--help").stdout, re.M))
    listed -= NEUTRAL | {option for of, option in HARMLESS if of == command}
    assert listed == options.keys()
    number, heard = 0, {word for base in bases for word in base} | {"--output"}
    for base in bases:
        plain = outcome(pecs_program, folder, tmp_path / f"base{number}", base)
        assert plain, base
        for option, values in options.items():
            if option in base or ("--times" in base and option not in TIMED):
                continue
            several = option == "--size" or not values
            for words in [values] if several else [[value] for value in values]:
                number += 1
                changed = outcome(pecs_program, folder, tmp_path / str(number), [*base, option, *words])
                own_format = option in ("--input-format", "--format") and FORMATS.get(base[1]) in words
                assert changed != plain or own_format, (base, option, words)
                heard |= {option} if changed and not own_format else set()
    assert sorted(options.keys() - heard) == sorted(option for of, option in ELSEWHERE if of == command)
