"""The command line of data sets."""

from __future__ import annotations

import argparse
import dataclasses
import math
import shutil
import sys
import time
from collections import defaultdict
from itertools import pairwise
from pathlib import Path

from .._arguments import THREADS, Parser, Whole
from .._command import answer
from .._errors import PecsOutputError, UsageError, bad_input
from .._files import existing_folder, read_text, write_text
from .._progress import Line
from .._text import counted
from . import manifest, recipe, recipe_check, report, run, scene_cameras, writers
from .card import write_cards
from .files import read_numbers, read_object
from .plan import Plan, SequencePlan
from .sequence import sequences
from .work import RUNS, Busy

Measured = dict[str, tuple[float, run.Cost]]  # scene -> duration [s] and cost of its first sequence
RECIPE = "recipe.toml"  # of a .blend, in its set
SHOWN_ROWS, SHOWN_BAD = 20, 4  # of --plan; of --check, which prints what is damaged
MOST_DRAWN = 1000  # sequences that --plan draws; of more, evenly spaced ones stand for all
ABOUT = """Makes a data set from a recipe (docs/reference/datasets.md): sequences of events with ground truth, rendered
from scenes. Run again, a stopped job continues. Several processes may work on one set: each takes sequences that no
other has."""
EXAMPLES = (
    "pecs dataset room.toml -o out/room --plan        # sequences, frames, hours and gigabytes; makes nothing",
    "pecs dataset room.toml -o out/room               # all of it",
    "pecs dataset room.toml -o out/room --only 3      # sequence 3 alone (a farm's task)",
    "pecs dataset room.toml -o out/room --check       # compares all files with their checksums",
    "pecs dataset my.blend -o out/my                  # the cameras of a .blend, by a recipe that is printed",
    "pecs dataset out/room --export dsec -o out/dsec  # an existing set in another layout",
)


def _parser() -> Parser:
    parser = Parser(prog="pecs dataset", description=ABOUT, examples=EXAMPLES)
    add = parser.add_argument
    add(
        "recipe",
        type=Path,
        help="RECIPE.toml, or FILE.blend (a set of its own cameras); with --export the folder of a set",
    )
    add("-o", "--output", type=Path, required=True, help="folder of the set, or of what --export writes")
    about = "how many, instead of the recipe's; the first ones stay the same"
    add("--sequences", type=Whole(1, recipe.MOST_SEQUENCES), help=about)
    add("--only", help="N or A:B: these sequences, without the set's own files")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--plan", action="store_true", help="print sequences, time and size; make nothing")
    what.add_argument(
        "--estimate",
        action="store_true",
        help="as --plan, with time, size and memory measured on a few frames of each scene",
    )
    what.add_argument("--check", action="store_true", help="compare all files with their checksums")
    what.add_argument("--repair", action="store_true", help="move damaged sequences aside and make them again")
    what.add_argument("--export", help=f"write an existing set in another layout: {', '.join(writers.WRITERS)}")
    add(
        "--allow-scripts",
        action="store_true",
        help="run the Python of .blend files and of scene folders that are not of PECS",
    )
    add("--threads", type=THREADS, default=0, help="0: all cores; does not change the result")
    return parser


def main(argv: list[str]) -> int:
    return answer(_parser(), _run, argv)


def _run(args: argparse.Namespace) -> None:
    line = Line(task="dataset", quiet=args.quiet, verbose=args.verbose)
    if args.export:
        _export(args.recipe, args.export, args.output, line)
        return
    text = None
    if args.recipe.suffix == ".blend":
        text = scene_cameras.recipe_of(args.recipe, args.output, args.allow_scripts)
        args.recipe = args.output / RECIPE
    found = dataclasses.replace(recipe.load(args.recipe, text), allow_scripts=args.allow_scripts)
    if args.sequences is not None:
        found = dataclasses.replace(found, sequences=args.sequences)
    wanted = _wanted(args.only, found.sequences)
    manifest.check_count(found, args.output)
    if args.check:
        _check(wanted, args.output)
        return
    recipe_check.check(plan := Plan(found))
    if text:
        _keep(args.recipe, text, write=not (args.plan or args.estimate))
    if args.plan or args.estimate:
        _plan(plan, wanted, args.output, _measure(plan, wanted, args.threads, line) if args.estimate else {})
        return
    if args.repair:
        _move_aside(wanted, args.output)
    _make(plan, wanted, args.output, args.threads, line)
    if not args.only:
        _finish(found, args.output, line)


