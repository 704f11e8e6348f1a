"""Which part may include which, and the longest a file may be."""

import ast
import re
from graphlib import TopologicalSorter
from pathlib import Path

import pytest
from support import ROOT

MAX_FILE_LINES = 600

# Part -> (folder, parts whose public headers it may include). Low to high: no part includes upward.
PARTS = {
    "common": ("common", ""),
    "events": ("sensor/events", "common"),
    "lens": ("blender_addon/lens", "common"),
    "sensor": ("sensor", "common events"),  # knows no lens
    "input": ("sensor/input", "common events sensor"),
    "metrics": ("calibration/metrics", "common events"),
    "page": ("calibration/page", "common events"),
    "view": ("calibration/view", "common events sensor input metrics page"),
    "calibration": ("calibration", "common events lens sensor metrics view"),
    "capi": ("python/c", "common events lens sensor metrics page"),
    "apps": ("apps", "common events lens sensor input metrics view calibration"),
}
# Folders of sensor/src: each includes only those before it. A public header belongs to the folder of its .cpp.
SENSOR_PARTS = ("spectrum", "chip", "stack", "motion", "light", "pixels", "models", "stages", "sense")
HEADERS_ALONE = {"stack": "stack", "motion": "motion", "event_slots": "pixels"}  # without a .cpp of their name
# Part of blender_addon/pecs_blender -> parts that it may import, low to high. Files outside the parts import none of
# them, except the entries.
ADD_ON = "blender_addon/pecs_blender"
ADD_ON_PARTS = {
    "spectral": "",
    "scene": "spectral",
    "camera": "spectral scene",
    "truth": "spectral scene camera",
    "adaptive": "spectral scene camera truth",
    "job": "spectral scene camera truth adaptive",
    "ui": "spectral scene camera truth job",
}
ADD_ON_ENTRIES = ("__init__", "__main__", "cli")
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


def part_of(path):
    """The part whose folder holds the file, the innermost one; tests/X has the rights of X."""
    name = name_of(path)
    if name.startswith("tests/"):
        return name.split("/")[1] if name.split("/")[1] in PARTS else None
    inside = [part for part, (folder, _) in PARTS.items() if name.startswith(folder + "/")]
    return max(inside, key=lambda part: len(PARTS[part][0]), default=None)


def includes(path):
    return re.findall(r'^\s*#\s*include\s*"([^"]+)"', path.read_text(), re.MULTILINE)


def public_headers():
    """Name in an #include -> part."""
    headers = {"pecs/version.h": "common", "pecs.h": "capi"}
    for part, (folder, _) in PARTS.items():
        include = ROOT / folder / "include"
        headers |= {p.relative_to(include).as_posix(): part for p in include.rglob("*.h")}
    return headers


def test_no_part_includes_upward():
    order = list(PARTS)
    for part, (_, allowed) in PARTS.items():
        assert all(order.index(lower) < order.index(part) for lower in allowed.split()), f"the table has {part} upward"
    headers, wrong, seen = public_headers(), [], set()
    for path in sources(".h", ".cpp"):
        part = part_of(path)
        test = name_of(path).startswith("tests/")
        for header in includes(path):
            owner = headers.get(header)
            if part is None or owner is None:
                continue
            seen.add((part, owner))
            allowed = {part, *PARTS[part][1].split()}
            # A test may feed its part from any part but the two on top.
            if owner not in (set(PARTS) - {"capi", "apps"} if test else allowed):
                wrong.append(f"{name_of(path)} includes {header} of {owner}")
    assert not wrong, "\n".join(wrong)
    assert ("calibration", "lens") in seen and ("sensor", "events") in seen  # there was something to look at


def test_parts_of_the_sensor_include_downward():
    parts, headers = {}, {}
    for path in sources(".h", ".cpp", under="sensor/src"):
        parts[path] = path.relative_to(ROOT / "sensor/src").parts[0]
        headers[path.relative_to(ROOT / "sensor/src").as_posix()] = parts[path]
    with_code = {path.stem: part for path, part in parts.items() if path.suffix == ".cpp"} | HEADERS_ALONE
    for path in sources(".h", under="sensor/include"):
        if path.stem != "random":  # below all
            parts[path] = headers[path.relative_to(ROOT / "sensor/include").as_posix()] = with_code[path.stem]
    order = SENSOR_PARTS.index
    wrong = [
        f"{name_of(path)} includes {header} of {headers[header]}"
        for path, part in parts.items()
        for header in includes(path)
        if header in headers and order(headers[header]) > order(part)
    ]
    assert not wrong and set(parts.values()) == set(SENSOR_PARTS), "\n".join(wrong)


def test_private_headers_stay_in_their_part():
    public, wrong = public_headers(), []
    private = {}  # name as a suffix of the path -> parts that have one
    for path in sources(".h"):
        if part_of(path) and "/include/" not in name_of(path) and not name_of(path).startswith("tests/"):
            private.setdefault(path.name, set()).add(part_of(path))
    for path in sources(".h", ".cpp"):
        for header in includes(path):
            owners = private.get(Path(header).name, set())
            if header in public or not owners or (path.parent / header).is_file():
                continue
            if part_of(path) not in owners and not name_of(path).startswith("tests/fuzz/"):  # of private readers
                wrong.append(f"{name_of(path)} includes {header}, private to {', '.join(owners)}")
    assert not wrong, "\n".join(wrong)


