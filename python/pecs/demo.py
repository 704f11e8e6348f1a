"""`pecs demo`: a scene with a known truth, through all pixel models, as event files, pictures, video and pages.

The scene is computed, not rendered: a disk of two white and two dark sectors turns before a grey wall. So it is known
when each edge passes each pixel, and with how many events an ideal pixel answers. Real pixels are late, and noisy.
"""

from __future__ import annotations

import argparse
import importlib.util
import math
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ._arguments import Parser
from ._command import answer
from ._errors import ExitCode, PecsError
from ._library import version
from ._program import program
from ._sense import sense
from .chip import Chip, bands, models
from .events import read, write
from .stack import StackWriter

CHIP = "imx636"
WIDTH, HEIGHT = 240, 180
CENTRE_PX, RADIUS_PX = (120.0, 90.0), 75.0
COUNTED = (0.2, 0.95)  # of the radius
SPEED_DEG_S = 1800.0  # counter-clockwise
PERIOD_US = round(180e6 / SPEED_DEG_S)  # the disk looks the same after half a turn
FRAMES = 250  # 0.95 pixels of the rim each
EDGE_PX = 3.0  # as a lens blurs them
WHITE, WALL, DARK = 2e-4, 8e-5, 2e-5  # W m^-2 nm^-1 on the film: a bright room, through f/2
ILLUMINANT = "d65"

LOOK = "Look: {folder}/report.html, {folder}/pecs.html (drag to turn it), {folder}/pecs.mp4, {folder}/pecs.png"
NEXT = """Next:
  what a file holds     pecs info {folder}/pecs.raw
  another pixel         pecs sense {folder}/stack -o mine.raw --set contrast_threshold_on=0.4
  your own video        pecs sense VIDEO.mp4 -o mine.raw --photocurrent 1pA
  another format        pecs convert {folder}/pecs.raw mine.h5
  a lens                pecs lens draw pecs_lab_15mm -o lens.svg
  a scene of Blender    {blender}
  Python                python -c 'import pecs; print(pecs.read("{folder}/pecs.raw"))'"""
EXAMPLES = ("pecs demo", "pecs demo -o out/demo --blender")
BLENDER_NEXT = "python -m pecs_blender render YOUR.blend -o stack"
BLENDER_MISSING = "pip install the wheel of pecs_blender; pecs demo --blender"


def light(t_s: float) -> NDArray[np.float64]:
    """[HEIGHT, WIDTH], W m^-2 nm^-1 on the film, edges EDGE_PX wide."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH] + 0.5
    radius = np.hypot(x - CENTRE_PX[0], y - CENTRE_PX[1])
    angle_deg = np.degrees(np.arctan2(CENTRE_PX[1] - y, x - CENTRE_PX[0])) - SPEED_DEG_S * t_s
    from_white_deg = np.abs((angle_deg + 45) % 180 - 90)  # from the middle of a white sector, 0 to 90
    white = np.clip(0.5 + radius * np.radians(45 - from_white_deg) / EDGE_PX, 0, 1)
    disk = np.clip(RADIUS_PX - radius + 0.5, 0, 1)
    return WALL + disk * (DARK + white * (WHITE - DARK) - WALL)


def on_disk(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Places whose events are counted."""
    radius = np.hypot(x - CENTRE_PX[0], y - CENTRE_PX[1]) / RADIUS_PX
    return (COUNTED[0] < radius) & (radius < COUNTED[1])


def write_stack(folder: Path) -> None:
    """One period; what is there already is not written again."""
    wavelengths = bands(CHIP, n=3, illuminant=ILLUMINANT)
    instants_ns = [round(1e3 * PERIOD_US * i / FRAMES) for i in range(FRAMES)]
    stack = {
        "pecs_stack": 1,
        "quantity": "irradiance",
        "width": WIDTH,
        "height": HEIGHT,
        "pixel_pitch_m": 4.86e-6,
        "bands": wavelengths,
        "times_ns": instants_ns,
        "period_ns": 1000 * PERIOD_US,
        "lens": None,
        "scene": {"name": "pecs demo", "parameters": {"speed_deg_s": SPEED_DEG_S, "contrast": WHITE / DARK}},
        "render": {},
        "versions": {"pecs": version()},
    }
    with StackWriter(folder, stack) as writer:
        for index, t_ns in enumerate(instants_ns):
            if not writer.has_frame(index):
                picture = light(1e-9 * t_ns).astype(np.float32)
                writer.write_frame(index, np.broadcast_to(picture, (len(wavelengths), HEIGHT, WIDTH)).copy())


def ideal_pixel(chip: Chip) -> tuple[float, float, float]:
    """The result of `measured` for a pixel that answers at once and has the chip's thresholds alone."""
    on_step, off_step = chip.contrast_threshold_on, chip.contrast_threshold_off
    level, peak, ons, offs, places = 0.0, math.log(WHITE / DARK), 0, 0, []  # log light over dark
    for turn in range(40):  # until it repeats, in the mean
        on = int((peak - level) / on_step)
        crossed = np.exp(level + on_step * np.arange(1, on + 1))
        level += on * on_step
        off = int(level / off_step)
        level -= off * off_step
        if turn >= 20:
            ons, offs = ons + on, offs + off
            places += list(EDGE_PX * ((crossed - 1) / (WHITE / DARK - 1) - 0.5))  # pixels, from the edge's middle
    radius_px = RADIUS_PX * np.sqrt(np.linspace(COUNTED[0] ** 2, COUNTED[1] ** 2, 100))  # of as many pixels each
    delay_s = np.median(np.array(places)[:, None] / (radius_px * math.radians(SPEED_DEG_S)))
    return ons / 20, offs / 20, 1e3 * float(delay_s)