def _keep(path: Path, text: str, write: bool) -> None:
    """Prints the recipe of a .blend, and writes it into the set."""
    if path.exists() and read_text(path, len(text.encode()) + 1_000_000) != text:
        message = f"{path}: the recipe of another .blend, or of this one before an edit; choose another folder, or run"
        raise PecsOutputError(f"{message} pecs dataset {path} -o {path.parent}")
    print(text)
    if write:
        write_text(path, text)


def _wanted(only: str | None, count: int) -> list[int]:
    if only is None:
        return list(range(count))
    first, colon, last = only.partition(":")
    try:
        begin = int(first)
        end = int(last) if colon else begin + 1
    except ValueError:
        begin, end = -1, -1
    if not 0 <= begin < end <= count:
        raise UsageError(f"--only {only}: wanted N below {count}, or A:B with B up to {count}")
    return list(range(begin, end))


def _make(plan: Plan, wanted: list[int], output: Path, threads: int, line: Line) -> None:
    begin, made = time.monotonic(), 0
    busy: list[int] = []
    for done, index in enumerate(wanted):
        final = manifest.sequence_folder(output, index)
        fresh = not final.is_dir()
        left = (time.monotonic() - begin) / made * (len(wanted) - done) if made else math.nan
        more = "" if math.isnan(left) else f", about {max(left / 60, 1):.0f} min left"

        def say(step: str, progress: str = "", index: int = index, done: int = done, more: str = more) -> None:
            text = f"dataset: {done + 1}/{len(wanted)}, sequence {index:04d}, {step}"
            if progress:
                line.detail(f"{text} {progress}{more}")
            else:
                line(f"{text}{more}", done, len(wanted))

        try:
            run.make(plan.sequence(index), output, threads, say)
        except Busy:
            if len(wanted) == 1:
                raise
            busy.append(index)
            continue
        made += fresh
    line.end()
    if busy:
        line.note(f"dataset: left to other processes: {', '.join(map(str, busy))}")


def _finish(found: recipe.Recipe, output: Path, line: Line) -> None:
    """Writes the files of the set once all sequences exist."""
    missing = manifest.missing(found, output)
    if missing:
        line.note(f"dataset: {len(missing)} sequences are still being made elsewhere")
        return
    content = manifest.write(found, output)
    write_cards(found, content, output)
    report.write_index(output, content)
    for row in content["sequences"]:
        for outside in row["outside_limits"]:
            line.note(f"dataset: sequence {row['name']}: {outside}")
    sums = {row["name"]: row["sha256"] for row in content["sequences"]}
    for name in found.export:
        to = output / "exports" / name
        if not (to.is_dir() and read_object(to / writers.REPORT, "an export").get("made_of") == sums):
            _export(output, name, to, line, replace=True)
    print(f"{output / 'index.html'}: {counted(found.sequences, 'sequence')}")


def _export(folder: Path, name: str, output: Path, line: Line, replace: bool = False) -> None:
    report = writers.write(name, sequences(folder), output, replace)
    if unfinished := len([*folder.glob("sequences/*.partial")]):
        line.note(f"{name}: left out: {unfinished} unfinished sequences")
    for gone in report["left_out"]:
        line.note(f"{name}: left out: {gone['what']}: {gone['why']}")
    print(f"{output}: {name}, {counted(len(report['sequences']), 'sequence')}")


