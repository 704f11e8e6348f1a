# SPDX-License-Identifier: GPL-3.0-or-later
"""A furnished room: walls, a wooden floor (procedural), a picture (image texture), a table with a glass ball and a
globe (vertex colours), a hanging ball, a lamp of another colour. RGB materials and measured ones side by side.

World: x right, y away from the camera, z up, metres; the camera's entrance pupil is the origin and looks along +y.
"""

import math
from random import Random

import bpy
from pecs_blender.scene.build import SceneParts, area_lamp, box, diffuse, material_of, mesh_object

FLOOR_M, BACK_M = -0.8, 2.6


def build(p):
    """p: resolved parameters of scene.json, spectra loaded. Returns SceneParts."""
    shift = 0.01 * (int(p["texture_seed"]) % 10007)  # of the procedural patterns; none in the default picture
    walls = box("room", (-1.6, 1.6), (-0.5, BACK_M), (FLOOR_M, 1.4), diffuse("walls", p["wall_reflectance"]))
    walls["pecs_class"] = "wall"
    area_lamp("ceiling lamp", (0.2, 1.2, 1.38), size_m=(0.8, 0.4), spectrum=p["ceiling_spectrum"])
    area_lamp("floor lamp", (-1.3, 2.0, 0.2), size_m=(0.2, 0.2), spectrum=p["floor_lamp_spectrum"])
    green = area_lamp("green lamp", (1.4, 1.6, 0.6), size_m=(0.15, 0.15), spectrum=p["ceiling_spectrum"])
    del green.data["pecs_spectrum"]
    green.data.color = (0.1, 1.0, 0.2)

    _floor(shift)
    _picture(shift)
    _table()
    globe = _ball("globe", (0.35, 1.7, -0.12), 0.17, _painted(), "globe")
    _paint(globe, shift)
    _ball("glass ball", (-0.15, 1.4, -0.17), 0.12, _glass(), "ball")
    hanging = _ball("hanging ball", (0.0, 1.9, 0.0), 0.1, _plastic("red plastic", (0.7, 0.05, 0.04)), "ball")
    top = (-0.45, 1.9, 1.3)

    movers = [_mover(k, Random(1000 * int(p["texture_seed"]) + k)) for k in range(int(p["movers"]))]
    turn_rad_per_s = 2 * math.pi * p["swing_hz"]

    def pose(t_s):
        angle = 0.35 * math.sin(turn_rad_per_s * t_s)
        hanging.location = (top[0] + 1.1 * math.sin(angle), top[1], top[2] - 1.1 * math.cos(angle))
        globe.rotation_euler = (0.0, 0.0, turn_rad_per_s * t_s)
        for move in movers:
            move(turn_rad_per_s * t_s)

    return SceneParts(
        pose=pose,
        period_s=1 / p["swing_hz"] if p["swing_hz"] else None,
        target=((0.7, BACK_M - 0.02, 0.45), (0.0, -1.0, 0.0)),
        illuminance_lux=p["illuminance_lux"],
        bounces=6,
    )


def _material(name, closure="ShaderNodeBsdfPrincipled"):
    material, shader = material_of(name, closure)
    return material, material.node_tree, shader


def _plastic(name, rgb):
    material, _, shader = _material(name)
    shader.inputs["Base Color"].default_value, shader.inputs["Roughness"].default_value = (*rgb, 1.0), 0.4
    return material


def _glass():
    material, _, shader = _material("glass", "ShaderNodeBsdfGlass")
    shader.inputs["Roughness"].default_value = 0.0
    material["pecs_glass"] = "N-SF11"
    return material


def _mover(index, rng):
    """A striped box that tumbles around an ellipse in front of the back wall, in whole turns of the swing."""
    half = [rng.uniform(0.04, 0.1) for _ in range(3)]
    material, tree, shader = _material(f"stripes {index}")
    where, wave, ramp = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("TexCoord", "TexWave", "ValToRGB"))
    wave.inputs["Scale"].default_value = rng.uniform(4, 12)
    for element in ramp.color_ramp.elements:
        element.color = (*(rng.uniform(0.03, 0.8) for _ in range(3)), 1.0)
    ramp.color_ramp.interpolation = "CONSTANT"
    ramp.color_ramp.elements[1].position = 0.5
    tree.links.new(where.outputs["Object"], wave.inputs["Vector"])
    tree.links.new(wave.outputs["Color"], ramp.inputs["Fac"])
    tree.links.new(ramp.outputs["Color"], shader.inputs["Base Color"])
    thing = box(f"mover {index}", *((-h, h) for h in half), material)
    thing["pecs_class"] = "box"
    centre = (rng.uniform(-0.9, 0.9), rng.uniform(1.9, 2.3), rng.uniform(0.1, 0.8))
    reach = (rng.uniform(0.1, 0.4), rng.uniform(0.0, 0.15), rng.uniform(0.05, 0.3))
    turns = [rng.choice((-2, -1, 1, 2)) for _ in range(3)]
    phases = [rng.uniform(0, 2 * math.pi) for _ in range(3)]

    def move(angle):
        thing.location = [c + r * math.sin(angle + f) for c, r, f in zip(centre, reach, phases, strict=True)]
        thing.rotation_euler = [n * angle + f for n, f in zip(turns, phases, strict=True)]

    return move


