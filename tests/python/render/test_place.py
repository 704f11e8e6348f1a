"""Objects of other files in a scene (`--place`): where they are, how they move, what is refused."""

import json

import numpy as np
import pecs
import pytest
from support import in_bpy, pecs_blender

FILES = """
import sys
import bpy
import numpy as np
from pecs_lab import blend
folder = sys.argv[1]
scene = blend.start()
blend.lamp("SUN", (1, 1, 1), 3)
blend.save(folder, "scene")
for name, uv in (("cube", True), ("plain", False)):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    cube = blend.box(None, (5, 1, 2), 3)
    if not uv:
        cube.data.uv_layers.remove(cube.data.uv_layers[0])
    blend.save(folder, name)
for name in ("material", "shape"):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    cube, code = blend.box(), f"open({folder!r} + '/ran', 'w').close() or 1"
    if name == "shape":
        driven, key = [cube.shape_key_add(name=one) for one in "ab"][1], "value"
    else:
        material, tree, _ = blend.material(name, ("ShaderNodeBsdfPrincipled", {}))
        cube.data.materials.append(material)
        driven, key = tree.nodes["Principled BSDF"].inputs["Roughness"], "default_value"
    driven.driver_add(key).driver.expression = code
    blend.save(folder, name)
bpy.ops.wm.read_factory_settings(use_empty=True)
blend.save(folder, "empty")
image = bpy.data.images.new("red", 4, 4)
image.pixels.foreach_set(np.tile(np.float32([0.8, 0.02, 0.02, 1]), 16))
image.filepath_raw, image.file_format = folder + "/red.png", "PNG"
image.save()
"""
COMMON = ("--bands", 3, "--samples", 4, "--fps", 10, "--frames", 2, "--width", 96, "--placement", "uniform")


@pytest.fixture(scope="module")
def files(root, tmp_path_factory):
    folder = tmp_path_factory.mktemp("place")
    in_bpy(FILES, folder)
    return folder


def thing(files, name="a", file="cube", **changes):
    path = file if "." in file else str(files / f"{file}.blend")
    return {"name": name, "file": path, "texture": None, "class": "box", "size_m": 0.5,
            "position_m": [0, 0, 0.3], "rotation_deg": [0, 0, 0], "velocity_m_s": [0, 0, 0],
            "spin_deg_s": [0, 0, 0]} | changes  # fmt: skip


def render(files, output, things, *more, check=True):
    (output.parent / "place.json").write_text(json.dumps({"format": 1, "objects": things}))
    words = ("--place", output.parent / "place.json", "-o", output, *COMMON, *more)
    return pecs_blender("render", files / "scene.blend", *words, check=check)


def test_size_place_and_speed(files, tmp_path):
    """A cube of half a metre, 4 m ahead, that flies 1 m/s to the right: its silhouette, its depth and its motion."""
    things = [thing(files, position_m=[-0.1, 0.25, 0.3], velocity_m_s=[1, 0, 0])]
    render(files, tmp_path / "s", things, "--layers", "depth,motion")
    with pecs.StackReader(tmp_path / "s") as stack:
        distance = stack.read_layer("depth", 0)[0]
        motion = stack.read_layer("motion", 0)
        seen = [np.isfinite(stack.read_layer("depth", i)[0]) for i in (0, 1)]
    assert np.nanmin(distance) > 3.9
    focal_px = 50 / 36 * 96
    side = np.count_nonzero(seen[0].any(0))  # seen from a camera that looks 10 deg down
    assert abs(side - 0.5 * focal_px / 4.0) < 1.5
    moved = np.nanmedian(motion[6][seen[0]])
    assert abs(moved - 0.1 * focal_px / 4.0) < 0.35
    assert abs(np.argwhere(seen[1])[:, 1].mean() - np.argwhere(seen[0])[:, 1].mean() - moved) < 0.6
    record = json.loads((tmp_path / "s/stack.json").read_text())["render"]["placed"]
    assert record[0]["file"] == "cube.blend" and record[0]["size_m"] == 0.5


def test_a_texture_colours_it(files, tmp_path):
    for name, texture in (("own", None), ("red", str(files / "red.png"))):
        render(files, tmp_path / name, [thing(files, texture=texture)], "--frames", 1)
    light = []
    for name in ("own", "red"):
        with pecs.StackReader(tmp_path / name) as stack:
            frame = stack.read_frame(0)
            light.append(frame[:, frame.sum(0) > 0].mean(1))
    blue_to_red = [values[0] / values[2] for values in light]  # bands rise
    assert blue_to_red[1] < 0.2 * blue_to_red[0]


