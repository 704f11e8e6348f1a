"""Other simulators, built from checkouts of their repositories (scripts/studies/peers)."""

import subprocess
from pathlib import Path

DRIVERS = Path(__file__).resolve().parents[3] / "scripts/studies/peers"


def build_esim(checkout: Path, driver: Path) -> None:
    flags = ["-I/usr/include/opencv4", "-I/usr/include/eigen3", "-lboost_filesystem", "-lboost_system"]
    flags += [f"-lopencv_{part}" for part in ("core", "imgproc", "imgcodecs", "videoio", "highgui")]
    source = [str(DRIVERS / "esim_driver.cpp"), str(checkout / "esim_py/src/esim.cpp")]
    command = ["g++", "-std=c++17", "-O3", "-march=native", "-o", str(driver), *source, f"-I{checkout}/esim_py/include"]
    subprocess.run([*command, *flags], check=True)
