"""Reads the sample set with the Python package of PECS: python load.py [FOLDER]. Without it: h5py reads events.h5."""

import sys
from pathlib import Path

from pecs.datasets import Windows, sequences

folder = sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent
for sequence in sequences(folder):
    data = Windows([sequence], window_us=40_000, fields=("depth", "flow"), voxel_grid={"bins": 5})
    count = sum(len(window["events"]) for window in data)
    first = data[0]
    print(f"{sequence.name} {sequence.info['scene']}: {count} events in {len(data)} windows,", end=" ")
    print(f"voxel grid {first['voxel_grid'].shape}, depth {first['depth'].shape}, flow {first['flow'].shape}")
