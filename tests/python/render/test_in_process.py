"""pecs_blender.render: the command's stack, from a Python program that has bpy."""

from support import in_bpy, pecs_blender

OPTIONS = "--fps 1kHz --frames 2 --width 16 --height 12 --samples 1 --bands 3 --lux 500 --layers depth".split()
BODY = """
import sys
from pathlib import Path
import bpy, pecs, pecs_blender

bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.mesh.primitive_cube_add(size=1)
material = bpy.data.materials.new("paint")
material.diffuse_color = (0.8, 0.2, 0.1, 1)
bpy.context.object.data.materials.append(material)
bpy.ops.object.light_add(type="SUN")
bpy.ops.object.camera_add(location=(0, 0, 4))
bpy.context.scene.camera = bpy.context.object
path, output = map(Path, sys.argv[1:])
bpy.ops.wm.save_as_mainfile(filepath=str(path))

before = tuple(material.diffuse_color)
options = dict(fps="1kHz", frames="2", width=16, height=12, samples=1, bands=3, lux=500, layers="depth", quiet=True)
written = pecs_blender.render(bpy.context.scene, output, pecs_blender.Options(**options))
assert written == output, written
with pecs.StackReader(written) as stack:
    assert stack.info["frames"] == 2 and stack.read_layer("depth", 1).shape == (2, 12, 16), stack.info
assert tuple(bpy.data.materials["paint"].diffuse_color) == before and not bpy.context.scene.keys()
assert pecs_blender.render(path, output, pecs_blender.Options(**options)) == output  # finds all frames
assert Path(bpy.data.filepath) == path

for wrong, message in ((dict(device="GPU"), "--device"), (dict(layers="dept"), "--layers"), (dict(fps="1px"), "--fps")):
    try:
        pecs_blender.Options(**wrong)
    except pecs.PecsError as e:
        assert message in str(e), e
    else:
        raise AssertionError(wrong)
"""


def test_the_open_scene_as_by_the_command(tmp_path):
    in_bpy(BODY, tmp_path / "cube.blend", tmp_path / "here")
    pecs_blender("render", tmp_path / "cube.blend", "-o", tmp_path / "there", *OPTIONS)
    files = sorted(file.name for file in (tmp_path / "there").iterdir())
    assert len(files) == 5 and files == sorted(file.name for file in (tmp_path / "here").iterdir())
    for name in files:
        assert (tmp_path / "there" / name).read_bytes() == (tmp_path / "here" / name).read_bytes(), name
