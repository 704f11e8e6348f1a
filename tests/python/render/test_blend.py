"""Rendering any .blend: the rewriting of its colours changes nothing but what it should, and the file not at all."""

import hashlib
import json
import os

import numpy as np
import pytest
from support import in_bpy, make_blends, pecs_blender, run_support
from support.blend_files import FILES

NAMES = [make.__name__ for make in FILES]


@pytest.fixture(scope="module")
def blends(tmp_path_factory):
    return make_blends("files", tmp_path_factory.mktemp("blends"))


def digests(folder):
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.glob("*.blend*")}


@pytest.fixture(scope="module")
def pictures(root, blends):
    before = digests(blends)
    paths = [blends / f"{name}.blend" for name in (*NAMES, "temperatures", "spectra")]
    run_support("band_pass", blends / "out.npz", *paths)
    assert digests(blends) == before
    return np.load(blends / "out.npz")


@pytest.mark.parametrize("name", NAMES)
def test_the_identity_matrix_changes_nothing(pictures, name):
    plain = pictures[f"{name}/plain"]
    assert plain.max() > 0 and np.ptp(plain.mean(axis=(1, 2))) > 1e-3  # there is light, and colour
    assert (pictures[f"{name}/identity"] == plain).all()


@pytest.mark.parametrize("name", NAMES)
def test_a_grey_matrix_makes_grey(pictures, name):
    grey = pictures[f"{name}/grey"]
    assert grey.max() > 0
    assert (grey[0] == grey[1]).all() and (grey[0] == grey[2]).all()


def test_a_band_pass_is_near_rgb_where_the_bands_are(pictures):
    """620, 540, 460 nm lie in red, green, blue."""
    for name in NAMES:
        if name != "emission":  # D65's own spectrum shows
            spectral, plain = (pictures[f"{name}/{kind}"].mean(axis=(1, 2)) for kind in ("spectral", "plain"))
            assert spectral == pytest.approx(plain, rel=0.15), name


def test_a_blackbody_follows_planck(pictures):
    nm = np.array([620.0, 540.0, 460.0])
    planck = nm**-5 / np.expm1(1.438776877e7 / (nm * 2500))
    picture = pictures["temperatures/radiance"][:, 10:20, 10:40]
    assert np.ptp(picture, axis=(1, 2)).max() < 1e-6
    seen = picture.mean(axis=(1, 2))
    assert seen / seen[1] == pytest.approx(planck / planck[1], rel=1e-3)


def test_named_spectra_replace_colours(pictures):
    """A wall of a ColorChecker's blue under a world of illuminant A: radiance is reflectance times A."""
    colour = pytest.importorskip("colour")
    nm = np.array([620.0, 540.0, 460.0])
    blue = colour.SDS_COLOURCHECKERS["ISO 17321-1"]["blue"]
    expected = np.array([blue[n] for n in nm]) * np.array([colour.SDS_ILLUMINANTS["A"][n] for n in nm])
    seen = pictures["spectra/radiance"].mean(axis=(1, 2))
    assert seen / seen[2] == pytest.approx(expected / expected[2], rel=0.02)


SMALL = ("--bands", 3, "--frames", 1, "--samples", 1)


def test_a_blend_becomes_a_stack(blends, tmp_path):
    before = digests(blends)
    pecs_blender("render", blends / "textures.blend", "-o", tmp_path / "s", *SMALL)
    stack = json.loads((tmp_path / "s" / "stack.json").read_text())
    assert (stack["quantity"], stack["width"], stack["height"]) == ("radiance", 48, 32)
    assert stack["render"]["emitters"] == ["d65"]
    assert digests(blends) == before


OCIO = """ocio_profile_version: 1
roles: {scene_linear: linear, default: raw, default_byte: raw, data: raw}
displays:
  screen:
    - !<View> {name: plain, colorspace: raw}
colorspaces:
  - !<ColorSpace> {name: linear}
  - !<ColorSpace> {name: raw, isdata: true}
"""
OPEN = """
from pathlib import Path
import bpy, sys
from pecs_blender.scene.open import open_scene
if len(sys.argv) > 2:
    if bpy.app.version < (5, 0):
        sys.exit()
    bpy.ops.wm.set_working_color_space(working_space=sys.argv[2])
    bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
try:
    open_scene(Path(sys.argv[1]), "d65")
except Exception as e:
    print(int(e.code), e)
"""


