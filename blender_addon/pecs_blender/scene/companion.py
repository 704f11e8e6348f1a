# SPDX-License-Identifier: GPL-3.0-or-later
"""A second scene of the same objects, in which Cycles says at each pixel which instance and which polygon it sees.

All surfaces have one material, which writes Object Info's Random (of each instance another) and the polygon's number
into AOVs. The numbers are an attribute that only evaluated meshes of this scene's own depsgraph get: neither the file
nor the light's render has it.
"""

from __future__ import annotations

import bpy
import numpy as np

from . import opacity

INSTANCE, POLYGON, OPENING = "pecs_instance", "pecs_polygon", "pecs_opening"
CLEAR = 1  # an OPENING of materials that are nowhere opaque
MAX_POLYGONS = 1 << 24  # a float32 holds their numbers


def number_polygons(data: bpy.types.ID) -> None:
    """In an evaluated mesh."""
    if isinstance(data, bpy.types.Mesh) and 0 < len(data.polygons) < MAX_POLYGONS and POLYGON not in data.attributes:
        numbers = np.arange(1, len(data.polygons) + 1, dtype=np.float32)
        data.attributes.new(POLYGON, "FLOAT", "FACE").data.foreach_set("value", numbers)


def name_id(name: str) -> int:
    """Cycles' Random of an object that is no instance (util/hash.h: a string's hash, and Jenkins' lookup3 of it)."""
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


def simulated(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """What rigid bodies move, in the scene that simulates them: a companion does not, for two simulations of one
    world crash Blender."""
    bodies = [thing for thing in scene.objects if scene.rigidbody_world and thing.rigid_body]
    return list(dict.fromkeys(thing for body in bodies for thing in (body, *body.children_recursive)))


def make(scene: bpy.types.Scene, size: tuple[int, int], material: Material) -> bpy.types.Scene:
    """The same objects and collections, for Cycles to look at apart from the light."""
    companion = scene.copy()
    companion.world = None
    if companion.rigidbody_world:
        with bpy.context.temp_override(scene=companion):
            bpy.ops.rigidbody.world_remove()
    companion.render.resolution_x, companion.render.resolution_y = size
    companion.render.use_border = False
    settings = {"samples": 1, "max_bounces": 0, "transparent_max_bounces": 1024, "use_denoising": False}
    for key, value in (settings | {"filter_width": 0.01}).items():
        setattr(companion.cycles, key, value)
    layer = companion.view_layers[0]
    for p in layer.bl_rna.properties:
        if p.identifier.startswith("use_pass_"):
            setattr(layer, p.identifier, p.identifier in ("use_pass_position", "use_pass_z"))
    while layer.aovs:
        layer.aovs.remove(layer.aovs[0])
    for name in (INSTANCE, POLYGON):
        layer.aovs.add().name = name
        layer.aovs[-1].type = "VALUE"
    layer.material_override = material.material
    return companion


class Material:
    """Of all surfaces. It says which instance and polygon is hit, and lets through where the polygon's own material is
    less than half opaque."""

    def __init__(self) -> None:
        self.material = bpy.data.materials.new("pecs surfaces")
        self.material.use_nodes = True
        self.material.node_tree.nodes.clear()
        tree = opacity.Tree(self.material.node_tree)
        self._numbers: dict[bpy.types.Material, int] = {}  # of those with holes, and of all that are clear
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

    def _connect(self, opacities: opacity.Tree, through: bpy.types.NodeSocket) -> None:
        tree = self.material.node_tree
        emission, hole, mix, output, instance = (
            tree.nodes.new(f"ShaderNode{kind}")
            for kind in ("Emission", "BsdfTransparent", "MixShader", "OutputMaterial", "ObjectInfo")
        )
        sources = (through, emission.outputs[0], hole.outputs[0])
        for source, target in zip(sources, mix.inputs, strict=True):
            tree.links.new(source, target)
        tree.links.new(mix.outputs[0], output.inputs["Surface"])
        opaque = opacities.math("SUBTRACT", 1.0, through)
        for name, value in ((INSTANCE, instance.outputs["Random"]), (POLYGON, self._attribute(POLYGON))):
            node = tree.nodes.new("ShaderNodeOutputAOV")
            node.aov_name = name
            tree.links.new(opacities.math("MULTIPLY", value, opaque), node.inputs["Value"])  # AOVs add up along a ray

    def mark(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Which polygons of evaluated meshes may let through."""
        for thing in depsgraph.objects:
            if isinstance(thing.data, bpy.types.Mesh):
                slots = (slot.material for slot in thing.material_slots)
                self._open(thing.data, [self._numbers.get(m and m.original, 0) for m in slots])

    @staticmethod
    def _open(mesh: bpy.types.Mesh, numbers: list[int]) -> None:
        if any(numbers) and len(mesh.polygons) and OPENING not in mesh.attributes:
            slots = np.empty(len(mesh.polygons), np.int32)
            mesh.polygons.foreach_get("material_index", slots)
            values = np.array(numbers, np.float32)[slots.clip(0, len(numbers) - 1)]
            mesh.attributes.new(OPENING, "FLOAT", "FACE").data.foreach_set("value", values)
