"""An edited scene does not continue the stack of the scene before it; a file that is saved again does."""

import json

import pytest
from support import in_bpy, pecs_blender

MAKE = """
import sys
import bpy
folder = sys.argv[1]
bpy.ops.wm.read_factory_settings()
cube = bpy.data.objects["Cube"]
for frame, x in ((1, 0), (10, 1)):
    cube.location.x = x
    cube.keyframe_insert("location", frame=frame)
cube.shape_key_add(name="Basis")
cube.shape_key_add(name="Wide")
cube.vertex_groups.new(name="some").add([0, 1], 0.5, "REPLACE")
cube.modifiers.new("bevel", "BEVEL")
image = bpy.data.images.new("red", 4, 4)
image.filepath_raw, image.file_format = folder + "/red.png", "PNG"
image.save()
tree = bpy.data.materials["Material"].node_tree
picture = tree.nodes.new("ShaderNodeTexImage")
picture.image = bpy.data.images.load(folder + "/red.png")
tree.links.new(picture.outputs[0], tree.nodes["Principled BSDF"].inputs["Base Color"])
modifier = cube.modifiers.new("nodes", "NODES")
group = modifier.node_group = bpy.data.node_groups.new("nodes", "GeometryNodeTree")
for kind in ("STRING", "FLOAT4X4", "INT8", "BOOLEAN", "FLOAT_COLOR"):
    cube.data.attributes.new(kind, kind, "POINT")
for way in ("INPUT", "OUTPUT"):
    group.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
group.interface.new_socket("Size", in_out="INPUT", socket_type="NodeSocketFloat")
group.links.new(group.nodes.new("NodeGroupInput").outputs[0], group.nodes.new("NodeGroupOutput").inputs[0])
child = bpy.data.objects.new("child", bpy.data.meshes.new("empty"))
child.parent = cube
scene = bpy.context.scene
scene.collection.objects.link(child)
cube.modifiers.new("remesh", "REMESH").show_render = False
cache, smoke = cube.modifiers.new("cache", "MESH_CACHE"), bpy.data.volumes.new("smoke")
for thing, one in ((cache, "moves.mdd"), (smoke, "smoke.vdb")):
    open(f"{folder}/{one}", "w").close()
    thing.filepath = "//" + one
scene.collection.objects.link(bpy.data.objects.new("smoke", smoke))
cube.modifiers.new("subdivided", "SUBSURF")
cube.constraints.new("LOCKED_TRACK").target = bpy.data.objects["Light"]
cube.data.uv_layers.new(name="second")
for name in ("one", "two"):
    cube.data.color_attributes.new(name, "FLOAT_COLOR", "POINT")
bpy.ops.object.armature_add()
bpy.ops.curve.primitive_bezier_curve_add()
curve = bpy.context.object
curve.name = "Curve"
curve.shape_key_add(name="Basis")
curve.shape_key_add(name="Bent")
for name, frame in (("plain", 1), ("cut", 2)):
    scene.timeline_markers.new(name, frame=frame)
scene.timeline_markers["cut"].camera = bpy.data.objects["Camera"]
bpy.data.materials.new("other").use_fake_user = True
bpy.data.worlds.new("other").use_fake_user = True
scene.frame_end = 3
bpy.ops.wm.save_as_mainfile(filepath=folder + "/scene.blend")
"""
DIGESTS = """
import json, sys
import bpy
from pathlib import Path
from pecs_blender.scene import content

def set_size(value):
    nodes = cube.modifiers["nodes"]
    if hasattr(nodes, "properties"):  # Blender 5.3
        nodes.properties.inputs.Socket_2.value = value
    else:
        nodes["Socket_2"] = value

folder = Path(sys.argv[1])
found = {}
for edit in json.loads(sys.argv[2]):
    bpy.ops.wm.open_mainfile(filepath=str(folder / "scene.blend"))
    data, scene = bpy.data, bpy.context.scene
    cube, nodes = data.objects["Cube"], data.materials["Material"].node_tree.nodes
    mesh = cube.data
    exec(edit)
    found[edit] = content.digest(bpy.context.scene)
print(json.dumps(found))
"""
EDIT = """
import sys
import bpy
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
data, scene = bpy.data, bpy.context.scene
exec(sys.argv[2])
bpy.ops.wm.save_mainfile()
"""
SHOWN = [  # edits that change the light
    'data.lights["Light"].energy = 2000',
    'data.lights["Light"].cycles.max_bounces = 2',
    'nodes["Principled BSDF"].inputs["Roughness"].default_value = 0.1',
    "data.materials['Material'].node_tree.links.clear()",
    'data.worlds["World"].node_tree.nodes["Background"].inputs["Strength"].default_value = 2',
    "mesh.vertices[0].co.x += 0.01",
    "mesh.polygons[0].use_smooth = True",
    "mesh.attributes['FLOAT_COLOR'].data[1].color = (1, 0, 0, 1)",
    "for _ in range(400): new = data.objects.new('link', None); new.parent, cube = cube, new; "
    "scene.collection.objects.link(new)",
    'mesh.shape_keys.key_blocks["Wide"].data[0].co.z = 3',
    'cube.vertex_groups[0].add([0], 1.0, "REPLACE")',
    'cube.modifiers["bevel"].width = 0.3',
    "set_size(2.5)",
    "cube.hide_render = True",
    "cube.scale.z = 2",
    "data.objects['Camera'].data.lens = 35",
    "data.objects.remove(data.objects['Light'])",
    "cube.keyframe_insert('location', frame=20)",
    "scene.render.fps = 30",
    "scene.view_layers[0].layer_collection.children[0].exclude = True",
    "cube.modifiers['remesh'].show_render = True",
    "cube.modifiers['remesh'].mode = 'BLOCKS'",
    "data.objects['child'].matrix_parent_inverse = __import__('mathutils').Matrix.Translation((3, 0, 0))",
    "mesh.uv_layers[1].active_render = True",
    "mesh.attributes.render_color_index = 1",
    "cube.constraints[0].lock_axis = 'LOCK_X'",
    "cube.show_instancer_for_render = False",
    "cube.show_only_shape_key = True",
    "cube.is_holdout = True",
    "data.objects['Curve'].data.shape_keys.key_blocks['Bent'].data[0].radius = 3",
    "data.objects['Curve'].data.splines[0].bezier_points[0].tilt = 1",
    "bpy.context.view_layer.objects.active = data.objects['Armature']; bpy.ops.object.mode_set(mode='EDIT'); "
    "data.armatures[0].edit_bones[0].tail.x += 1; bpy.ops.object.mode_set(mode='OBJECT')",
    "data.actions[0].layers[0].strips[0].channelbags[0].fcurves[0].keyframe_points[0].back = 3",
    "scene.timeline_markers.new('more', frame=3).camera = data.objects['Camera']",
    "scene.timeline_markers['cut'].frame = 3",
    "scene.render.frame_map_new = 200",
    "scene.render.use_simplify = True",
    "scene.render.hair_type = 'STRIP'",
    "scene.render.film_transparent = True",
    "scene.cycles.volume_step_rate = 5",
    "scene.cycles.dicing_rate = 8",
    "scene.cycles.use_camera_cull = True",
    "scene.cycles_curves.subdivisions = 4",
    "scene.view_layers[0].material_override = data.materials['other']",
    "scene.view_layers[0].world_override = data.worlds['other']",
    "scene.view_layers[0].use_sky = False",
    "(folder / 'moves.mdd').write_text('1')",
    "(folder / 'smoke.vdb').write_text('1')",
    "(folder / 'red.png').write_bytes((folder / 'green.png').read_bytes())",
]
HIDDEN = [  # what a user does to a file without changing its light
    "pass",
    "scene.frame_set(7)",
    "cube.select_set(False); cube.show_wire = True; mesh.vertices[0].select = False",
    "bpy.context.view_layer.objects.active = data.objects['Camera']",
    "nodes['Principled BSDF'].location.x += 100",
    "scene.render.filepath = '/tmp/x'; scene.render.resolution_x = 99; scene.cycles.samples = 3",
    "scene.timeline_markers['plain'].frame = 9; scene.timeline_markers['cut'].name = 'other'",
    "cube.modifiers['subdivided'].levels = 3; cube.modifiers['subdivided'].show_viewport = False",
    "cube.display_type = 'WIRE'; cube.hide_viewport = True; cube.lock_location[0] = True",
    "cube.active_shape_key_index = 1; mesh.remesh_voxel_size = 2",
    "scene.tool_settings.use_snap = True; scene.frame_end = 9; scene.cursor.location.x = 3",
    "scene.view_layers[0].use_pass_z = True; scene.view_layers.new('other')",
    "scene.unit_settings.length_unit = 'CENTIMETERS'; data.texts.new('notes')",
    "(folder / 'deeper').mkdir(exist_ok=True); new = str(folder / 'deeper' / 'copy.blend'); "
    "bpy.ops.wm.save_as_mainfile(filepath=new, relative_remap=True); bpy.ops.wm.open_mainfile(filepath=new)",
]


