#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""docs/reference/trajectories.png: paths from above, and what an IMU on them reads.

.venv/bin/python scripts/pictures/trajectories.py -o docs/reference/trajectories.png
"""

import argparse
from pathlib import Path

import numpy as np
from figures import plt, save
from pecs.datasets import imu
from pecs.datasets.trajectories import Surfaces, plan

COMMON = {"duration_s": 4.0, "pauses": [[1.8, 0.4]], "clearance_m": 0.4}
KINDS = {
    "drone": {"volume": [[-2.5, -2.5, 0.5], [2.5, 2.5, 2.5]], "speed_m_per_s": 1.5, "step_m": [1, 2]},
    "hand_held": {"volume": [[-1, -1, 1.4], [1, 1, 1.7]], "speed_m_per_s": 0.8, "yaw_deg": 60, "pause_ramp_s": 0.3},
    "vehicle": {
        "volume": [[-2.6, -2.6, 1.2], [2.6, 2.6, 1.2]],
        "speed_m_per_s": 1.5,
        "step_m": [0.8, 1.5],
        "min_radius_m": 0.8,
        "pause_ramp_s": 0.4,
    },
    "orbit": {"target": [0, 0, 1], "radius_m": 2, "height_m": 0.5, "bob_m": 0.2, "pause_ramp_s": 0.3},
}
WALL_M = 3.0
PILLAR_M = (0.9, 0.2, 0.25)  # x, y, radius


def surfaces(pillar: bool) -> Surfaces:
    """A square room, and a pillar in it."""
    side, up = np.linspace(-WALL_M, WALL_M, 61), np.linspace(0, 3, 31)
    u, z = (c.ravel() for c in np.meshgrid(side, up))
    at = np.full(u.shape, WALL_M)
    points = [np.stack(c, 1) for c in ((u, at, z), (u, -at, z), (at, u, z), (-at, u, z))]
    if pillar:
        angle, z = (c.ravel() for c in np.meshgrid(np.linspace(0, 2 * np.pi, 24), up))
        x, y, r = PILLAR_M
        points.append(np.stack([x + r * np.cos(angle), y + r * np.sin(angle), z], 1))
    return Surfaces([0.0], [np.concatenate(points)], spacing_m=0.08)


def draw(axes, kind: str, more: dict) -> None:
    pillar = kind in ("drone", "vehicle")
    trajectory = plan(kind, COMMON | more, surfaces(pillar), np.random.default_rng(11))
    t = np.linspace(0, trajectory.duration_s, 2001)
    state = trajectory.state(t)
    x, y = state.position_m[:, 0], state.position_m[:, 1]
    speed = np.linalg.norm(state.velocity_m_s, axis=1)
    above, rates, forces = axes
    above.scatter(x, y, c=speed, s=3, cmap="viridis")
    for i in range(0, len(t), 125):
        ahead = state.world_from_body[i, :2, 2]
        above.plot(x[i] + np.array([0, 0.35]) * ahead[0], y[i] + np.array([0, 0.35]) * ahead[1], "r-", lw=1)
    above.add_patch(plt.Rectangle((-WALL_M, -WALL_M), 2 * WALL_M, 2 * WALL_M, fill=False, lw=2))
    if pillar:
        above.add_patch(plt.Circle(PILLAR_M[:2], PILLAR_M[2], color="0.5"))
    above.set(
        title=f"{kind}: from above [m]\nup to {speed.max():.1f} m/s", aspect="equal", xlim=(-3.2, 3.2), ylim=(-3.2, 3.2)
    )
    part = imu.Imu.of_part("mpu6050", rate_hz=200)
    said, true = imu.measure(trajectory, part, np.random.default_rng(1)), imu.ideal(trajectory, t)
    for axis, values, exact in ((rates, said.gyro_rad_s, true[0]), (forces, said.accel_m_s2, true[1])):
        for k, name in enumerate("xyz"):
            axis.plot(said.t_ns * 1e-9, values[:, k], ".", ms=1.5, color=f"C{k}")
            axis.plot(t, exact[:, k], lw=0.8, color=f"C{k}", label=name)
        axis.axvspan(1.8, 2.2, color="0.9")
    rates.set_title("angular rate [rad/s]")
    forces.set(title="specific force [m/s²]", xlabel="time [s]")
    rates.legend(loc="upper right", fontsize=7)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default="docs/reference/trajectories.png")
    output = parser.parse_args().output
    figure, axes = plt.subplots(3, len(KINDS), figsize=(13, 8.2), gridspec_kw={"height_ratios": [1.8, 1, 1]})
    for column, (kind, more) in enumerate(KINDS.items()):
        draw(axes[:, column], kind, more)
    figure.tight_layout()
    save(figure, output, dpi=80)


if __name__ == "__main__":
    main()
