# SPDX-License-Identifier: GPL-3.0-or-later
"""A picture of all directions (HDRI) as the scene's only sky, of a given illuminance."""

from __future__ import annotations

import math
from pathlib import Path

import bpy
import numpy as np
from pecs._config import Fields
from pecs._errors import PecsNotFoundError, bad_input
from pecs._files import sha256

from ..spectral.emitters import LUMINANCE


class Sky:
    """lux: on a horizontal surface that sees all of it. The sky replaces the scene's world. record: for stack.json."""

    def __init__(self, entry: Fields, scene: bpy.types.Scene):
        file = Path(entry.text("file"))
        self.lux = entry.number("lux", low=1e-6, high=1e7)
        turn_deg = entry.number("turn_deg", low=-360, high=360)
        entry.done()
        if not file.is_file():
            raise PecsNotFoundError(f"{file}: no such file")
        image = _picture(file)
        self._irradiance = _upward(image)
        if not self._irradiance > 0:
            raise bad_input(file, "", "no light above the horizon", "a picture of a sky")
        self.record = {"file": file.name, "sha256": sha256(file), "lux": self.lux, "turn_deg": turn_deg}
        world = scene.world = bpy.data.worlds.new(file.stem)
        world.use_nodes = True
        tree = world.node_tree
        tree.nodes.clear()
        kinds = ("TexCoord", "Mapping", "TexEnvironment", "Background", "OutputWorld")
        where, mapping, texture, self._background, output = (tree.nodes.new(f"ShaderNode{kind}") for kind in kinds)
        mapping.inputs["Rotation"].default_value[2] = math.radians(turn_deg)
        texture.image = image
        tree.links.new(where.outputs["Generated"], mapping.inputs["Vector"])
        tree.links.new(mapping.outputs["Vector"], texture.inputs["Vector"])
        tree.links.new(texture.outputs["Color"], self._background.inputs["Color"])
        tree.links.new(self._background.outputs["Background"], output.inputs["Surface"])

    def shine(self, luminance_per_unit: float) -> None:
        """Sets the strength, for the luminance [cd/m^2] of a rendered 1; 0: dark."""
        light = self._irradiance * luminance_per_unit
        self._background.inputs["Strength"].default_value = self.lux / light if light else 0.0


def _picture(file: Path) -> bpy.types.Image:
    try:
        image = bpy.data.images.load(str(file))
    except RuntimeError as e:
        raise bad_input(file, "", str(e).strip(), "a picture") from None
    if not all(image.size):
        raise bad_input(file, "", "no pixels", "a picture of all directions")
    if image.size[0] != 2 * image.size[1]:
        raise bad_input(file, "size", f"{image.size[0]} x {image.size[1]}", "twice as wide as high (equirectangular)")
    return image


def _upward(image: bpy.types.Image) -> float:
    """The integral of luminance times the cosine over the upper half of the sky, of a picture in linear colours."""
    width, height = image.size
    pixels = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(pixels)
    colours = pixels.reshape(height, width, image.channels)
    if not np.isfinite(colours).all():
        raise bad_input(image.filepath, "pixels", "values that are not finite", "light")
    luminance = colours[..., :3] @ LUMINANCE if image.channels >= 3 else colours[..., 0]
    up = (np.arange(height) + 0.5) / height * math.pi - math.pi / 2  # elevation; row 0 is the lowest
    weights = np.where(up > 0, np.sin(up) * np.cos(up), 0) * (math.pi / height) * (2 * math.pi / width)
    return float((luminance * weights[:, None]).sum())
