# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts of scene folders, each with its spectrum. Lengths in metres."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import bpy
from mathutils import Vector

from ..spectral.spectra import Spectrum

RIM_SEGMENTS = 2048  # sagitta R(1 - cos(pi/2048)) = 0.0004 px at R = 303 px
ROOM_X_M, ROOM_Y_M, ROOM_Z_M = (-1.2, 1.2), (-0.4, 1.8), (-0.9, 0.9)

Vec = tuple[float, float, float]


@dataclass
class SceneParts:
    """Result of build() in scene.py. pose(t_s) moves everything to an instant; target is the point and normal at which
    `illuminance_lux` is defined; period_s is None for a scene that does not repeat. lamps: those whose
    strength (`energy`) pose changes."""

    pose: Callable[[float], None]
    target: tuple[Vec, Vec]
    illuminance_lux: float
    period_s: float | None = None
    bounces: int = 2
    lamps: tuple[bpy.types.Light, ...] = ()


def material_of(name: str, kind: str) -> tuple[bpy.types.Material, bpy.types.ShaderNode]:
    """A material of one shader node of this type, and that node."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    shader, output = nodes.new(kind), nodes.new("ShaderNodeOutputMaterial")
    material.node_tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return material, shader


def diffuse(name: str, reflectance: Spectrum) -> bpy.types.Material:
    material, bsdf = material_of(name, "ShaderNodeBsdfDiffuse")
    material["pecs_reflectance"] = reflectance.source
    if reflectance.is_constant:
        bsdf.inputs["Color"].default_value = (*[float(reflectance.value[0])] * 3, 1.0)
    return material


def mesh_object(name: str, vertices: list[Vec], faces: list[tuple[int, ...]], materials: list) -> bpy.types.Object:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, [], faces)
    for material in materials:
        mesh.materials.append(material)
    thing = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def box(name: str, x_m, y_m, z_m, material: bpy.types.Material) -> bpy.types.Object:
    """A closed box, to be seen from inside."""
    corners = [(x, y, z) for z in z_m for y in y_m for x in x_m]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return mesh_object(name, corners, faces, [material])


def area_lamp(name: str, centre: Vec, size_m: tuple[float, float], spectrum: Spectrum) -> bpy.types.Object:
    """A rectangular lamp of radiance 1, directed down (-z)."""
    light = bpy.data.lights.new(name, "AREA")
    light.shape = "RECTANGLE"
    light.size, light.size_y = size_m
    light.energy = math.pi * size_m[0] * size_m[1]  # Blender: radiance = energy / (pi * area)
    light["pecs_spectrum"] = spectrum.source
    thing = bpy.data.objects.new(name, light)
    thing.location = centre
    bpy.context.scene.collection.objects.link(thing)
    return thing


def sun_lamp(towards: Vec, energy: float, spectrum: Spectrum) -> bpy.types.Light:
    """Parallel light from this direction, of this relative irradiance."""
    light = bpy.data.lights.new("sun", "SUN")
    light.energy = energy
    light["pecs_spectrum"] = spectrum.source
    thing = bpy.data.objects.new("sun", light)
    thing.rotation_euler = Vector(towards).to_track_quat("Z", "Y").to_euler()
    bpy.context.scene.collection.objects.link(thing)
    return light


def lab_box(p: dict) -> None:
    """The lab of a scene's parameters: a closed grey box with a long lamp directed down; the camera at the origin looks
    along +y."""
    box("room", ROOM_X_M, ROOM_Y_M, ROOM_Z_M, diffuse("walls", p["wall_reflectance"]))
    centre = tuple(p[key] * 1e-3 for key in ("lamp_right_mm", "lamp_distance_mm", "lamp_up_mm"))
    area_lamp("lamp", centre, (p["lamp_length_mm"] * 1e-3, p["lamp_width_mm"] * 1e-3), p["lamp_spectrum"])


def sector_disk(name: str, sectors: int, radius_m: float, materials: list) -> bpy.types.Object:
    """A disk in the x-z plane, seen from -y: sectors of equal angle, the materials in turn, counter-clockwise from +x.

    Inner rings have half the segments, so that triangles stay compact (a fan of slivers renders slowly)."""
    per_sector = 1 << math.ceil(math.log2(RIM_SEGMENTS / sectors))  # rings halve it
    vertices, faces, colours = [(0.0, 0.0, 0.0)], [], []
    n, radius = sectors * per_sector, radius_m
    ring = _ring(vertices, n, radius)
    while n // sectors > 4:
        radius -= 2 * math.pi * radius / n  # as thick as its segments are long
        inner = _ring(vertices, n // 2, radius)
        for i in range(n // 2):
            a, b, c = ring[2 * i], ring[2 * i + 1], ring[(2 * i + 2) % n]
            d, e = inner[i], inner[(i + 1) % (n // 2)]
            faces += [(a, b, d), (b, e, d), (b, c, e)]
            colours += [i // (n // 2 // sectors)] * 3
        ring, n = inner, n // 2
    for i in range(n):
        faces.append((0, ring[i], ring[(i + 1) % n]))
        colours.append(i // (n // sectors))
    disk = mesh_object(name, vertices, faces, materials)
    disk.data.polygons.foreach_set("material_index", [c % len(materials) for c in colours])
    disk.data.update()
    return disk


def _ring(vertices, n, radius_m):
    """Appends n vertices of a circle; returns their indices."""
    first = len(vertices)
    angles = (2 * math.pi * i / n for i in range(n))
    vertices += [(radius_m * math.cos(a), 0.0, radius_m * math.sin(a)) for a in angles]
    return range(first, first + n)
