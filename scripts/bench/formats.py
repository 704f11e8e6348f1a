"""Reading and writing event files beside readers that are not ours, in one run: JSON on stdout, Mevents/s.

.venv/bin/python scripts/bench/formats.py [--events 2000000] [--passes 5]
"""

import argparse
import importlib.util
import json
import sys
import tempfile
from pathlib import Path

import numpy as np
import pecs
from pecs_lab.measure import median_s

ROOT = Path(__file__).resolve().parents[2]
WIDTH, HEIGHT = 1280, 720


def test_readers():
    """The readers of tests/python/support/event_readers.py."""
    spec = importlib.util.spec_from_file_location("event_readers", ROOT / "tests/python/support/event_readers.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def edge_stream(count):
    """A vertical edge that sweeps to the right: bursts along columns with noise of some microseconds."""
    rng = np.random.default_rng(1)
    events = np.zeros(count, pecs.EVENT_DTYPE)
    events["t"] = np.sort(rng.integers(0, count // 8, count))
    events["x"] = (events["t"] // 50 + rng.integers(0, 4, count)) % WIDTH
    events["y"] = rng.integers(0, HEIGHT, count)
    events["p"] = rng.integers(0, 2, count)
    return events


def rate(work, count, passes):
    return round(count / median_s(work, passes)[0] / 1e6, 2)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--events", type=int, default=2_000_000)
    parser.add_argument("--passes", type=int, default=5)
    args = parser.parse_args()
    readers = test_readers()
    peers = {}
    for format, _, reader in readers.PEERS:
        peers.setdefault(format, []).append(reader)
    events = edge_stream(args.events)
    result = {"events": args.events, "passes": args.passes, "unit": "Mevents/s", "formats": {}}
    with tempfile.TemporaryDirectory() as folder:
        for format in pecs.event_formats():
            name = format["name"]
            path = Path(folder) / f"e{format['extensions'][0]}"
            row = result["formats"][name] = {}
            row["write"] = rate(lambda: pecs.write(path, events, WIDTH, HEIGHT, name), len(events), args.passes)  # noqa: B023
            row["read"] = rate(lambda: pecs.read(path, name), len(events), args.passes)  # noqa: B023
            row["bytes_per_event"] = round(path.stat().st_size / len(events), 2)
            for peer in peers.get(name, []):
                label = f"read {peer.__name__.removeprefix('by_')}"
                try:
                    row[label] = rate(lambda: [np.asarray(c) for c in peer(path)], len(events), args.passes)  # noqa: B023
                except BaseException as error:  # a reader that is missing, or a skipped test's exception
                    row[label] = f"none: {error}"[:80]
            print(name, row, file=sys.stderr)
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
