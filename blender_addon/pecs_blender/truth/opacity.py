# SPDX-License-Identifier: GPL-3.0-or-later
"""Opacity of a material: a number, or an output of a node tree that computes it like the material's own.

Only nodes that determine the opacity are copied (textures of holes and their inputs), not the closures. Closures that
are not listed below are opaque, and so is a group of closures.
"""

from __future__ import annotations

from typing import Any

import bpy

Value = float | bpy.types.NodeSocket

OF_EDITOR = {"label", "parent", "location", "location_absolute", "width", "height", "select", "hide"}
NOT_COPIED = {"rna_type", "name", *OF_EDITOR}


def surface(material: bpy.types.Material) -> bpy.types.NodeSocket | float:
    """The surface input of its output node; 0 with only a volume, 1 without nodes."""
    if not (material.use_nodes and material.node_tree):
        return 1.0
    output = material.node_tree.get_output_node("CYCLES") or material.node_tree.get_output_node("ALL")
    if not output:
        return 1.0
    if output.inputs["Surface"].is_linked:
        return output.inputs["Surface"]
    return 0.0 if output.inputs["Volume"].is_linked else 1.0


class Tree:
    """A node tree to which the computation of opacities is added."""

    def __init__(self, tree: bpy.types.NodeTree):
        self._tree, self._copies = tree, {}

    def opacity(self, closure: bpy.types.NodeSocket) -> Value:
        """closure: an input."""
        node = _source(closure)
        kind = node.node.bl_idname if node else ""
        if kind == "ShaderNodeBsdfTransparent":
            return 0.0
        if kind == "ShaderNodeBsdfPrincipled":
            return self._value(node.node.inputs["Alpha"])
        if kind == "ShaderNodeMixShader":
            share, one, other = node.node.inputs
            first, second = self.opacity(one), self.opacity(other)
            return self.math(
                "ADD", first, self.math("MULTIPLY", self._value(share), self.math("SUBTRACT", second, first))
            )
        if kind == "ShaderNodeAddShader":  # transparencies add up
            return self.math("SUBTRACT", self.math("ADD", *map(self.opacity, node.node.inputs)), 1.0)
        return 1.0

    def math(self, operation: str, *values: Value) -> Value:
        """A Math node; of numbers, a number."""
        if all(isinstance(value, float) for value in values):
            return NUMBERS[operation](*values)
        node = self._tree.nodes.new("ShaderNodeMath")
        node.operation = operation
        for socket, value in zip(node.inputs, values, strict=False):
            if isinstance(value, float):
                socket.default_value = value
            else:
                self._tree.links.new(value, socket)
        return node.outputs[0]

    def _value(self, socket: bpy.types.NodeSocket) -> Value:
        """Value of an input in a material."""
        source = _source(socket)
        return self._copy(source) if source else float(socket.default_value)

    def _copy(self, output: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        """The same output on a copy of its node and all nodes before it."""
        node = output.node
        if node not in self._copies:
            copy = self._copies[node] = self._tree.nodes.new(node.bl_idname)
            _assign(copy, node)
            for socket, own in zip(copy.inputs, node.inputs, strict=True):
                if source := _source(own):
                    self._tree.links.new(self._copy(source), socket)
                elif hasattr(own, "default_value"):
                    socket.default_value = own.default_value
        return self._copies[node].outputs[list(node.outputs).index(output)]


NUMBERS = {
    "ADD": lambda a, b: a + b,
    "SUBTRACT": lambda a, b: a - b,
    "MULTIPLY": lambda a, b: a * b,
    "MAXIMUM": max,
    "LESS_THAN": lambda a, b: float(a < b),
}


def _source(socket: bpy.types.NodeSocket) -> bpy.types.NodeSocket | None:
    """The output that feeds an input."""
    if not socket.is_linked or socket.links[0].is_muted:
        return None
    source = socket.links[0].from_socket
    return _source(source.node.inputs[0]) if source.node.bl_idname == "NodeReroute" else source


def _assign(to: Any, source: Any) -> None:
    """Copies all properties, also of curves and ramps."""
    for p in source.bl_rna.properties:
        if p.identifier in NOT_COPIED:
            continue
        value = getattr(source, p.identifier)
        if p.type == "POINTER" and p.is_readonly:
            if value is not None and not isinstance(value, bpy.types.ID):
                _assign(getattr(to, p.identifier), value)
        elif p.type == "COLLECTION":
            if p.identifier in ("elements", "points", "curves"):
                _assign_all(getattr(to, p.identifier), value)
        elif not p.is_readonly:
            setattr(to, p.identifier, value)


def _assign_all(to: Any, source: Any) -> None:
    for k, item in enumerate(source):
        if k == len(to):
            to.new(*((item.position,) if hasattr(item, "position") else item.location))
        _assign(to[k], item)
