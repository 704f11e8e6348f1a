"""Runs inside an interpreter with bpy, apart from pytest's: `python lens_render.py JOB.json OUT.npz`.

A job: {"osl": source, a list of sources (then `image` has one more axis) or null (then the built-in perspective camera,
"hfov_deg"), "scene": "white" | "corner" | "dots", "width", "height", "samples", "seed"}. OUT.npz holds `image`, linear
RGB as float32, row 0 at the bottom.
"""

import json
import math
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np
from pecs_lab import blend


def set_camera(scene, osl, job, folder):
    data = bpy.data.cameras.new("camera")
    scene.camera = blend.put(data)
    data.clip_start, data.clip_end = 1e-6, 1e5
    if osl is None:
        data.angle = math.radians(job["hfov_deg"])
        return
    import _cycles

    source, compiled = folder / "camera.osl", folder / "camera.oso"
    source.write_text(osl)
    assert _cycles.osl_compile(str(source), str(compiled)), "the shader does not compile"
    data.type, data.custom_mode = "CUSTOM", "EXTERNAL"
    try:
        data.custom_filepath = str(compiled)
    except ModuleNotFoundError:  # the wheel has no oslquery; the shader has no parameters
        pass


def emission(name, colour):
    return blend.material(name, ("ShaderNodeEmission", {"Color": (*colour, 1), "Strength": 1.0}))[0]


def build(scene, job):
    blend.world("world", (1, 1, 1, 1) if job["scene"] == "white" else (0, 0, 0, 1), 1.0)
    if job["scene"] == "corner":  # red to the upper right, green to the lower left, blue on the right
        distance, size = 2.0, 0.08
        for name, x, y, colour in (
            ("a", 0.3, 0.15, (1, 0, 0)),
            ("b", -0.3, -0.1, (0, 1, 0)),
            ("c", 0.25, -0.02, (0, 0, 1)),
        ):
            blend.floor(emission(name, colour), size, (x, y, -distance))
    if job["scene"] == "dots":  # discs at [x, y, distance], facing the camera
        white = emission("dot", (1, 1, 1))
        bpy.ops.mesh.primitive_circle_add(vertices=48, radius=job["dot_radius"], fill_type="NGON")
        disc = bpy.context.object
        disc.data.materials.append(white)
        for x, y, z in job["dots"]:
            blend.put(disc.data, (x, y, -z))
        bpy.data.objects.remove(disc)


def main(job_path, out_path):
    job = json.loads(Path(job_path).read_text())
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = job["width"], job["height"]
    scene.render.resolution_percentage = 100
    c = scene.cycles
    c.device, c.samples, c.seed = "CPU", job["samples"], job.get("seed", 1)
    c.use_adaptive_sampling = c.use_denoising = False
    c.pixel_filter_type, c.filter_width = "BOX", 1.0
    scene.view_settings.view_transform = "Raw"
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    sources = job["osl"] if isinstance(job["osl"], list) else [job["osl"]]
    images = []
    with tempfile.TemporaryDirectory() as temp:
        build(scene, job)
        for k, source in enumerate(sources):
            folder = Path(temp) / str(k)
            folder.mkdir()
            set_camera(scene, source, job, folder)
            scene.render.filepath = str(folder / "image.exr")
            bpy.ops.render.render(write_still=True)
            image = bpy.data.images.load(scene.render.filepath)
            image.colorspace_settings.name = "Non-Color"
            pixels = np.empty(job["width"] * job["height"] * image.channels, np.float32)
            image.pixels.foreach_get(pixels)
            images.append(pixels.reshape(job["height"], job["width"], -1)[..., :3])
    image = np.array(images) if isinstance(job["osl"], list) else images[0]
    np.savez(out_path, image=image)


if __name__ == "__main__":
    main(*sys.argv[1:])