def test_colours_are_blenders_own(blends, tmp_path):
    """Not those of an OpenColorIO configuration that other programs use, nor of another working space."""
    (tmp_path / "own.ocio").write_text(OCIO)
    own = os.environ | {"OCIO": str(tmp_path / "own.ocio")}
    file = blends / "textures.blend"
    plain, same = (pecs_blender("light", file, "--json", env=env).stdout for env in (None, own))
    assert same == plain
    assert "6 OpenColorIO: got /" in in_bpy(OPEN, file, env=own).stdout
    said = in_bpy(OPEN, tmp_path / "wide.blend", "ACEScg", check=False).stdout
    assert not said or "wide.blend: Color Management > Working Space: got ACEScg, wanted Linear Rec.709" in said


def test_a_blend_through_a_lens(blends, tmp_path):
    """The lens camera stands where the file's camera does; its field is the lens's."""
    import pecs

    common = ("--lens", "cmount_8mm_f2p8", "--stop-diameter", 2, "--focus", 4, *SMALL, "--samples", 16)
    pecs_blender("render", blends / "instances.blend", "-o", tmp_path / "s", *common)
    with pecs.StackReader(tmp_path / "s") as reader:
        frame = reader.read_frame(0)
    stack = json.loads((tmp_path / "s" / "stack.json").read_text())
    assert stack["quantity"] == "irradiance"
    assert frame[:, 24:].mean() > 3 * frame[:, :8].mean()  # floor below, nothing above


@pytest.mark.parametrize(
    "name, args, code, says",
    [
        ("missing_texture", [], 3, "gone.png"),
        ("no_camera", [], 4, "camera"),
        ("python_driver", [], 6, "--allow-scripts"),
        ("textures", ["--frames", "0"], 2, "--frames"),
        ("textures", ["--scene-name", "nowhere"], 4, "--scene-name"),
        ("textures", ["--illuminant", "../../secret"], 3, "../../secret: cannot be opened"),
        ("textures", ["--illuminant", "blackbody:12"], 4, "blackbody"),
        ("textures", ["--set", "rpm=3"], 2, "--set"),
        ("no_such_file", [], 3, "no such file"),
        ("textures", ["--frames", "100000", "--width", "8000"], 5, "disk"),
        ("disk_cache", [], 4, "'Plane': got physics with a disk cache that is not baked, wanted baked physics"),
        ("fluid", [], 4, "'Cube': got physics with a disk cache that is not baked, wanted baked physics"),
        ("late", ["--fps", "1kHz", "--frames", "2"], 4, "got times 326 us apart near frame 100000, wanted at most 250"),
    ],
)
def test_bad_input_is_one_line(blends, tmp_path, name, args, code, says):
    result = pecs_blender("render", blends / f"{name}.blend", "-o", tmp_path / "s", *SMALL, *args, check=False)
    assert result.returncode == code, result.stderr
    assert len(result.stderr.strip().splitlines()) == 1 and says in result.stderr
    assert not list(tmp_path.glob("s/frame_*"))


def test_a_missing_library_is_one_line(blends, tmp_path):
    library = blends / "groups.blend"
    library.rename(tmp_path / "moved.blend")
    try:
        result = pecs_blender("render", blends / "linked.blend", "-o", tmp_path / "s", *SMALL, check=False)
    finally:
        (tmp_path / "moved.blend").rename(library)
    assert result.returncode == 3 and "groups.blend" in result.stderr, result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


def test_no_blend_at_all(tmp_path):
    (tmp_path / "x.blend").write_text("BLENDER?")
    result = pecs_blender("render", tmp_path / "x.blend", "-o", tmp_path / "s", *SMALL, check=False)
    assert result.returncode == 4, result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


def test_a_python_driver_runs_when_asked(blends, tmp_path):
    pecs_blender("render", blends / "python_driver.blend", "-o", tmp_path / "s", *SMALL, "--allow-scripts")


