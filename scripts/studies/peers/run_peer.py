"""run_peer.py v2e|icns|voltmeter CHECKOUT FRAMES.npy T_US.npy OUT.npy OPTIONS: another simulator, from a checkout
of its repository, on 8-bit frames. Writes rows of t [us], x, y, p and prints the seconds. v2e requires torch, voltmeter
torch and easydict."""

import atexit
import json
import logging
import sys
import time

import numpy as np


def v2e(checkout, frames, t_us, options):
    """SensorsINI/v2e"""
    sys.path.insert(0, checkout)
    import v2ecore.emulator as emulator_module
    from v2ecore.emulator import EventEmulator
    from v2ecore.emulator_utils import lin_log

    if "linear_below" in options:  # an argument of its function that it does not hand on
        below = options.pop("linear_below")
        emulator_module.lin_log = lambda x: lin_log(x, below)
    logging.disable(logging.WARNING)  # of a screen, which it looks for
    emulator = EventEmulator(device="cpu", **options)
    atexit.unregister(emulator.cleanup)  # would keep it in memory
    start = time.perf_counter()
    found = [emulator.generate_events(frame, t * 1e-6) for frame, t in zip(frames, t_us, strict=True)]
    seconds = time.perf_counter() - start
    events = np.concatenate([e for e in found if e is not None] or [np.empty((0, 4))]).astype(np.float64)
    return seconds, np.stack([events[:, 0] * 1e6, events[:, 1], events[:, 2], events[:, 3] > 0], axis=1)


def icns(checkout, frames, t_us, options):
    """neuromorphicsystems/IEBCS"""
    sys.path.insert(0, checkout + "/src")
    from dvs_sensor import DvsSensor

    np.random.seed(options.pop("seed"))
    white_lux = options.pop("white_lux")
    sensor = DvsSensor("sensor")
    sensor.initCamera(frames.shape[2], frames.shape[1], **options)
    start = time.perf_counter()
    sensor.init_image(frames[0] / 255.0 * white_lux)
    found = []
    for frame, dt in zip(frames[1:], np.diff(np.round(t_us)), strict=True):
        e = sensor.update(frame / 255.0 * white_lux, int(dt))
        found.append(np.stack([e.get_ts(), e.get_x(), e.get_y(), e.get_p()], axis=1).astype(np.float64))
    return time.perf_counter() - start, np.concatenate(found)


def voltmeter(checkout, frames, t_us, options):
    """Lynn0306/DVS-Voltmeter"""
    sys.path.insert(0, checkout)
    import torch
    from src.config import cfg
    from src.simulator import EventSim

    torch.manual_seed(options["seed"])
    cfg.SENSOR.K = options["k"]
    simulator = EventSim(cfg=cfg, output_folder="", video_name="")
    start = time.perf_counter()
    found = [simulator.generate_events(frame, t) for frame, t in zip(frames, t_us, strict=True)]
    return time.perf_counter() - start, np.concatenate([e for e in found if e is not None]).astype(np.float64)


if __name__ == "__main__":
    peer, checkout, frames, t_us, out, options = sys.argv[1:]
    run = {"v2e": v2e, "icns": icns, "voltmeter": voltmeter}[peer]
    seconds, events = run(checkout, np.load(frames), np.load(t_us), json.loads(options))
    print(seconds)
    np.save(out, events)
