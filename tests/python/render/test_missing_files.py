"""Input that is missing is an error, not empty input: every kind of file that Blender reads with the .blend."""

import pecs
import pytest
from support import in_bpy, pecs_blender

MAKE = """
import sys
import bpy
from mathutils import Matrix

folder = sys.argv[1]

def new():
    bpy.ops.wm.read_factory_settings()
    scene = bpy.context.scene
    scene.frame_end = 3
    return scene, bpy.data.objects["Cube"], bpy.data.materials["Material"].node_tree

def save(name):
    bpy.ops.wm.save_as_mainfile(filepath=f"{folder}/{name}.blend", copy=True)

def empty(name):
    open(f"{folder}/{name}", "wb").close()

def volume(scene, path, **settings):
    one = bpy.data.volumes.new("smoke")
    one.filepath = path
    for key, value in settings.items():
        setattr(one, key, value)
    scene.collection.objects.link(bpy.data.objects.new("smoke", one))

def texture(tree, path, source):
    image = bpy.data.images.new("picture", 4, 4, tiled=source == "TILED")
    image.source, image.filepath = source, path
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    return image

scene, cube, tree = new()
bpy.ops.object.select_all(action="DESELECT")
cube.select_set(True)
for frame in (1, 3):
    cube.location.x = frame
    cube.keyframe_insert("location", frame=frame)
bpy.ops.wm.alembic_export(filepath=folder + "/cache.abc", start=1, end=3, selected=True)
bpy.data.objects.remove(cube)
bpy.ops.wm.alembic_import(filepath=folder + "/cache.abc")
bpy.data.cache_files[0].filepath = "//cache.abc"
save("alembic")
bpy.data.cache_files[0].filepath = "//gone.abc"
save("no_alembic")

for name, source in (("image", "FILE"), ("movie", "MOVIE"), ("sequence", "SEQUENCE")):
    scene, cube, tree = new()
    texture(tree, f"//gone_{name}_01.png", source)
    save("no_" + name)
for name, numbers in (("udim", (1001,)), ("udim_of_two", (1001, 1012))):
    scene, cube, tree = new()
    image = texture(tree, f"//{name}.<UDIM>.png", "TILED")
    image.tiles.new(1012) if len(numbers) > 1 else None
    empty("udim_of_two.1001.png")
    save("no_" + name)
scene, cube, tree = new()
texture(tree, "//tile_<UVTILE>.png", "TILED").tiles.new(1012)
empty("tile_u1_v1.png")
save("no_uvtile")

scene, cube, tree = new()
volume(scene, "//gone.vdb")
save("no_vdb")
for number in (1, 2):
    empty(f"smoke_{number:04}.vdb")
scene, cube, tree = new()
volume(scene, "//smoke_0001.vdb", is_sequence=True, frame_start=1, frame_duration=2)
save("vdb_sequence")  # the third frame is beyond its end
bpy.data.volumes[0].frame_duration = 3
save("no_vdb_sequence")
bpy.data.volumes[0].frame_duration, bpy.data.volumes[0].frame_offset = 2, 7
save("no_vdb_offset")

for kind in ("PC2", "MDD"):
    scene, cube, tree = new()
    modifier = cube.modifiers.new("cache", "MESH_CACHE")
    modifier.cache_format, modifier.filepath = kind, f"//gone.{kind.lower()}"
    save("no_" + kind.lower())
modifier.show_render = False
save("modifier_off")

scene, cube, tree = new()
node = bpy.data.lights["Light"]
node.use_nodes = True
ies = node.node_tree.nodes.new("ShaderNodeTexIES")
ies.mode, ies.filepath = "EXTERNAL", "//gone.ies"
save("no_ies")

scene, cube, tree = new()
text = bpy.data.objects.new("text", bpy.data.curves.new("text", "FONT"))
scene.collection.objects.link(text)
save("font")
text.data.font = bpy.data.fonts.load(sys.argv[2])
text.data.font.filepath = "//gone.ttf"
save("no_font")

scene, cube, tree = new()
modifier = cube.modifiers.new("nodes", "NODES")
group = modifier.node_group = bpy.data.node_groups.new("nodes", "GeometryNodeTree")
group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
node = group.nodes.new("GeometryNodeImportPLY")
node.inputs[0].default_value = "//gone.ply"
save("no_ply")
"""
MISSING = {
    "image": "gone_image_01.png",
    "movie": "gone_movie_01.png",
    "sequence": "gone_sequence_01.png",
    "udim": "udim.1001.png",
    "udim_of_two": "udim_of_two.1012.png",
    "uvtile": "tile_u2_v2.png",
    "vdb": "gone.vdb",
    "vdb_sequence": "smoke_0003.vdb",
    "vdb_offset": "smoke_0008.vdb",
    "alembic": "gone.abc",
    "pc2": "gone.pc2",
    "mdd": "gone.mdd",
    "ies": "gone.ies",
    "font": "gone.ttf",
    "ply": "gone.ply",
}
THERE = ("alembic", "font", "modifier_off", "vdb_sequence")
CHECK = """
import json, sys
import bpy
from pecs_blender.scene.outside_files import missing_files

found = {}
for name in json.loads(sys.argv[2]):
    bpy.ops.wm.open_mainfile(filepath=f"{sys.argv[1]}/{name}.blend")
    found[name] = list(missing_files(bpy.context.scene))
print(json.dumps(found))
"""
KINDS = """
import bpy
from pecs_blender.scene import outside_files

NO_INPUT = {  # what Blender writes, shows or plays, or only names
    *("AssetRepresentation", "BakeSettings", "BlendData", "BlendFileColorspace", "BlendImportContextLibrary"),
    *("CompositorNodeOutputFile", "DynamicPaintSurface", "FileBrowserFSMenuEntry", "FileSelectEntry", "NodesModifier"),
    *("FileSelectParams", "ImageStrip", "LibraryWeakReference", "MovieClip", "MovieClipProxy", "MovieStrip", "Sound"),
    *("NodesModifierBake", "PathCompare", "RenderSettings", "ScriptDirectory", "SequenceEditor", "StripElement"),
    *("BlenderProject", "Brush", "CollectionExport", "StripProxy", "StudioLight", "Theme", "UserAssetLibrary"),
    *("CollectionImport", "ProjectAssetLibrary", "UserExtensionRepo", "VolumeGrids"),
}
PARTS = {  # read through their owners
    *("CacheFileLayer", "ImagePackedFile", "FluidDomainSettings", "PointCacheItem", "NodeSocketStringFilePath"),
    "NodeTreeInterfaceSocketStringFilePath",
}
read = {kind.bl_rna.identifier for kind in outside_files._READ} | PARTS
for name in dir(bpy.types):
    struct = getattr(getattr(bpy.types, name), "bl_rna", None)
    if not struct or "_OT_" in name or name.startswith(("Preferences", "Compositor")):
        continue
    inherited = struct.base.properties.keys() if struct.base else ()
    for prop in struct.properties:
        is_path = prop.type == "STRING" and prop.subtype in ("FILE_PATH", "DIR_PATH", "FILE_NAME")
        if is_path and prop.identifier not in inherited:
            assert name in read or name in NO_INPUT, (name, prop.identifier)
"""


