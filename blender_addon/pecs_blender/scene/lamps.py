# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps of animated strength. Cycles renders their light apart (light groups), at one strength, so that adaptive steps
know the light at every other strength without a render: light is a sum over lamps, each times its strength."""

from __future__ import annotations

from dataclasses import dataclass, field

import bpy
import numpy as np

from ..spectral.spectral_scene import movers
from .source import Source

MOST_GROUPS = 4  # each needs as much memory and denoising as the rest of the light
SAME = 1e-3  # difference of strength, relative to the largest, below which lamps share a group or are constant


@dataclass
class Strength:
    """A property that all light of `lit_by`, objects or a world, is proportional to. movers: animate it."""

    owner: object
    key: str
    lit_by: list
    movers: list
    values: list[float] = field(default_factory=list)  # at all instants

    def read(self) -> None:
        self.values.append(getattr(self.owner, self.key))

    @property
    def largest(self) -> float:
        return float(np.max(np.abs(self.values)))

    @property
    def factors(self) -> np.ndarray:
        return np.array(self.values) / (self.largest or 1.0)

    def hold(self) -> None:
        """At the largest value, without animation."""
        for mover in self.movers:
            mover.mute = True
        if getattr(self.owner, self.key) != self.largest:  # Cycles synchronizes what is set
            setattr(self.owner, self.key, self.largest)


class Lamps:
    """names: passes of Cycles, one per group of lamps whose strengths change alike."""

    def __init__(self, source: Source, times_s: list[float]):
        """Reads the strengths at all instants, and makes the groups: before the scene's first render, since Cycles
        keeps its data."""
        self._times_s, strengths = times_s, _strengths(source) if times_s else []
        for t_s in times_s if strengths else ():
            source.set_time(t_s)
            for one in strengths:
                one.read()
        groups: list[list[Strength]] = []
        for one in (one for one in strengths if np.ptp(one.factors) > SAME):
            alike = (group for group in groups if np.allclose(group[0].factors, one.factors, rtol=0, atol=SAME))
            group = next(alike, None)
            if group is None:
                groups.append(group := [])
            group.append(one)
        self._groups = groups if len(groups) <= MOST_GROUPS else []
        self.names = tuple(f"Combined_pecs {number}" for number in range(len(self._groups)))
        for name, group in zip(self.names, self._groups, strict=True):
            name = name.removeprefix("Combined_")
            for layer in source.scene.view_layers:
                layer.lightgroups.add(name=name)
            for thing in (thing for one in group for thing in one.lit_by):
                thing.lightgroup = name

    def hold(self) -> None:
        """Each lamp has its largest strength. After every Source.set_time, which may set others."""
        for one in (one for group in self._groups for one in group):
            one.hold()

    def factors(self, t_s: float) -> np.ndarray:
        """[groups]: strengths at a time, relative to the largest."""
        return np.array([np.interp(t_s, self._times_s, group[0].factors) for group in self._groups])


def _strengths(source: Source) -> list[Strength]:
    strengths, world = [], source.scene.world
    for light in bpy.data.lights:
        objects = [thing for thing in bpy.data.objects if thing.data == light]
        changes = light.node_tree and light.node_tree.animation_data or movers(light, "color")
        by = _curves(light, "energy")
        if objects and not changes and (by or light in source.lamps):
            strengths.append(Strength(light, "energy", objects, by))
    tree = world and world.node_tree
    if tree and tree.animation_data:
        shaders = [node for node in tree.nodes if any(o.type == "SHADER" for o in node.outputs)]
        if len(shaders) == 1 and shaders[0].bl_idname == "ShaderNodeBackground":
            strength = shaders[0].inputs["Strength"]
            by = _curves(tree, f"{strength.path_from_id()}.default_value")
            if by and not strength.is_linked:
                strengths.append(Strength(strength, "default_value", [world], by))
    return strengths


def _curves(id_block: bpy.types.ID, path: str) -> list:
    """What animates a property; nothing if an NLA track does, whose strips may move others."""
    found = movers(id_block, path)
    return found if all(isinstance(mover, bpy.types.FCurve) for mover in found) else []
