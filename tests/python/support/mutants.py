"""Random changes of JSON texts."""

import json
import random

STRANGE = [
    "",
    "\u0000",
    "../..",
    "1e999",
    "NaN",
    "-1",
    "0",
    "null",
    "[]",
    "{}",
    '""',
    "true",
    "1e-300",
    "9" * 400,
    '"\\ud800"',
]


def mutant(text: str, rng: random.Random) -> bytes:
    """One to three changes: bytes, tokens, or whole values."""
    data = text.encode()
    for _ in range(rng.randint(1, 3)):
        kind, at = rng.randrange(6), rng.randrange(len(data) + 1)
        if kind == 0:
            data = data[:at] + bytes([rng.randrange(256)]) + data[at + 1 :]
        elif kind == 1:
            data = data[:at] + data[at + rng.randint(1, 40) :]
        elif kind == 2:
            data = data[:at]
        elif kind == 3:
            data = data[:at] + data[rng.randrange(len(data) + 1) :]
        else:  # a value of the tree
            try:
                tree = json.loads(data)
            except ValueError:
                continue
            places = list(walk(tree))
            if places:
                holder, key = rng.choice(places)
                holder[key] = "@@"
                data = json.dumps(tree).replace('"@@"', rng.choice(STRANGE)).encode()
    return data or b" "


def walk(tree):
    for key, value in list(tree.items() if isinstance(tree, dict) else enumerate(tree)):
        yield tree, key
        if isinstance(value, (dict, list)):
            yield from walk(value)
