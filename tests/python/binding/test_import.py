"""`import pecs` loads nothing, and pecs and bpy work in one process in either order."""

import subprocess
import sys

import pecs
import pytest


def run(code, *arguments):
    done = subprocess.run([sys.executable, "-c", code, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_import_loads_neither_numpy_nor_the_library():
    code = """import sys, pecs
from pecs import PecsError, _arguments, _command, _config, _errors, _files, _platform, _progress, program
assert not {"numpy", "scipy", "ctypes"} & set(sys.modules), sorted(sys.modules)
from pecs.stack import StackWriter
loaded = lambda: "libpecs" in open("/proc/self/maps").read()
assert not loaded()
pecs.version()
assert loaded()"""
    run(code)


def test_every_name_is_there():
    assert set(pecs.__all__) == set(" ".join(pecs._MODULES.values()).split()) and set(pecs.__all__) < set(dir(pecs))
    assert all(hasattr(pecs, name) for name in pecs.__all__)
    assert pecs.sensor.LABELS[0] == "signal" and pecs.__version__ == pecs.version()
    with pytest.raises(AttributeError, match="no attribute 'lense'"):
        pecs.lense  # noqa: B018


IMPORT_PECS = "import pecs"
CALL_PECS = """
import json
import numpy as np
from pecs.stack import StackReader, StackWriter
stack = {"pecs_stack": 1, "quantity": "irradiance", "width": 20, "height": 17, "pixel_pitch_m": 1e-5,
    "bands": [{"lambda_nm": 550, "weight_nm": 1}], "times_ns": [0, 1000000], "period_ns": None,
    "lens": None, "scene": {}, "render": {}, "versions": {}}
with StackWriter(folder, stack) as writer:
    for i in range(2):
        writer.write_frame(i, np.full((1, 17, 20), 1e-6 * (i + 1), np.float32))
assert np.allclose(StackReader(folder).read_frame(1), 2e-6, rtol=1e-3)
pecs.sense(folder, folder + "/events.raw")
"""
IMPORT_BPY = "import bpy"
CALL_BPY = """
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.mesh.primitive_monkey_add()
bpy.context.object.modifiers.new("fine", "SUBSURF").levels = 3
assert len(bpy.context.object.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.vertices) > 10000
scene = bpy.context.scene
scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
scene.collection.objects.link(scene.camera)
scene.render.engine, scene.cycles.samples, scene.cycles.device = "CYCLES", 1, "CPU"
scene.render.resolution_x = scene.render.resolution_y = 16
scene.render.image_settings.file_format, scene.render.filepath = "OPEN_EXR", folder + "/bpy.exr"
bpy.ops.render.render(write_still=True)
"""
ORDERS = {
    "bpy first": [IMPORT_BPY, IMPORT_PECS, CALL_BPY, CALL_PECS],
    "pecs first": [IMPORT_PECS, IMPORT_BPY, CALL_PECS, CALL_BPY],
    "pecs called before bpy is imported": [IMPORT_PECS, CALL_PECS, IMPORT_BPY, CALL_BPY, CALL_PECS],
    "bpy called before pecs is imported": [IMPORT_BPY, CALL_BPY, IMPORT_PECS, CALL_PECS],
}


@pytest.mark.parametrize("order", ORDERS)
def test_either_order_with_bpy(order, tmp_path):
    """A checkout's libpecs and bpy require the same libtbb.so.12: both get bpy's."""
    pytest.importorskip("bpy")
    last = """
used = {line.split()[-1] for line in open("/proc/self/maps") if "libtbb.so" in line}
print("\\n".join(used))"""
    words = run("\n".join(["import sys", "folder = sys.argv[1]", *ORDERS[order], last]), tmp_path)
    used = [line for line in words.splitlines() if "libtbb.so" in line]
    assert len(used) == 1 and "/bpy/" in used[0]
    assert (tmp_path / "events.raw").stat().st_size > 0 and (tmp_path / "bpy.exr").stat().st_size > 0
