"""Biases and digital stages of the panel become the options of `pecs sense`."""

from support import in_bpy

BODY = """
import bpy
from pecs_blender import ui
from pecs_blender.ui import presets, settings

ui.register()
sensor = bpy.context.scene.pecs.sensor

def words():
    found = settings.sensor_arguments(bpy.context.scene)
    return " ".join(found[found.index("--readout") + 2 :])

assert words() == ""
sensor.diff_on, sensor.diff_off = 35, -10
assert words() == "--bias diff_on=35,diff_off=-10"
sensor.diff_on = sensor.diff_off = 0
sensor.afk, sensor.trail, sensor.trail_ms, sensor.erc_mhz, sensor.mask = "stop", "stc-keep", 2.5, 20, "/tmp/m.txt"
assert words() == "--afk 50:520 --stc-keep 2.5ms --erc 20MHz --mask /tmp/m.txt"
sensor.afk, sensor.afk_low_hz, sensor.afk_high_hz, sensor.trail = "pass", 90, 110, "trail"
assert words() == "--afk-pass 90:110 --trail 2.5ms --erc 20MHz --mask /tmp/m.txt"
assert all(hasattr(sensor, key) for key in presets._SENSOR_KEYS)
"""


def test_the_panel_gives_options_of_the_program():
    in_bpy(BODY)