def measured(events: NDArray[np.void]) -> tuple[float, float, float]:
    """Events per passing ON and OFF edge, and the median delay of ON events behind their edges [ms].

    `events` of one period: one edge of each kind passes each pixel.
    """
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH] + 0.5
    counted = on_disk(x, y)
    events = events[counted[events["y"], events["x"]]]
    on = events[events["p"] == 1]
    angle_deg = np.degrees(np.arctan2(CENTRE_PX[1] - (on["y"] + 0.5), on["x"] + 0.5 - CENTRE_PX[0]))
    past_deg = (90 + SPEED_DEG_S * 1e-6 * on["t"] - angle_deg + 45) % 180 - 45
    per_edge = [float((events["p"] == p).sum() / counted.sum()) for p in (1, 0)]
    return per_edge[0], per_edge[1], 1e3 * float(np.median(past_deg)) / SPEED_DEG_S


def run_program(*arguments: object, talk: list[str]) -> None:
    command = [str(program()), *map(str, arguments), *talk]
    done = subprocess.run(command, stdout=subprocess.DEVNULL)
    if done.returncode:
        raise PecsError(f"demo: {' '.join(command)} failed", done.returncode)


def show(events: Path, stack: Path, talk: list[str]) -> None:
    """Contact sheet, video, 3-D page and report next to the events. The core's program says that it makes none."""
    try:
        run_program("view", events, "-o", events.with_suffix(".png"), talk=talk)
    except PecsError as e:
        if e.code != ExitCode.UNSUPPORTED:
            raise
        return
    for ending in ("mp4", "html"):
        run_program("view", events, "-o", events.with_suffix(f".{ending}"), talk=talk)
    run_program("report", "--sim", events, "--stack", stack, "-o", events.with_name("report.html"), talk=talk)
    if "--quiet" not in talk:
        print(LOOK.format(folder=events.parent))


def demo(folder: Path, talk: list[str]) -> None:
    print(f"A disk turns before a wall: {WIDTH} x {HEIGHT} pixels, {PERIOD_US / 1000:.0f} ms, in {folder}/stack")
    write_stack(folder / "stack")
    print(f"\n{'model':<12}{'events':>8}{'per ON edge':>13}{'per OFF edge':>14}{'ON at, ms':>11}")

    def row(name: str, events: object, found: tuple[float, float, float]) -> None:
        print(f"{name:<12}{events:>8}{found[0]:>13.2f}{found[1]:>14.2f}{found[2]:>11.2f}", flush=True)

    row("ideal pixel", "", ideal_pixel(Chip(CHIP)))
    for model in [m["name"] for m in models()]:
        path = folder / f"{model}.raw"
        report = sense(folder / "stack", path, chip=CHIP, model=model, warmup_loops=2, duration_us=PERIOD_US)
        row(model, report["results"]["events"], measured(read(path)))
    events = folder / "pecs.raw"
    edge_ms = 1e3 * EDGE_PX / (RADIUS_PX * math.radians(SPEED_DEG_S))
    print(f"An edge takes {edge_ms:.1f} ms at the rim; time counts from its middle.\n", flush=True)
    write(folder / "pecs.aedat4", read(events))
    show(events, folder / "stack", talk)


def blender_folder() -> Path | None:
    """The folder of pecs_blender's scenes, if it and bpy are installed."""
    found = importlib.util.find_spec("pecs_blender")
    if not found or not found.submodule_search_locations or not importlib.util.find_spec("bpy"):
        return None
    package = Path(found.submodule_search_locations[0])
    return next((p for p in (package / "scenes", package.parents[1] / "scenes") if p.is_dir()), None)


def blender_demo(folder: Path, talk: list[str]) -> None:
    """The lab's rotating disk, rendered small through a real lens."""
    scenes = blender_folder()
    if scenes is None:
        raise PecsError("demo --blender: got no bpy, wanted the wheel of pecs_blender installed", ExitCode.NOT_FOUND)
    if "--quiet" not in talk:
        print(f"Rendering {scenes / 'rotating_disk'} through the lens pecs_lab_15mm", flush=True)
    options = "--bands 3 --width 160 --height 90 --samples 4 --fps 2800 --frames period --time adaptive"
    command = ["render", str(scenes / "rotating_disk"), "-o", str(folder / "stack"), *options.split(), *talk]
    done = subprocess.run([sys.executable, "-m", "pecs_blender", *command, "--set", "illuminance_lux=2000"])
    if done.returncode:
        raise PecsError("demo --blender: the render failed", done.returncode)
    events = folder / "pecs.raw"
    count = sense(folder / "stack", events, chip=CHIP, warmup_loops=2)["results"]["events"]
    print(f"{count} events")
    show(events, folder / "stack", talk)


def _parser() -> Parser:
    parser = Parser(prog="pecs demo", description=(__doc__ or "").removeprefix("`pecs demo`: "), examples=EXAMPLES)
    parser.add_argument("-o", "--output", type=Path, default=Path("pecs-demo"), help="folder")
    parser.add_argument("--blender", action="store_true", help="render a small scene instead (needs pecs_blender)")
    return parser


def _run(args: argparse.Namespace) -> None:
    begin = time.monotonic()
    args.output.mkdir(parents=True, exist_ok=True)
    talk = [f"--{name}" for name in ("quiet", "verbose") if getattr(args, name)]
    (blender_demo if args.blender else demo)(args.output, talk)
    if not args.quiet:
        print(f"Done in {time.monotonic() - begin:.0f} s.")
        print(NEXT.format(folder=args.output, blender=BLENDER_NEXT if blender_folder() else BLENDER_MISSING))


def main(argv: list[str]) -> int:
    return answer(_parser(), _run, argv)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
