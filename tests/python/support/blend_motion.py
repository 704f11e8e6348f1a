"""Scenes whose motion is known, as .blend files (with bpy): `python blend_motion.py FOLDER [NAME...]`. Frames are
seconds; frame 1 is t = 0. The camera is a pinhole at the origin that looks along +y."""

import math

import bpy
from pecs_lab import blend
from pecs_lab.blend import geometry_nodes, instance_on_points, material, move, put

SIZE = 64, 36


def start(unit_m=1.0):
    scene = blend.start(SIZE, (0, 0, 0), 90, focal_mm=36.0)  # focal length: the picture's width
    scene.render.fps = 1
    scene.unit_settings.scale_length = unit_m
    blend.lamp("POINT", (1, 1, 1), 300, (1, -1, 2))
    return scene


def grid(name, size, n=1, distance=0.0):
    """A square in the x-z plane, seen from -y, of n x n polygons."""
    steps = [(i / n - 0.5) * size for i in range(n + 1)]
    mesh = bpy.data.meshes.new(name)
    corners = [(x, distance, z) for z in steps for x in steps]
    row = n + 1
    mesh.from_pydata(
        corners,
        [],
        [(j * row + i, j * row + i + 1, (j + 1) * row + i + 1, (j + 1) * row + i) for j in range(n) for i in range(n)],
    )
    return mesh


def rigid(unit_m=1.0):
    """A small square at 4 m shifts and comes nearer, another at 5 m turns about its centre; a still wall at 8 m that
    does not fill the picture."""
    start(unit_m)
    m = 1 / unit_m
    put(grid("wall", 7 * m), (0, 8 * m, 0))
    shifts = put(grid("shifts", 1 * m), (-1 * m, 4 * m, 0))
    move(shifts, "location", [(-1 * m, 4 * m, 0), (-0.7 * m, 3.8 * m, 0.1 * m)])
    turns = put(grid("turns", 1.5 * m), (1.2 * m, 5 * m, 0))
    move(turns, "rotation_euler", [(0, 0, 0), (0, 0.3, 0)])


def centimetres():
    rigid(0.01)


def travel():
    """The camera shifts and turns before a near square, a wall and the sky."""
    scene = start()
    put(grid("wall", 4), (0, 8, 0))
    put(grid("near", 0.8), (0.2, 3, 0.1))
    move(scene.camera, "location", [(0, 0, 0), (0.2, 0.1, 0.05)])
    move(scene.camera, "rotation_euler", [(math.pi / 2, 0, 0), (math.pi / 2 + 0.02, 0.01, 0.05)])


def led():
    """As `travel`, with a camera that much else moves: a parent, a constraint, deltas."""
    travel()
    scene = bpy.context.scene
    parent = put(None, (0, -1, 0), name="parent")
    move(parent, "rotation_euler", [(0, 0, 0), (0, 0, 0.5)])
    scene.camera.parent, scene.camera.delta_location = parent, (0.1, 0, 0)
    scene.camera.delta_rotation_euler, scene.camera.scale = (0.1, 0, 0.1), (2, 2, 2)
    scene.camera.constraints.new("TRACK_TO").target = bpy.data.objects["near"]


def instances():
    """Collection instances that move, and geometry-nodes instances on a mesh that moves, one mesh linked twice."""
    start()
    square = grid("square", 0.6)
    collection = bpy.data.collections.new("many")
    collection.objects.link(bpy.data.objects.new("inside", square))
    for i in range(3):
        empty = put(None, (-1.2 + 1.2 * i, 4, 0.7), name=f"empty {i}")
        empty.instance_type, empty.instance_collection = "COLLECTION", collection
        move(empty, "location", [(-1.2 + 1.2 * i, 4, 0.7), (-1.2 + 1.2 * i + 0.1 * (i + 1), 4, 0.7)])
    for i in range(2):
        twin = put(square, (-0.5 + i, 4, 0), name=f"twin {i}")
        move(twin, "location", [(-0.5 + i, 4, 0), (-0.5 + i, 4 + 0.2 * i, -0.05 * i)])
    points = bpy.data.meshes.new("points")
    points.from_pydata([(-1.2, 0, 0), (0, 0, 0), (1.2, 0, 0)], [], [])
    holder = put(points, (0, 4, -0.7), name="holder")
    hidden = put(square, (0, -5, 0), name="hidden")
    hidden.hide_render = True
    instance_on_points(holder, hidden)
    move(holder, "location", [(0, 4, -0.7), (0.15, 4, -0.75)])


