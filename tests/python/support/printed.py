"""What a page shows as printed, against what is printed."""

import re

import pytest

PRINTED = re.compile(r"```(?:sh|python)\n([^`]*)```\n\n```text title=\"printed\"\n([^`]*)```")
NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]\d+)?")


def assert_printed(expected, prints):
    """The lines are there, in this order; numbers within 1 %, since events may differ between instruction sets."""
    left = prints.splitlines()
    for line in expected.splitlines():
        while left and NUMBER.sub("#", left[0]) != NUMBER.sub("#", line):
            left.pop(0)
        assert left, f"wanted {line}\nin {prints}"
        got, wanted = ([float(n) for n in NUMBER.findall(text)] for text in (left.pop(0), line))
        assert got == pytest.approx(wanted, rel=0.01), f"wanted {line}\nin {prints}"
