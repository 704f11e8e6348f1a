"""What test files of Blender are built from (with bpy)."""

import math

import bpy

RED, GREEN, BLUE, GREY = (0.8, 0.2, 0.1, 1), (0.1, 0.7, 0.2, 1), (0.1, 0.2, 0.9, 1), (0.5, 0.5, 0.5, 1)


def start():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = 48, 32
    scene.frame_end = 10
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.location, camera.rotation_euler = (0, -4, 1), (math.radians(80), 0, 0)
    scene.collection.objects.link(camera)
    scene.camera = camera
    return scene


def lamp(kind="POINT", colour=(1, 0.8, 0.6), energy=200):
    light = bpy.data.lights.new("lamp", kind)
    light.color, light.energy = colour, energy
    thing = bpy.data.objects.new("lamp", light)
    thing.location = (1.5, -2, 3)
    bpy.context.scene.collection.objects.link(thing)
    return light


def material(name, *closures):
    """A surface of the sum of closures: (type, {socket: value})."""
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
        tree.links.new(total.outputs[0], out.inputs["Surface"])
    return m, tree, out


def ball(m, location=(0, 0, 0.6), radius=0.6):
    bpy.ops.mesh.primitive_uv_sphere_add(location=location, radius=radius, segments=24, ring_count=12)
    thing = bpy.context.object
    if m:
        thing.data.materials.append(m)
    return thing


def floor(m=None):
    bpy.ops.mesh.primitive_plane_add(size=8)
    if m:
        bpy.context.object.data.materials.append(m)
    return bpy.context.object
