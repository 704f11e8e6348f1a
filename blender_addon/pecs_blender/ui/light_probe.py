# SPDX-License-Identifier: GPL-3.0-or-later
"""Probe render of about a second: illuminance, photocurrent and the photoreceptor's corner; light scale for a target
illuminance."""

from __future__ import annotations

import json
from typing import Any

import bpy
from bpy.props import FloatProperty

from ..job.brightness import light_rows
from . import operators, paths, settings
from .background import BackgroundJob, state
from .interface import Edit

DIM_HZ = 100.0  # corner of the photoreceptor below which moving edges blur


class PecsLight(bpy.types.PropertyGroup):
    wanted_lux: FloatProperty(
        name="Target (lux)",
        default=500,
        min=1e-3,
        soft_max=1e5,
        precision=1,
        description="Illuminance of the median surface in view: street at night 1, corridor 100, office 500, overcast "
        "sky 10,000, sun 100,000",
    )


class PECS_OT_probe_light(operators.Renders, bpy.types.Operator):
    """Measure the illuminance in view, and the chip's photocurrent and corner frequency at this light"""

    bl_label = "Probe Light"

    @staticmethod
    def job(context) -> BackgroundJob:
        scene = context.scene
        name, used = scene.name, measured_with(scene)

        def done(job: BackgroundJob) -> str:
            line = next(line for line in job.answer if line.startswith("{"))  # among Blender's own output
            measured = json.loads(line)
            state.light[name] = measured | {"settings": used}
            return ": ".join(rows(measured)[0])

        command = operators.blender(scene, "light", None, *operators.frame_words(scene), "--json")
        return BackgroundJob("Probe Light", command, paths.stack(scene), done, for_file=True)


def measured_with(scene) -> list[str]:
    """Settings on which the answer depends; it is scaled with the light, and layers have none."""
    words = settings.render_arguments(scene)
    for name in ("--light-scale", "--layers"):
        at = words.index(name) if name in words else len(words)
        del words[at : at + 2]
    return [*words, *map(str, settings.size(scene))]


def rows(measured: dict[str, Any], scale: float = 1.0) -> list[tuple[str, str]]:
    """Labels and values of the answer."""
    return [(what.title(), value) for what, value in light_rows(measured, scale)]


class PECS_OT_set_lux(Edit, bpy.types.Operator):
    """Set the light scale for the target illuminance"""

    bl_label = "Set Light Scale"

    @classmethod
    def why_not(cls, context) -> str:
        measured = state.light.get(context.scene.name)
        if not measured:
            return "Probe the light first"
        lux = measured["lux"]
        return "" if lux and lux["median"] > 0 else "The probe found no lit surface in view"

    def act(self, context) -> None:
        measured = state.light[context.scene.name]
        wanted = context.scene.pecs_light.wanted_lux
        context.scene.pecs.light_scale = measured["light_scale"] * wanted / measured["lux"]["median"]


PROPERTIES = {(bpy.types.Scene, "pecs_light"): bpy.props.PointerProperty(type=PecsLight)}
