"""The recipe of docs/start/own_objects.md, smaller, with models and a sky that Blender makes."""

import json
import re
from functools import partial

import numpy as np
import pytest
from support import ROOT, in_bpy, run_module
from support.faults import refused

pytest.importorskip("bpy", reason="renders with Cycles")

from pecs.datasets import Sequence

dataset = partial(run_module, "pecs.datasets", check=False)
PAGE = (ROOT / "docs/start/own_objects.md").read_text()
SMALL = (
    ("duration_s = 0.5", "duration_s = 0.05"),
    ("count = { choice = [3, 4, 5] }", "count = 3"),
    ('chip = "davis346"', 'chip = "davis346"\nwidth = 48\nheight = 32'),
)
RENDER = '[render]\nbands = 3\nsamples = 2\nfps = 80\ntime = "uniform"\n[truth]\nfps = 40\n'
MODELS = """
import os, sys
import bpy
import numpy as np
from pecs_lab import blend
folder = sys.argv[1]
for name in ("models", "skies"):
    os.makedirs(f"{folder}/{name}")
for name, make in (("cone.glb", bpy.ops.mesh.primitive_cone_add), ("monkey.obj", bpy.ops.mesh.primitive_monkey_add)):
    blend.start()
    make()
    red = {"Base Color": (0.8, 0.02, 0.02, 1)}
    bpy.context.object.data.materials.append(blend.material("red", ("ShaderNodeBsdfPrincipled", red))[0])
    write = bpy.ops.export_scene.gltf if name.endswith("glb") else bpy.ops.wm.obj_export
    write(filepath=f"{folder}/models/{name}")
image = bpy.data.images.new("sky", 64, 32, float_buffer=True)
pixels = np.full((32, 64, 4), 0.5, np.float32)
pixels[24:27, 40:43, :3] = 50
image.pixels.foreach_set(pixels.ravel())
image.filepath_raw, image.file_format = f"{folder}/skies/sky.hdr", "HDR"
image.save()
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("things")
    in_bpy(MODELS, folder)
    text = re.search("```toml\n(.*?)```", PAGE, re.DOTALL)[1]
    for old, new in SMALL:
        assert old in text
        text = text.replace(old, new)
    (folder / "things.toml").write_text(text + RENDER)
    return folder


@pytest.fixture(scope="module")
def made(folder):
    done = dataset(folder / "things.toml", "-o", folder / "set", "--only", 0)
    assert done.returncode == 0, done.stderr
    return folder / "set/sequences/0000"


def test_the_recipe_of_the_page(made):
    sequence, info = Sequence(made), json.loads((made / "sequence.json").read_text())
    camera, drawn = sequence.cameras["left"], info["drawn"]
    assert 500 <= drawn["sky"]["lux"] <= 20000 and len(drawn["place"]) == 3
    assert {o["class"] for o in camera.truth.objects} <= {"floor", "cone", "monkey"}
    flow = json.loads((made / "checks.json").read_text())["cameras"]["left"]["flow"]
    assert flow["count"] > 1000 and flow["rms_px"] < 0.02, flow
    poses = camera.truth.object_poses(0)
    names = {o["name"]: o["id"] for o in camera.truth.objects}
    for number, thing in enumerate(drawn["place"]):
        name = f"{thing['class']}_{number:03d}"
        if name in names and names[name] in poses:
            assert np.abs(poses[names[name]][:3, 3] - thing["position_m"]).max() < thing["size_m"]
    assert not (made / "place.json").exists()


def test_files_of_models_and_skies_count(folder, made):
    """A changed material of the .obj, or another sky, is another sequence."""
    used = json.loads((made / "drawn.json").read_text())["files"]
    assert "skies/sky.hdr" in used
    material = folder / "models/monkey.mtl"
    text = material.read_text()
    for path, changed in ((folder / "skies/sky.hdr", None), (material, text.replace("Kd 0.8", "Kd 0.2"))):
        before = path.read_bytes()
        if changed is None:
            path.write_bytes(before[:-1] + bytes([before[-1] ^ 1]))
        elif any("monkey" in name for name in used):
            path.write_text(changed)
        else:
            continue
        refused(dataset(folder / "things.toml", "-o", folder / "set", "--only", 0), 5, "changed since it was made")
        path.write_bytes(before)


@pytest.mark.parametrize(
    ("old", "new", "code", "line"),
    [
        ('files = "skies"', 'files = "models"', 4, "sky.files: got models: no file, wanted a folder or a pattern of"),
        ('files = "models"', 'files = "nosuch"', 4, "place[0].files: got nosuch: no file, wanted a folder"),
        ('files = "models"', 'files = "models"\nup = "z"', 4, "place[0].up: got an axis for models/cone.glb"),
        ('files = "models"', 'files = "models"\nunit_m = 2', 4, "place[0].unit_m: got"),
        ('files = "models"', 'files = "models"\nclass = "a"\nclass_by = "folder"', 4, "place[0].class_by: got"),
        ("lux = { log = [500, 20000] }", "lux = 0", 4, "sky.lux: got 0"),
        ('path = "stage"', 'path = "nosuch"', 4, "path: got"),
    ],
)  # fmt: skip
def test_wrong_keys_are_one_line(folder, old, new, code, line):
    text = (folder / "things.toml").read_text()
    assert old in text
    (folder / "wrong.toml").write_text(text.replace(old, new, 1))
    done = dataset(folder / "wrong.toml", "-o", folder / "none", "--plan")
    refused(done, code, line)


def test_what_fits_nowhere_ends_before_the_render(folder):
    text = (folder / "things.toml").read_text()
    (folder / "wide.toml").write_text(text.replace("size_m = [0.3, 0.8]", "size_m = 50"))
    done = dataset(folder / "wide.toml", "-o", folder / "none", "--only", 0)
    said = [line for line in done.stderr.splitlines() if not line.startswith("dataset: ")]
    assert done.returncode == 4 and len(said) == 1 and "scene stage.place: object 0" in said[0], done.stderr
    assert not list((folder / "none").glob("sequences/*/*/stack"))
