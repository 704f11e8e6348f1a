"""run_voltmeter.py CHECKOUT FRAMES.npy T_US.npy OUT.npy OPTIONS: the simulator of a checkout of Lynn0306/DVS-Voltmeter.
Needs torch, easydict."""

import json
import sys
import time

import numpy as np

checkout, frames, t_us, out, options = sys.argv[1:]
sys.path.insert(0, checkout)
import torch  # noqa: E402
from src.config import cfg  # noqa: E402
from src.simulator import EventSim  # noqa: E402

options = json.loads(options)
torch.manual_seed(options["seed"])
cfg.SENSOR.K = options["k"]
simulator = EventSim(cfg=cfg, output_folder="", video_name="")
frames, t_us = np.load(frames), np.load(t_us)
start = time.perf_counter()
found = [simulator.generate_events(frame, t) for frame, t in zip(frames, t_us, strict=True)]
print(time.perf_counter() - start)
np.save(out, np.concatenate([e for e in found if e is not None]).astype(np.float64))
