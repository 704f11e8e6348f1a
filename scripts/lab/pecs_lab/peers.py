"""Other simulators, built from checkouts of their repositories (scripts/studies/peers)."""

import subprocess
from pathlib import Path

import numpy as np

DRIVERS = Path(__file__).resolve().parents[3] / "scripts/studies/peers"


def build_esim(checkout: Path, driver: Path) -> None:
    flags = ["-I/usr/include/opencv4", "-I/usr/include/eigen3", "-lboost_filesystem", "-lboost_system"]
    flags += [f"-lopencv_{part}" for part in ("core", "imgproc", "imgcodecs", "videoio", "highgui")]
    source = [str(DRIVERS / "esim_driver.cpp"), str(checkout / "esim_py/src/esim.cpp")]
    command = ["g++", "-std=c++17", "-O3", "-march=native", "-o", str(driver), *source, f"-I{checkout}/esim_py/include"]
    subprocess.run([*command, *flags], check=True)


def run_esim(
    driver: Path,
    frames: np.ndarray,
    step_s: float,
    thresholds: tuple[float, float],
    refractory_s: float,
    epsilon: float,
) -> tuple[np.ndarray, float]:
    """Events of frames [T, H, W] (linear light), rows of t [us], x, y, p (0 or 1); CPU seconds. epsilon: added to the
    light before its logarithm."""
    raw, out = driver.with_name("frames.f32"), driver.with_name("out.f64")
    frames.astype(np.float32).tofile(raw)
    count, height, width = frames.shape
    numbers = (width, height, count, step_s, *thresholds, refractory_s, epsilon)
    command = [str(driver), str(raw), *map(str, numbers), str(out)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    x, y, t_s, p = np.fromfile(out).reshape(-1, 4).T
    return np.stack([t_s * 1e6, x, y, p > 0], axis=1), float(done.stdout)
