# SPDX-License-Identifier: GPL-3.0-or-later
"""The colours of a spectral scene's surfaces and lamps, from which its bands follow (bands.py)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from itertools import product

import bpy
import numpy as np

from .bands import Bands, Chosen, Colours, at_points, means
from .emitters import LUMINANCE
from .spectra import srgb_reflectances
from .spectral_scene import BASE_COLOUR, PER_CHANNEL, ColourRole, SpectralScene

MOST_SURFACES = 96  # the most frequent colours of a scene
MOST_TEXELS = 4096  # of a texture
LEVELS = 8  # of a texture's channels, as the cube root of light
BLACK = 1e-3  # reflectance below which a surface does not count
UNKNOWN = tuple(rgb for rgb in product((0.05, 0.75), repeat=3) if len(set(rgb)) > 1)  # of nodes that give any colour
GREY_NODES = {
    "ShaderNodeTexWave",
    "ShaderNodeTexGabor",
    "ShaderNodeTexGradient",
    "ShaderNodeMapRange",
    "ShaderNodeMath",
}

Rgb = tuple[float, float, float]
Shares = list[tuple[Rgb, float]]  # colours with their shares, of sum 1


def choose(bands: Bands, scene: SpectralScene) -> Chosen:
    if bands.placement == "means":
        return means(bands.chip, bands.count, colours(scene), bands.min_nm, bands.max_nm, bands.tolerance)
    lamps = scene.emitters.mean_pairs()
    return at_points(bands.chip, bands.count, bands.placement, lamps, bands.min_nm, bands.max_nm)


def words(chosen: Chosen, pass_count: int) -> str:
    count = len(chosen.entries)
    return (
        f"{count} band{'s' * (count > 1)} in {pass_count} pass{'es' * (pass_count > 1)}; estimated error of "
        f"ln(photocurrent) {100 * chosen.rms:.2f} % RMS, {100 * chosen.largest:.2f} % at most"
    )


def colours(scene: SpectralScene) -> Colours:
    """Every material's colour counts once. Lamps share the light by kind (lamps in watts, suns, world, surfaces), and
    within a kind by power."""
    surfaces: Counter = Counter()
    lamps: dict[str, Counter] = {}
    for owner, role, is_base, rgb_shares in _seen(scene):
        if role.reflectance:
            surfaces[role.reflectance.source, None] += 1
        elif role.emitter is None:
            for rgb, share in rgb_shares:
                if max(rgb) > BLACK and (is_base or max(rgb) - min(rgb) > BLACK):
                    surfaces[None, rgb] += share
        else:
            kind, power = _kind_and_power(owner)
            for rgb, share in rgb_shares:
                shown = None if role.named else rgb
                lamps.setdefault(kind, Counter())[role.emitter, shown] += power * share * float(LUMINANCE @ rgb)
    if not lamps or not any(power for kind in lamps.values() for power in kind.values()):
        lamps = {"illuminant": Counter({(scene.emitters.illuminant.source, None): 1.0})}
    kinds = [Counter({key: p / kind.total() for key, p in kind.items()}) for kind in lamps.values() if kind.total() > 0]
    shares = sum(kinds, Counter())
    by_source = {c.role.reflectance.source: c.role.reflectance for c in scene.constants if c.role.reflectance}
    most = surfaces.most_common(MOST_SURFACES) or [((None, (0.5, 0.5, 0.5)), 1)]
    return Colours(
        [by_source[source].reflectance if rgb is None else partial(_of_rgb, rgb) for (source, rgb), _ in most],
        np.array([count for _, count in most], float),
        [_lamp(scene, source, rgb) for source, rgb in shares],
        np.array(list(shares.values())),
    )


def _of_rgb(rgb: Rgb, nm: np.ndarray) -> np.ndarray:
    return srgb_reflectances(nm) @ rgb


def _lamp(scene: SpectralScene, source: float | str, rgb: Rgb | None) -> Callable[[np.ndarray], np.ndarray]:
    """Power at luminance 1."""
    if rgb is None:
        return partial(scene.emitters.power, source)
    return lambda nm: scene.emitters.power(source, nm) * _of_rgb(rgb, nm) / float(LUMINANCE @ rgb)


def _seen(scene: SpectralScene) -> Iterator[tuple[object, ColourRole, bool, Shares]]:
    """Owner, role, whether it is a base colour, and the colours themselves."""
    for constant in scene.constants:
        owner, node = constant.owner, getattr(constant.owner, "node", None)
        if node and (node.bl_idname, owner.name) in PER_CHANNEL or constant.dark:
            continue
        rgb = tuple(float(c) for c in np.clip(constant.base, 0, None))
        yield owner, constant.role, not node or owner.name in BASE_COLOUR, [(rgb, 1.0)]
    for linked in scene.linked:
        socket = linked.owner
        if (socket.node.bl_idname, socket.name) not in PER_CHANNEL and not linked.dark:
            yield socket, linked.role, socket.name in BASE_COLOUR, _shares(_upstream(linked.node))


def _kind_and_power(owner) -> tuple[str, float]:
    if isinstance(owner, bpy.types.Light):
        return ("sun" if owner.type == "SUN" else "lamp"), owner.energy
    node = getattr(owner, "node", None)
    is_world = isinstance(owner, bpy.types.World) or node and node.bl_idname == "ShaderNodeBackground"
    return ("world" if is_world else "surface"), 1.0


def _shares(parts: list[np.ndarray]) -> Shares:
    """parts: [n, 3] each, of equal weight. Similar colours become one."""
    total: Counter = Counter()
    for rgb in parts:
        levels = np.round(np.cbrt(np.clip(rgb, 0, 1)) * LEVELS).astype(int)
        for level, count in Counter(map(tuple, levels.tolist())).items():
            total[tuple((v / LEVELS) ** 3 for v in level)] += count / len(levels) / len(parts)
    return list(total.items())


def _upstream(node, depth: int = 0) -> list[np.ndarray]:
    """Colours that a node may give, as far as its textures, ramps and constants show."""
    kind = node.bl_idname
    if kind in ("ShaderNodeTexImage", "ShaderNodeTexEnvironment"):
        return [_texels(node.image)]
    if kind == "ShaderNodeValToRGB":
        return [np.array([element.color[:3] for element in node.color_ramp.elements])]
    if kind == "ShaderNodeRGB":
        return [np.array([node.outputs[0].default_value[:3]])]
    if kind == "ShaderNodeBlackbody" or kind in GREY_NODES:
        return [np.full((1, 3), 0.5)]
    if kind in ("ShaderNodeAttribute", "ShaderNodeVertexColor"):
        return [_painted(node.attribute_name if kind == "ShaderNodeAttribute" else node.layer_name)]
    inputs = [s for s in node.inputs if s.enabled and s.type == "RGBA"]
    if not inputs or depth > 16:
        return [np.array(UNKNOWN)]
    parts = [
        _upstream(s.links[0].from_node, depth + 1) if s.is_linked else [np.array([s.default_value[:3]])] for s in inputs
    ]
    return [rgb for one in parts for rgb in one]


def _texels(image) -> np.ndarray:
    if not image or image.source not in ("FILE", "GENERATED") or not image.size[0]:
        return np.array(UNKNOWN)
    had_data, channels = image.has_data, image.channels
    values = np.empty(image.size[0] * image.size[1] * channels, np.float32)
    image.pixels.foreach_get(values)
    texels = values.reshape(-1, channels)[:: max(1, values.size // channels // MOST_TEXELS)].astype(float)
    if not had_data:
        image.buffers_free()
    rgb = texels[:, :3] if channels >= 3 else np.repeat(texels[:, :1], 3, axis=1)
    if not image.is_float and image.colorspace_settings.name == "sRGB":  # IEC 61966-2-1
        rgb = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return rgb


def _painted(name: str) -> np.ndarray:
    """Colours of the meshes' attribute of this name."""
    parts = []
    for mesh in bpy.data.meshes:
        attribute = mesh.color_attributes.get(name) if name else mesh.color_attributes.active_color
        if attribute and len(attribute.data):
            values = np.empty(4 * len(attribute.data), np.float32)
            attribute.data.foreach_get("color", values)
            parts.append(values.reshape(-1, 4)[:: max(1, len(values) // 4 // MOST_TEXELS), :3])
    return np.concatenate(parts).astype(float) if parts else np.array(UNKNOWN)
