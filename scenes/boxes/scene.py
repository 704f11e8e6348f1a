# SPDX-License-Identifier: GPL-3.0-or-later
"""Boxes with grey patterns that fly and tumble in front of a wall with another one. The light is parallel and has no
shadows, and surfaces also glow a little in place of ambient light; so all changes of light come from motion, and the
noise of the renderer from edges alone.

World: x right, y away from the camera, z up, metres; the camera's entrance pupil is the origin and looks along +y.
"""

import math
from random import Random

import bpy
from pecs_blender.scene.build import SceneParts, box, mesh_object, sun_lamp

WALL_M, HALF_WALL_M = 3.0, 6.0
TOWARDS_LIGHT = 0.3, -1.0, 0.4
AMBIENT = 0.2  # of a surface that faces the light
GREYS = (0.04, 0.1, 0.2, 0.4, 0.8)


def build(p):
    """p: resolved parameters of scene.json, spectra loaded. Returns SceneParts."""
    rng = Random(int(p["texture_seed"]))
    light = sun_lamp(TOWARDS_LIGHT, math.pi, p["sun_spectrum"])
    light.angle = 0.0
    light.use_shadow = False

    half = HALF_WALL_M
    corners = [(x, WALL_M, z) for x, z in ((-half, -half), (half, -half), (half, half), (-half, half))]
    mesh_object("wall", corners, [(0, 1, 2, 3)], [pattern("wall", 4.0, 8.0, rng)])["pecs_class"] = "wall"
    movers = [flying(k, p["speed"], rng) for k in range(int(p["boxes"]))]

    def pose(t_s):
        for move in movers:
            move(t_s)

    return SceneParts(
        pose=pose,
        target=((0.0, WALL_M - 0.001, 0.0), (0.0, -1.0, 0.0)),
        illuminance_lux=p["illuminance_lux"],
        bounces=0,
    )


def pattern(name, low, high, rng):
    """Cells or blobs of some greys, low to high of them a metre."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    kinds = ("TexCoord", "Mapping", "ValToRGB", "BsdfDiffuse", "Emission", "AddShader", "OutputMaterial")
    where, mapping, ramp, lit, glow, both, output = (nodes.new(f"ShaderNode{kind}") for kind in kinds)
    texture = nodes.new(rng.choice(("ShaderNodeTexVoronoi", "ShaderNodeTexVoronoi", "ShaderNodeTexNoise")))
    texture.inputs["Scale"].default_value = rng.uniform(low, high)
    mapping.inputs["Location"].default_value = [rng.uniform(-50, 50) for _ in range(3)]
    ramp.color_ramp.interpolation = "CONSTANT"
    greys = rng.sample(GREYS, 4)
    for place, grey in zip((0.0, 0.42, 0.5, 0.58), greys, strict=True):
        known = {0.0: ramp.color_ramp.elements[0]}
        element = known.get(place) or ramp.color_ramp.elements.new(place)
        element.color = (grey, grey, grey, 1.0)
    ramp.color_ramp.elements.remove(ramp.color_ramp.elements[-1])  # the white one at 1
    links.new(where.outputs["Object"], mapping.inputs["Vector"])
    links.new(mapping.outputs["Vector"], texture.inputs["Vector"])
    links.new(texture.outputs["Color"], ramp.inputs["Fac"])
    glow.inputs["Strength"].default_value = AMBIENT
    for k, shader in enumerate((lit, glow)):
        links.new(ramp.outputs["Color"], shader.inputs["Color"])
        links.new(shader.outputs[0], both.inputs[k])
    links.new(both.outputs[0], output.inputs["Surface"])
    return material


def flying(index, speed, rng):
    half = [rng.uniform(0.08, 0.25) for _ in range(3)]
    thing = box(f"box {index}", *((-h, h) for h in half), pattern(f"box {index}", 6.0, 15.0, rng))
    thing["pecs_class"] = "box"
    centre = rng.uniform(-0.7, 0.7), rng.uniform(1.6, 2.5), rng.uniform(-0.5, 0.5)
    reach = [rng.uniform(0.0, 0.4), rng.uniform(0.0, 0.1), rng.uniform(0.0, 0.4)]
    rates = [rng.uniform(2.0, 6.0) for _ in range(3)]
    phases = [rng.uniform(0, 2 * math.pi) for _ in range(6)]
    spins = [rng.gauss(0, 1.0), rng.gauss(0, 3.0), rng.gauss(0, 1.0)]  # mostly about the line of sight

    def move(t_s):
        s = speed * t_s
        thing.location = [c + r * math.sin(w * s + f) for c, r, w, f in zip(centre, reach, rates, phases, strict=False)]
        thing.rotation_euler = [w * s + f for w, f in zip(spins, phases[3:], strict=True)]

    return move
