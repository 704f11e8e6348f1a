"""`pecs_blender light` and `render --lux`: the light of a .blend in lux, and what a chip makes of it."""

import json
import subprocess
import sys

import numpy as np
import pecs
import pytest
from support import in_bpy, pecs_blender

pytest.importorskip("bpy")

SCENES = """
import sys
import bpy
from pecs_lab import blend

def scene(reflects, energy, file, world=0.0):
    scene = blend.start((32, 24), (0, 0, 5), 0)
    scene.camera.data.dof.aperture_fstop = 4
    kind, colour = reflects
    values = {"Color": (*colour, 1), "Roughness": 0}
    blend.floor(blend.material("floor", (kind, values))[0], 20)
    blend.lamp("SUN", (1, 1, 1), energy).angle = 0.01
    if world:
        blend.world("sky", (world, world, world, 1))
    blend.save(sys.argv[1], file)

scene(("ShaderNodeBsdfDiffuse", (0.4, 0.2, 0.1)), 5.0, "sun")
scene(("ShaderNodeBsdfDiffuse", (0.4, 0.2, 0.1)), 5.0, "sky", 0.2)
scene(("ShaderNodeBsdfGlossy", (0.8, 0.8, 0.8)), 5.0, "mirror", 0.2)

# Balls hide parts of the sky from the floor: noise.
scene(("ShaderNodeBsdfDiffuse", (0.4, 0.2, 0.1)), 0.0, "noisy", 0.2)
for x in range(-4, 5):
    for y in range(-3, 4):
        bpy.ops.mesh.primitive_uv_sphere_add(radius=0.3, location=(x / 2, y / 2, 0.4), segments=12, ring_count=8)
        bpy.context.object.data.materials.append(bpy.data.materials["floor"])
blend.save(sys.argv[1], "noisy")

# A bright square slides over a dark floor: 2 units in 9 frames, seen from 5.
scene(("ShaderNodeBsdfDiffuse", (0.1, 0.1, 0.1)), 5.0, "slide")
bright = bpy.data.materials["floor"].copy()
bright.node_tree.nodes["Diffuse BSDF"].inputs["Color"].default_value = (0.8, 0.8, 0.8, 1)
square = blend.floor(bright, 1, (-1, 0, 0.001))
blend.move(square, "location", [(-1, 0, 0.001), (1, 0, 0.001)], (1, 10))
blend.save(sys.argv[1], "slide")
"""


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("light")
    subprocess.run([sys.executable, "-c", SCENES, folder], check=True, capture_output=True)
    return folder


def light(path, *options):
    return json.loads(pecs_blender("light", path, "--json", *options).stdout)


def lux_per_watt(illuminant="d65"):
    """Luminous efficacy of the illuminant's radiant power over its table."""
    from pecs_blender.spectral.spectra import K_CD_LM_PER_W, spectrum

    s = spectrum(illuminant, None)
    return K_CD_LM_PER_W * s.luminous() / s.power()


def test_the_sun_on_a_floor_is_its_watts(scenes):
    """5 W/m^2 from above, of which the colour of the floor takes nothing; all pixels are lit the same."""
    found = light(scenes / "sun.blend")
    assert found["lux"]["median"] == pytest.approx(5 * lux_per_watt(), rel=2e-3)
    assert found["lux"]["p5"] == pytest.approx(found["lux"]["p95"], rel=1e-2)
    lamp_a = light(scenes / "sun.blend", "--illuminant", "a", "--light-scale", "3")
    assert lamp_a["lux"]["median"] == pytest.approx(15 * lux_per_watt("a"), rel=2e-3)


def test_a_sky_of_equal_radiance_adds_pi(scenes):
    assert light(scenes / "sky.blend", "--lux", 300)["lux"]["median"] == pytest.approx(300, rel=1e-2)
    found = light(scenes / "sky.blend")
    assert found["lux"]["median"] == pytest.approx((5 + np.pi * 0.2) * lux_per_watt(), rel=5e-3)


def test_the_event_rate_is_what_the_edges_sweep(scenes):
    """Both edges sweep 1 unit wide at 2 / (9/24) units a second; each pixel there fires ln 8 / 0.2 = 10.4: 10 times."""
    found = light(scenes / "slide.blend", "--chip", "ideal", "--frames", 100, "--fps", 1000)
    pixels_per_unit = 32 / (36 / 50 * 5)
    swept = 2 * 2 / (9 / 24) * pixels_per_unit**2
    assert found["events_per_s"] == pytest.approx(10 * swept, rel=0.1)
    assert (found["events_over_s"], found["corner_hz"]) == (pytest.approx(0.099), None)
    smaller = light(scenes / "slide.blend", "--chip", "ideal", "--frames", 100, "--fps", 1000, "--width", 16)
    assert smaller["events_per_s"] == pytest.approx(10 * swept / 4, rel=0.1)
    assert light(scenes / "sky.blend", "--frames", 100)["events_per_s"] == 0  # nothing moves
    assert light(scenes / "sun.blend", "--frames", 1)["events_per_s"] is None


def test_a_mirror_is_no_light_meter(scenes):
    found = light(scenes / "mirror.blend")
    assert found["lux"] is None and found["luminance_cd_m2"]["median"] > 0
    said = pecs_blender("light", scenes / "mirror.blend").stdout
    assert "no diffuse surface" in said
    failed = pecs_blender("render", scenes / "mirror.blend", "-o", scenes / "m", "--lux", "100", check=False)
    assert failed.returncode == 4 and "--lux: got 100, wanted surfaces in view" in failed.stderr