def _ball(name, centre, radius_m, material, kind):
    bpy.ops.mesh.primitive_uv_sphere_add(radius=radius_m, location=centre, segments=64, ring_count=32)
    ball = bpy.context.object
    ball.name = name
    ball["pecs_class"] = kind
    ball.data.polygons.foreach_set("use_smooth", [True] * len(ball.data.polygons))
    # The sphere's own normals: Blender's, summed from faces, differ from run to run in the last bits.
    normals = ball.data.attributes.new("custom_normal", "FLOAT_VECTOR", "POINT")
    normals.data.foreach_set("vector", [c for vertex in ball.data.vertices for c in vertex.co.normalized()])
    ball.data.materials.append(material)
    return ball


def _painted():
    material, tree, shader = _material("painted")
    attribute = tree.nodes.new("ShaderNodeAttribute")
    attribute.attribute_name = "paint"
    tree.links.new(attribute.outputs["Color"], shader.inputs["Base Color"])
    return material


def _paint(ball, shift):
    paint = ball.data.color_attributes.new("paint", "FLOAT_COLOR", "POINT")
    for vertex, item in zip(ball.data.vertices, paint.data, strict=True):
        x, y, z = vertex.co.normalized()
        land = math.sin(5 * x + shift) * math.cos(4 * y + shift) + math.sin(6 * z + shift) > 0.2
        item.color = (0.1, 0.35, 0.08, 1.0) if land else (0.03, 0.12, 0.45, 1.0)


def _floor(shift):
    material, tree, shader = _material("wood")
    wave, ramp = tree.nodes.new("ShaderNodeTexWave"), tree.nodes.new("ShaderNodeValToRGB")
    wave.inputs["Scale"].default_value, wave.inputs["Distortion"].default_value = 3.0, 4.0
    wave.inputs["Phase Offset"].default_value = shift
    ramp.color_ramp.elements[0].color = (0.09, 0.04, 0.015, 1.0)
    ramp.color_ramp.elements[1].color = (0.35, 0.18, 0.07, 1.0)
    tree.links.new(wave.outputs["Color"], ramp.inputs["Fac"])
    tree.links.new(ramp.outputs["Color"], shader.inputs["Base Color"])
    z = FLOOR_M + 0.002
    corners = [(-1.6, -0.5, z), (1.6, -0.5, z), (1.6, BACK_M, z), (-1.6, BACK_M, z)]
    mesh_object("floor", corners, [(0, 1, 2, 3)], [material])["pecs_class"] = "floor"


def _picture(shift):
    """Made here: stripes of colour over a gradient."""
    n = 64
    image = bpy.data.images.new("picture", n, n)
    pixels = []
    for row in range(n):
        for column in range(n):
            stripe = (row + column + int(100 * shift)) // 8 % 3
            pixels += [0.9 if stripe == k else 0.15 + 0.6 * row / n for k in range(3)] + [1.0]
    image.pixels = pixels
    image.pack()
    material, tree, shader = _material("picture")
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    tree.links.new(texture.outputs["Color"], shader.inputs["Base Color"])
    y = BACK_M - 0.01
    corners = [(0.35, y, 0.2), (1.05, y, 0.2), (1.05, y, 0.7), (0.35, y, 0.7)]
    frame = mesh_object("picture", corners, [(0, 1, 2, 3)], [material])
    frame["pecs_class"] = "picture"
    layer = frame.data.uv_layers.new()
    for corner, uv in zip(layer.data, ((0, 0), (1, 0), (1, 1), (0, 1)), strict=True):
        corner.uv = uv


def _table():
    material = _plastic("table", (0.5, 0.42, 0.3))
    boxes = [((-0.5, 0.7), (1.2, 2.0), (-0.34, -0.30))]
    boxes += [((x, x + 0.05), (y, y + 0.05), (FLOOR_M, -0.34)) for x in (-0.48, 0.63) for y in (1.22, 1.93)]
    for index, (x_m, y_m, z_m) in enumerate(boxes):
        box(f"table {index}", x_m, y_m, z_m, material)["pecs_class"] = "table"
