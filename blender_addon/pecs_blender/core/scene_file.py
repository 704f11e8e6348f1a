# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene is a folder: scene.json (camera, parameters with unit and range) and scene.py with build(parameters)."""

from __future__ import annotations

import importlib.util
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .errors import NOT_FOUND, USAGE, RenderError, bad_input
from .spectra import Spectrum, spectrum


@dataclass(frozen=True)
class SceneFile:
    folder: Path
    camera: dict[str, Any]
    parameters: dict[str, Any]  # resolved, as recorded

    @property
    def name(self) -> str:
        return self.folder.name

    def build(self):
        """Runs scene.py's build() with spectra loaded."""
        path = self.folder / "scene.py"
        spec = importlib.util.spec_from_file_location(f"pecs_scene_{self.name}", path)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module.build(self.loaded())

    def loaded(self) -> dict[str, Any]:
        """Parameters with spectra as Spectrum."""
        return {k: self._spectrum(v) if _is_spectral(k) else v for k, v in self.parameters.items()}

    def _spectrum(self, value: float | str) -> Spectrum:
        return spectrum(value, self.folder)


def _is_spectral(key: str) -> bool:
    return key.endswith(("_reflectance", "_spectrum"))


def load_scene(folder: Path, overrides: list[str]) -> SceneFile:
    """overrides: "key=value" texts, and "@FILE" for an aligned.json of `pecs align`."""
    path = folder / "scene.json"
    if not path.is_file():
        raise RenderError(NOT_FOUND, f"{path}: no such file; a scene is a folder with scene.json and scene.py")
    try:
        description = json.loads(path.read_text())
    except json.JSONDecodeError as e:
        raise bad_input(path, f"line {e.lineno} column {e.colno}", e.msg, "valid JSON") from None
    unknown = {k for k in description if not k.startswith("_")} - {"camera", "parameters"}
    if unknown:
        raise bad_input(path, sorted(unknown)[0], "an unknown key", "one of camera, parameters")
    declared = description["parameters"]
    values = {key: declaration["value"] for key, declaration in declared.items()}
    camera = dict(description["camera"])
    for text in overrides:
        if text.startswith("@"):
            aligned = _aligned(Path(text[1:]), folder.resolve().name, declared)
            camera |= aligned["camera"]
            values |= aligned["parameters"]
            continue
        key, equals, value = text.partition("=")
        if not equals or key not in declared:
            raise RenderError(USAGE, f"--set {text}: got an unknown parameter, wanted one of {', '.join(declared)}")
        values[key] = _parsed(key, value)
    for key, value in values.items():
        _check(path, key, value, declared[key])
    return SceneFile(folder, camera, values)


def _aligned(path: Path, scene: str, declared: dict[str, Any]) -> dict[str, Any]:
    try:
        aligned = json.loads(path.read_text())
        name, parameters, rotation = aligned["scene"], aligned["parameters"], aligned["camera"]["rotation_deg"]
    except (OSError, ValueError, KeyError) as e:
        raise bad_input(path, "", f"{type(e).__name__}: {e}", "an aligned.json of pecs align") from None
    if name != scene:
        raise bad_input(path, "scene", name, scene)
    for key in parameters:
        if key not in declared:
            raise bad_input(path, key, "an unknown parameter", f"one of {', '.join(declared)}")
    return {"camera": {"rotation_deg": rotation}, "parameters": parameters}


def _parsed(key: str, text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        if _is_spectral(key):
            return text
        raise RenderError(USAGE, f"--set {key}: got {text!r}, wanted a number") from None


def _check(path: Path, key: str, value: Any, declared: dict[str, Any]) -> None:
    low, high = declared.get("range", (float("-inf"), float("inf")))
    if isinstance(value, str):
        if not _is_spectral(key):
            raise bad_input(path, key, repr(value), f"a number in [{low}, {high}] {declared['unit']}")
    elif not low <= value <= high:  # also false for NaN
        raise bad_input(path, key, value, f"a number in [{low}, {high}] {declared['unit']}")