@pytest.mark.parametrize("lens", ["none", "pecs_lab_15mm"])
def test_current_and_corner_are_those_of_a_render(scenes, tmp_path, lens):
    options = ("--lens", lens, "--chip", "davis346")
    found = light(scenes / "sky.blend", *options)
    size = ("--width", 16, "--height", 12, "--samples", 32, "--frames", 1)
    pecs_blender("render", scenes / "sky.blend", "-o", tmp_path / "s", *options, *size)
    chip = pecs.Chip("davis346")
    current = chip.photocurrent(tmp_path / "s", 0)
    middle = float(np.median(current[4:8, 5:11]))  # on the axis of the lens
    assert found["photocurrent_a"]["median"] == pytest.approx(middle, rel=0.04)
    corner = chip.corner_hz_per_a * (found["photocurrent_a"]["median"] + chip.dark_current_a)
    assert found["corner_hz"]["median"] == pytest.approx(corner, rel=1e-3)
    assert found["fnumber"] == pytest.approx(4 if lens == "none" else 4.15, abs=0.01)


def test_lux_sets_the_light(scenes, tmp_path, pecs_program):
    small = ("--width", 16, "--height", 12, "--samples", 1, "--frames", 1, "--bands", 3)
    pecs_blender("render", scenes / "sky.blend", "-o", tmp_path / "lux", "--lux", 300, *small)
    scale = json.loads((tmp_path / "lux/stack.json").read_text())["render"]["light_scale"]
    assert "\nlight        300 lux\n" in pecs_program("info", tmp_path / "lux").stdout
    again = light(scenes / "sky.blend", "--light-scale", scale)
    assert again["lux"]["median"] == pytest.approx(300, rel=5e-3)
    pecs_blender("render", scenes / "sky.blend", "-o", tmp_path / "scale", "--light-scale", scale, *small)
    with pecs.StackReader(tmp_path / "lux") as one, pecs.StackReader(tmp_path / "scale") as two:
        np.testing.assert_array_equal(one.read_frame(0), two.read_frame(0))  # the meter leaves nothing behind
    pecs_blender("render", scenes / "sky.blend", "-o", tmp_path / "lux", "--lux", 300, *small)  # continued


def test_noise_is_that_of_a_render(scenes, tmp_path):
    """The noise of the median pixel, from renders with two seeds; from 16 samples on it falls with their root, before
    it falls faster, and is measured."""
    found = light(scenes / "noisy.blend", "--samples", 16)
    small = ("--width", 32, "--height", 24, "--samples", 16, "--frames", 1, "--lens", "none", "--bands", 3)
    chip, seen = pecs.Chip("imx636"), []
    for seed in (5, 6):
        pecs_blender("render", scenes / "noisy.blend", "-o", tmp_path / f"{seed}", *small, "--seed", seed, "--quiet")
        seen.append(chip.photocurrent(tmp_path / f"{seed}", 0))
    threshold = min(chip.contrast_threshold_on, chip.contrast_threshold_off)
    lit = (seen[0] > 0) & (seen[1] > 0)
    apart = float(np.median(np.abs(np.log(seen[0][lit] / seen[1][lit]))))
    noise = apart / 0.6745 / 2**0.5 / threshold
    assert found["noise_thresholds"] == pytest.approx(noise, rel=0.15) and found["samples"] == 16
    finer, coarser = (light(scenes / "noisy.blend", "--samples", n)["noise_thresholds"] for n in (64, 4))
    assert finer == pytest.approx(found["noise_thresholds"] / 2, rel=0.01)
    assert 2 * found["noise_thresholds"] < coarser < 5 * found["noise_thresholds"]


@pytest.mark.parametrize(
    "words, says",
    [
        (("--lux", 300, "--light-scale", 2), "--lux and --light-scale exclude each other"),
        (("--lux", 300, "--no-light", "--layers", "depth"), "--lux cannot be combined with --no-light"),
        (("--lux", -1), "--lux: got -1.0, wanted a finite number above 0"),
    ],
)
def test_wrong_words(scenes, tmp_path, words, says):
    failed = pecs_blender("render", scenes / "sun.blend", "-o", tmp_path / "s", *words, check=False)
    assert failed.returncode == 2 and says in failed.stderr, failed.stderr


def test_a_folder_has_its_own(root, tmp_path):
    words = ("render", root / "scenes/rotating_disk", "-o", tmp_path / "s", "--lux", 300)
    failed = pecs_blender(*words, check=False)
    assert failed.returncode == 2 and "--set illuminance_lux" in failed.stderr


PANEL = """
import sys, time
import bpy
from pecs_blender import ui
from pecs_blender.job.brightness import light_rows
from pecs_blender.ui import background, light_probe

ui.register()
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
scene = bpy.context.scene
assert not bpy.ops.pecs.set_lux.poll()
background.start(light_probe.PECS_OT_probe_light.job(bpy.context))
while background.poll() is not None:
    time.sleep(0.02)
message = background.state.message
assert message.startswith("Illuminance: 953 lux (953–"), message
scene.pecs_light.wanted_lux = 500
assert bpy.ops.pecs.set_lux() == {"FINISHED"}
found = background.state.light[scene.name]
assert abs(scene.pecs.light_scale - 500 / found["lux"]["median"]) < 1e-5
rows = dict(light_rows(found, scene.pecs.light_scale / found["light_scale"]))
assert rows["illuminance"].startswith("500 lux"), rows
bpy.ops.wm.read_factory_settings()
assert not background.state.light
ui.unregister()
"""


def test_the_panel_probes_and_sets(scenes):
    in_bpy(PANEL, scenes / "sun.blend")
