"""The scenes of motion.py, as .blend files: `python motion_scenes.py FOLDER [NAME...]` (with bpy). Each lasts 64
Blender frames of 1 ms (`still`: 256); the fastest surface moves about one pixel in a millisecond at 96x54 pixels."""

import math

import bpy
import numpy as np
from pecs_lab import blend
from pecs_lab.blend import box, curves, instance_on_points, material, put

FRAMES = 64
MIRROR = {"Color": (0.9, 0.9, 0.9, 1), "Roughness": 0.0}


def start(sky=0.0):
    scene = blend.start((96, 54), (0, 0, 1), 90, focal_mm=36.0)
    scene.render.fps, scene.render.fps_base = 1000, 1.0
    scene.frame_start, scene.frame_end = 0, FRAMES - 1
    if sky:
        blend.world("sky", strength=sky)
    return scene, scene.camera


def lamp(kind="AREA", location=(0, 0, 4), energy=400.0, size=2.0):
    light = bpy.data.lights.new("lamp", kind)
    light.energy = energy
    if kind == "AREA":
        light.size = size
    return put(light, location)


def picture(name, seed, pixels=512, finest=1, octaves=6):
    """Noise of equal strength in octaves from `finest` texels on, reflectance 0.02 to 0.95."""
    rng = np.random.default_rng(seed)
    total = np.zeros((pixels, pixels))
    for k in range(octaves):
        side = max(2, pixels // (finest << k))
        coarse = rng.uniform(-1, 1, (side, side))
        total += np.kron(coarse, np.ones((pixels // side, pixels // side)))
    low, high = np.percentile(total, (2, 98))
    grey = np.clip(0.05 + 0.85 * (total - low) / (high - low), 0.02, 0.95)
    image = bpy.data.images.new(name, pixels, pixels, float_buffer=True, is_data=True)
    rgba = np.ones((pixels, pixels, 4), np.float32)
    rgba[..., :3] = grey[..., None]
    image.pixels.foreach_set(rgba.ravel())
    image.pack()
    return image


def textured(name, seed, scale=1.0, finest=1):
    m, tree, _ = material(name, ("ShaderNodeBsdfDiffuse", {}))
    image, mapping, uv = (tree.nodes.new(f"ShaderNode{k}") for k in ("TexImage", "Mapping", "TexCoord"))
    image.image = picture(name, seed, finest=finest)
    mapping.inputs["Scale"].default_value = (scale, scale, scale)
    tree.links.new(uv.outputs["UV"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs[0], image.inputs["Vector"])
    tree.links.new(image.outputs["Color"], tree.nodes["Diffuse BSDF"].inputs["Color"])
    return m


def plane(m, location, size, rotation_deg=(90, 0, 0)):
    return blend.floor(m, size, location, rotation_deg)


def ball(m, location, radius):
    return blend.ball(m, location, radius, segments=48, smooth=True)


def moves(thing, path, first, last):
    blend.move(thing, path, (first, last), (0, FRAMES - 1))


def room():
    """Parallax, occlusion, detail down to a pixel; the camera moves and turns."""
    _, camera = start()
    lamp("AREA", (0, 2, 3.9), 300, 3)
    plane(textured("back", 1), (0, 6, 1), 9)
    plane(textured("floor", 2), (0, 3, -0.5), 12, (0, 0, 0))
    box(textured("crate", 3, 0.5), (-0.8, 3.2, 0.4), 0.9)
    box(textured("post", 4, 0.3), (0.9, 2.4, 0.9), 0.35).scale.z = 6
    ball(textured("globe", 5, 0.7), (0.3, 4.0, 1.3), 0.5)
    moves(camera, "location", (-0.5, 0, 1), (0.5, 0.1, 1.05))
    moves(camera, "rotation_euler", (math.radians(90), 0, math.radians(6)), (math.radians(91), 0, math.radians(-6)))


def shadow():
    """A textured board moves one way, the shadow of a bar the other way."""
    start(sky=0.2)
    lamp("SUN", (0, 0, 5), 3.0).rotation_euler = (math.radians(50), 0, 0)
    wall = plane(textured("wall", 6), (0, 4, 1), 8)
    moves(wall, "location", (-0.6, 4, 1), (0.6, 4, 1))
    bar = box(material("bar", ("ShaderNodeBsdfDiffuse", {}))[0], (0, 1.5, 3.6), 0.4)  # out of sight
    moves(bar, "location", (1.2, 1.5, 3.6), (-1.2, 1.5, 3.6))


def mirror():
    """A mirror ball in a textured room; the camera passes it."""
    _, camera = start(sky=0.3)
    lamp("AREA", (0, 2, 3.9), 300, 3)
    plane(textured("back", 1), (0, 6, 1), 9)
    plane(textured("floor", 2), (0, 3, -0.5), 12, (0, 0, 0))
    ball(material("mirror", ("ShaderNodeBsdfAnisotropic", MIRROR))[0], (0.1, 3, 1), 0.6)
    moves(camera, "location", (-0.5, 0, 1), (0.5, 0, 1))


def glass():
    """A glass ball before a textured wall that moves."""
    start(sky=0.8)
    wall = plane(textured("wall", 7, finest=2), (0, 4, 1), 8)
    moves(wall, "location", (-1.2, 4, 1), (1.2, 4, 1))
    ball(material("glass", ("ShaderNodeBsdfGlass", {"Roughness": 0.0, "IOR": 1.5}))[0], (0.2, 2.5, 1), 0.5)


def flicker():
    """A textured board moves under a lamp that flickers by 60 % at 125 Hz."""
    start(sky=0.1)
    light = lamp("AREA", (0, 1, 3.5), 200, 1)
    for frame in range(0, FRAMES + 4, 4):
        light.data.energy = 200 * (1 + 0.6 * math.sin(2 * math.pi * frame / 8 + math.pi / 4))
        light.data.keyframe_insert("energy", frame=frame)
    wall = plane(textured("wall", 8), (0, 4, 1), 8)
    moves(wall, "location", (-1.2, 4, 1), (1.2, 4, 1))


def lamps():
    """A textured board moves under a lamp that is off half of the time and an instanced lamp and a sky that fade."""
    scene, _ = start(sky=0.1)
    for name, at, values in (("switched", -1.5, (300, 0)), ("fading", 1.5, (50, 150))):
        light = lamp("AREA", (at, 1, 3.5), values[0], 1)
        light.data.name = name
        for frame in range(0, FRAMES + 8, 8):
            light.data.energy = values[frame // 8 % 2]
            light.data.keyframe_insert("energy", frame=frame)
        if name == "switched":
            for point in curves(light.data)[0].keyframe_points:
                point.interpolation = "CONSTANT"
        else:
            collection = bpy.data.collections.new("instanced")
            scene.collection.objects.unlink(light)
            collection.objects.link(light)
            instance = put(None, name="instance")
            instance.instance_type, instance.instance_collection = "COLLECTION", collection
    strength = scene.world.node_tree.nodes["Background"].inputs["Strength"]
    for frame, value in ((0, 0.1), (FRAMES, 0.3)):
        strength.default_value = value
        strength.keyframe_insert("default_value", frame=frame)
    wall = plane(textured("wall", 8), (0, 4, 1), 8)
    moves(wall, "location", (-1.2, 4, 1), (1.2, 4, 1))


def character():
    """An arm that bends at its armature, linked copies that spin, and instances of geometry nodes that drift."""
    start(sky=0.4)
    lamp("AREA", (0, 1, 3.9), 250, 3)
    plane(textured("back", 1), (0, 6, 1), 9)
    arm = box(textured("arm", 9, 0.5), (0, 0, 0), 2.0)
    arm.scale = (0.12, 0.12, 0.6)
    bpy.ops.object.transform_apply(location=False, rotation=False, scale=True)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.subdivide(number_cuts=6)
    bpy.ops.object.mode_set(mode="OBJECT")
    bones = put(bpy.data.armatures.new("bones"))
    bpy.context.view_layer.objects.active = bones
    bpy.ops.object.mode_set(mode="EDIT")
    lower, upper = bones.data.edit_bones.new("lower"), bones.data.edit_bones.new("upper")
    lower.head, lower.tail, upper.head, upper.tail = (0, 0, -0.6), (0, 0, 0), (0, 0, 0), (0, 0, 0.6)
    upper.parent = lower
    bpy.ops.object.mode_set(mode="OBJECT")
    for name, inside in (("lower", lambda z: z <= 0), ("upper", lambda z: z > 0)):
        group = arm.vertex_groups.new(name=name)
        group.add([v.index for v in arm.data.vertices if inside(v.co.z)], 1.0, "REPLACE")
    arm.modifiers.new("bend", "ARMATURE").object = bones
    for thing in (arm, bones):
        thing.location = (-0.6, 2.5, 0.9)
    bone = bones.pose.bones["upper"]
    bone.rotation_mode = "XYZ"
    for frame, angle in ((0, -35.0), (FRAMES - 1, 35.0)):
        bone.rotation_euler = (0, 0, math.radians(angle))
        bone.keyframe_insert("rotation_euler", frame=frame)
    dice = box(textured("dice", 10, 0.6), (0.5, 3.0, 0.6), 0.45)
    for k, place in enumerate(((0.5, 3.0, 0.6), (1.1, 3.4, 1.2), (0.4, 3.6, 1.5))):
        copy = put(dice.data, name=f"dice {k}") if k else dice
        copy.location = place
        moves(copy, "rotation_euler", (0.3 * k, 0, 0), (0.3 * k, 0.5, 2.0))
    _drifting(textured("confetti", 11))


def _drifting(material):
    """Small balls on the points of a grid, moved by geometry nodes."""
    small = ball(material, (0, -5, 0), 0.12)
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=2, y_subdivisions=2, size=1.4, location=(0.2, 2.2, 1.0))
    grid = bpy.context.object
    grid.rotation_euler = (math.radians(90), 0, 0)
    instance_on_points(grid, small)
    moves(grid, "location", (0.0, 2.2, 0.7), (0.7, 2.2, 1.1))


def still():
    """Nothing moves until frame 64, then a ball does."""
    start(sky=0.3)
    lamp("AREA", (0, 1, 3.9), 250, 3)
    plane(textured("back", 1), (0, 6, 1), 9)
    thing = ball(textured("globe", 5), (-0.5, 4, 1), 0.4)
    for frame, x in ((0, -0.5), (FRAMES, -0.5), (4 * FRAMES, 1.0)):
        thing.location.x = x
        thing.keyframe_insert("location", frame=frame)
    bpy.context.scene.frame_end = 4 * FRAMES


SCENES = (room, shadow, mirror, glass, flicker, lamps, character, still)


if __name__ == "__main__":
    blend.write(SCENES)