def test_spin_turns_it_about_its_middle(files, tmp_path):
    render(files, tmp_path / "s", [thing(files, spin_deg_s=[0, 0, 450])], "--no-light", "--layers", "depth")
    with pecs.StackReader(tmp_path / "s") as stack:
        first, second = (np.isfinite(stack.read_layer("depth", i)[0]) for i in (0, 1))
    widths = [np.count_nonzero(seen.any(0)) for seen in (first, second)]
    assert 1.2 < widths[1] / widths[0] < 1.5  # a square, then its diagonal
    assert abs(np.argwhere(second)[:, 1].mean() - np.argwhere(first)[:, 1].mean()) < 0.5


@pytest.mark.parametrize(
    ("changes", "code", "line"),
    [
        ({"file": "/no/such.blend"}, 3, "no such file"),
        ({"texture": "/no/such.png"}, 3, "no such file"),
        ({"size_m": -1}, 4, "objects[0].size_m: got -1"),
        ({"position_m": [0, 0]}, 4, "objects[0].position_m"),
        ({"velocity_m_s": [1e300, 0, 0]}, 4, "objects[0].velocity_m_s"),
        ({"colour": 1}, 4, "objects[0].colour"),
    ],
)
def test_what_is_wrong_is_one_line(files, tmp_path, changes, code, line):
    result = render(files, tmp_path / "s", [thing(files) | changes], check=False)
    assert result.returncode == code and line in result.stderr and result.stderr.count("\n") == 1, result.stderr


@pytest.mark.parametrize("name", ["material", "shape"])
def test_python_of_a_placed_file_is_refused(files, tmp_path, name):
    """As that of the main file, in one line, before Blender tries it."""
    (files / "ran").unlink(missing_ok=True)  # by Blender that made the file
    result = render(files, tmp_path / "s", [thing(files, file=name)], check=False)
    assert result.returncode == 6 and result.stderr.count("\n") == 1, result.stderr
    assert f"{name}.blend: " in result.stderr and "--allow-scripts runs it" in result.stderr
    assert not (files / "ran").exists()
    render(files, tmp_path / "s", [thing(files, file=name)], "--allow-scripts")
    assert (files / "ran").exists()


MODELS = """
import sys
import bpy
from pecs_lab import blend
folder = sys.argv[1]
blend.start()
red = {"Base Color": (0.8, 0.02, 0.02, 1)}
thing = blend.box(blend.material("red", ("ShaderNodeBsdfPrincipled", red))[0], size=1)
thing.scale = (1, 0.4, 2)
blend.lamp("SUN", (1, 1, 1), 50)  # comes with some of the files, and stays out
bpy.ops.object.transform_apply(scale=True)
blend.save(folder, "thing")
bpy.ops.wm.obj_export(filepath=folder + "/thing.obj")
bpy.ops.wm.ply_export(filepath=folder + "/thing.ply", up_axis="Z", forward_axis="Y")
bpy.ops.export_scene.gltf(filepath=folder + "/thing.glb", export_lights=True, export_cameras=True)
bpy.ops.export_scene.gltf(filepath=folder + "/thing.gltf", export_format="GLTF_SEPARATE")
bpy.ops.export_scene.fbx(filepath=folder + "/thing.fbx")
bpy.ops.wm.usd_export(filepath=folder + "/thing.usdc")
for name in ("obj", "ply", "glb", "gltf", "fbx", "usdc"):
    open(f"{folder}/broken.{name}", "w").write("nothing")
"""


@pytest.fixture(scope="module")
def models(files):
    in_bpy(MODELS, files)
    seen = {}
    for kind in ("blend", "obj", "ply", "glb", "gltf", "fbx", "usdc"):
        output = files / f"seen_{kind}"
        things = [thing(files, file=str(files / f"thing.{kind}"), size_m=1.0)]
        render(files, output, things, "--layers", "depth", "--frames", 1, "--width", 48)
        with pecs.StackReader(output) as stack:
            seen[kind] = stack.read_layer("depth", 0)[0].copy(), stack.read_frame(0).copy()
    return seen


