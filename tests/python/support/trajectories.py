"""Parameters of a gentle trajectory of each kind."""

import numpy as np
from pecs import _poses as poses

VOLUME = [[-2, -2, -1], [2, 2, 1]]
FLAT = [[-2, -2, 0.2], [2, 2, 0.2]]
CENTRE = [0.1, 0.2, -0.3]


def recording(folder):
    """A TUM file of a smooth motion, with quaternions of both signs."""
    t = np.arange(0, 4.0, 0.01)
    p = np.stack([np.sin(t), 0.5 * np.cos(1.3 * t), 0.1 * t], axis=1)
    q = np.stack([0.3 * np.sin(t), 0.2 * np.cos(2 * t), np.sin(0.5 * t), np.cos(0.5 * t)], axis=1)
    q *= np.where(np.arange(len(t)) % 7 < 3, -1, 1)[:, None] / np.linalg.norm(q, axis=1, keepdims=True)
    poses.write_tum(folder / "poses.txt", t + 1.5e9, p, q)
    return folder / "poses.txt"


def parameters(kind, folder, **more):
    """A gentle motion of a kind; `folder` is for the recording."""
    of_kind = {
        "drone": {"volume": VOLUME, "pitch_deg": -20},
        "hand_held": {"volume": VOLUME},
        "vehicle": {"volume": FLAT, "speed_m_per_s": 1, "step_m": [0.5, 1], "min_radius_m": 0.4},
        "orbit": {"target": CENTRE, "radius_m": 1.5, "height_m": 0.2, "bob_m": 0.1},
        "still": {"volume": VOLUME, "target": CENTRE},
        "recorded": {"file": recording(folder)} if kind == "recorded" else {},
    }[kind]
    return {"duration_s": 2.0} | of_kind | more
