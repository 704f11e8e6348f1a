# SPDX-License-Identifier: GPL-3.0-or-later
"""Ground truth: layers of a stack (docs/reference/exr_stack.md), one file each, and surveys. Imports spectral, scene
and camera.

To add a layer:

1. Write NAME.py with a class Name(Layer), see ../output.py. Its constructor takes a HitCache.
2. Add NAME to LAYERS.
3. Add a row to the table of layers in docs/reference/exr_stack.md.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..output import Layer

LAYERS = ("depth", "normal", "motion", "objects")


def layer_class(name: str) -> type[Layer]:
    """Imports bpy."""
    return getattr(import_module(f".{name}", __name__), name.capitalize())
