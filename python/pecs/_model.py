"""Pixel models in Python (docs/howto/add_pixel_model.md): called by the library in this process, or, as
`python -m pecs._model FILE.py:NAME`, by the program `pecs sense`."""

from __future__ import annotations

import ctypes
import importlib.util
import json
import os
import struct
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from ._c_types import DOUBLE, INT, INT64, POINTER, unmasked
from ._config import parse_json
from ._errors import ExitCode, PecsError, PecsNotFoundError, UsageError, existing, one_line
from ._platform import empty_standard_input

_FLOAT_POINTER, _DOUBLE_POINTER = ctypes.POINTER(ctypes.c_float), ctypes.POINTER(DOUBLE)
_Begin = ctypes.CFUNCTYPE(POINTER, ctypes.c_char_p, POINTER)
_Interval = ctypes.CFUNCTYPE(INT64, POINTER, _FLOAT_POINTER, _DOUBLE_POINTER, ctypes.POINTER(_DOUBLE_POINTER))


class _CModel(ctypes.Structure):
    _fields_ = [
        ("takes_light", INT),
        ("tells_causes", INT),
        ("user", POINTER),
        ("begin", _Begin),
        ("interval", _Interval),
        ("end", POINTER),
    ]


def name_of(model: Callable[..., Any]) -> str:
    return str(getattr(model, "__qualname__", type(model).__qualname__))


