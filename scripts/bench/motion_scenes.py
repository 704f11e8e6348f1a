"""The scenes of motion.py, as .blend files: `python motion_scenes.py FOLDER [NAME...]` (with bpy). Each lasts 64
Blender frames of 1 ms (`still`: 256); the fastest surface moves about one pixel in a millisecond at 96x54 pixels."""

import math
import sys
from pathlib import Path

import bpy
import numpy as np

FRAMES = 64


def start(sky=0.0):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = 96, 54
    scene.render.fps, scene.render.fps_base = 1000, 1.0
    scene.frame_start, scene.frame_end = 0, FRAMES - 1
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.lens, camera.data.sensor_width = 36.0, 36.0
    camera.location, camera.rotation_euler = (0, 0, 1), (math.radians(90), 0, 0)  # looks along +y
    scene.collection.objects.link(camera)
    scene.camera = camera
    if sky:
        scene.world = bpy.data.worlds.new("sky")
        scene.world.use_nodes = True
        scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = sky
    return scene, camera


def lamp(kind="AREA", location=(0, 0, 4), energy=400.0, size=2.0):
    light = bpy.data.lights.new("lamp", kind)
    light.energy = energy
    if kind == "AREA":
        light.size = size
    thing = bpy.data.objects.new("lamp", light)
    thing.location = location
    bpy.context.scene.collection.objects.link(thing)
    return thing


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
    m = bpy.data.materials.new(name)
    m.use_nodes = True
    tree = m.node_tree
    tree.nodes.clear()
    out, diffuse = tree.nodes.new("ShaderNodeOutputMaterial"), tree.nodes.new("ShaderNodeBsdfDiffuse")
    image, mapping, uv = (tree.nodes.new(f"ShaderNode{k}") for k in ("TexImage", "Mapping", "TexCoord"))
    image.image = picture(name, seed, finest=finest)
    mapping.inputs["Scale"].default_value = (scale, scale, scale)
    for a, b in (
        (uv.outputs["UV"], mapping.inputs["Vector"]),
        (mapping.outputs[0], image.inputs["Vector"]),
        (image.outputs["Color"], diffuse.inputs["Color"]),
        (diffuse.outputs[0], out.inputs["Surface"]),
    ):
        tree.links.new(a, b)
    return m


def plain(name, kind, **values):
    m = bpy.data.materials.new(name)
    m.use_nodes = True
    tree = m.node_tree
    tree.nodes.clear()
    out, node = tree.nodes.new("ShaderNodeOutputMaterial"), tree.nodes.new(kind)
    for key, value in values.items():
        node.inputs[key].default_value = value
    tree.links.new(node.outputs[0], out.inputs["Surface"])
    return m


def plane(m, location, size, rotation_deg=(90, 0, 0)):
    bpy.ops.mesh.primitive_plane_add(size=size, location=location, rotation=[math.radians(a) for a in rotation_deg])
    bpy.context.object.data.materials.append(m)
    return bpy.context.object


def box(m, location, size):
    bpy.ops.mesh.primitive_cube_add(size=size, location=location)
    bpy.context.object.data.materials.append(m)
    return bpy.context.object


def ball(m, location, radius):
    bpy.ops.mesh.primitive_uv_sphere_add(radius=radius, location=location, segments=48, ring_count=24)
    thing = bpy.context.object
    thing.data.polygons.foreach_set("use_smooth", [True] * len(thing.data.polygons))
    thing.data.materials.append(m)
    return thing


def moves(thing, path, first, last):
    """Linear, from the first frame to the last, as text that needs no interpolation settings of the user."""
    for frame, value in ((0, first), (FRAMES - 1, last)):
        setattr(thing, path, value)
        thing.keyframe_insert(path, frame=frame)
    for curve in curves(thing):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
        curve.extrapolation = "LINEAR"


def curves(thing):
    block = thing.animation_data.action
    return block.fcurves if hasattr(block, "fcurves") else block.layers[0].strips[0].channelbags[0].fcurves


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
    bar = box(plain("bar", "ShaderNodeBsdfDiffuse"), (0, 1.5, 3.6), 0.4)  # out of sight
    moves(bar, "location", (1.2, 1.5, 3.6), (-1.2, 1.5, 3.6))


def mirror():
    """A mirror ball in a textured room; the camera passes it."""
    _, camera = start(sky=0.3)
    lamp("AREA", (0, 2, 3.9), 300, 3)
    plane(textured("back", 1), (0, 6, 1), 9)
    plane(textured("floor", 2), (0, 3, -0.5), 12, (0, 0, 0))
    ball(plain("mirror", "ShaderNodeBsdfAnisotropic", Color=(0.9, 0.9, 0.9, 1), Roughness=0.0), (0.1, 3, 1), 0.6)
    moves(camera, "location", (-0.5, 0, 1), (0.5, 0, 1))


def glass():
    """A glass ball before a textured wall that moves."""
    start(sky=0.8)
    wall = plane(textured("wall", 7, finest=2), (0, 4, 1), 8)
    moves(wall, "location", (-1.2, 4, 1), (1.2, 4, 1))
    ball(plain("glass", "ShaderNodeBsdfGlass", Roughness=0.0, IOR=1.5), (0.2, 2.5, 1), 0.5)


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
            instance = bpy.data.objects.new("instance", None)
            instance.instance_type, instance.instance_collection = "COLLECTION", collection
            scene.collection.objects.link(instance)
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
    bones = bpy.data.objects.new("bones", bpy.data.armatures.new("bones"))
    bpy.context.scene.collection.objects.link(bones)
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
        copy = dice if k == 0 else bpy.data.objects.new(f"dice {k}", dice.data)
        if k:
            bpy.context.scene.collection.objects.link(copy)
        copy.location = place
        moves(copy, "rotation_euler", (0.3 * k, 0, 0), (0.3 * k, 0.5, 2.0))
    _drifting(textured("confetti", 11))


def _drifting(material):
    """Small balls on the points of a grid, moved by geometry nodes."""
    small = ball(material, (0, -5, 0), 0.12)
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=2, y_subdivisions=2, size=1.4, location=(0.2, 2.2, 1.0))
    grid = bpy.context.object
    grid.rotation_euler = (math.radians(90), 0, 0)
    tree = bpy.data.node_groups.new("drift", "GeometryNodeTree")
    for in_out in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=in_out, socket_type="NodeSocketGeometry")
    enter, leave = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    points, info = tree.nodes.new("GeometryNodeInstanceOnPoints"), tree.nodes.new("GeometryNodeObjectInfo")
    info.inputs["Object"].default_value = small
    tree.links.new(enter.outputs[0], points.inputs["Points"])
    tree.links.new(info.outputs["Geometry"], points.inputs["Instance"])
    tree.links.new(points.outputs[0], leave.inputs[0])
    grid.modifiers.new("drift", "NODES").node_group = tree
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


def main(folder, *names):
    Path(folder).mkdir(parents=True, exist_ok=True)
    for make in SCENES:
        if not names or make.__name__ in names:
            make()
            bpy.ops.wm.save_as_mainfile(filepath=str(Path(folder).absolute() / f"{make.__name__}.blend"))


if __name__ == "__main__":
    main(*sys.argv[1:])