def test_a_scene_whose_name_is_a_path(blends, tmp_path):
    args = (blends / "world.blend", "-o", tmp_path / "s", *SMALL, "--scene-name", "../other/scene")
    result = pecs_blender("render", *args, check=False)
    assert result.returncode == 4 and "camera" in result.stderr  # found, and it has none
    assert len(result.stderr.strip().splitlines()) == 1


def test_a_worlds_map_is_as_fine_as_its_picture(blends):
    """16 pixels here. One that a file chooses stays."""
    code = """
import bpy, sys
from pecs_blender.scene import cycles
for chosen in (False, True):
    bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
    settings = bpy.context.scene.world.cycles
    if chosen:
        settings.sampling_method, settings.sample_map_resolution = "MANUAL", 512
    cycles.configure(bpy.context.scene, 8, 8, cycles.Sampling(samples=1, seed=1, bounces={}))
    print(settings.sampling_method, settings.sample_map_resolution, flush=True)
"""
    result = in_bpy(code, blends / "world.blend")
    assert [line for line in result.stdout.splitlines() if "MANUAL" in line] == ["MANUAL 16", "MANUAL 512"]


FOREIGN = """
import sys
from pathlib import Path
import bpy
from pecs_blender.scene.blend import save_copy
from pecs_blender.scene.open import open_scene

folder = Path(sys.argv[1])
path = folder / "file.blend"
bpy.ops.wm.read_factory_settings()
bpy.context.scene["pecs_folder"] = "/etc"
bpy.context.scene.render.resolution_x = 5000
bpy.ops.wm.save_as_mainfile(filepath=str(path))
(folder / "copies").mkdir()
copy = save_copy(folder / "copies")
records = []
for file in (path, copy):
    source = open_scene(file, "d65")
    assert source.folder == folder.resolve(), source.folder
    records.append(source.record)
assert records[0] == records[1]
"""


def test_what_a_foreign_file_cannot_choose(tmp_path):
    """The folder of relative files, also in a copy; a size that no stack has, which took memory and minutes."""
    in_bpy(FOREIGN, tmp_path)
    words = ("render", tmp_path / "file.blend", "-o", tmp_path / "s", "--plan", "--bands", 1)
    result = pecs_blender(*words, "--time", "adaptive", check=False)
    line = "--width: got 5000 x 1080 pixels of 2 x 2 subpixels, wanted 4 to 8192 each way"
    assert (result.returncode, result.stderr) == (2, f"pecs_blender: {line}\n")


SETTINGS = """
import bpy, sys
from pecs_lab.blend import RED, ball, floor, lamp, material, put, save, start
for name in ("plain", "settings", "others", "mirrored"):
    scene = start()
    light, view = lamp(), scene.camera.data
    for data, key in ((light, "energy"), (view, "lens")):
        data.keyframe_insert(key, frame=1)
        setattr(data, key, 20)
        data.keyframe_insert(key, frame=10)
    glassy, tree, _ = material("glassy", ("ShaderNodeBsdfPrincipled", {"Base Color": RED, "Alpha": 0.6}))
    ball(glassy)
    layer = scene.view_layers[0]
    if name == "settings":
        for thing in scene.objects:
            thing.hide_viewport = True
            thing.keyframe_insert("hide_viewport", frame=1)
        scene.cycles.time_limit, layer.pass_alpha_threshold, scene.cycles.shading_system = 0.001, 0.9, True
        scene.cycles.use_guiding = True
        scene.driver_add("cycles.seed").driver.expression = "frame + 5"
        scene.cycles.film_exposure = 3
        scene.keyframe_insert("cycles.film_exposure", frame=1)
        animation, action = scene.animation_data, scene.animation_data.action
        animation.nla_tracks.new().strips.new("own", 1, action).action_slot = action.slots[0]
        animation.action = None
        scene.cycles.use_sample_subset, scene.cycles.sample_offset, scene.cycles.sample_subset_length = True, 1, 1
    elif name == "mirrored":
        scene.camera.scale.x = -1
    elif name == "others":
        floor(glassy)
        squeezed = put(None, name="squeezed")
        squeezed.scale = 1, 2, 1
        scene.camera.parent, scene.camera.rotation_euler.z, scene.camera.location.z = squeezed, 0.3, 0.5
        extra, second = bpy.data.collections.new("extra"), scene.view_layers.new("second")
        scene.collection.children.link(extra)
        extra.objects.link(bpy.context.object)
        scene.collection.objects.unlink(bpy.context.object)
        second.layer_collection.children["extra"].exclude, layer.use = True, False
        scene.render.use_multiview = True
        bpy.ops.object.grease_pencil_add(type="MONKEY")
    save(sys.argv[1], name)
"""


