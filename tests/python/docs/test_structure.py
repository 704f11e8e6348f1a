"""Which room may include which, and the longest a file may be."""

import ast
import re
from pathlib import Path

from support import ROOT

MAX_FILE_LINES = 600

# Room -> (folder, rooms whose public headers it may include). Low to high: no room includes upward.
ROOMS = {
    "common": ("common", ""),
    "events": ("sensor/events", "common"),
    "lens": ("blender_addon/lens", "common"),
    "sensor": ("sensor", "common events"),  # knows no lens
    "input": ("sensor/input", "common events sensor"),
    "metrics": ("calibration/metrics", "common events"),
    "view": ("calibration/view", "common events sensor input metrics"),
    "calibration": ("calibration", "common events lens sensor metrics view"),
    "capi": ("python/c", "common events lens sensor metrics"),
    "apps": ("apps", "common events lens sensor input metrics view calibration"),
}
BLENDER_ROOMS = ("spectral", "scene", "camera", "truth", "adaptive", "job", "ui")  # of blender_addon/pecs_blender
# No file puts these on sys.path: code that two of them share belongs in a package.
NO_LIBRARIES = {"bench", "tools", "studies", "scripts", "tests"}


def sources(*suffixes, under="."):
    """Files of the checkout, without what is built or fetched."""
    folders = [ROOT / under] if under != "." else sorted(p for p in ROOT.iterdir() if p.is_dir())
    folders = [p for p in folders if p.name not in ("build", "out") and not p.name.startswith(".")]
    found = sorted(p for folder in folders for p in folder.rglob("*") if p.suffix in suffixes and p.is_file())
    assert found, f"no {suffixes} below {under}"
    return found


def name_of(path):
    return path.relative_to(ROOT).as_posix()


def room_of(path):
    """The room whose folder holds the file, the innermost one; tests/X has the rights of X."""
    name = name_of(path)
    if name.startswith("tests/"):
        return name.split("/")[1] if name.split("/")[1] in ROOMS else None
    inside = [room for room, (folder, _) in ROOMS.items() if name.startswith(folder + "/")]
    return max(inside, key=lambda room: len(ROOMS[room][0]), default=None)


def includes(path):
    return re.findall(r'^\s*#\s*include\s*"([^"]+)"', path.read_text(), re.MULTILINE)


def public_headers():
    """Name in an #include -> room."""
    headers = {"pecs/version.h": "common", "pecs.h": "capi"}
    for room, (folder, _) in ROOMS.items():
        include = ROOT / folder / "include"
        headers |= {p.relative_to(include).as_posix(): room for p in include.rglob("*.h")}
    return headers


def test_no_room_includes_upward():
    order = list(ROOMS)
    for room, (_, allowed) in ROOMS.items():
        assert all(order.index(lower) < order.index(room) for lower in allowed.split()), f"the table has {room} upward"
    headers, wrong, seen = public_headers(), [], set()
    for path in sources(".h", ".cpp"):
        room = room_of(path)
        test = name_of(path).startswith("tests/")
        for header in includes(path):
            owner = headers.get(header)
            if room is None or owner is None:
                continue
            seen.add((room, owner))
            allowed = {room, *ROOMS[room][1].split()}
            # A test may feed its room from any room but the two on top.
            if owner not in (set(ROOMS) - {"capi", "apps"} if test else allowed):
                wrong.append(f"{name_of(path)} includes {header} of {owner}")
    assert not wrong, "\n".join(wrong)
    assert ("calibration", "lens") in seen and ("sensor", "events") in seen  # there was something to look at


def test_private_headers_stay_in_their_room():
    public, wrong = public_headers(), []
    private = {}  # name as a suffix of the path -> rooms that have one
    for path in sources(".h"):
        if room_of(path) and "/include/" not in name_of(path) and not name_of(path).startswith("tests/"):
            private.setdefault(path.name, set()).add(room_of(path))
    for path in sources(".h", ".cpp"):
        for header in includes(path):
            owners = private.get(Path(header).name, set())
            if header in public or not owners or (path.parent / header).is_file():
                continue
            # The benches measure private kernels, the fuzzers reach private readers.
            if room_of(path) not in owners and not name_of(path).startswith(("scripts/bench/", "tests/fuzz/")):
                wrong.append(f"{name_of(path)} includes {header}, private to {', '.join(owners)}")
    assert not wrong, "\n".join(wrong)


def imported(path):
    """Top names of all modules that the file imports."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        if isinstance(node, ast.ImportFrom) and node.level == 0:
            names.add(node.module.split(".")[0])
    return names


def test_bpy_only_where_blender_is():
    extension = "blender_addon/pecs_blender"
    entries = {f"{extension}/{name}.py" for name in ("__init__", "__main__", "cli")}
    for path in sources(".py", under=extension):
        if "bpy" in imported(path):
            name = name_of(path)
            assert name in entries or name.removeprefix(f"{extension}/").split("/")[0] in BLENDER_ROOMS, name
    for path in sources(".py", under="python/pecs"):
        assert not imported(path) & {"bpy", "pecs_blender"}, name_of(path)


def paths_added(path):
    """Folders of NO_LIBRARIES in the statements that change sys.path."""
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.Expr | ast.Assign | ast.AugAssign) or "sys.path" not in ast.unparse(node):
            continue
        texts = {n.value for n in ast.walk(node) if isinstance(n, ast.Constant) and isinstance(n.value, str)}
        for folder in sorted(NO_LIBRARIES & {part for text in texts for part in text.split("/")}):
            yield f"{name_of(path)}:{node.lineno} puts {folder}/ on sys.path"


def test_no_room_reaches_another_by_sys_path():
    wrong = [line for path in sources(".py") for line in paths_added(path)]
    assert not wrong, "\n".join(wrong)


def test_random_numbers_are_those_of_every_standard_library():
    """Engines of <random> are specified to the bit; its distributions and std::shuffle are not."""
    code = [p for p in sources(".cpp", ".h") if not name_of(p).startswith(("tests/", "scripts/"))]
    unspecified = re.compile(r"std::(shuffle|sample|random_device|\w+_distribution|generate_canonical)\b")
    found = [f"{name_of(p)}: {m[0]}" for p in code if (m := unspecified.search(re.sub("//.*", "", p.read_text())))]
    assert not found, "\n".join(found)


def test_files_are_short():
    """Functions: ruff (pyproject.toml) and clang-tidy (.clang-tidy)."""
    lines = {name_of(p): len(p.read_text().splitlines()) for p in sources(".py", ".cpp", ".h")}
    long = {name: count for name, count in lines.items() if count > MAX_FILE_LINES}
    assert not long, f"longer than {MAX_FILE_LINES} lines: {long}"