@pytest.mark.parametrize("kind", ["obj", "ply", "glb", "gltf", "fbx", "usdc"])
def test_a_model_of_any_format_is_the_same(models, kind):
    """Its place, axes, size and, except for .ply, its colour; no lamp of its file."""
    (depth, light), (wanted_depth, wanted_light) = models[kind], models["blend"]
    seen = np.isfinite(wanted_depth)
    assert seen.sum() > 100 and np.array_equal(np.isfinite(depth), seen)
    assert np.abs(depth[seen] - wanted_depth[seen]).max() < 1e-4
    if kind != "ply":
        assert light[:, seen].mean(1) == pytest.approx(wanted_light[:, seen].mean(1), rel=0.05)


@pytest.mark.parametrize("kind", ["obj", "ply", "glb", "gltf", "fbx", "usdc", "stl"])
def test_a_broken_model_is_one_line(files, tmp_path, kind):
    (files / f"broken.{kind}").write_text("nothing")
    result = render(files, tmp_path / "s", [thing(files, file=str(files / f"broken.{kind}"))], check=False)
    ours = [said for said in result.stderr.splitlines() if said.startswith("pecs_blender: ")]
    assert result.returncode == 4 and len(ours) == 1 and f"broken.{kind}: " in ours[0], result.stderr


FACES = "f 1 2 3\nf 1 2 4\n"
USD = """#usda 1.0
def Mesh "m" {
    int[] faceVertexCounts = [3, 3]
    int[] faceVertexIndices = [0, 1, 2, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (nan, 0, 0)]
}
"""
PLY = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
nan 0 0
0 1 0
3 0 1 2
"""
PARTS = (
    USD
    + """
