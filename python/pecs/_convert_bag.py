"""`pecs convert` of ROS bags: the program converts a file of events in place of each bag (pecs.ros)."""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import warnings
from functools import partial
from pathlib import Path

from ._arguments import Parser
from ._command import answer
from ._config import read_json
from ._errors import UsageError, one_line
from ._files import check_outputs, sha256, write_json
from ._platform import die_with_parent
from ._program import program
from .events import EventReader
from .ros import MESSAGES, check_messages, unpack, write_bag


def _parser() -> Parser:
    parser = Parser(prog="pecs convert", description="Converts a ROS bag to a file of events, or back.")
    add = parser.add_argument
    add("input", help="a bag or a file of events")
    add("output", help="a file of events, or a bag: .bag, .mcap, or a folder")
    add("--from-bag", action="store_true", help="INPUT is a bag")
    add("--to-bag", action="store_true", help="OUTPUT becomes a bag")
    add("--topic", help="of the events of INPUT if it is a bag, otherwise of OUTPUT")
    add("--format", help="format of a file; of a bag its messages: " + " or ".join(MESSAGES))
    return parser


def main(argv: list[str]) -> int:
    """[OPTIONS] -- INPUT OUTPUT and the command line of the program."""
    end = argv.index("--") + 3
    return answer(_parser(), partial(_convert, argv[end:]), argv[:end])


def _convert(words: list[str], args: argparse.Namespace) -> None:
    """Runs the program with a file of events in place of each bag."""
    source, target = Path(args.input), Path(args.output)
    from_bag, to_bag = args.from_bag, args.to_bag
    if to_bag and args.format is not None:
        check_messages(f"{target}: --format", args.format)
    check_outputs([source], [target])
    with tempfile.TemporaryDirectory(prefix="pecs-") as folder:
        with warnings.catch_warnings(record=True) as caught:
            file = unpack(source, Path(folder), args.topic) if from_bag else source
        for warning in caught:
            print(f"pecs: warning: {one_line(str(warning.message))}", file=sys.stderr)
        made = Path(folder) / "made.npz" if to_bag else target
        aliases = {args.input: str(file), args.output: str(made)}
        run = [aliases.get(word, word) for word in _without(words, ["--topic"] + ["--format"] * to_bag)]
        if not {str(file), str(made)} <= {*run}:  # the program would hand over to this module again
            raise UsageError(f"convert: got {args.input} and {args.output} in another form, wanted them as they are")
        text = _run_program(run, {alias: name for name, alias in aliases.items() if name != alias})
        if to_bag:
            with EventReader(made) as reader:
                size = reader.info["width"], reader.info["height"]
                write_bag(target, reader, *size, messages=args.format, topic=None if from_bag else args.topic)
            text = text.replace(" npz", " ROS bag").replace('"npz"', '"ROS bag"')
        _record(words, args, made, from_bag, to_bag)
    print(text, end="")


def _without(words: list[str], options: list[str]) -> list[str]:
    """A command line without these options and their values."""
    out, skip = [], False
    for word in words:
        if not skip and word.partition("=")[0] not in options:
            out.append(word)
        skip = word in options
    return out


def _run_program(words: list[str], names: dict[str, str]) -> str:
    """Runs the program; returns its output. Messages have the names of the user's files. Raises SystemExit."""

    def named(text: str) -> str:
        for alias, name in names.items():
            text = text.replace(alias, name)
        return text

    command = die_with_parent([program(), *words])
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as child:
        for line in child.stderr or ():
            sys.stderr.write(named(line))
        text = child.stdout.read() if child.stdout else ""
    if child.returncode:
        raise SystemExit(child.returncode)
    return named(text)


def _record(words: list[str], args: argparse.Namespace, made: Path, from_bag: bool, to_bag: bool) -> None:
    """The program's run record with the user's files and the bag's options."""
    path = made.with_name(made.name + ".run.json")
    if not path.exists():  # a pipe or a device has none
        return
    source, target = Path(args.input), Path(args.output)
    record = read_json(path) | {"arguments": words, "output": str(target)}
    record["config"]["topic"] = args.topic
    if from_bag:
        content = source / "metadata.yaml" if source.is_dir() else source
        record["inputs"] = [{"path": str(source), "sha256": sha256(content)}]
        record["config"]["input_format"] = "ROS bag"
    if to_bag:
        record["config"]["format"] = record["results"]["format"] = args.format or "ROS bag"
    write_json(target.with_name(target.name + ".run.json"), record)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
