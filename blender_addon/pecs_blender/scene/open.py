# SPDX-License-Identifier: GPL-3.0-or-later
"""Opens a scene of either kind."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import bpy
from pecs._errors import ExitCode, PecsError, UsageError

from ..spectral.spectra import K_CD_LM_PER_W, OCIO, spectrum
from .blend import BlendScene, check
from .folder import FolderScene
from .placed import Placed
from .scene_file import load_scene
from .source import Source

WORKING_SPACE = "Linear Rec.709"


def open_scene(
    path: Path,
    illuminant: str,
    *,
    parameters: Sequence[str] = (),
    scene_name: str | None = None,
    allow_scripts: bool = False,
    place: Path | None = None,
    camera: str | None = None,
) -> Source:
    """A .blend file or a scene folder. illuminant: spectrum of a .blend's RGB lamps. parameters: "key=value" and
    "@aligned.json" of a scene folder. place: file of objects to add. camera: of a .blend, instead of its active one."""
    if path.suffix != ".blend" and camera:
        raise UsageError(f"--camera {camera}: only a .blend has named cameras, not a scene folder")
    if path.suffix != ".blend":
        source: Source = FolderScene(load_scene(path, parameters))
    elif parameters:
        only = "only scene folders have parameters, not a .blend; values of a chip: pecs run … --sense --set"
        raise UsageError(f"--set {parameters[0]}: {only}")
    else:
        source = BlendScene(path, scene_name, spectrum(illuminant, path.absolute().parent), allow_scripts, camera)
    _check_colours(path)
    if place:
        scene = source.scene
        source.placed = Placed(place, scene, source.unit_m, lambda file: check(file, scene, allow_scripts))
        source.sky = source.placed.sky
        if isinstance(source, BlendScene) and source.sky:
            source.sky.shine(K_CD_LM_PER_W * source.radiance_per_unit(None))
    return source


def _check_colours(path: Path) -> None:
    """Colours are those of Blender's own configuration, in Rec. 709. Raises PecsError for others."""
    own = Path(bpy.utils.system_resource("DATAFILES", path="colormanagement")) / "config.ocio"
    space = getattr(bpy.data, "colorspace", None)  # since Blender 5
    named = next(filter(None, map(os.environ.get, OCIO)), None)
    # Blender 5.3 has the path, and sets OCIO to its own.
    if (used := getattr(space, "ocio_config_path", named)) and Path(used) != own:
        wanted = f"Blender's own configuration ({' and '.join(OCIO)} unset)"
        raise PecsError(f"OpenColorIO: got {used}, wanted {wanted}", ExitCode.UNSUPPORTED)
    if space and space.working_space != WORKING_SPACE:
        where = "Color Management > Working Space"
        raise PecsError(f"{path}: {where}: got {space.working_space}, wanted {WORKING_SPACE}", ExitCode.UNSUPPORTED)
