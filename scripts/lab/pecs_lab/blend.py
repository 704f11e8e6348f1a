"""Parts of Blender files, for benches and tests (with bpy)."""

import math
import sys
from pathlib import Path

import bpy

RED, GREEN, BLUE, GREY = (0.8, 0.2, 0.1, 1), (0.1, 0.7, 0.2, 1), (0.1, 0.2, 0.9, 1), (0.5, 0.5, 0.5, 1)


def start(size=(48, 32), location=(0, -4, 1), tilt_deg=80, focal_mm=50.0):
    """A scene of ten frames with a camera alone, which looks along +y, down if tilt_deg is below 90."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.frame_end = 10
    scene.camera = put(bpy.data.cameras.new("camera"), location, (tilt_deg, 0, 0))
    scene.camera.data.lens = focal_mm
    return scene


def put(data, location=(0, 0, 0), rotation_deg=(0, 0, 0), name=None):
    thing = bpy.data.objects.new(name or data.name, data)
    thing.location, thing.rotation_euler = location, [math.radians(a) for a in rotation_deg]
    bpy.context.scene.collection.objects.link(thing)
    return thing


def lamp(kind="POINT", colour=(1, 0.8, 0.6), energy=200, location=(1.5, -2, 3)):
    light = bpy.data.lights.new("lamp", kind)
    light.color, light.energy = colour, energy
    put(light, location)
    return light


def world(name, colour=None, strength=None):
    """Of the scene; returns its node tree."""
    made = bpy.context.scene.world = bpy.data.worlds.new(name)
    made.use_nodes = True
    for key, value in (("Color", colour), ("Strength", strength)):
        if value is not None:
            made.node_tree.nodes["Background"].inputs[key].default_value = value
    return made.node_tree


def material(name, *closures, end="Surface"):
    """A surface, or a volume, of the sum of closures: (type, {socket: value})."""
    m = bpy.data.materials.new(name)
    m.use_nodes = True
    tree = m.node_tree
    tree.nodes.clear()
    out = tree.nodes.new("ShaderNodeOutputMaterial")
    total = None
    for kind, values in closures:
        node = tree.nodes.new(kind)
        for key, value in values.items():
            node.inputs[key].default_value = value
        if total is None:
            total = node
        else:
            add = tree.nodes.new("ShaderNodeAddShader")
            tree.links.new(total.outputs[0], add.inputs[0])
            tree.links.new(node.outputs[0], add.inputs[1])
            total = add
    if total:
        tree.links.new(total.outputs[0], out.inputs[end])
    return m, tree, out


def _made(m):
    if m:
        bpy.context.object.data.materials.append(m)
    return bpy.context.object


def ball(m=None, location=(0, 0, 0.6), radius=0.6, segments=24, smooth=False):
    bpy.ops.mesh.primitive_uv_sphere_add(location=location, radius=radius, segments=segments, ring_count=segments // 2)
    mesh = bpy.context.object.data
    mesh.polygons.foreach_set("use_smooth", [smooth] * len(mesh.polygons))
    return _made(m)


def floor(m=None, size=8, location=(0, 0, 0), rotation_deg=(0, 0, 0)):
    bpy.ops.mesh.primitive_plane_add(size=size, location=location, rotation=[math.radians(a) for a in rotation_deg])
    return _made(m)


def box(m=None, location=(0, 0, 0), size=2):
    bpy.ops.mesh.primitive_cube_add(location=location, size=size)
    return _made(m)


def curves(thing):
    """Those of a block's or a bone's animation."""
    animation = getattr(thing, "animation_data", None) or thing.id_data.animation_data
    strips = [strip for layer in animation.action.layers for strip in layer.strips]
    return [curve for strip in strips for bag in strip.channelbags for curve in bag.fcurves]


def move(thing, path, values, frames=(1, 2)):
    """Keyframes with straight lines between and beyond."""
    for frame, value in zip(frames, values, strict=True):
        setattr(thing, path, value)
        thing.keyframe_insert(path, frame=frame)
    for curve in curves(thing):
        curve.extrapolation = "LINEAR"
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    bpy.context.scene.frame_set(frames[0])


def geometry_nodes(holder):
    """A group of geometry nodes on an object, its input and its output."""
    group = bpy.data.node_groups.new("nodes", "GeometryNodeTree")
    for in_out in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Geometry", in_out=in_out, socket_type="NodeSocketGeometry")
    holder.modifiers.new("nodes", "NODES").node_group = group
    return group, group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")


def instance_on_points(holder, what):
    """Geometry nodes that put an object on each of the holder's points."""
    group, enter, leave = geometry_nodes(holder)
    on_points, info = group.nodes.new("GeometryNodeInstanceOnPoints"), group.nodes.new("GeometryNodeObjectInfo")
    info.inputs["Object"].default_value = what
    group.links.new(enter.outputs[0], on_points.inputs["Points"])
    group.links.new(info.outputs["Geometry"], on_points.inputs["Instance"])
    group.links.new(on_points.outputs["Instances"], leave.inputs[0])


def save(folder, name):
    Path(folder).mkdir(parents=True, exist_ok=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(Path(folder).absolute() / f"{name}.blend"))


def write(scenes):
    """The command line FOLDER [NAME...]: each scene or those, functions that make one, as a .blend file."""
    folder, *names = sys.argv[1:]
    for make in scenes:
        if not names or make.__name__ in names:
            make()
            save(folder, make.__name__)
