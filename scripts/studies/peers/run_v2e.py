"""run_v2e.py CHECKOUT FRAMES.npy T_US.npy OUT.npy OPTIONS: the emulator of a checkout of SensorsINI/v2e.
Needs torch."""

import json
import sys
import time

import numpy as np

checkout, frames, t_us, out, options = sys.argv[1:]
sys.path.insert(0, checkout)
from v2ecore.emulator import EventEmulator  # noqa: E402

frames, t_us = np.load(frames), np.load(t_us)
emulator = EventEmulator(device="cpu", **json.loads(options))
start = time.perf_counter()
found = [emulator.generate_events(frame, t * 1e-6) for frame, t in zip(frames, t_us, strict=True)]
print(time.perf_counter() - start)
events = np.concatenate([e for e in found if e is not None] or [np.empty((0, 4))]).astype(np.float64)
np.save(out, np.stack([events[:, 0] * 1e6, events[:, 1], events[:, 2], events[:, 3] > 0], axis=1))
