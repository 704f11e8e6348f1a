# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials of scene folders: plain ones, and procedural textures of the object's own metres."""

from .build import material_of


class Paint:
    """Materials by what they look like, each made once; textures are shifted by the seed."""

    def __init__(self, rng):
        self._rng, self._made = rng, {}

    def plain(self, rgb, roughness=0.5):
        return self._material("plain", (rgb, roughness), roughness, _constant(rgb))

    def glass(self):
        return self._material("glass", (), 0.1, _constant((0.02, 0.025, 0.03)))

    def noise(self, name, dark, light, scales, roughness=0.8, contrast=0.25):
        """Noise of several scales [1/m], multiplied, between two colours."""

        def paint(tree, base):
            value = None
            for scale in scales:
                texture = self._texture(tree, "ShaderNodeTexNoise", scale)
                texture.inputs["Detail"].default_value = 6.0
                factor = texture.outputs["Fac"]
                value = math_node(tree, "ADD", value, factor) if value else factor
            mean = math_node(tree, "DIVIDE", value, float(len(scales)))
            tree.links.new(ramp(tree, mean, 0.5 - contrast / 2, 0.5 + contrast / 2, dark, light), base)

        return self._material(name, (dark, light), roughness, paint)

    def bricks(self, name, one, other, mortar, size_m, gap_m=0.012, level=False):
        """Courses of bricks on upright walls, or slabs on what is level."""

        def paint(tree, base):
            bricks = self._texture(tree, "ShaderNodeTexBrick", 1.0, upright=not level)
            for key, value in (("Color1", one), ("Color2", other), ("Mortar", mortar)):
                bricks.inputs[key].default_value = (*value, 1.0)
            for key, value in (("Brick Width", size_m[0]), ("Row Height", size_m[1]), ("Mortar Size", gap_m)):
                bricks.inputs[key].default_value = value
            grain = self._texture(tree, "ShaderNodeTexNoise", 1.7)
            grain.inputs["Detail"].default_value = 8.0
            shade = ramp(tree, grain.outputs["Fac"], 0.3, 0.7, (0.65, 0.65, 0.65), (1.0, 1.0, 1.0))
            mix = tree.nodes.new("ShaderNodeMixRGB")
            mix.blend_type = "MULTIPLY"
            mix.inputs["Fac"].default_value = 1.0
            tree.links.new(bricks.outputs["Color"], mix.inputs["Color1"])
            tree.links.new(shade, mix.inputs["Color2"])
            tree.links.new(mix.outputs["Color"], base)

        return self._material(name, (one, other), 0.85, paint)

    def _texture(self, tree, kind, scale, upright=False):
        """A texture of the object's own metres. upright: (x + y, z), for walls along x or y."""
        nodes, links = tree.nodes, tree.links
        where, mapping, texture = nodes.new("ShaderNodeTexCoord"), nodes.new("ShaderNodeMapping"), nodes.new(kind)
        links.new(where.outputs["Object"], mapping.inputs["Vector"])
        mapping.inputs["Location"].default_value = [self._rng.uniform(-50, 50) for _ in range(3)]
        source = mapping.outputs["Vector"]
        if upright:
            parts, joined = nodes.new("ShaderNodeSeparateXYZ"), nodes.new("ShaderNodeCombineXYZ")
            links.new(source, parts.inputs[0])
            links.new(math_node(tree, "ADD", parts.outputs["X"], parts.outputs["Y"]), joined.inputs["X"])
            links.new(parts.outputs["Z"], joined.inputs["Y"])
            source = joined.outputs[0]
        links.new(source, texture.inputs["Vector"])
        texture.inputs["Scale"].default_value = scale
        return texture

    def _material(self, name, look, roughness, paint):
        """The material of this name and look. paint(tree, base) sets or links its base colour, at the first call."""
        key = name, *look
        if key not in self._made:
            material, shader = material_of(name, "ShaderNodeBsdfPrincipled")
            shader.inputs["Roughness"].default_value = roughness
            paint(material.node_tree, shader.inputs["Base Color"])
            self._made[key] = material
        return self._made[key]


def _constant(rgb):
    return lambda tree, base: setattr(base, "default_value", (*rgb, 1.0))


def math_node(tree, operation, a, b):
    node = tree.nodes.new("ShaderNodeMath")
    node.operation = operation
    for socket, value in zip(node.inputs, (a, b), strict=False):
        if isinstance(value, (int, float)):
            socket.default_value = value
        else:
            tree.links.new(value, socket)
    return node.outputs[0]


def ramp(tree, value, low, high, dark, light):
    node = tree.nodes.new("ShaderNodeValToRGB")
    for element, at, rgb in zip(node.color_ramp.elements, (low, high), (dark, light), strict=True):
        element.position, element.color = at, (*rgb, 1.0)
    tree.links.new(value, node.inputs["Fac"])
    return node.outputs["Color"]
