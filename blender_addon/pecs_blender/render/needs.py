# SPDX-License-Identifier: GPL-3.0-or-later
"""Files and Python that the open .blend requires."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import bpy


def python_drivers() -> Iterator[str]:
    """Drivers beyond Blender's simple expressions."""
    for block in _all_ids():
        for holder in (block, getattr(block, "node_tree", None), getattr(block, "shape_keys", None)):
            for curve in getattr(getattr(holder, "animation_data", None), "drivers", ()):
                driver = curve.driver
                if driver.type == "SCRIPTED" and not driver.is_simple_expression:
                    yield f"{block.name}: {curve.data_path}: Python driver {driver.expression!r}"


def missing_files() -> Iterator[str]:
    for library in bpy.data.libraries:
        if not Path(bpy.path.abspath(library.filepath)).is_file():
            yield f"library {library.filepath}: no such file"
    for image in bpy.data.images:
        if image.source in ("FILE", "SEQUENCE", "MOVIE") and image.users and not image.packed_file:
            if image.filepath and not Path(bpy.path.abspath(image.filepath, library=image.library)).is_file():
                yield f"image {image.name!r}: {image.filepath}: no such file"


def _all_ids():
    for prop in bpy.data.bl_rna.properties:
        if prop.type == "COLLECTION":
            for block in getattr(bpy.data, prop.identifier):
                if isinstance(block, bpy.types.ID):
                    yield block
