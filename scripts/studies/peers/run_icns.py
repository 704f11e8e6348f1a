"""run_icns.py CHECKOUT FRAMES.npy T_US.npy OUT.npy OPTIONS: the sensor of a checkout of neuromorphicsystems/IEBCS."""

import json
import sys
import time

import numpy as np

checkout, frames, t_us, out, options = sys.argv[1:]
sys.path.insert(0, checkout + "/src")
from dvs_sensor import DvsSensor  # noqa: E402

frames, t_us, options = np.load(frames), np.load(t_us), json.loads(options)
np.random.seed(options.pop("seed"))
white_lux = options.pop("white_lux")
sensor = DvsSensor("sensor")
sensor.initCamera(frames.shape[2], frames.shape[1], **options)
start = time.perf_counter()
sensor.init_image(frames[0] / 255.0 * white_lux)
found = []
for frame, dt in zip(frames[1:], np.diff(t_us), strict=True):
    e = sensor.update(frame / 255.0 * white_lux, int(dt))
    found.append(np.stack([e.get_ts(), e.get_x(), e.get_y(), e.get_p()], axis=1).astype(np.float64))
print(time.perf_counter() - start)
np.save(out, np.concatenate(found))
