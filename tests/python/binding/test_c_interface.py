"""pecs.h as a whole: what it declares is what the library exports, and no call without arguments crashes."""

import ctypes
import re
import subprocess
import sys

import pecs
import pytest
from pecs import _library


@pytest.fixture(scope="module")
def header(root):
    return re.sub(r"/\*.*?\*/", "", (root / "python/c/include/pecs.h").read_text(), flags=re.DOTALL)


def declared(header):
    """(result, name, arguments) of every function."""
    found = re.findall(r"PECS_API\s+([\w ]+[\w*])\s+\*?(\w+)\(([^)]*)\);", header)
    return [(result.strip(), name, re.sub(r"\s+", " ", arguments)) for result, name, arguments in found]


def test_exports_are_declared(header):
    library = _library._find().resolve()
    lines = subprocess.run(["nm", "-D", "--defined-only", library], capture_output=True, text=True, check=True).stdout
    exported = {line.split()[-1].split("@")[0] for line in lines.splitlines()}
    names = {name for _, name, _ in declared(header)}
    assert len(names) > 35 and {e for e in exported if e.startswith("pecs_")} == names


def test_versions_agree(header):
    numbers = re.findall(r"PECS_VERSION_\w+ (\d+)", header)
    assert ".".join(numbers) == pecs.__version__ == re.search(r'PECS_VERSION "(.*)"', header)[1]


def test_names_are_type_and_verb(header):
    """A handle is opened or created, and closed."""
    names = {name for _, name, _ in declared(header)}
    for handle in re.findall(r"typedef struct (pecs_\w+) \1;", header):
        assert f"{handle}_close" in names and names & {f"{handle}_open", f"{handle}_create"}


def test_outputs_have_capacities(header):
    for _, name, arguments in declared(header):
        for kind, pointer in re.findall(r"(?<!const )\b(float|double|pecs_event|uint8_t)\* (\w+)", arguments):
            if (name, pointer) != ("pecs_lens_diffract", "pixels") and f"const {kind}* {pointer}" not in arguments:
                assert re.search(rf"{pointer}, int64_t capacity", arguments), name


CALL = """
import ctypes, sys
library, name, result, *arguments = sys.argv[1:]
kinds = {"int": ctypes.c_int, "int64_t": ctypes.c_int64, "double": ctypes.c_double}
error = ctypes.create_string_buffer(2048)  # begins with its code
f = getattr(ctypes.CDLL(library), name)
f.restype = kinds.get(result, ctypes.c_void_p)
f.argtypes = [kinds.get(a, ctypes.c_void_p) for a in arguments] + [ctypes.c_void_p]
print(f(*[None if kind is ctypes.c_void_p else 0 for kind in f.argtypes[:-1]], error), error.raw[0])
"""


def test_null_is_refused(header):
    answers = {"pecs_event_formats", "pecs_models", "pecs_presets", "pecs_bands"}  # static
    for result, name, arguments in declared(header):
        *kinds, last = [a.rsplit(" ", 1)[0] for a in arguments.split(", ")]
        if last != "pecs_error*" or name in answers:
            continue
        command = [sys.executable, "-c", CALL, _library._find(), name, result, *kinds]
        done = subprocess.run(list(map(str, command)), capture_output=True, text=True)
        assert done.returncode == 0, f"{name}: {done.stderr}"
        got, code = done.stdout.split()
        assert got == ("-1" if result in ("int", "int64_t") else "None") and code in "24", name


def test_a_small_array_is_refused():
    library = ctypes.CDLL(str(_library._find()))
    opened = _library.function("pecs_sensor_open", ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)
    sensor = opened(b'{"width": 4, "height": 4, "photocurrent_a": 1e-12, "chip": "ideal"}', None)
    frames = (ctypes.c_float * 48)(*[1.0] * 16, *[2.0] * 16, *[3.0] * 16)
    times = (ctypes.c_double * 3)(0, 1000, 2000)
    library.pecs_sensor_push.restype = ctypes.c_int64
    count = library.pecs_sensor_push(ctypes.c_void_p(sensor), frames, times, ctypes.c_int64(3), 1, None)
    assert count > 16
    take = _library.function("pecs_sensor_events", ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64)
    room = (ctypes.c_uint8 * (16 * count))()
    with pytest.raises(pecs.PecsInputError, match=f"capacity: got {count - 1}, wanted at least {count}"):
        take(sensor, room, count - 1)
    assert not any(room) and take(sensor, room, count) == count and any(room)
    push = _library.function(
        "pecs_sensor_push",
        ctypes.c_int64,
        *[ctypes.c_void_p] * 3,
        ctypes.c_int64,
        ctypes.c_int,
    )
    with pytest.raises(pecs.PecsInputError, match="after the last"):
        push(sensor, frames, times, 1, 0)
    library.pecs_sensor_close(ctypes.c_void_p(sensor))
