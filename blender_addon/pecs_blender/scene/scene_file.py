# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene is a folder: scene.json (camera, parameters with unit and range) and scene.py with build(parameters)."""

from __future__ import annotations

import importlib.util
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pecs._config import Fields, is_number, read_json, wanted_number
from pecs._errors import PecsError, PecsInputError, PecsNotFoundError, UsageError, bad_input, shown

from ..spectral.spectra import spectrum


@dataclass(frozen=True)
class Declaration:
    """A parameter in scene.json; the value of a spectral one may be text that names a spectrum."""

    value: float | str
    unit: str
    range: tuple[float, float]
    spectral: bool

    def check(self, file: object, place: str, value: Any) -> None:
        low, high = self.range
        if isinstance(value, str) and self.spectral:
            return
        if not (is_number(value) and low <= value <= high):
            raise bad_input(file, place, shown(value), f"{wanted_number(low, high)} {self.unit}")


class _Parameters(dict):
    """Parameters for build(); a missing one is an error in scene.json."""

    def __init__(self, file: Path, values: dict[str, Any]):
        super().__init__(values)
        self._file = file

    def __missing__(self, key: str):
        raise bad_input(self._file, f"parameters.{key}", "nothing", "a parameter that scene.py uses")


@dataclass(frozen=True)
class SceneFile:
    folder: Path
    camera: dict[str, Any]
    parameters: dict[str, Any]  # resolved, as recorded

    @property
    def name(self) -> str:
        return self.folder.name

    def build(self):
        """Runs build() of scene.py with spectra loaded."""
        path = self.folder / "scene.py"
        if not path.is_file():
            raise PecsNotFoundError(f"{path}: no such file")
        spec = importlib.util.spec_from_file_location(f"pecs_scene_{self.name}", path)
        module = importlib.util.module_from_spec(spec)
        parameters = self.loaded()
        try:
            spec.loader.exec_module(module)
            return module.build(parameters)
        except PecsError:
            raise
        except Exception as e:
            lines = [f.lineno for f in traceback.extract_tb(e.__traceback__) if f.filename == str(path)]
            place = f"line {lines[-1]}" if lines else f"line {getattr(e, 'lineno', None) or 1}"
            raise PecsInputError(f"{path}: {place}: {type(e).__name__}: {e}") from e

    def loaded(self) -> dict[str, Any]:
        """Parameters with spectra as Spectrum."""
        values = {k: spectrum(v, self.folder) if _is_spectral(k) else v for k, v in self.parameters.items()}
        return _Parameters(self.folder / "scene.json", values)


def _is_spectral(key: str) -> bool:
    return key.endswith(("_reflectance", "_spectrum"))


def load_scene(folder: Path, overrides: Sequence[str]) -> SceneFile:
    """overrides: "key=value" texts, and "@FILE" for an aligned.json of `pecs align`."""
    path = folder / "scene.json"
    if not path.is_file():
        raise PecsNotFoundError(f"{path}: no such file; a scene is a folder with scene.json and scene.py")
    top = Fields(read_json(path), path)
    camera = _camera(top.table("camera"))
    declared = _declarations(top.table("parameters"))
    top.done()
    values = {key: declaration.value for key, declaration in declared.items()}
    for text in overrides:
        if text.startswith("@"):
            rotation_deg, parameters = _aligned(Path(text[1:]), folder.resolve().name, declared)
            camera["rotation_deg"] = rotation_deg
            values |= parameters
            continue
        key, equals, value = text.partition("=")
        if not equals or key not in declared:
            wanted = f"one of {', '.join(declared)} (values of a chip: pecs run … --sense --set)"
            raise UsageError(f"--set {text}: got an unknown parameter, wanted {wanted}")
        values[key] = _parsed(key, value)
        declared[key].check("--set", key, values[key])
    return SceneFile(folder, camera, values)


def _camera(camera: Fields) -> dict[str, Any]:
    values = {
        "lens": camera.text("lens"),
        "stop_diameter_mm": camera.optional(camera.number, "stop_diameter_mm", low=1e-3, high=1e3),
        "focus_m": camera.optional(camera.number, "focus_m", low=1e-3, high=1e9),
    }
    if camera.has("rotation_deg"):
        values["rotation_deg"] = camera.numbers("rotation_deg", count=3, low=-360, high=360)
    camera.done()
    return values


def _declarations(parameters: Fields) -> dict[str, Declaration]:
    declared = {}
    for key in parameters.keys():
        entry = parameters.table(key)
        low, high = entry.numbers("range", count=2) if entry.has("range") else (float("-inf"), float("inf"))
        if low > high:
            raise entry.fail("range", f"[{low}, {high}]", "the lower end first")
        if entry.has("about"):
            entry.text("about")
        unit = entry.text("unit") if entry.has("unit") else ""
        declared[key] = Declaration(entry.any("value"), unit, (low, high), _is_spectral(key))
        declared[key].check(entry.file, f"{entry.place}.value", declared[key].value)
        entry.done()
    return declared


def _aligned(path: Path, scene: str, declared: dict[str, Declaration]) -> tuple[list[float], dict[str, Any]]:
    """Camera rotation and parameters of an aligned.json of `pecs align`."""
    aligned = Fields(read_json(path), path)
    if aligned.has("pecs_aligned"):
        aligned.number("pecs_aligned", low=1, high=1)
    if aligned.text("scene") != scene:
        raise aligned.wrong("scene", scene)
    parameters = aligned.table("parameters")
    for key in parameters.keys():
        if key not in declared:
            raise parameters.fail(shown(key)[1:-1], "an unknown parameter", f"one of {', '.join(declared)}")
        declared[key].check(path, f"parameters.{key}", parameters.any(key))
    return aligned.table("camera").numbers("rotation_deg", count=3, low=-360, high=360), {
        key: parameters.any(key) for key in parameters.keys()
    }


def _parsed(key: str, text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        if _is_spectral(key):
            return text
        raise UsageError(f"--set {key}: got {text!r}, wanted a number") from None
