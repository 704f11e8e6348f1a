# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts that scenes are built from, each with its spectrum. Lengths in metres."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import bpy

from ..core.spectra import Spectrum

Vec = tuple[float, float, float]


@dataclass
class Material:
    material: bpy.types.Material
    spectrum: Spectrum

    def set_pass(self, rgb) -> None:
        self.material.node_tree.nodes["pecs"].inputs["Color"].default_value = (*rgb, 1.0)


@dataclass
class Lamp:
    light: bpy.types.Light
    spectrum: Spectrum

    def set_pass(self, rgb) -> None:
        self.light.color = rgb


@dataclass
class SceneParts:
    """What the renderer needs of a scene. pose(t_s) moves everything to an instant; target is a point and its normal
    where `illuminance_lux` is meant; period_s is None for a scene that does not repeat."""

    materials: list[Material]
    lamps: list[Lamp]
    pose: Callable[[float], None]
    period_s: float | None
    target: tuple[Vec, Vec]
    illuminance_lux: float


def diffuse(name: str, reflectance: Spectrum) -> Material:
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    bsdf = nodes.new("ShaderNodeBsdfDiffuse")
    bsdf.name = "pecs"
    output = nodes.new("ShaderNodeOutputMaterial")
    material.node_tree.links.new(bsdf.outputs[0], output.inputs["Surface"])
    return Material(material, reflectance)


def mesh_object(name: str, vertices: list[Vec], faces: list[tuple[int, ...]], materials: list) -> bpy.types.Object:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, [], faces)
    for material in materials:
        mesh.materials.append(material)
    thing = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def box(name: str, x_m, y_m, z_m, material: Material) -> bpy.types.Object:
    """A closed box, seen from inside."""
    corners = [(x, y, z) for z in z_m for y in y_m for x in x_m]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return mesh_object(name, corners, faces, [material.material])


def area_lamp(name: str, centre: Vec, size_m: tuple[float, float], spectrum: Spectrum) -> Lamp:
    """A rectangle that shines down (-z) with radiance 1 times its spectrum."""
    light = bpy.data.lights.new(name, "AREA")
    light.shape = "RECTANGLE"
    light.size, light.size_y = size_m
    light.energy = math.pi * size_m[0] * size_m[1]  # Blender: radiance = energy / (pi * area)
    thing = bpy.data.objects.new(name, light)
    thing.location = centre
    bpy.context.scene.collection.objects.link(thing)
    return Lamp(light, spectrum)
