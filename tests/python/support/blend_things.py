"""Scenes with things to be told apart, as .blend files (with bpy): `python blend_things.py FOLDER [NAME...]`; and
`python blend_things.py --cryptomatte FILE.blend OUT.npz`: Cycles' own masks of its first frame."""

import sys

import bpy
import numpy as np
from pecs_lab import blend
from pecs_lab.blend import instance_on_points, move, put

from support.blend_motion import grid, start

SIZE = 160, 120


def cube(name, size=1.0):
    mesh = bpy.data.meshes.new(name)
    h = size / 2
    corners = [(x, y, z) for z in (-h, h) for y in (-h, h) for x in (-h, h)]
    mesh.from_pydata(corners, [], [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)])
    return mesh


def ball(name, radius):
    thing = blend.ball(None, (0, 0, 0), radius, segments=192, smooth=True)
    mesh = thing.data
    mesh.name = name
    bpy.data.objects.remove(thing)
    return mesh


def collection(name, parent=None, **properties):
    made = bpy.data.collections.new(name)
    (parent or bpy.context.scene.collection).children.link(made)
    for key, value in properties.items():
        made[key] = value
    return made


def into(holder, thing):
    for other in thing.users_collection:
        other.objects.unlink(thing)
    holder.objects.link(thing)
    return thing


def things():
    """A room from behind to ahead (class by its material), a ball, cars in a collection below one that says what they
    are, one before another and one half outside; trees of two parts, made by empties; leaves made by nodes; a flag that
    an armature bends; something behind the camera."""
    scene = start()
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    room = cube("room", 20)
    room.materials.append(bpy.data.materials.new("stone"))
    room.materials[0]["pecs_class"] = "wall"
    put(room, (0, 5, 6))
    globe = put(ball("ball", 0.5), (-1.2, 4, 0.6))
    globe["pecs_class"] = "ball"
    cars = collection("cars", collection("vehicles", pecs_class="car"))
    first, second, third = (
        into(cars, put(cube(f"car {i}"), place, (0, 0, 20 * i)))
        for i, place in enumerate([(0.2, 4, -0.6), (0.7, 5.5, -0.4), (2.0, 4, -0.3)])
    )
    second.scale = (1.5, -0.8, 1.2)
    move(first, "location", [(0.2, 4, -0.6), (0.0, 4, -0.5)])
    tree = collection("tree", pecs_object="tree")
    scene.collection.children.unlink(tree)
    into(tree, put(cube("trunk", 0.25), (0, 0, 0)))
    into(tree, put(ball("crown", 0.3), (0, 0, 0.35)))
    for i in range(2):
        empty = put(None, (-2.0 + 1.1 * i, 5, -0.6), (0, 0, 30), f"empty {i}")
        empty.instance_type, empty.instance_collection, empty["pecs_class"] = "COLLECTION", tree, "tree"
    _leaves()
    _flag()
    put(cube("behind", 0.5), (0, -2, 0))


def _leaves():
    points = bpy.data.meshes.new("points")
    points.from_pydata([(-0.6, 0, 0), (0.1, 0, 0), (0.8, 0, 0.1)], [], [])
    holder = put(points, (0.4, 4.5, 1.1), name="leaves")
    leaf = put(cube("leaf", 0.35), (0, -50, 0))
    leaf.hide_render = True
    instance_on_points(holder, leaf)


def _flag():
    flag = put(grid("flag", 0.9, 4), (1.5, 4, 0.7))
    flag.shape_key_add(name="rest")
    key = flag.shape_key_add(name="long")
    for point in key.data:
        point.co.x *= 1.5
    move(key, "value", [0.0, 1.0])


def alone():
    """The car that another one hides, without others."""
    things()
    for thing in bpy.data.objects:
        if thing.type == "MESH" and thing.name not in ("car 1",):
            thing.hide_render = True
    for empty in [thing for thing in bpy.data.objects if thing.name.startswith("empty")]:
        bpy.data.objects.remove(empty)


def centimetres():
    """A ball, a turned plane and a cube, in a scene in centimetres, before a picture with nothing behind."""
    scene = start(0.01)
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    put(ball("ball", 50), (-80, 400, 20))
    put(grid("plane", 100), (70, 400, 0), (20, 10, 30))
    put(cube("cube", 60), (-20, 500, -120), (10, 20, 30))


def twins():
    """Two touching cubes whose names give the same Random in Cycles."""
    from pecs_blender.truth.identity import name_id

    start().render.resolution_x, bpy.context.scene.render.resolution_y = SIZE
    seen, i = {}, 0
    while (value := np.float32(name_id(name := f"cube {i}"))) not in seen:
        seen[value] = name
        i += 1
    for x, twin in ((-0.5, seen[value]), (0.5, name)):
        put(cube(twin), (x, 4, 0))


def bad_class():
    start()
    put(cube("thing"), (0, 4, 0))["pecs_class"] = 3


def blank_class():
    start()
    into(collection("all", pecs_class=" "), put(cube("thing"), (0, 4, 0)))


def cryptomatte(blend, out):
    from pecs_blender.scene import cycles

    bpy.ops.wm.open_mainfile(filepath=blend)
    scene = bpy.context.scene
    cycles.configure(scene, *SIZE, cycles.Sampling(samples=64, seed=1, bounces={}))
    layer = scene.view_layers[0]
    layer.use_pass_cryptomatte_object = True
    layer.pass_cryptomatte_depth = 4
    names = [f"CryptoObject{i:02d}" for i in range(2)]
    np.savez(out, **cycles.Film(scene).passes(*names))


if __name__ == "__main__":
    if sys.argv[1] == "--cryptomatte":
        cryptomatte(*sys.argv[2:])
        sys.exit()
    blend.write((things, alone, centimetres, twins, bad_class, blank_class))