def vanishing():
    """The nearer of two squares is hidden from frame 2 on."""
    start()
    put(grid("wall", 4), (0, 8, 0))
    square = put(grid("square", 1), (0, 4, 0))
    for frame in (1, 2):
        square.hide_render = frame == 2
        square.keyframe_insert("hide_render", frame=frame)


def cut():
    """Markers change the camera at frame 2, which has samples of its own."""
    scene = start()
    put(grid("wall", 4), (0, 8, 0))
    put(grid("near", 0.8), (0.2, 3, 0.1))
    other = put(scene.camera.data, (0.5, 0, 0.2), (88, 0, 5), "other")
    for frame, camera in ((1, scene.camera), (2, other)):
        scene.timeline_markers.new(camera.name, frame=frame).camera = camera
    scene.view_layers[0].samples = 3


def uncut():
    """Its second camera alone."""
    cut()
    scene = bpy.context.scene
    scene.camera = bpy.data.objects["other"]
    scene.timeline_markers.clear()
    scene.view_layers[0].samples = 0


def fog():
    """A square that moves behind a box of fog and a clear pane, which move otherwise."""
    start()
    put(grid("wall", 4), (0, 8, 0))
    move(put(grid("square", 1), (0, 4, 0)), "location", [(0, 4, 0), (0.2, 4, 0)])
    for name, distance, kind in (("fog", 2, "VolumeScatter"), ("pane", 1, "BsdfTransparent")):
        mesh = grid(name, 3)
        volume = kind.startswith("Volume")
        mesh.materials.append(material(name, (f"ShaderNode{kind}", {}), end="Volume" if volume else "Surface")[0])
        thing = put(mesh, (0, distance, 0))
        if volume:
            thing.modifiers.new("thick", "SOLIDIFY").thickness = 0.5
        move(thing, "location", [(0, distance, 0), (0.5, distance, 0)])


def holes():
    """A still plate with holes in every other square metre of a checker texture, behind nodes that shift it; through
    them a wall is seen that moves. Its polygons have two materials, one of them a clear one."""
    start()
    wall = put(grid("wall", 12), (0, 8, 0))
    move(wall, "location", [(0, 8, 0), (0.5, 8, 0)])
    plate = put(grid("plate", 4, 2), (0, 4, 0))
    texture, clear = bpy.data.materials.new("holes"), bpy.data.materials.new("clear")
    texture.use_nodes = clear.use_nodes = True
    nodes, links = texture.node_tree.nodes, texture.node_tree.links
    checker, ramp, mapping, place = (
        nodes.new(f"ShaderNode{k}") for k in ("TexChecker", "ValToRGB", "Mapping", "TexCoord")
    )
    reroute = nodes.new("NodeReroute")
    checker.inputs["Scale"].default_value = 1.0  # a square metre each
    mapping.inputs["Location"].default_value = (0, 0.5, 0)  # away from the edges between squares
    ramp.color_ramp.elements[0].color, ramp.color_ramp.elements[1].color = (1, 1, 1, 1), (0, 0, 0, 1)  # the other way
    ramp.color_ramp.elements.new(0.4).color = (1, 1, 1, 1)
    links.new(place.outputs["Object"], mapping.inputs["Vector"])
    links.new(mapping.outputs["Vector"], checker.inputs["Vector"])
    links.new(checker.outputs["Fac"], ramp.inputs["Fac"])
    links.new(ramp.outputs["Color"], reroute.inputs[0])
    links.new(reroute.outputs[0], nodes["Principled BSDF"].inputs["Alpha"])
    clear.node_tree.nodes["Principled BSDF"].inputs["Alpha"].default_value = 0.2
    for one in (texture, clear):
        plate.data.materials.append(one)
    plate.data.polygons[3].material_index = 1  # at the upper right