@pytest.fixture(scope="module")
def blends(tmp_path_factory):
    matplotlib = pytest.importorskip("matplotlib")
    folder = tmp_path_factory.mktemp("missing")
    in_bpy(MAKE, folder, f"{matplotlib.get_data_path()}/fonts/ttf/DejaVuSans.ttf")
    return folder


def test_every_missing_file_is_named(blends):
    import json

    names = [*(f"no_{name}" for name in MISSING), *THERE]
    done = in_bpy(CHECK, blends, json.dumps(names))
    found = json.loads(next(line for line in done.stdout.splitlines() if line.startswith("{")))
    for name, file in MISSING.items():
        first, *more = found["no_" + name]
        assert f"{blends}/{file}: no such file" in first and len(more) == (name == "vdb_offset"), (name, found)
    assert [found[name] for name in THERE] == [[]] * len(THERE)


def test_every_path_in_blender_is_an_input_or_listed_as_none():
    in_bpy(KINDS)


@pytest.mark.parametrize("name", ["udim_of_two", "vdb", "alembic", "mdd"])
def test_a_missing_file_ends_the_command(blends, tmp_path, name):
    result = pecs_blender("render", blends / f"no_{name}.blend", "-o", tmp_path / "s", "--bands", 1, check=False)
    assert result.returncode == 3 and MISSING[name] in result.stderr, result.stderr
    assert result.stderr.count("\n") == 1 and not (tmp_path / "s").exists()


DARK = """
import sys
import bpy
bpy.ops.wm.read_factory_settings()
scene = bpy.context.scene
bpy.data.lights["Light"].energy = 0
bpy.data.worlds["World"].node_tree.nodes["Background"].inputs["Strength"].default_value = 0
layer = scene.view_layers.new("other")
collection = bpy.data.collections.new("apart")
scene.collection.children.link(collection)
collection.objects.link(bpy.data.objects.new("apart", bpy.data.meshes.new("apart")))
scene.view_layers[0].layer_collection.children["apart"].exclude = True
scene.render.pixel_aspect_x, scene.render.use_border, scene.cycles.film_exposure = 2, True, 8
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
"""


@pytest.mark.parametrize("time", ["uniform", "adaptive"])
def test_what_is_left_out_is_said(tmp_path, time):
    in_bpy(DARK, tmp_path / "dark.blend")
    words = ("--bands", 1, "--samples", 1, "--frames", 2, "--width", 24, "--time", time)
    lines = pecs_blender("render", tmp_path / "dark.blend", "-o", tmp_path / "s", *words).stderr.splitlines()
    said = "pixel aspect of 2:1", "render region is ignored", "film exposure is ignored; --light-scale 8 has its effect"
    for text in ("no light reaches the camera", "without 'apart' of other view layers", *said):
        assert len([line for line in lines if text in line]) == 1, (text, lines)
    with pecs.StackReader(tmp_path / "s") as reader:
        assert not reader.read_frame(0).any()
    quiet = pecs_blender("render", tmp_path / "dark.blend", "-o", tmp_path / "q", *words, "--quiet").stderr
    assert "view layer" not in quiet