class _Models:
    """A pixel model, with the instance of each simulation."""

    def __init__(self, model: Callable[..., Any], name: str):
        self.model, self.name = model, name
        self.takes_light = bool(getattr(model, "takes_light", True))
        self.tells_causes = bool(getattr(model, "tells_causes", False))
        self.running: list[tuple[Callable[..., Any], tuple[int, int, int]]] = []

    def begin(self, setup_json: bytes) -> int:
        """The number of a new instance, from 1 on."""
        setup = parse_json(setup_json, "setup")
        chip = {key: entry["value"] for key, entry in setup["chip"]["values"].items()}
        given = SimpleNamespace(width=setup["width"], height=setup["height"], seed=setup["seed"], chip=chip)
        instance = self.model(given, **setup["parameters"])
        self.running.append((instance, (2, setup["height"], setup["width"])))
        return len(self.running)

    def interval(self, number: int, planes: NDArray[np.float32], t_us: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rows of t_us, x, y, p, cause. The model gets copies, which it may keep, in double precision: NumPy 1 takes
        products of single precision and a time as single precision, which has no microseconds after 17 s."""
        instance, shape = self.running[number - 1]
        found = instance(planes.astype(np.float64).reshape(shape), t_us.copy())
        names = ("t", "x", "y", "p", "cause")[: 5 if self.tells_causes else 4]
        if found is None or len(found) != len(names):
            got = "None" if found is None else f"{len(found)} arrays"
            raise ValueError(f"{self.name}: got {got}, wanted {', '.join(names)}")
        columns = [unmasked(name, part) for name, part in zip(names, found, strict=True)]
        if columns[0].dtype in (np.float16, np.float32):
            raise ValueError(f"{self.name}: t: got {columns[0].dtype}, wanted float64 or whole numbers")
        rows = np.zeros((columns[0].size, 5))
        for i, (name, column) in enumerate(zip(names, columns, strict=True)):
            if column.shape != (len(rows),):
                raise ValueError(f"{self.name}: {name}: got shape {column.shape}, wanted ({len(rows)},) as t")
            rows[:, i] = column.astype(np.float64, casting="same_kind")
        return rows


class CallbackModel:
    """A pixel model as the callbacks of `pecs_model`; must outlive the library's use of them."""

    def __init__(self, model: Callable[..., Any], raised: list[BaseException]):
        models = _Models(model, name_of(model))
        self._rows = np.zeros((0, 5))  # valid until the next call

        @_Begin
        def begin(setup_json: bytes, _user: int | None) -> int | None:
            try:
                return models.begin(setup_json)
            except BaseException as e:
                raised.append(e)
                return None

        @_Interval
        def interval(state: int, planes: Any, t_us: Any, events: Any) -> int:
            try:
                shape = models.running[state - 1][1]
                light, times = np.ctypeslib.as_array(planes, shape), np.ctypeslib.as_array(t_us, (2,))
                self._rows = models.interval(state, light, times)
                events[0] = self._rows.ctypes.data_as(_DOUBLE_POINTER)
                return len(self._rows)
            except BaseException as e:
                raised.append(e)
                return -1

        self.struct = _CModel(models.takes_light, models.tells_causes, None, begin, interval, None)


def callbacks(model: object, raised: list[BaseException]) -> tuple[CallbackModel | None, Any]:
    """The model to keep, and the argument of the C function; None for a name."""
    if not callable(model):
        return None, None
    kept = CallbackModel(model, raised)
    return kept, ctypes.byref(kept.struct)


@contextmanager
def raising(raised: list[BaseException]) -> Iterator[None]:
    """Raises the exception of a callback (KeyboardInterrupt too), which the library reports as an error of its own."""
    try:
        yield
    except PecsError:
        if raised:
            raise raised.pop() from None
        raise


def _load(text: str) -> _Models:
    """FILE.py:NAME"""
    file, _, name = text.rpartition(":")
    path = existing(Path(file), "a Python file").resolve()
    sys.path.insert(0, str(path.parent))
    spec = importlib.util.spec_from_file_location("_pecs_model", path)  # not the name of a module that is in use
    if spec is None or spec.loader is None:
        raise PecsNotFoundError(f"{file}: cannot be opened, wanted a Python file")
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    model = getattr(module, name, None)
    if not callable(model):
        known = [key for key, value in vars(module).items() if getattr(value, "__module__", "") == spec.name]
        raise UsageError(f"--model: got {text}, wanted one of {file}'s {', '.join(known) or 'models (it has none)'}")
    return _Models(model, text)


def _line_of(error: BaseException, model: str, verbose: bool) -> tuple[int, str]:
    """Exit code and line. An error of the model's file has its place; --verbose also prints the traceback."""
    if isinstance(error, PecsError):
        return error.code, str(error)
    if verbose:
        traceback.print_exception(error)
    file = Path(model.rpartition(":")[0])
    frames = [f for f in traceback.extract_tb(error.__traceback__) if Path(f.filename) == file.resolve()]
    line = getattr(error, "lineno", None) if isinstance(error, SyntaxError) else frames[-1].lineno if frames else None
    place = f"line {line}: " if line else ""
    message = next(iter(str(error).splitlines()), "")
    return ExitCode.BAD_INPUT, f"{file}: {place}{type(error).__name__}: {message}"


def _serve(text: str, verbose: bool, read: BinaryIO, write: BinaryIO) -> None:
    """Messages in both directions are 8 bytes of length, then so many bytes. From the program: the setup as JSON, or
    number, t_us[2] and planes; to it: "{", traits or an error as JSON, or "=", rows of events."""

    def send(payload: bytes) -> None:
        write.write(struct.pack("<q", len(payload)) + payload)
        write.flush()

    try:
        models = _load(text)
        send(json.dumps({"takes_light": models.takes_light, "tells_causes": models.tells_causes}).encode())
        while head := read.read(8):
            message = read.read(struct.unpack("<q", head)[0])
            if message[:1] == b"{":
                models.begin(message)
                send(b"=")
            else:
                number, begin_us, end_us = struct.unpack_from("<xqdd", message)
                planes = np.frombuffer(message, np.float32, offset=25)
                send(b"=" + models.interval(number, planes, np.array([begin_us, end_us])).tobytes())
    except (KeyboardInterrupt, ConnectionError):
        return  # the program also ends, or has ended
    except BaseException as e:  # also SystemExit
        code, line = _line_of(e, text, verbose)
        with suppress(OSError):  # the model closed the stream
            send(json.dumps({"code": int(code), "error": one_line(line)}).encode())


if __name__ == "__main__":
    with suppress(ConnectionError), os.fdopen(os.dup(0), "rb") as read, os.fdopen(os.dup(0), "wb") as write:
        empty_standard_input()  # of the model
        _serve(sys.argv[1], "--verbose" in sys.argv[2:], read, write)
