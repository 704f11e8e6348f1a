# SPDX-License-Identifier: GPL-3.0-or-later
"""A second scene of the same objects, in which Cycles says at each pixel which instance and which polygon it sees.

All surfaces have one material, which writes Object Info's Random (of each instance another) and the polygon's number
into AOVs. The numbers are an attribute that only evaluated meshes of this scene's own depsgraph get: neither the file
nor the light's render has it.
"""

from __future__ import annotations

import bpy
import numpy as np

INSTANCE, POLYGON, CLEAR = "pecs_instance", "pecs_polygon", "pecs_clear"
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


def make(scene: bpy.types.Scene, size: tuple[int, int]) -> bpy.types.Scene:
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
    layer.material_override = _material()
    return companion


def _material() -> bpy.types.Material:
    """Says which instance and polygon is hit; an object that is CLEAR is not."""
    material = bpy.data.materials.new("pecs surfaces")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    emission, hole, mix, output, clear, instance, polygon = (
        tree.nodes.new(f"ShaderNode{kind}")
        for kind in (
            "Emission",
            "BsdfTransparent",
            "MixShader",
            "OutputMaterial",
            "Attribute",
            "ObjectInfo",
            "Attribute",
        )
    )
    clear.attribute_type, clear.attribute_name, polygon.attribute_name = "OBJECT", CLEAR, POLYGON
    links = [(clear.outputs["Fac"], mix.inputs[0]), (mix.outputs[0], output.inputs["Surface"])]
    links += [(closure.outputs[0], mix.inputs[1 + k]) for k, closure in enumerate((emission, hole))]
    for name, value in ((INSTANCE, instance.outputs["Random"]), (POLYGON, polygon.outputs["Fac"])):
        opaque, product, aov = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("Math", "Math", "OutputAOV"))
        opaque.operation, product.operation, aov.aov_name = "SUBTRACT", "MULTIPLY", name
        links += [(clear.outputs["Fac"], opaque.inputs[1]), (opaque.outputs[0], product.inputs[0])]
        links += [(value, product.inputs[1]), (product.outputs[0], aov.inputs["Value"])]  # AOVs add up along a ray
        opaque.inputs[0].default_value = 1.0
    for source, target in links:
        tree.links.new(source, target)
    return material


def is_clear(material: bpy.types.Material) -> bool:
    """Less than half opaque everywhere, as far as constants say: a volume alone, glassy panes of fog."""
    if not (material.use_nodes and material.node_tree):
        return False
    output = material.node_tree.get_output_node("CYCLES") or material.node_tree.get_output_node("ALL")
    if not output:
        return False
    if not output.inputs["Surface"].is_linked:
        return output.inputs["Volume"].is_linked
    return _opacity(output.inputs["Surface"]) < 0.5


def _opacity(socket: bpy.types.NodeSocket) -> float:
    if not socket.is_linked:
        return 1.0
    node = socket.links[0].from_node
    if node.bl_idname == "ShaderNodeBsdfTransparent":
        return 0.0
    if node.bl_idname == "ShaderNodeMixShader" and not node.inputs[0].is_linked:
        share, (one, other) = node.inputs[0].default_value, map(_opacity, node.inputs[1:])
        return one * (1 - share) + other * share
    if node.bl_idname == "ShaderNodeBsdfPrincipled" and not node.inputs["Alpha"].is_linked:
        return node.inputs["Alpha"].default_value
    return 1.0
