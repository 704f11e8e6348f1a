"""The IMU: what it reads on known motions, strapdown back to the pose over all kinds, noise as stated."""

import json
import math

import numpy as np
import pytest
from pecs.datasets.imu import PARTS, Errors, Imu, ideal, integrate, measure, parts, sample_times_ns
from pecs.datasets.paths import GRAVITY_M_S2
from pecs.datasets.trajectories import KINDS, plan
from support.trajectories import parameters

TURN = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
LEVER_M = [0.05, -0.03, 0.11]
RIG = np.block([[TURN, np.array([LEVER_M]).T], [np.zeros((1, 3)), 1]])
RNG = np.random.default_rng


def trajectory_of(kind, folder, **more):
    return plan(kind, parameters(kind, folder, **more), None, RNG(5))


def angle_deg(a, b):
    turn = np.swapaxes(a[:, :3, :3], 1, 2) @ b[:, :3, :3]
    axis = np.stack([turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]], 1)
    return np.degrees(np.arcsin(np.clip(np.linalg.norm(axis, axis=1) / 2, 0, 1)))


def motion(trajectory, t_s, rig):
    """world_from_imu [n, 4, 4] and the IMU's velocity [n, 3] in the world, which integrate() should return."""
    s = trajectory.state(t_s)
    pose = np.tile(np.eye(4), (len(s.position_m), 1, 1))
    pose[:, :3, :3], pose[:, :3, 3] = s.world_from_body, s.position_m
    turning = np.einsum("nij,nj->ni", s.world_from_body, np.cross(s.angular_velocity_rad_s, rig[:3, 3]))
    return pose @ rig, s.velocity_m_s + turning


@pytest.mark.parametrize("rig", [np.eye(4), RIG], ids=["rig", "lever"])
@pytest.mark.parametrize(
    "moves", [{}, {"pauses": [[0.9, 0.2]], "pause_ramp_s": 0.3, "speed": [0.2, 1.5]}], ids=["", "pause"]
)
@pytest.mark.parametrize("kind", KINDS)
def test_strapdown_returns_the_pose(kind, moves, rig, tmp_path):
    """2 s at 1 kHz: within 1 mm and 0.01 deg."""
    trajectory = trajectory_of(kind, tmp_path, **moves)
    samples = measure(trajectory, Imu.of_part("ideal", 1000, rig), RNG(0))
    t_s = samples.t_ns * 1e-9
    assert len(t_s) == 2001 and t_s[-1] == 2.0
    wanted, velocity = motion(trajectory, t_s, rig)
    assert np.abs(wanted - trajectory.matrices(t_s) @ rig).max() < 1e-12
    got, speed = integrate(t_s, samples.gyro_rad_s, samples.accel_m_s2, wanted[0], velocity[0])
    assert np.linalg.norm((got - wanted)[:, :3, 3], axis=1).max() < 1e-3
    assert angle_deg(got, wanted).max() < 0.01
    assert np.abs(speed - velocity).max() < 1e-3
    if kind != "still":  # and it is the IMU that says so
        lost, _ = integrate(t_s, samples.gyro_rad_s * 0, samples.accel_m_s2, wanted[0], velocity[0])
        assert np.linalg.norm((lost - wanted)[-1, :3, 3]) > 5e-3


def test_still_reads_gravity(tmp_path):
    trajectory = plan("still", {"duration_s": 1, "position": [1, 2, 3], "yaw_deg": 30, "pitch_deg": -25}, None, RNG(0))
    gyro, accel = ideal(trajectory, [0.0, 0.5], RIG)
    up = trajectory.matrices([0.0])[0, 2, :3] @ TURN
    assert np.abs(gyro).max() == 0 and np.abs(accel - GRAVITY_M_S2 * up).max() < 1e-12
    level = plan("still", {"duration_s": 1, "position": [1, 2, 3], "yaw_deg": 30}, None, RNG(0))
    assert np.abs(ideal(level, [0.0])[1] - [0, -GRAVITY_M_S2, 0]).max() < 1e-12  # y is down


def test_orbit_reads_its_centripetal_force():
    """Radius 2 m at 3 m/s, looking inwards: w = 1.5 rad/s about the vertical, v^2/r ahead; at the lever arm w^2 r less
    per metre nearer to the centre."""
    given = {"duration_s": 1, "target": [0, 0, 0], "radius_m": 2, "speed_m_per_s": 3}
    trajectory = plan("orbit", given, None, RNG(0))
    lever = np.eye(4)
    lever[:3, 3] = [0.3, 0, 0.5]
    gyro, accel = ideal(trajectory, [0.2, 0.9], lever)
    assert np.abs(np.abs(gyro) - [0, 1.5, 0]).max() < 1e-12
    assert np.abs(accel - [-(1.5**2) * 0.3, -GRAVITY_M_S2, 1.5**2 * (2 - 0.5)]).max() < 1e-7


def test_same_generator_same_bits(tmp_path):
    trajectory, imu = trajectory_of("orbit", tmp_path), Imu.of_part("bmi088", turn_on=1)
    a, b, c = (measure(trajectory, imu, RNG(seed)) for seed in (1, 1, 2))
    fields = ("t_ns", "gyro_rad_s", "accel_m_s2", "gyro_bias_rad_s", "accel_bias_m_s2")
    assert all(np.array_equal(getattr(a, f), getattr(b, f)) for f in fields)
    assert not np.array_equal(a.gyro_rad_s, c.gyro_rad_s)


