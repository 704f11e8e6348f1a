"""Samples of an inertial measurement unit (IMU) on a trajectory: angular rate and specific force from the exact
derivatives, with the errors of a named part.

    imu = Imu.of_part("mpu6050", rate_hz=1000)
    samples = measure(trajectory, imu, np.random.default_rng(7))

Parts are files in imus/, from data sheets. `rig_from_imu` [4, 4] is the pose of the IMU in the rig, whose axes are
those of the trajectory's body. At rest, the IMU reads +g along the axis that points up. Model per axis, in this order:

1. turn-on bias: constant, uniform within the part's tolerance times `turn_on` (0: removed by a calibration at rest)
2. bias instability: first-order Gauss-Markov process whose Allan deviation peaks at the part's floor
3. bias random walk, and white noise of the part's density up to half the rate
4. clipping at the range, rounding to a step of the converter

Scale errors, cross-axis sensitivity, temperature and the part's own low-pass are not modelled.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._config import Fields, read_json
from .._errors import PecsInputError
from .paths import GRAVITY_M_S2, Trajectory

__all__ = ["Errors", "Imu", "Samples", "ideal", "integrate", "measure", "parts", "sample_times_ns"]

PARTS = Path(__file__).parent / "imus"
UNITS = {"dps": math.radians(1), "g": GRAVITY_M_S2, "mg": 1e-3 * GRAVITY_M_S2, "ug": 1e-6 * GRAVITY_M_S2}  # in SI units
# Allan deviation's peak over the standard deviation of a first-order Gauss-Markov process: 0.437 q_c sqrt(T) with
# sigma = q_c sqrt(T / 2) (IEEE 952-1997, B.4.5).
GAUSS_MARKOV_PEAK = 0.437 * math.sqrt(2)


@dataclass(frozen=True)
class Errors:
    """Errors of a gyroscope or an accelerometer with three equal axes; the unit u is rad/s or m/s^2. noise: one-sided
    density [u/sqrt(Hz)]; bias_floor: of the Allan deviation [u]; bias_time_s: correlation time of the bias instability;
    bias_walk: random walk [u/sqrt(s)]; turn_on: largest turn-on bias [u]; range: largest value [u]; step: of the
    converter [u], 0: exact."""

    noise: float = 0.0
    bias_floor: float = 0.0
    bias_time_s: float = 1.0
    bias_walk: float = 0.0
    turn_on: float = 0.0
    range: float = math.inf
    step: float = 0.0

    def bias(self, count: int, rate_hz: float, turn_on: float, rng: np.random.Generator) -> NDArray[np.float64]:
        """Draw the biases [count, 3] in u of consecutive samples. turn_on: a factor, 0 after calibration at rest."""
        from scipy.signal import lfilter

        constant = turn_on * self.turn_on * rng.uniform(-1, 1, 3)
        drive = rng.standard_normal((count, 3))
        walk = np.concatenate([np.zeros((1, 3)), rng.standard_normal((max(count - 1, 0), 3))])
        keep = math.exp(-1 / (rate_hz * self.bias_time_s))
        sigma = self.bias_floor / GAUSS_MARKOV_PEAK
        drive[1:] *= math.sqrt(1 - keep * keep)
        instability = sigma * lfilter([1.0], [1.0, -keep], drive, axis=0)
        return constant + instability + np.cumsum(walk, axis=0) * self.bias_walk / math.sqrt(rate_hz)

    def read(self, true: NDArray[np.float64], bias: NDArray[np.float64], rate_hz: float, rng) -> NDArray[np.float64]:
        """Add `bias` and noise to `true` values, [n, 3] in u, clip and round them."""
        noise = self.noise * math.sqrt(rate_hz / 2) * rng.standard_normal(true.shape)
        got = np.clip(true + bias + noise, -self.range, self.range - self.step)
        return np.round(got / self.step) * self.step if self.step else got


@dataclass(frozen=True)
class Imu:
    """An IMU: its rate, its errors and its pose [4, 4] in the rig (m). `Imu.of_part` makes one from a data sheet.
    turn_on: factor of the turn-on bias, 0 is calibrated at rest."""

    rate_hz: float
    gyro: Errors = Errors()
    accel: Errors = Errors()
    rig_from_imu: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))
    turn_on: float = 0.0
    part: str = "ideal"

    @classmethod
    def of_part(
        cls,
        name: str,
        rate_hz: float | None = None,
        rig_from_imu: ArrayLike | None = None,
        gyro_range_dps: float | None = None,
        accel_range_g: float | None = None,
        turn_on: float = 0.0,
    ) -> Imu:
        """Make an IMU from the data sheet of a part that `parts` lists; "ideal" has no errors.

        Rate [Hz] and ranges are the part's by default, the widest of them; rig_from_imu is its pose [4, 4] in the rig,
        in m; turn_on a factor of the turn-on bias, 0 to 10 (0: calibrated at rest).
        """
        rig = np.eye(4) if rig_from_imu is None else np.asarray(rig_from_imu, float)
        is_pose = rig.shape == (4, 4) and np.isfinite(rig).all() and (rig[3] == [0, 0, 0, 1]).all()
        R = rig[:3, :3]
        if not is_pose or not np.allclose(R @ R.T, np.eye(3), atol=1e-6) or np.linalg.det(R) < 0:
            raise PecsInputError(f"imu: rig_from_imu: got {rig.tolist()}, wanted a rotation and a translation")
        if name not in parts():
            raise PecsInputError(f"imu: got part {name!r}, wanted one of {', '.join(parts())}")
        part = None if name == "ideal" else read_json(PARTS / f"{name}.json")
        fields = Fields({"turn_on": turn_on, "rate_hz": rate_hz}, "imu")
        fields.number("turn_on", low=0, high=10)
        rate = fields.number("rate_hz", part["rate_hz"] if part else 1000.0, low=1, high=1e6)
        if not part:
            return cls(rate, rig_from_imu=rig)
        gyro = _errors(part["gyro"], "gyro_range_dps", gyro_range_dps)
        accel = _errors(part["accel"], "accel_range_g", accel_range_g)
        return cls(rate, gyro, accel, rig, turn_on, name)

    def kalibr(self) -> dict[str, float]:
        """Return the values of Kalibr's imu.yaml: rate [Hz], two-sided noise densities (1/sqrt(2) of the one-sided
        ones) and random walks of the biases over times that are short against their correlation time."""
        values = {"update_rate": self.rate_hz}
        for name, e in (("gyroscope", self.gyro), ("accelerometer", self.accel)):
            walk = math.hypot(e.bias_walk, e.bias_floor / GAUSS_MARKOV_PEAK * math.sqrt(2 / e.bias_time_s))
            values |= {f"{name}_noise_density": e.noise / math.sqrt(2), f"{name}_random_walk": walk}
        return values


def parts() -> list[str]:
    """List the names that `Imu.of_part` accepts: parts with a data sheet, and "ideal"."""
    return [*sorted(path.stem for path in PARTS.glob("*.json")), "ideal"]


def _errors(data: Mapping, option: str, wanted: float | None) -> Errors:
    """Errors by a part's file, whose keys end with a unit. wanted: the full range, one of the part's."""
    unit = option.rpartition("_")[2]
    ranges = data[f"ranges_{unit}"]
    if wanted is not None and wanted not in ranges:
        listed = ", ".join(f"{r:g}" for r in ranges)
        raise PecsInputError(f"imu: {option}: got {wanted!r}, wanted one of {listed}")
    full = (ranges[-1] if wanted is None else wanted) * UNITS[unit]

    def si(name: str) -> float:
        key = next(key for key in data if key.startswith(f"{name}_"))
        return data[key] * UNITS[key.removeprefix(f"{name}_").partition("_")[0]]

    values = {name: si(name) for name in ("noise", "bias_floor", "bias_walk", "turn_on")}
    return Errors(**values, bias_time_s=data["bias_time_s"], range=full, step=full / 2 ** (data["bits"] - 1))


@dataclass(frozen=True)
class Samples:
    """Samples of an IMU, [n, 3] at times [n] in its own axes, and the biases in them as ground truth. Accelerometers
    measure specific force."""

    t_ns: NDArray[np.int64]
    gyro_rad_s: NDArray[np.float64]
    accel_m_s2: NDArray[np.float64]
    gyro_bias_rad_s: NDArray[np.float64]
    accel_bias_m_s2: NDArray[np.float64]


def sample_times_ns(duration_s: float, rate_hz: float) -> NDArray[np.int64]:
    """Return the times of an IMU's samples from 0 [ns]; the last one is at `duration_s` or less than a period before
    it."""
    return np.round(np.arange(math.floor(duration_s * rate_hz * (1 + 1e-12)) + 1) * (1e9 / rate_hz)).astype(np.int64)


def measure(trajectory: Trajectory, imu: Imu, rng: np.random.Generator) -> Samples:
    """Simulate the samples of an IMU over a whole trajectory of its rig. The same generator, trajectory and IMU give
    the same bits."""
    t_ns = sample_times_ns(trajectory.duration_s, imu.rate_hz)
    true = ideal(trajectory, t_ns * 1e-9, imu.rig_from_imu)
    errors = (imu.gyro, imu.accel)
    bias = [e.bias(len(t_ns), imu.rate_hz, imu.turn_on, rng) for e in errors]
    said = [e.read(v, b, imu.rate_hz, rng) for e, v, b in zip(errors, true, bias, strict=True)]
    return Samples(t_ns, *said, *bias)


def ideal(
    trajectory: Trajectory, t_s: ArrayLike, rig_from_imu: ArrayLike | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return angular rates [rad/s] and specific forces [m/s^2] without errors, [n, 3] each, at times [n] in s.

    They are w, and R^T (a + g) + w' x r + w x (w x r) at the lever arm r, in the axes of the IMU, whose pose in the rig
    is `rig_from_imu` [4, 4] (default: identity).
    """
    s, rig = trajectory.state(t_s), np.eye(4) if rig_from_imu is None else np.asarray(rig_from_imu, float)
    turn, lever = rig[:3, :3], rig[:3, 3]
    w, dw = s.angular_velocity_rad_s, s.angular_acceleration_rad_s2
    carried = s.acceleration_m_s2 + [0.0, 0.0, GRAVITY_M_S2]
    force = np.einsum("nji,nj->ni", s.world_from_body, carried)
    force += np.cross(dw, lever) + np.cross(w, np.cross(w, lever))
    return w @ turn, force @ turn


