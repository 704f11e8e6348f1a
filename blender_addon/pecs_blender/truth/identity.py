# SPDX-License-Identifier: GPL-3.0-or-later
"""Identifies instances and polygons in a picture: one material for all surfaces writes Object Info's Random (which
differs between instances), the polygon's number and the normal into AOVs.

The numbers are an attribute of the evaluated meshes in a render's depsgraph; the file and the materials of the light
are unchanged."""

from __future__ import annotations

from contextlib import contextmanager

import bpy
import numpy as np

from . import opacity
from .mesh_points import values_of

INSTANCE, POLYGON, NORMAL, OPENING = "pecs_instance", "pecs_polygon", "pecs_normal", "pecs_opening"
CLEAR = 1  # OPENING of materials that are nowhere opaque
MAX_POLYGONS = 1 << 24  # numbers are exact in float32


def name_id(name: str) -> int:
    """Cycles' Random of an object that is not an instance (util/hash.h: string hash, then Jenkins' lookup3)."""
    key = 0
    for byte in name.encode():
        key = key * 37 + (byte if byte < 128 else byte - 256)
    mask = 0xFFFFFFFF
    start = (0xDEADBEEF + (2 << 2) + 13) & mask
    state = {"a": (start + key) & mask, "b": start, "c": start}
    for of, by, turn in zip("cabcabc", "bcabcab", (14, 11, 25, 16, 4, 14, 24), strict=True):
        other = state[by]
        state[of] = ((state[of] ^ other) - ((other << turn) | (other >> (32 - turn)))) & mask
    return state["c"]


class Identity:
    """The material of all surfaces. It writes instance and polygon, and is transparent where the polygon's own material
    is less than half opaque, or the view layer's instead of it."""

    def __init__(self, override: bpy.types.Material | None) -> None:
        self._override = override
        self.material = bpy.data.materials.new("pecs surfaces")
        self.material.use_nodes = True
        self.material.node_tree.nodes.clear()
        tree = opacity.Tree(self.material.node_tree)
        self._numbers: dict[bpy.types.Material, int] = {}  # of materials with holes, and of clear ones
        which = self._attribute(OPENING)
        through = tree.math("COMPARE", which, float(CLEAR), 0.5)
        for material in list(bpy.data.materials):
            closure = opacity.surface(material)
            opaque = closure if isinstance(closure, float) else tree.opacity(closure)
            if not isinstance(opaque, float):
                number = self._numbers[material] = CLEAR + 1 + len(self._numbers)
                hole = tree.math("LESS_THAN", opaque, 0.5)
                here = tree.math("COMPARE", which, float(number), 0.5)
                through = tree.math("MAXIMUM", through, tree.math("MULTIPLY", hole, here))
            elif opaque < 0.5:
                self._numbers[material] = CLEAR
        self._connect(tree, through)

    def _attribute(self, name: str) -> bpy.types.NodeSocket:
        node = self.material.node_tree.nodes.new("ShaderNodeAttribute")
        node.attribute_name = name
        return node.outputs["Fac"]

    def _connect(self, tree: opacity.Tree, through: bpy.types.NodeSocket) -> None:
        nodes, links = self.material.node_tree.nodes, self.material.node_tree.links
        black, hole, mix, output, instance = (
            nodes.new(f"ShaderNode{kind}")
            for kind in ("BsdfDiffuse", "BsdfTransparent", "MixShader", "OutputMaterial", "ObjectInfo")
        )
        black.inputs["Color"].default_value = (0.0, 0.0, 0.0, 1.0)  # emission would turn every polygon into a lamp
        for source, target in zip((through, black.outputs[0], hole.outputs[0]), mix.inputs, strict=True):
            links.new(source, target)
        links.new(mix.outputs[0], output.inputs["Surface"])
        opaque = tree.math("SUBTRACT", 1.0, through)
        for name, value in ((INSTANCE, instance.outputs["Random"]), (POLYGON, self._attribute(POLYGON))):
            node = nodes.new("ShaderNodeOutputAOV")
            node.aov_name = name
            links.new(tree.math("MULTIPLY", value, opaque), node.inputs["Value"])  # AOVs add up along a ray
        geometry, scaled, node = (nodes.new(f"ShaderNode{k}") for k in ("NewGeometry", "VectorMath", "OutputAOV"))
        scaled.operation, node.aov_name = "SCALE", NORMAL
        links.new(geometry.outputs["Normal"], scaled.inputs[0])
        if isinstance(opaque, float):
            scaled.inputs["Scale"].default_value = opaque
        else:
            links.new(opaque, scaled.inputs["Scale"])
        links.new(scaled.outputs[0], node.inputs["Color"])

    @contextmanager
    def on(self, layer: bpy.types.ViewLayer, names: tuple[str, ...] = (INSTANCE, POLYGON)):
        """Applies the material to a view layer and adds these passes; removes both at the end."""
        own, layer.material_override = layer.material_override, self.material
        for name in names:
            aov = layer.aovs.add()
            aov.name, aov.type = name, "COLOR" if name == NORMAL else "VALUE"
        try:
            yield
        finally:
            layer.material_override = own
            for name in names:
                layer.aovs.remove(layer.aovs[name])

    def mark(self, thing: bpy.types.Object) -> None:
        """Adds the attributes of polygon numbers and openings to an evaluated object's mesh."""
        mesh = thing.data
        if not isinstance(mesh, bpy.types.Mesh) or not len(mesh.polygons) or POLYGON in mesh.attributes:
            return
        if len(mesh.polygons) < MAX_POLYGONS:
            _add(mesh, POLYGON, np.arange(1, len(mesh.polygons) + 1))
        own = [slot.material for slot in thing.material_slots] or mesh.materials
        materials = [self._override] if self._override else own
        openings = np.array([self._numbers.get(material and material.original, 0) for material in materials])
        if openings.any():
            slots = values_of(mesh.polygons, "material_index")
            _add(mesh, OPENING, openings[slots.clip(0, len(openings) - 1)])


def _add(mesh: bpy.types.Mesh, name: str, values: np.ndarray) -> None:
    mesh.attributes.new(name, "FLOAT", "FACE").data.foreach_set("value", values.astype(np.float32))