def test_noise_is_as_stated():
    """White noise: its one-sided spectral density; bias: the Allan deviation's floor; saturation and steps."""
    rate, n = 1000.0, 400000
    noise = Errors(noise=2e-3).read(np.zeros((n, 3)), np.zeros((n, 3)), rate, RNG(0))
    density = 2 * np.abs(np.fft.rfft(noise, axis=0)) ** 2 / (n * rate)  # one-sided, u^2 / Hz
    assert np.sqrt(density[1:-1].mean()) == pytest.approx(2e-3, rel=0.01)
    time_s = 20.0
    bias = Errors(bias_floor=1e-3, bias_time_s=time_s).bias(200000, 10.0, 0.0, RNG(1))
    tau = round(1.89 * time_s * 10)  # where it peaks
    means = np.cumsum(bias, axis=0)[tau - 1 :: tau]
    steps = np.diff(np.diff(means, axis=0, prepend=0) / tau, axis=0)
    assert math.sqrt((steps**2).mean() / 2) == pytest.approx(1e-3, rel=0.12)
    walk = Errors(bias_walk=0.5).bias(4001, 1000.0, 0.0, RNG(2))
    many = np.array([Errors(bias_walk=0.5).bias(101, 100.0, 0.0, RNG(k))[-1] for k in range(300)])
    assert walk[0].max() == 0 and many.std() == pytest.approx(0.5, rel=0.1)  # after 1 s
    turn_on = np.array([Errors(turn_on=3.0).bias(2, 100.0, 0.5, RNG(k))[1] for k in range(300)])
    assert np.abs(turn_on).max() <= 1.5 and turn_on.std() == pytest.approx(1.5 / math.sqrt(3), rel=0.1)
    ramp = np.linspace(-3, 3, 1001)[:, None] * [1, 1, 1]
    read = Errors(range=2.0, step=2.0 / 128).read(ramp, 0 * ramp, rate, RNG(0))
    assert read.min() == -2 and read.max() == 2 - 2 / 128 and np.array_equal(read * 64, np.round(read * 64))
    assert np.abs(read - np.clip(ramp, -2, 2 - 2 / 128)).max() <= 1 / 128 + 1e-12


@pytest.mark.parametrize("name", parts())
def test_parts(name, tmp_path):
    """Every part measures; its numbers are in the range of such parts."""
    imu = Imu.of_part(name, rate_hz=500, turn_on=0.1)
    samples = measure(trajectory_of("drone", tmp_path), imu, RNG(0))
    assert len(samples.t_ns) == 1001 and np.isfinite(samples.gyro_rad_s).all()
    kalibr = imu.kalibr()
    if name == "ideal":
        assert not samples.gyro_bias_rad_s.any() and kalibr["gyroscope_noise_density"] == 0
        return
    assert np.abs(samples.gyro_bias_rad_s).max() > 1e-5
    assert 3e-5 < kalibr["gyroscope_noise_density"] < 1e-3 and 5e-4 < kalibr["accelerometer_noise_density"] < 1e-2
    assert 1e-7 < kalibr["gyroscope_random_walk"] < 1e-4 and 1e-6 < kalibr["accelerometer_random_walk"] < 1e-3
    data = json.loads((PARTS / f"{name}.json").read_text())
    assert data["source"] and data["bias_source"] and imu.gyro.range == math.radians(data["gyro"]["ranges_dps"][-1])


def test_data_sheet_numbers():
    """MPU-6050: 131 LSB/(deg/s) at 250 deg/s, 16384 LSB/g at 2 g (PS-MPU-6000A, tables 6.1 and 6.2)."""
    imu = Imu.of_part("mpu6050", gyro_range_dps=250, accel_range_g=2)
    assert math.radians(1) / imu.gyro.step == pytest.approx(131, rel=1e-3)
    assert GRAVITY_M_S2 / imu.accel.step == 16384
    assert imu.gyro.noise == math.radians(0.005) and imu.accel.noise == pytest.approx(400e-6 * GRAVITY_M_S2)


def test_times():
    assert sample_times_ns(0.01, 1000).tolist() == list(range(0, 10000001, 1000000))
    third = sample_times_ns(1.0, 1125)
    assert len(third) == 1126 and third[-1] == 10**9 and third[1] == 888889


@pytest.mark.parametrize(
    "name, more, match",
    [
        ("adis", {}, "got part 'adis', wanted one of bmi088, icm20948, mpu6050, ideal"),
        ("bmi088", {"gyro_range_dps": 300}, "gyro_range_dps: got 300, wanted one of 125, 250, 500, 1000, 2000"),
        ("bmi088", {"accel_range_g": 2}, "accel_range_g: got 2, wanted one of 3, 6, 12, 24"),
        ("bmi088", {"rate_hz": 0}, "imu: rate_hz: got 0, wanted a number in"),
        ("bmi088", {"turn_on": -1}, "imu: turn_on: got -1"),
        ("bmi088", {"rig_from_imu": np.ones((4, 4))}, "wanted a rotation and a translation"),
        ("ideal", {"rig_from_imu": np.diag([1, 1, -1, 1])}, "wanted a rotation and a translation"),  # left-handed
        ("ideal", {"rig_from_imu": np.eye(4) + 0.1 * np.eye(4, k=-3)}, "wanted a rotation and a translation"),
    ],
)
def test_bad_parts(name, more, match):
    with pytest.raises(ValueError, match=match) as e:
        Imu.of_part(name, **more)
    assert "\n" not in str(e.value)
