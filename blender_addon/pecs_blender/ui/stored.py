# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of the panel that a .blend contains, for a data set of it (`pecs_blender cameras`)."""

from __future__ import annotations

import argparse
from typing import Any

import bpy

from ..job.options import add_argument
from . import add, preferences, settings

OTHERWISE = {"chip", "fnumber", "focus_m", "light_scale"}  # keys of a recipe elsewhere than in [render]
NO_KEYS = {"film_width_mm", "film_shift_mm", "min_nm", "max_nm", "moving_px", "seed", "threads"}


def stored(scene: bpy.types.Scene) -> dict[str, Any] | None:
    """By the keys of a recipe; None if the panel was never used. left_out: settings that a recipe has no key for."""
    if not hasattr(bpy.types.Scene, "pecs"):
        for module in (preferences, settings):
            add(module)
    if not scene.is_property_set("pecs"):
        return None
    panel = scene.pecs
    parser = argparse.ArgumentParser()
    words: list[str] = []
    for name in settings.SHOWN:
        add_argument(parser, name)
        words += settings.words(scene, name) if panel.is_property_set(name) else []
    given = {k: v for k, v in vars(parser.parse_args(words)).items() if v != parser.get_default(k)}
    sensor, known = panel.sensor, settings.parameters(panel)
    biases = {name: getattr(sensor, name) for name in ("diff_on", "diff_off") if getattr(sensor, name)}
    return {
        **{key: value for key, value in given.items() if key in OTHERWISE},
        "chip": panel.chip,
        "lens": panel.lens if settings.has_lens(panel) else "none",
        "render": {key: value for key, value in given.items() if key not in OTHERWISE | NO_KEYS},
        "sensor": {"preset": sensor.preset} if sensor.preset else {"model": sensor.model},
        "set": {o.name: float(o.value) for o in sensor.overrides if known.get(o.name, {}).get("of") == "chip"},
        "bias": biases,
        "left_out": sorted(given.keys() & NO_KEYS),
    }