def integrate(
    t_s: ArrayLike, gyro_rad_s: ArrayLike, accel_m_s2: ArrayLike, world_from_imu: ArrayLike, velocity_m_s: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Integrate samples [n, 3] of an IMU (strapdown) from the first pose [4, 4] and velocity [3]; returns poses
    world_from_imu [n, 4, 4] and velocities [n, 3] in m/s.

    Rates between samples are a spline of degree 5; a step's rotation is Magnus' expansion of fourth order (Iserles et
    al. 2000, eq. 4.19). Velocity and position are integrals of the spline of the force in the world.
    """
    from scipy.interpolate import make_interp_spline
    from scipy.spatial.transform import Rotation

    t, w, f = (np.asarray(v, float) for v in (t_s, gyro_rad_s, accel_m_s2))
    start = np.asarray(world_from_imu, float)
    degree = min(5, (len(t) - 1) // 2 * 2 + 1 if len(t) > 2 else 1)
    rate = make_interp_spline(t, w, min(degree, len(t) - 1))
    h = np.diff(t)[:, None]
    early, late = (rate(t[:-1] + h[:, 0] * (0.5 + side * math.sqrt(3) / 6)) for side in (-1, 1))
    # R' = R [w]x multiplies from the right: the commutator's sign is the other one.
    turns = h / 2 * (early + late) + math.sqrt(3) / 12 * h * h * np.cross(early, late)
    rotation = np.concatenate([start[None, :3, :3], Rotation.from_rotvec(turns).as_matrix()])
    step = 1
    while step < len(rotation):  # all products from the first, doubling
        rotation = np.concatenate([rotation[:step], rotation[:-step] @ rotation[step:]])
        step *= 2
    world = np.einsum("nij,nj->ni", rotation, f) - [0.0, 0.0, GRAVITY_M_S2]
    gained = make_interp_spline(t, world, min(degree, len(t) - 1)).antiderivative()
    travelled = gained.antiderivative()
    velocity = np.asarray(velocity_m_s, float) + gained(t) - gained(t[0])
    past = (t - t[0])[:, None]
    pose = np.tile(np.eye(4), (len(t), 1, 1))
    pose[:, :3, :3] = rotation
    drift = (np.asarray(velocity_m_s, float) - gained(t[0])) * past
    pose[:, :3, 3] = start[:3, 3] + drift + travelled(t) - travelled(t[0])
    return pose, velocity