def "part" (
    references = @nosuch.usda@
)
{
}
"""
)
VERTICES = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"


@pytest.mark.parametrize(
    ("text", "code", "line"),
    [
        (VERTICES.replace("v 1", "v nan") + FACES, 4, "odd.obj: got v nan 0 0, wanted vertices of finite numbers"),
        (PLY, 4, "odd.ply: got nan, wanted vertices of finite numbers"),
        (PARTS.replace("nan", "0"), 3, "odd.usda: nosuch.usda: no such file"),
        (USD, 4, "odd.usda: objects: got vertices that are not finite, wanted numbers"),
        (VERTICES.replace("1", "1e30") + FACES, 4, "objects: got an extent of 1e+30, wanted 1e-09 to 1e+09"),
        ("mtllib nosuch.mtl\n" + VERTICES + FACES, 3, "odd.obj: mtllib: "),
        ("mtllib text.mtl\nusemtl a\n" + VERTICES + "usemtl a\n" + FACES, 4, "text.mtl: got no picture that Blender"),
    ],
    ids=["nan", "nan of PLY", "missing part of USD", "nan of USD", "large", "no materials", "no picture"],
)
def test_a_model_that_would_vanish_or_lose_its_look_is_refused(files, tmp_path, text, code, line):
    (tmp_path / "text.mtl").write_text("newmtl a\nmap_Kd text.mtl\n")
    file = tmp_path / ("odd" + {"#": ".usda", "p": ".ply"}.get(text[0], ".obj"))
    file.write_text(text)
    result = render(files, tmp_path / "s", [thing(files, file=str(file))], check=False)
    assert result.returncode == code and line in result.stderr and result.stderr.count("\n") == 1, result.stderr


def test_size_and_axis_of_a_file(files, models, tmp_path):
    """Half a metre per unit, 2 units high; with z up, the .obj lies on its side."""
    for up, high in (("y", True), ("z", False)):
        entry = thing(files, file=str(files / "thing.obj"), size_m=None, unit_m=0.5, up=up)
        render(files, tmp_path / up, [entry], "--no-light", "--layers", "depth", "--frames", 1, "--width", 48)
        with pecs.StackReader(tmp_path / up) as stack:
            seen = np.isfinite(stack.read_layer("depth", 0)[0])
        assert np.array_equal(seen, np.isfinite(models["blend"][0])) == high


def test_a_changed_texture_or_material_is_another_stack(files, models, tmp_path):
    """The files that a model reads count."""
    entry = [thing(files, file=str(files / "thing.obj"))]
    words = ("--no-light", "--layers", "depth", "--frames", 1, "--width", 16)
    render(files, tmp_path / "s", entry, *words)
    (files / "thing.mtl").write_text((files / "thing.mtl").read_text().replace("Kd 0.8", "Kd 0.2"))
    assert render(files, tmp_path / "s", entry, *words, check=False).returncode == 5


SKIES = """
import sys
import bpy
import numpy as np
from pecs_lab import blend
folder = sys.argv[1]
scene = blend.start()
blend.floor(blend.material("grey", ("ShaderNodeBsdfDiffuse", {"Color": blend.GREY}))[0], 1000)
scene.camera.location.z, scene.camera.rotation_euler = 2, (0.3, 0, 0)
blend.save(folder, "floor")
for name, size, below in (("sky", (64, 32), False), ("dark", (64, 32), True), ("square", (32, 32), False)):
    pixels = np.zeros((*size[::-1], 4), np.float32)
    pixels[: size[1] // 2 if below else None] = 0.2, 0.3, 0.4, 1
    if not below:
        pixels[24:27, 40:43, :3] = 300
    image = bpy.data.images.new(name, *size, float_buffer=True)
    image.pixels.foreach_set(pixels.ravel())
    image.filepath_raw, image.file_format = f"{folder}/{name}.hdr", "HDR"
    image.save()
    if name == "sky":
        pixels[20, 20, 1] = np.nan
        image.pixels.foreach_set(pixels.ravel())
        image.filepath_raw, image.file_format = folder + "/nan.exr", "OPEN_EXR"
        image.save()
open(folder + "/empty.hdr", "w").close()
"""


@pytest.fixture(scope="module")
def skies(files):
    in_bpy(SKIES, files)
    return files


def under_sky(folder, scene, name, *words, check=True):
    sky = {"file": str(folder / (name if "." in name else f"{name}.hdr")), "lux": 1000, "turn_deg": 40}
    (folder / "sky.json").write_text(json.dumps({"format": 1, "objects": [], "sky": sky}))
    return pecs_blender("light", scene, "--place", folder / "sky.json", "--json", *words, check=check)


def test_a_sky_gives_a_floor_its_lux(root, skies):
    """Measured on the rendered floor, in a .blend and in a scene folder; a lamp of the folder adds its own."""
    stage, without = root / "scenes/stage", ("--set", "lamps=0")
    for scene, words in ((skies / "floor.blend", ()), (stage, without)):
        found = json.loads(under_sky(skies, scene, "sky", *words).stdout)
        assert found["lux"]["median"] == pytest.approx(1000, rel=0.1), scene
    both = json.loads(under_sky(skies, stage, "sky", "--set", "illuminance_lux=3000").stdout)
    assert both["lux"]["median"] > 2000


@pytest.mark.parametrize(
    ("name", "code", "line"),
    [
        ("nosuch", 3, "nosuch.hdr: no such file"),
        ("empty", 4, "empty.hdr: got no pixels"),
        ("dark", 4, "dark.hdr: got no light above the horizon"),
        ("nan.exr", 4, "nan.exr: pixels: got values that are not finite, wanted light"),
        ("square", 4, "square.hdr: size: got 32 x 32, wanted twice as wide as high"),
    ],
)
def test_what_is_no_sky_is_one_line(skies, name, code, line):
    result = under_sky(skies, skies / "floor.blend", name, check=False)
    ours = [said for said in result.stderr.splitlines() if said.startswith("pecs_blender: ")]
    assert result.returncode == code and len(ours) == 1 and line in ours[0], result.stderr


def test_a_stage_without_light_is_refused(root):
    result = pecs_blender("light", root / "scenes/stage", "--set", "lamps=0", check=False)
    assert result.returncode == 4 and "no lamp that shines" in result.stderr


def test_what_files_lack_is_one_line(files, tmp_path):
    for things, line in (
        ([thing(files, file="plain", texture=str(files / "red.png"))], "no UV map"),
        ([thing(files, file="empty")], "no mesh"),
        ([thing(files), thing(files)], "a name that no other object has"),
        ([thing(files, texture=str(files / "cube.blend"))], "cube.blend"),
    ):
        result = render(files, tmp_path / "s", things, check=False)
        ours = [said for said in result.stderr.splitlines() if said.startswith("pecs_blender: ")]
        assert result.returncode == 4 and len(ours) == 1 and line in ours[0], result.stderr