def clay():
    holes()
    bpy.context.view_layer.material_override = bpy.data.materials.new("clay")


def falling():
    """A rigid body, and nearer a thing that simulation nodes move; neither is baked."""
    scene = start()
    scene.render.fps = 24
    body = put(grid("body", 0.5), (0, 4, 0.5))
    floor = put(grid("floor", 1), (0, 4, -3))
    for thing, kind in ((body, "ACTIVE"), (floor, "PASSIVE")):
        bpy.context.view_layer.objects.active = thing
        bpy.ops.rigidbody.object_add(type=kind)
        thing.rigid_body.collision_shape = "BOX"
    put(grid("child", 0.3), (0.6, 0, 0)).parent = body
    group, enter, leave = geometry_nodes(put(grid("played", 0.2), (-0.8, 2, -0.4)))
    begin, moved, end = (
        group.nodes.new(f"GeometryNode{k}") for k in ("SimulationInput", "SetPosition", "SimulationOutput")
    )
    begin.pair_with_output(end)
    moved.inputs["Offset"].default_value = 0.02, 0, 0
    group.links.new(enter.outputs[0], begin.inputs[0])
    group.links.new(begin.outputs[1], moved.inputs[0])
    group.links.new(moved.outputs[0], end.inputs[1])
    group.links.new(end.outputs[0], leave.inputs[0])
    scene.frame_set(1)


def deforming():
    """From left to right: an armature turns a mesh; a shape key shears one, on an object that moves, below a
    subdivision; a modifier gives one more polygons from frame to frame."""
    scene = start()
    put(grid("wall", 12), (0, 8, 0))
    turned = put(grid("turned", 0.9, 4), (-1.2, 4, 0))
    armature = bpy.data.armatures.new("armature")
    bones = put(armature, (-1.2, 4, 0))
    bpy.context.view_layer.objects.active = bones
    bpy.ops.object.mode_set(mode="EDIT")
    armature.edit_bones.new("bone").tail = (0, 0.5, 0)
    bpy.ops.object.mode_set(mode="OBJECT")
    turned.vertex_groups.new(name="bone").add(range(len(turned.data.vertices)), 1, "REPLACE")
    turned.modifiers.new("armature", "ARMATURE").object = bones
    bone = bones.pose.bones["bone"]
    bone.rotation_mode = "XYZ"
    move(bone, "rotation_euler", [(0, 0, 0), (0, 0.3, 0)])  # about the bone, which points along y

    sheared = put(grid("sheared", 0.9, 3), (0, 4, 0))
    sheared.shape_key_add(name="rest")
    key = sheared.shape_key_add(name="shear")
    for point in key.data:
        point.co.x, point.co.z = point.co.x + 0.3 * point.co.z, point.co.z * 1.2
    subdivision = sheared.modifiers.new("subdivision", "SUBSURF")
    subdivision.subdivision_type, subdivision.render_levels, subdivision.levels = "SIMPLE", 2, 0
    move(key, "value", [0.0, 1.0])
    move(sheared, "location", [(0, 4, 0), (0.1, 4, 0)])

    grows = put(grid("grows", 0.5), (1.1, 4, 0)).modifiers.new("array", "ARRAY")
    for frame, count in ((1, 1), (2, 2), (3, 3)):
        grows.count = count
        grows.keyframe_insert("count", frame=frame)
    scene.frame_set(1)


SCENES = (rigid, centimetres, travel, led, instances, vanishing, cut, uncut, fog, holes, clay, falling, deforming)

if __name__ == "__main__":
    blend.write(SCENES)