EVERY = """
import sys
import bpy
from pecs_blender.scene import content
from pecs_blender.scene.content import INTERFACE

def things():
    "One of each type that the scene has, read again: a change may free others."
    bpy.ops.wm.open_mainfile(filepath=sys.argv[1] + "/scene.blend")
    walk = content.Walk(bpy.context.scene)
    walk.value(bpy.context.scene)
    walk.value(bpy.context.scene.view_layers[0])
    walk.to_the_end()
    return {kind.bl_rna.identifier: found[0] for kind, found in walk.met.items()}

def read(thing):
    walk = content.Walk(bpy.context.scene)
    walk.value(thing)
    walk._read(thing)
    return walk._hash.hexdigest()

def another(prop, value):
    if getattr(prop, "is_array", False) or prop.type == "ENUM" and prop.is_enum_flag:
        return value
    if prop.type == "ENUM":
        return next((item.identifier for item in prop.enum_items if item.identifier != value), value)
    if prop.type in ("INT", "FLOAT"):
        return next((v for v in (0, 1, 2, prop.hard_min, prop.hard_max) if v != value), value)
    return not value if prop.type == "BOOLEAN" else value + "x"

seen, kinds = 0, {name: type(thing) for name, thing in things().items()}
for name, kind in kinds.items():
    thing = things()[name]
    for prop in kind.bl_rna.properties:
        if prop.is_readonly or prop.type in ("POINTER", "COLLECTION") or not content.counts(kind, prop):
            continue
        if prop.identifier.startswith("bl_"):  # Blender frees what has another type
            continue
        try:
            old, before = getattr(thing, prop.identifier), read(thing)
            setattr(thing, prop.identifier, another(prop, old))
            new = getattr(thing, prop.identifier)
        except (AttributeError, TypeError, ValueError, RuntimeError):  # it cannot have another value here
            continue
        if new != old:
            assert read(thing) != before, f"{name}.{prop.identifier}"
            seen += 1
            setattr(thing, prop.identifier, old)  # Blender may crash with some values when it opens the next file
print(len(kinds), seen, flush=True)
assert len(kinds) > 40 and seen > 300, (len(kinds), seen)

types = [getattr(bpy.types, name) for name in dir(bpy.types)]
known = {one.bl_rna.identifier for one in types if hasattr(one, "bl_rna")} | set(kinds)
assert bpy.app.version >= (5, 0) or not INTERFACE.keys() - known, INTERFACE.keys() - known
"""


