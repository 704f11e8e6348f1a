"""What a repaired wheel bundles: which Debian packages it is made of, their licence texts, an SPDX list of them."""

import base64
import hashlib
import json
import re
import subprocess
import time
import zipfile
from dataclasses import dataclass
from pathlib import Path

# Linked into the program or the library, so that no file of a wheel names them: headers, and build/wheel-libraries.
HEADERS = ["libeigen3-dev", "libcli11-dev", "libflatbuffers-dev", "nlohmann-json3-dev"]
STATIC = ["opencv", "ceres-solver", "hdf5"]
SHARED = {r"lib(av|sw)[a-z]+\.so": "ffmpeg", r"libtiff\.so": "tiff"}


@dataclass(frozen=True)
class Part:
    """A source package of Debian, and where its licence texts lie."""

    name: str
    version: str
    copyright: Path


def installed_part(package: str) -> Part:
    """Of an installed binary package; raises CalledProcessError if it is not installed."""
    form = "${source:Package} ${source:Version}"
    answer = subprocess.run(["dpkg-query", "-W", "-f", form, package], capture_output=True, text=True, check=True)
    name, version = answer.stdout.split()
    return Part(name, version, Path("/usr/share/doc", package.split(":")[0], "copyright"))


def built_part(name: str, libraries: Path) -> Part:
    """Of a source package that scripts/wheel_libraries.sh unpacked."""
    (folder,) = (p for p in libraries.glob(f"{name}-*") if p.is_dir())
    changes = (folder / "debian" / "changelog").read_text(encoding="utf-8")
    return Part(name, re.search(r"\((.+?)\)", changes)[1], folder / "debian" / "copyright")


def needed_files(binary: Path, library_path: Path) -> list[Path]:
    """The shared libraries that a binary loads, as this system's files."""
    answer = subprocess.run(
        ["ldd", binary], capture_output=True, text=True, check=True, env={"LD_LIBRARY_PATH": str(library_path)}
    )
    return [Path(m).resolve() for m in re.findall(r"=> (/\S+)", answer.stdout)]


def package_of(path: Path) -> str:
    """The Debian package that a library file belongs to."""
    for name in (path, str(path).removeprefix("/usr")):
        answer = subprocess.run(["dpkg", "-S", name], capture_output=True, text=True)
        if answer.returncode == 0:
            return answer.stdout.rsplit(": ", 1)[0].split(",")[0]
    raise RuntimeError(f"{path}: belongs to no Debian package")


def parts_of(wheel: Path, binaries: list[Path], libraries: Path) -> list[Part]:
    """The third-party parts of a repaired wheel. `binaries`: its own before the repair; `libraries`:
    build/wheel-libraries."""
    with zipfile.ZipFile(wheel) as archive:  # libldap-2-5c8a0b1d.5.so.0: its name, with a hash of its content
        bundled = [Path(n).name for n in archive.namelist() if n.startswith("pecs.libs/lib")]
    stems = {re.sub(r"-[0-9a-f]{8}(?=\.)", "", name).split(".so")[0] for name in bundled}
    files = {f for b in binaries for f in needed_files(b, libraries / "lib") if f.name.split(".so")[0] in stems}
    if missing := stems - {f.name.split(".so")[0] for f in files}:
        raise RuntimeError(f"bundled, but not needed by {binaries}: {sorted(missing)}")
    found = {installed_part(p) for p in HEADERS}
    for file in files:
        if libraries in file.parents:
            found.add(built_part(next(part for form, part in SHARED.items() if re.match(form, file.name)), libraries))
        else:
            found.add(installed_part(package_of(file)))
    if any(b.name == "pecs" for b in binaries):
        found |= {built_part(name, libraries) for name in STATIC}
    one_each = {p.name: p for p in sorted(found, key=lambda p: str(p.copyright), reverse=True)}
    return [one_each[name] for name in sorted(one_each)]


