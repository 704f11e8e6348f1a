# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials of scene folders: plain ones, and procedural textures of the object's own metres."""

from .build import material_of


class Paint:
    """Materials by what they look like, each made once; textures are shifted by the seed."""

    def __init__(self, rng):
        self._rng, self._made = rng, {}

    def plain(self, rgb, roughness=0.5):
        return self._get(("plain", rgb, roughness), lambda nodes, links: rgb, roughness)

    def glass(self):
        return self._get("glass", lambda nodes, links: (0.02, 0.025, 0.03), 0.1)

    def noise(self, name, dark, light, scales, roughness=0.8, contrast=0.25):
        """Noise of several scales [1/m], multiplied, between two colours."""

        def colour(nodes, links):
            value = None
            for scale in scales:
                texture = self._texture(nodes, links, "ShaderNodeTexNoise", scale)
                texture.inputs["Detail"].default_value = 6.0
                factor = texture.outputs["Fac"]
                value = math_node(nodes, links, "ADD", value, factor) if value else factor
            mean = math_node(nodes, links, "DIVIDE", value, float(len(scales)))
            return ramp(nodes, links, mean, 0.5 - contrast / 2, 0.5 + contrast / 2, dark, light)

        return self._get((name, dark, light), colour, roughness)

    def bricks(self, name, one, other, mortar, size_m, gap_m=0.012, level=False):
        """Courses of bricks on upright walls, or slabs on what is level."""

        def colour(nodes, links):
            bricks = self._texture(nodes, links, "ShaderNodeTexBrick", 1.0, upright=not level)
            for key, value in (("Color1", one), ("Color2", other), ("Mortar", mortar)):
                bricks.inputs[key].default_value = (*value, 1.0)
            for key, value in (("Brick Width", size_m[0]), ("Row Height", size_m[1]), ("Mortar Size", gap_m)):
                bricks.inputs[key].default_value = value
            grain = self._texture(nodes, links, "ShaderNodeTexNoise", 1.7)
            grain.inputs["Detail"].default_value = 8.0
            shade = ramp(nodes, links, grain.outputs["Fac"], 0.3, 0.7, (0.65, 0.65, 0.65), (1.0, 1.0, 1.0))
            mix = nodes.new("ShaderNodeMixRGB")
            mix.blend_type = "MULTIPLY"
            mix.inputs["Fac"].default_value = 1.0
            links.new(bricks.outputs["Color"], mix.inputs["Color1"])
            links.new(shade, mix.inputs["Color2"])
            return mix.outputs["Color"]

        return self._get((name, one, other), colour, 0.85)

    def _texture(self, nodes, links, kind, scale, upright=False):
        """A texture of the object's own metres. upright: (x + y, z), for walls along x or y."""
        where, mapping, texture = nodes.new("ShaderNodeTexCoord"), nodes.new("ShaderNodeMapping"), nodes.new(kind)
        links.new(where.outputs["Object"], mapping.inputs["Vector"])
        mapping.inputs["Location"].default_value = [self._rng.uniform(-50, 50) for _ in range(3)]
        source = mapping.outputs["Vector"]
        if upright:
            parts, joined = nodes.new("ShaderNodeSeparateXYZ"), nodes.new("ShaderNodeCombineXYZ")
            links.new(source, parts.inputs[0])
            links.new(math_node(nodes, links, "ADD", parts.outputs["X"], parts.outputs["Y"]), joined.inputs["X"])
            links.new(parts.outputs["Z"], joined.inputs["Y"])
            source = joined.outputs[0]
        links.new(source, texture.inputs["Vector"])
        texture.inputs["Scale"].default_value = scale
        return texture

    def _get(self, key, colour, roughness):
        if key not in self._made:
            material, shader = material_of(str(key if isinstance(key, str) else key[0]), "ShaderNodeBsdfPrincipled")
            self._made[key] = material
            nodes, links = material.node_tree.nodes, material.node_tree.links
            shader.inputs["Roughness"].default_value = roughness
            found = colour(nodes, links)
            if isinstance(found, tuple):
                shader.inputs["Base Color"].default_value = (*found, 1.0)
            else:
                links.new(found, shader.inputs["Base Color"])
        return self._made[key]


def math_node(nodes, links, operation, a, b):
    node = nodes.new("ShaderNodeMath")
    node.operation = operation
    for socket, value in zip(node.inputs, (a, b), strict=False):
        if isinstance(value, (int, float)):
            socket.default_value = value
        else:
            links.new(value, socket)
    return node.outputs[0]


def ramp(nodes, links, value, low, high, dark, light):
    node = nodes.new("ShaderNodeValToRGB")
    for element, at, rgb in zip(node.color_ramp.elements, (low, high), (dark, light), strict=True):
        element.position, element.color = at, (*rgb, 1.0)
    links.new(value, node.inputs["Fac"])
    return node.outputs["Color"]