@pytest.fixture
def blend(tmp_path):
    in_bpy(MAKE, tmp_path)
    return tmp_path / "scene.blend"


def test_a_digest_changes_with_what_the_scene_shows(blend):
    folder = blend.parent
    (folder / "green.png").write_bytes((folder / "red.png").read_bytes() + b" ")
    done = in_bpy(DIGESTS, folder, json.dumps(HIDDEN + SHOWN))
    found = json.loads(next(line for line in done.stdout.splitlines() if line.startswith("{")))
    assert {edit for edit, digest in found.items() if digest == found["pass"]} == set(HIDDEN)
    assert len({found[edit] for edit in SHOWN}) == len(SHOWN)


def test_every_property_counts_but_those_of_the_interface(blend):
    """RNA, type by type: a value that changes is seen unless interface_only.txt lists it."""
    in_bpy(EVERY, blend.parent)


def test_an_edited_scene_is_refused_and_overwritten(blend):
    def render(*more, check=True):
        words = ("-o", blend.with_name("s"), "--bands", 3, "--samples", 1, "--width", 32, "--height", 24, *more)
        return pecs_blender("render", blend, *words, check=check).stderr

    render()
    frame = blend.with_name("s") / "frame_000000.exr"
    light = frame.read_bytes()
    in_bpy(EDIT, blend, HIDDEN[1])
    assert "exist already" in render()
    in_bpy(EDIT, blend, SHOWN[0])
    assert (
        "'scene.content_sha256' (the scene was edited); --overwrite" in render(check=False)
        and frame.read_bytes() == light
    )
    render("--overwrite")
    assert frame.read_bytes() != light