def _check(wanted: list[int], output: Path) -> None:
    bad = _damaged(wanted, output)
    damaged, absent = [index for index in bad if bad[index]], [index for index in bad if not bad[index]]
    for line in (line for lines in bad.values() for line in lines):
        print(line)
    got = [
        f"{len(indices)} {what}{_some(indices)}"
        for what, indices in (("damaged", damaged), ("absent", absent))
        if indices
    ]
    if got:
        raise bad_input(output, "", f"{', '.join(got)}, of {len(wanted)}", "all whole (--repair makes them)")
    print(f"{output}: {len(wanted)} sequences, whole")


def _some(indices: list[int]) -> str:
    """The first ones, in brackets."""
    more = ", …" if len(indices) > SHOWN_BAD else ""
    return f" ({', '.join(f'{index:04d}' for index in indices[:SHOWN_BAD])}{more})"


def _damaged(wanted: list[int], output: Path) -> dict[int, list[str]]:
    """Faults of the sequences that are not whole; of one that is absent, none."""
    found, sums = {}, manifest.sums(output)
    for index in wanted:
        folder = manifest.sequence_folder(output, index)
        there = folder.is_dir()
        lines = manifest.faults(folder, sums.get(folder.name)) if there else []
        if lines or not there:
            found[index] = lines
    return found


def _move_aside(wanted: list[int], output: Path) -> None:
    for index in _damaged(wanted, output):
        folder, aside = manifest.sequence_folder(output, index), output / "damaged"
        if folder.is_dir():
            aside.mkdir(exist_ok=True)
            places = (aside / f"{folder.name}.{number}" for number in range(1, 10**6))
            folder.rename(next(place for place in places if not place.exists()))
            (output / "dataset.json").unlink(missing_ok=True)


def _measure(plan: Plan, wanted: list[int], threads: int, line: Line) -> Measured:
    measured: Measured = {}
    for index in wanted[:MOST_DRAWN]:
        if (name := plan.scene(index).name) not in measured:
            line(f"dataset: a few frames of {name}", len(measured), 0)
            sequence = plan.sequence(index)
            measured[name] = sequence.duration_s, run.cost(sequence, threads)
    line.end()
    return measured


@dataclasses.dataclass
class _Sum:
    """Of some sequences: how many, and what they last and take."""

    number: float = 0.0
    duration_s: float = 0.0
    seconds: float = 0.0
    disk_gb: float = 0.0
    cpu_s: float = 0.0
    events: float = 0.0

    def add(self, other: _Sum, factor: float = 1.0) -> None:
        for key, value in vars(other).items():
            setattr(self, key, getattr(self, key) + factor * value)