def spdx(name: str, version: str, parts: list[Part], epoch_s: int) -> str:
    """The parts as an SPDX 2.3 document. Licences: the texts beside it in the wheel say them, none are concluded."""

    def entry(name: str, version: str, **more: object) -> dict[str, object]:
        unsaid = dict.fromkeys(("downloadLocation", "licenseConcluded", "copyrightText"), "NOASSERTION")
        spdx_id = "SPDXRef-" + re.sub(r"[^A-Za-z0-9.-]", "-", name)
        return {"SPDXID": spdx_id, "name": name, "versionInfo": version, "filesAnalyzed": False} | unsaid | more

    packages = [entry(name, version, licenseDeclared="Apache-2.0")]
    for p in parts:
        purl = {"referenceCategory": "PACKAGE-MANAGER", "referenceType": "purl"}
        purl["referenceLocator"] = f"pkg:deb/debian/{p.name}@{p.version.replace('+', '%2B')}?arch=source"
        packages.append(entry(p.name, p.version, licenseDeclared="NOASSERTION", externalRefs=[purl]))
    digest = hashlib.sha256(json.dumps(packages).encode()).hexdigest()
    main = packages[0]["SPDXID"]
    relations = [("SPDXRef-DOCUMENT", "DESCRIBES", main)] + [(main, "CONTAINS", p["SPDXID"]) for p in packages[1:]]
    keys = ("spdxElementId", "relationshipType", "relatedSpdxElement")
    document = {
        "spdxVersion": "SPDX-2.3",
        "dataLicense": "CC0-1.0",
        "SPDXID": "SPDXRef-DOCUMENT",
        "name": f"{name}-{version}",
        "documentNamespace": f"https://spdx.org/spdxdocs/{name}-{version}-{digest}",
        "creationInfo": {
            "created": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(epoch_s)),
            "creators": ["Tool: pecs-make_wheels"],
        },
        "packages": packages,
        "relationships": [dict(zip(keys, r, strict=True)) for r in relations],
    }
    return json.dumps(document, indent=1) + "\n"


def write_entry(archive: zipfile.ZipFile, name: str, data: bytes, mode: int, epoch_s: int) -> None:
    """Adds a file that is the same bytes whenever and wherever it is made."""
    info = zipfile.ZipInfo(name, time.gmtime(epoch_s)[:6])
    info.compress_type = zipfile.ZIP_DEFLATED
    info.external_attr = (0o100000 | mode) << 16
    archive.writestr(info, data)


Files = dict[str, tuple[bytes, int]]  # name in the archive: content, mode


def files_of(wheel: Path) -> Files:
    """All but RECORD, which `write_wheel` makes, and auditwheel's list, which is dated."""
    with zipfile.ZipFile(wheel) as archive:
        files = {i.filename: (archive.read(i), (i.external_attr >> 16) & 0o777) for i in archive.infolist()}
    return {n: f for n, f in files.items() if not n.endswith(("/", ".cdx.json", "/RECORD"))}


def with_own_version(wheel: Path, folder: Path, epoch_s: int) -> Path:
    """A copy of the wheel whose version says its content: 0.1.0+h1a2b3c4d. Blender keeps what it has installed of a
    wheel under the same version, so a new build of one version would not arrive."""
    name, version, tags = wheel.name.split("-", 2)
    own = f"{version.partition('+')[0]}+h{hashlib.sha256(wheel.read_bytes()).hexdigest()[:8]}"
    info, own_info = f"{name}-{version}.dist-info/", f"{name}-{own}.dist-info/"
    files = {own_info + n.removeprefix(info) if n.startswith(info) else n: f for n, f in files_of(wheel).items()}
    metadata, mode = files[f"{own_info}METADATA"]
    line, own_line = f"\nVersion: {version}\n".encode(), f"\nVersion: {own}\n".encode()
    if metadata.count(line) != 1:
        raise RuntimeError(f"{wheel}: METADATA: got no line Version: {version}")
    files[f"{own_info}METADATA"] = (metadata.replace(line, own_line), mode)
    target = folder / f"{name}-{own}-{tags}"
    write_wheel(files, target, epoch_s)
    return target


def write_wheel(files: Files, target: Path, epoch_s: int) -> None:
    """Sorted, with its RECORD: the same files are the same bytes."""
    (info,) = {n.split("/")[0] for n in files if n.split("/")[0].endswith(".dist-info")}
    lines = []
    with zipfile.ZipFile(target, "w") as archive:
        for name, (data, mode) in sorted(files.items()):
            digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
            lines.append(f"{name},sha256={digest},{len(data)}\n")
            write_entry(archive, name, data, mode, epoch_s)
        write_entry(archive, f"{info}/RECORD", "".join([*lines, f"{info}/RECORD,,\n"]).encode(), 0o644, epoch_s)
