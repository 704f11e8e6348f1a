"""An edited scene does not continue the stack of the scene before it; a file that is saved again does."""

import json

import pytest
from support import in_bpy, pecs_blender

pytest.importorskip("pecs")

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
bpy.context.scene.frame_end = 3
bpy.ops.wm.save_as_mainfile(filepath=folder + "/scene.blend")
"""
DIGESTS = """
import json, sys
import bpy
from pathlib import Path
from pecs_blender.render import content

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
    'cube.modifiers["nodes"]["Socket_2"] = 2.5',
    "cube.hide_render = True",
    "cube.scale.z = 2",
    "data.objects['Camera'].data.lens = 35",
    "data.objects.remove(data.objects['Light'])",
    "cube.keyframe_insert('location', frame=20)",
    "scene.render.fps = 30",
    "scene.view_layers[0].layer_collection.children[0].exclude = True",
    "(folder / 'red.png').write_bytes((folder / 'green.png').read_bytes())",
]
HIDDEN = [  # what a user does to a file without changing its light
    "pass",
    "scene.frame_set(7)",
    "cube.select_set(False); cube.show_wire = True; mesh.vertices[0].select = False",
    "bpy.context.view_layer.objects.active = data.objects['Camera']",
    "nodes['Principled BSDF'].location.x += 100",
    "scene.render.filepath = '/tmp/x'; scene.render.resolution_x = 99; scene.cycles.samples = 3",
    "(folder / 'deeper').mkdir(exist_ok=True); new = str(folder / 'deeper' / 'copy.blend'); "
    "bpy.ops.wm.save_as_mainfile(filepath=new, relative_remap=True); bpy.ops.wm.open_mainfile(filepath=new)",
]


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