def _plan(plan: Plan, wanted: list[int], output: Path, measured: Measured) -> None:
    """Prints the drawn sequences, and their time and size as measured on what exists of the same scenes, or by
    `_measure`."""
    rows, truth, light = [], 0, 0
    made, missing = defaultdict[str, _Sum](_Sum), defaultdict[str, _Sum](_Sum)  # by scene
    every, left = _Sum(), _Sum()
    stacks = sum(camera.has_light for camera in plan.recipe.cameras)
    owners = sum(not camera.pixels_of for camera in plan.recipe.cameras)
    names = {path.name for path in output.glob("sequences/*")}
    whole, begun = ([index for index in wanted if f"{index:04d}{end}" in names] for end in ("", ".partial"))
    spaced = set(_spaced(wanted))
    for index in sorted({*wanted[:SHOWN_ROWS], *spaced, *_spaced(whole), *_spaced(begun)}):
        sequence, folder = plan.sequence(index), manifest.sequence_folder(output, index)
        scene, duration_s = sequence.scene.name, sequence.duration_s
        if index in spaced:
            truth += owners * sequence.truth_frames
            light += sum(map(sequence.instants, sequence.with_light))
        share, seconds, gigabytes = _made(sequence, folder)
        if share and not measured:
            made[scene].add(_Sum(share, share * duration_s, seconds, gigabytes))
        if index in spaced and not folder.is_dir():
            missing[scene].add(_Sum(1, (1 - share) * duration_s))
        words = [f"{index:04d}", f"{sequence.split:5}", f"{scene:16}", f"{duration_s:.3g} s"]
        rows.append("  ".join([*words, sequence.trajectory["kind"], *(["(there)"] if folder.is_dir() else [])]))
    print("\n".join(rows[:SHOWN_ROWS]))
    if len(wanted) > SHOWN_ROWS:
        print(f"… and {len(wanted) - SHOWN_ROWS} more")
    kind = "keyframes among" if plan.sequence(wanted[0]).is_adaptive else "all of"
    about, each = "about " if len(spaced) < len(wanted) else "", len(wanted) / len(spaced)
    what = f"ground truth at {about}{truth * each:.0f} instants, light at {kind} {about}{light * each:.0f}"
    print(f"{counted(len(wanted), 'sequence')}, {counted(stacks, 'stack')} each: {what}")
    free = shutil.disk_usage(existing_folder(output)).free * 1e-9
    made.update((scene, _Sum(1, duration_s, *cost[:4])) for scene, (duration_s, cost) in measured.items())
    if not made:
        print(f"--estimate measures time and size on a few frames of each scene; {free:.0f} GB free")
        return
    for of in made.values():
        every.add(of)
    what = "the renders of a few frames" if measured else f"{every.number:.2g} existing sequences"
    print(f"measured on {what} of {', '.join(sorted(made))}")
    for scene, (duration_s, cost) in measured.items():
        if cost.events:
            noise = f"{100 * cost.render_noise:.0f} % of them by the renderer's noise, median {cost.px_per_s:.2g} px/s"
            print(f"{scene}, {duration_s:.3g} s: about {cost.events:.2g} events, {noise}")
    number = sum(of.number for of in missing.values())
    each = (len(wanted) - len(whole)) / max(1, number)
    for scene, of in missing.items():
        usual = made.get(scene, every)
        left.add(usual, each * of.duration_s / usual.duration_s)
    unknown = sorted(missing.keys() - made.keys())
    note = f" (no sequence yet of {', '.join(unknown)})" if unknown else ""
    memory = f", {max(cost.memory_gb for _, cost in measured.values()):.1f} GB of memory" if measured else ""
    beyond = f", and the sensor's time, and {f'{left.events:.2g} ' if left.events else ''}events" if measured else ""
    cores = f" ({left.cpu_s / 3600:.2f} hours of one core)" if measured else ""
    hours = f"{left.seconds / 3600:.2f} h of this machine as loaded{cores}"
    print(f"{each * number:.0f} left: {hours} and {left.disk_gb:.1f} GB{note}{memory}{beyond}; {free:.0f} GB free")


def _spaced(indices: list[int]) -> list[int]:
    return indices[:: -(-len(indices) // MOST_DRAWN) or 1]


def _made(sequence: SequencePlan, folder: Path) -> tuple[float, float, float]:
    """Share of a sequence that exists, the time that this took [s] without pauses between runs, and its size [GB]. The
    share of a sequence that is being made is that of the instants and pixels of the cameras whose light is complete."""
    if folder.is_dir():
        share, until = 1.0, math.inf
    else:
        folder = folder.with_name(f"{folder.name}.partial")
        done = {camera.name: folder / camera.stack / "done" for camera in sequence.with_light}
        rendered = {name: path.stat().st_mtime for name, path in done.items() if path.exists()}
        if not rendered:
            return 0.0, 0.0, 0.0
        sizes = {one.name: one.pixels.width * one.pixels.height for one in sequence.with_light}
        parts = {one.name: sizes[one.name] * sequence.instants(one) for one in sequence.with_light}
        share, until = sum(parts[name] for name in rendered) / sum(parts.values()), max(rendered.values())
    files = [one for one in (p.stat() for p in folder.rglob("*") if p.is_file()) if one.st_mtime <= until]
    times_s, runs = [one.st_mtime for one in files], folder / RUNS
    begins_s = read_numbers(runs, "times of runs") if runs.exists() else [min(times_s)]
    seconds = 0.0
    for begin_s, next_s in pairwise([*begins_s, math.inf]):
        seconds += max((t_s - begin_s for t_s in times_s if begin_s <= t_s < next_s), default=0)
    return share, seconds, sum(one.st_size for one in files) * 1e-9


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
