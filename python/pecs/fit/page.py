"""`pecs stimulus`: the page that plays the protocol."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from .._arguments import Parser
from .._command import answer
from .._files import write_text
from .stimulus import stimulus_page, timeline

ABOUT = (
    "Writes a web page that plays the protocol of `pecs fit --stimulus` in full screen: slow ramps between "
    "known relative levels and still light, each announced by flashes."
)
EXAMPLES = ("pecs stimulus -o stimulus.html",)


def main(argv: list[str]) -> int:
    parser = Parser(prog="pecs stimulus", description=ABOUT, examples=EXAMPLES)
    parser.add_argument("-o", "--output", type=Path, required=True, help="the page (.html)")
    return answer(parser, _write, argv)


def _write(args: argparse.Namespace) -> None:
    write_text(args.output, stimulus_page())
    seconds = sum(part[2] for part in timeline())
    print(f"{args.output}: {seconds:.0f} s; open it in a browser and record the screen with the camera")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