def test_settings_of_blenders_own_renders(tmp_path):
    """Samples, limits, OSL, animated seeds of the file's own renders, and what windows hide; a camera that its parent's
    scale shears, the view layer that renders, and what is left out."""
    import pecs

    in_bpy(SETTINGS, tmp_path)
    layers, words = ("depth", "normal", "objects"), {}
    found = {}
    for name in ("plain", "settings", "others"):
        done = pecs_blender(
            "render", tmp_path / f"{name}.blend", "-o", tmp_path / name, *SMALL, "--layers", ",".join(layers)
        )
        words[name] = done.stderr
        with pecs.StackReader(tmp_path / name) as reader:
            found[name] = [reader.read_frame(0), *(reader.read_layer(layer, 0) for layer in layers)]
    for plain, same in zip(found["plain"], found["settings"], strict=True):
        np.testing.assert_array_equal(same, plain)
    assert json.loads((tmp_path / "settings/stack.json").read_text())["render"]["cycles"]["use_guiding"] is False
    light, depth, _, objects = found["others"]
    seen = light[0] > 0
    assert 20 < np.count_nonzero(seen) < 0.5 * seen.size  # the ball before nothing, without the floor
    assert np.count_nonzero(seen != np.isfinite(depth[0])) <= 0.2 * np.count_nonzero(seen)  # its outline
    assert ((objects[0] > 0) == np.isfinite(depth[0])).all()
    assert "grease pencil is not rendered: 'Suzanne'" in words["others"] and "stereo is ignored" in words["others"]
    assert "ignored" not in words["plain"]
    for name, got in (("mirrored", "a negative scale, which mirrors it"), ("others", "shear by its parents' scale")):
        words = "--lens", "angenieux_100mm_f1p1", "--focus", 1, *SMALL
        done = pecs_blender("render", tmp_path / f"{name}.blend", "-o", tmp_path / "l", *words, check=False)
        assert done.returncode == 4 and f"got {got}, wanted none with a lens" in done.stderr
        assert not (tmp_path / "l/stack.json").exists()
    shown, hidden = (json.loads(pecs_blender("cameras", tmp_path / f"{n}.blend").stdout) for n in ("plain", "settings"))
    assert shown["cameras"]["camera"]["zooms"] and hidden["cameras"] == shown["cameras"]


ALEMBIC = """
import sys
import bpy
from pecs_lab.blend import ball, lamp, material, move, save, start
scene, file = start((16, 12)), sys.argv[1] + "/ball.abc"
lamp()
shaped = ball()
shaped.shape_key_add(name="rest")
key = shaped.shape_key_add(name="wide")
for point in key.data:
    point.co.x *= 2
move(key, "value", (0, 1))
bpy.ops.wm.alembic_export(filepath=file, start=1, end=3, as_background_job=False)
bpy.data.objects.remove(shaped)
bpy.ops.wm.alembic_import(filepath=file, as_background_job=False)
if bpy.app.version < (5, 0):
    bpy.data.cache_files[0].use_render_procedural, scene.cycles.feature_set = True, "EXPERIMENTAL"
save(sys.argv[1], "cached")
"""


def test_a_cache_that_cycles_would_read_itself(tmp_path):
    """It would show the first frame's shape in all frames."""
    import pecs

    in_bpy(ALEMBIC, tmp_path)
    words = (*SMALL, "--frames", 2, "--fps", 24, "--layers", "motion")
    pecs_blender("render", tmp_path / "cached.blend", "-o", tmp_path / "s", *words)
    with pecs.StackReader(tmp_path / "s") as reader:
        first, second = reader.read_frame(0)[0] > 0, reader.read_frame(1)[0] > 0
        motion = reader.read_layer("motion", 0)[6]
    assert second.sum() > 1.3 * first.sum() > 20
    assert (np.abs(motion[first]) > 0.1).mean() > 0.7
