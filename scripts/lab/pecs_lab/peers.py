"""Other simulators, run from checkouts of their repositories (scripts/studies/peers)."""

from pathlib import Path

import numpy as np

from .measure import answer

DRIVERS = Path(__file__).resolve().parents[3] / "scripts/studies/peers"


def build_esim(checkout: Path, driver: Path) -> None:
    flags = ["-I/usr/include/opencv4", "-I/usr/include/eigen3", "-lboost_filesystem", "-lboost_system"]
    flags += [f"-lopencv_{part}" for part in ("core", "imgproc", "imgcodecs", "videoio", "highgui")]
    source = [str(DRIVERS / "esim_driver.cpp"), str(checkout / "esim_py/src/esim.cpp")]
    include = f"-I{checkout}/esim_py/include"
    answer("g++", "-std=c++17", "-O3", "-march=native", "-o", driver, *source, include, *flags)


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
    seconds = float(answer(driver, raw, *numbers, out))
    x, y, t_s, p = np.fromfile(out).reshape(-1, 4).T
    return np.stack([t_s * 1e6, x, y, p > 0], axis=1), seconds


def options_of(peer: str, values: dict, seed: int) -> dict:
    """Options of run_peer.py, from the values of PECS's model. A program takes one deviation for both thresholds: the
    mismatch times their mean."""
    if peer == "voltmeter":
        return {"k": [values[f"k{i}"] for i in range(1, 7)], "seed": seed}
    on, off = values["contrast_threshold_on"], values["contrast_threshold_off"]
    sigma, refractory_s = values.get("threshold_mismatch", 0) * (on + off) / 2, values.get("refractory_period_s", 0)
    noise = values.get("background_on_hz", 0), values.get("background_off_hz", 0)
    if peer == "v2e":
        found = {"pos_thres": on, "neg_thres": off, "sigma_thres": sigma, "refractory_period_s": refractory_s}
        found |= {"leak_rate_hz": values.get("leak_rate_hz", 0), "shot_noise_rate_hz": sum(noise), "seed": seed}
        return found | {k: values[k] for k in ("cutoff_hz", "linear_below") if k in values}
    found = {"th_pos": on, "th_neg": off, "th_noise": sigma, "ref": refractory_s * 1e6, "tau": values["tau_us"]}
    found |= {"lat": values["latency_us"], "jit": values["jitter_us"], "white_lux": values["white_lux"], "seed": seed}
    return found | {"bgnp": max(noise[0], 1e-9), "bgnn": max(noise[1], 1e-9)}