def test_platform_headers_stay_in_one_part():
    """Files, locks, processes, signals, memory and libraries of the operating system: pecs/platform.h."""
    names = "unistd|fcntl|signal|csignal|dlfcn|poll|termios|windows|shellapi|io"
    of_system = re.compile(rf"#\s*include <((sys|linux)/.*|{names})\b")
    found = {name_of(p) for p in sources(".h", ".cpp") if of_system.search(p.read_text())}
    found = {name for name in found if not name.startswith(("tests/", "scripts/"))}
    unix = {"common/src/platform.cpp", "common/src/platform_files.cpp"}
    assert found == unix | {name.replace(".cpp", "_windows.cpp") for name in unix} | {"common/src/on_windows.h"}


OF_SYSTEM = re.compile(
    r"^\s*(?:import|from) (?:fcntl|grp|mmap|msvcrt|pty|pwd|resource|select|signal|termios|winreg)\b"
    r"|\bos\.(?:fork|exec|kill|spawn|wait|pipe|dup2|set[a-z]*id|sysconf|sched_|O_|RTLD_)|\b(?:sys\.platform|os\.name)\b"
    r"|CDLL\(None|\bprctl\b|\bmkstemp\b|\bpreexec_fn\b|\bstart_new_session\b|\.(?:so|dll|dylib)\b|/proc\b",
    re.MULTILINE,
)


def test_the_system_stays_in_one_part_of_python():
    """The same of the package and of the extension: pecs/_platform.py."""
    examples = "import signal|from fcntl import fcntl|ctypes.CDLL(None)|os.fork()|os.execvp(a, b)|os.killpg(1, 2)"
    examples += "|libc.prctl(1)|tempfile.mkstemp()|Path('/proc/self/status')|import resource|os.O_NOFOLLOW|'libpecs.so'"
    assert all(OF_SYSTEM.search(line) for line in examples.split("|"))
    assert not OF_SYSTEM.search("from scipy.signal import lfilter")
    found = [p for folder in ("python/pecs", ADD_ON) for p in sources(".py", under=folder)]
    assert [name_of(p) for p in found if OF_SYSTEM.search(p.read_text())] == [
        "python/pecs/_platform.py",
        "python/pecs/_platform_unix.py",
        "python/pecs/_platform_windows.py",
    ]


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
    for path in sources(".py", under=ADD_ON):
        if "bpy" in imported(path):
            name = path.relative_to(ROOT / ADD_ON)
            assert name.parts[0] in ADD_ON_PARTS or name.stem in ADD_ON_ENTRIES, name
    for path in sources(".py", under="python/pecs"):
        assert not imported(path) & {"bpy", "pecs_blender"}, name_of(path)


def modules_imported(path, package_folder=ADD_ON):
    """Parts of the names of a package's modules that one of its files imports."""
    root = ROOT / package_folder
    package = path.relative_to(root).parts[:-1]
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = *package[: len(package) - node.level + 1], *(node.module or "").split(".")
            for alias in node.names:
                module = Path(*filter(None, base), alias.name)
                module = module if (root / module).with_suffix(".py").is_file() else module.parent
                yield (module / "__init__" if (root / module).is_dir() else module).parts


def test_parts_of_the_add_on_import_downward():
    order, wrong, graph = list(ADD_ON_PARTS), [], {}
    for part, allowed in ADD_ON_PARTS.items():
        assert all(order.index(lower) < order.index(part) for lower in allowed.split()), f"the table has {part} upward"
    for path in sources(".py", under=ADD_ON):
        own = path.relative_to(ROOT / ADD_ON).with_suffix("").parts
        graph[own] = set(modules_imported(path)) - {own}
        if own[0] in ADD_ON_ENTRIES:
            continue
        allowed = {own[0], *ADD_ON_PARTS.get(own[0], "").split()}
        for module in graph[own]:
            if module and module[0] in ADD_ON_PARTS and module[0] not in allowed:
                wrong.append(f"{name_of(path)} imports {'/'.join(module)}")
    assert not wrong, "\n".join(wrong)
    list(TopologicalSorter(graph).static_order())  # raises CycleError
    assert ("camera", "plan") in graph["job", "resolve"]  # there was something to look at


@pytest.mark.parametrize("part", ["datasets", "fit", "learning"])
def test_modules_of_a_part_import_in_one_direction(part):
    folder, graph = f"python/pecs/{part}", {}
    for path in sources(".py", under=folder):
        own = path.relative_to(ROOT / folder).with_suffix("").parts
        inside = set(modules_imported(path, folder)) - {own}
        graph[own] = {m for m in inside if (ROOT / folder).joinpath(*m).with_suffix(".py").is_file()}
    assert any(graph.values())
    list(TopologicalSorter(graph).static_order())  # raises CycleError


def paths_added(path):
    """Folders of NO_LIBRARIES in the statements that change sys.path."""
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.Expr | ast.Assign | ast.AugAssign) or "sys.path" not in ast.unparse(node):
            continue
        texts = {n.value for n in ast.walk(node) if isinstance(n, ast.Constant) and isinstance(n.value, str)}
        for folder in sorted(NO_LIBRARIES & {part for text in texts for part in text.split("/")}):
            yield f"{name_of(path)}:{node.lineno} puts {folder}/ on sys.path"


def test_no_part_reaches_another_by_sys_path():
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
