# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes an open scene spectral: in each pass, every colour input of a shader is replaced by its values in the pass's
three bands (docs/reference/render.md lists all nodes).

Colours are computed in RGB as in the file, and multiplied by the pass's 3x3 matrix at the shader's input: an unlinked
socket gets its value times the matrix, a linked one gets a node group in between. Custom properties name spectra:
`pecs_reflectance` (material), `pecs_emission` (material), `pecs_spectrum` (lamp, world), `pecs_glass` (material: a
glass of lens_data/glasses, or an Abbe number).

Only this process's copy changes; it is never saved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import bpy
import numpy as np
from pecs._errors import PecsError, bad_input

from .bands import BandSet
from .emitters import LUMINANCE, Emitters
from .spectra import Spectrum, glass, spectrum

# Sockets that emit; all others reflect, transmit or absorb.
EMISSION = {
    ("ShaderNodeEmission", "Color"),
    ("ShaderNodeBackground", "Color"),
    ("ShaderNodeBsdfPrincipled", "Emission Color"),
    ("ShaderNodeVolumePrincipled", "Emission Color"),
    ("ShaderNodeVolumeCoefficients", "Emission Coefficients"),
}
# Sockets that a measured reflectance replaces; tints and coats keep their colour.
BASE_COLOUR = ("Color", "Base Color")
# Vectors with one component each for red, green and blue; the matrix interpolates between them.
PER_CHANNEL = {
    ("ShaderNodeBsdfPrincipled", "Subsurface Radius"),
    ("ShaderNodeSubsurfaceScattering", "Radius"),
    ("ShaderNodeBsdfMetallic", "IOR"),
    ("ShaderNodeBsdfMetallic", "Extinction"),
    ("ShaderNodeBsdfHairPrincipled", "Absorption Coefficient"),
    ("ShaderNodeVolumeCoefficients", "Absorption Coefficients"),
    ("ShaderNodeVolumeCoefficients", "Scatter Coefficients"),
    ("ShaderNodeVolumeCoefficients", "Emission Coefficients"),
}
REFRACTIVE = ("ShaderNodeBsdfGlass", "ShaderNodeBsdfRefraction", "ShaderNodeBsdfPrincipled")


def band_matrix(bands: BandSet, lamp: Spectrum | None) -> np.ndarray:
    """[3, 3]: values in three bands = matrix @ linear Rec. 709. lamp: whose light is coloured."""
    return bands.filtered(lamp) if lamp else bands.srgb()


@dataclass(frozen=True)
class ColourRole:
    """Meaning of a colour: it reflects (no emitter) or emits with a spectrum. `reflectance` replaces the colour by a
    measured one; `named` keeps only its luminance, the spectrum is the emitter's."""

    emitter: float | str | None = None
    named: bool = False
    reflectance: Spectrum | None = None
    strength: float = 1.0

    def matrix(self, bands: BandSet, emitters: Emitters) -> np.ndarray:
        if self.emitter is None:
            return self.strength * band_matrix(bands, None)
        rows = np.tile(LUMINANCE, (3, 1)) if self.named else band_matrix(bands, emitters.spectrum(self.emitter))
        return self.strength * emitters.relative(self.emitter, bands)[:, None] * rows


@dataclass(frozen=True)
class Linked:
    """A colour that nodes compute. node: the last of them; owner: the shader's socket. dark: as in Constant."""

    node: object
    owner: object
    role: ColourRole
    dark: bool


@dataclass
class Constant:
    """A colour property. base: its value in the file, at the current time if animated. dark: of an emission without
    strength."""

    owner: object
    key: str
    role: ColourRole
    base: np.ndarray
    movers: list
    dark: bool = False

    def read(self) -> None:
        self.base = np.array(getattr(self.owner, self.key)[:3])

    def write(self, rgb) -> None:
        value = getattr(self.owner, self.key)
        setattr(self.owner, self.key, (*rgb, value[3]) if len(value) == 4 else tuple(rgb))


class SpectralScene:
    """Rewrites all materials, lamps and worlds of bpy.data. illuminant: spectrum of emitters that name none. folder: of
    relative CSV paths. unit_m: metres per unit of coordinates; the power of lamps in watts scales with its square."""

    def __init__(self, illuminant: Spectrum, folder, unit_m: float = 1.0):
        self.emitters = Emitters(illuminant)
        self.approximated: list[str] = []
        self.emitting: list[str] = []  # materials
        self._folder, self._unit_m = folder, unit_m
        self.constants: list[Constant] = []
        self.linked: list[Linked] = []
        self._groups: dict[ColourRole, bpy.types.NodeTree] = {}
        self._glasses: list[tuple[object, Callable[[float], float]]] = []
        self._bands: BandSet | None = None  # that colours have now
        groups = [group for group in bpy.data.node_groups if group.bl_idname == "ShaderNodeTree"]
        for material in bpy.data.materials:
            if material.users > material.use_fake_user:
                self._material(material)
        for light in bpy.data.lights:
            self._light(light)
        for world in bpy.data.worlds:
            self._world(world)
        for group in groups:  # last: materials copy groups before they change
            self._tree(group, _Named(group))
        if not self.emitters.spectra:
            self.emitters.add(illuminant)

    # Per instant and per pass

    def before_instant(self) -> None:
        """Enables the animation of colours; `after_instant` reads them and disables it."""
        for constant in self.constants:
            for mover in constant.movers:
                mover.mute = False

    def after_instant(self) -> None:
        for constant in self.constants:
            if constant.movers:
                self._bands = None
                constant.read()
                for mover in constant.movers:
                    mover.mute = True

    def set_pass(self, bands: BandSet) -> None:
        """bands: of the red, green and blue channels."""
        if bands is self._bands:
            return  # Blender and Cycles would evaluate all materials again
        self._bands, matrices = bands, {}
        for constant in self.constants:
            role = constant.role
            if role.reflectance:
                constant.write(bands.reflectance(role.reflectance))
                continue
            if role not in matrices:
                matrices[role] = role.matrix(bands, self.emitters)
            constant.write(matrices[role] @ constant.base)
        for role, group in self._groups.items():
            for channel, row in zip("rgb", role.matrix(bands, self.emitters), strict=True):
                group.nodes[channel].inputs[1].default_value = row
        for socket, index in self._glasses:
            socket.default_value = index(float(np.mean(bands.lambda_nm)))

    # Finding the colours

    def _material(self, material) -> None:
        reflectance = self._spectrum(material, "pecs_reflectance")
        named = _Named(material, reflectance, self._spectrum(material, "pecs_emission"), material.get("pecs_glass"))
        if material.use_nodes and material.node_tree:
            self._tree(material.node_tree, named)
        else:
            self._constant(material, "diffuse_color", material, ColourRole(reflectance=reflectance))

    def _light(self, light) -> None:
        own = self._spectrum(light, "pecs_spectrum")
        role = ColourRole(self._emitter(own), named=own is not None)
        if not own and getattr(light, "use_temperature", False):
            role = ColourRole(self._emitter(spectrum(f"blackbody:{light.temperature:g}")))
        if getattr(light, "use_temperature", False):
            light.use_temperature = False
            if movers(light, "temperature"):
                self.approximated.append(f"{light.name}: animated temperature: that of the first frame")
        if light.use_nodes and light.node_tree and not own:
            for socket in [n.inputs["Color"] for n in light.node_tree.nodes if n.bl_idname == "ShaderNodeEmission"]:
                if socket.is_linked and (source := _blackbody(socket.links[0].from_node)):
                    _unlink(light.node_tree, socket)
                    socket.default_value = (1.0, 1.0, 1.0, 1.0)
                    role = ColourRole(self._emitter(spectrum(source)))
        # Strength is per area of a sun, and of lamps whose size changes their power; that of others is in watts.
        per_area = light.type == "SUN" or not (light.normalize or getattr(light, "shadow_soft_size", 1.0) == 0)
        strength = 1.0 if per_area else self._unit_m**-2
        self._constant(light, "color", light, replace(role, strength=strength))
        if light.use_nodes and light.node_tree:  # filters in front of the lamp's own spectrum
            self._tree(light.node_tree, _Named(light, filters=True))

    def _world(self, world) -> None:
        own = self._spectrum(world, "pecs_spectrum")
        if world.use_nodes and world.node_tree:
            self._tree(world.node_tree, _Named(world, emission=own))
        else:
            self._constant(world, "color", world, ColourRole(self._emitter(own), named=own is not None))

    def _tree(self, tree, named: _Named) -> None:
        for node in list(tree.nodes):
            if node.bl_idname == "ShaderNodeGroup":
                if named.differs and node.node_tree:  # closures inside have this ID's spectra
                    node.node_tree = node.node_tree.copy()
                    self._tree(node.node_tree, named)
            elif any(o.type == "SHADER" for o in node.outputs):
                self._shader(tree, node, named)
            self._bare_colours(tree, node, named)

    def _shader(self, tree, node, named) -> None:
        for socket in node.inputs:
            key = (node.bl_idname, socket.name)
            if socket.type == "RGBA" or key in PER_CHANNEL:
                self._socket(tree, socket, self._role(key, named, _is_dark(node)), named)
            elif socket.name == "IOR" and node.bl_idname in REFRACTIVE and named.glass is not None:
                _unlink(tree, socket)
                self._glasses.append((socket, glass(named.glass, socket.default_value)))
        self.approximated += beyond_reach(node, named.owner.name)

    def _role(self, key, named, dark: bool = False) -> ColourRole:
        if key in EMISSION:
            if named.filters:
                return ColourRole()
            if isinstance(named.owner, bpy.types.Material) and not dark and named.owner.name not in self.emitting:
                self.emitting.append(named.owner.name)
            return ColourRole(self._emitter(named.emission, dark), named=named.emission is not None)
        return ColourRole(reflectance=named.reflectance if key[1] in BASE_COLOUR else None)

    def _socket(self, tree, socket, role, named) -> None:
        if role.reflectance:
            _unlink(tree, socket)
        if not socket.is_linked or socket.links[0].is_muted:
            self._constant(socket, "default_value", tree, role)
            return
        link = socket.links[0]
        if role.emitter is not None and not role.named and (own := _blackbody(link.from_node)):
            _unlink(tree, socket)
            socket.default_value = (1.0, 1.0, 1.0, 1.0)  # as bright as Blender's, whose luminance is 1
            self._constant(socket, "default_value", tree, ColourRole(self._emitter(spectrum(own)), named=True))
            return
        self._insert(tree, link, role)

    def _bare_colours(self, tree, node, named) -> None:
        """A colour linked to a shader socket emits."""
        for socket in node.inputs:
            if socket.type == "SHADER":
                for link in socket.links:
                    if link.from_socket.type != "SHADER":
                        role = ColourRole() if named.filters else self._role(("ShaderNodeEmission", "Color"), named)
                        self._insert(tree, link, role)

    def _insert(self, tree, link, role) -> None:
        from_socket, to_socket = link.from_socket, link.to_socket
        self.linked.append(Linked(link.from_node, to_socket, role, _emits_nothing(role, to_socket)))
        node = tree.nodes.new("ShaderNodeGroup")
        node.node_tree = self._group(role)
        tree.links.new(from_socket, node.inputs[0])
        tree.links.new(node.outputs[0], to_socket)

    def _group(self, role) -> bpy.types.NodeTree:
        if role not in self._groups:
            group = bpy.data.node_groups.new("pecs band matrix", "ShaderNodeTree")
            group.interface.new_socket("Color", in_out="INPUT", socket_type="NodeSocketColor")
            group.interface.new_socket("Color", in_out="OUTPUT", socket_type="NodeSocketColor")
            inside, outside = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
            combine = group.nodes.new("ShaderNodeCombineColor")
            for index, channel in enumerate("rgb"):
                dot = group.nodes.new("ShaderNodeVectorMath")
                dot.operation, dot.name = "DOT_PRODUCT", channel
                group.links.new(inside.outputs[0], dot.inputs[0])
                group.links.new(dot.outputs["Value"], combine.inputs[index])
            group.links.new(combine.outputs[0], outside.inputs[0])
            self._groups[role] = group
        return self._groups[role]

    def _constant(self, owner, key, id_block, role) -> None:
        path = key if isinstance(owner, bpy.types.ID) else f"{owner.path_from_id()}.{key}"
        constant = Constant(owner, key, role, np.zeros(3), movers(id_block, path), _emits_nothing(role, owner))
        constant.read()
        self.constants.append(constant)

    def _spectrum(self, owner, key) -> Spectrum | None:
        value = owner.get(key)
        if value is None:
            return None
        if not isinstance(value, (str, int, float)):
            raise bad_input(owner.name, key, value, "a number, a CSV file or a name in lens_data/spectra")
        if isinstance(value, str) and value.startswith("//"):
            value = bpy.path.abspath(value, library=owner.library)
        try:
            return spectrum(value if isinstance(value, str) else float(value), self._folder)
        except PecsError as e:
            raise PecsError(f"{owner.name}: {key}: {e}", e.code) from None

    def _emitter(self, s: Spectrum | None, dark: bool = False) -> float | str:
        s = s or self.emitters.illuminant
        self.emitters.add(s, dark)
        return s.source


@dataclass(frozen=True)
class _Named:
    """Spectra that an ID names for its node tree. filters: the tree of a lamp, whose light has its spectrum already."""

    owner: object
    reflectance: Spectrum | None = None
    emission: Spectrum | None = None
    glass: str | float | None = None
    filters: bool = False

    @property
    def differs(self) -> bool:
        return bool(self.reflectance or self.emission or self.glass is not None or self.filters)


def beyond_reach(node, owner: str) -> list[str]:
    """Parts of a shader node that are not made spectral."""
    kinds = []
    if node.bl_idname == "ShaderNodeVolumePrincipled":
        blackbody = node.inputs["Blackbody Intensity"]
        if blackbody.default_value > 0 or blackbody.is_linked:
            kinds.append("blackbody of a principled volume")
    if node.bl_idname == "ShaderNodeBsdfHairPrincipled" and node.parametrization == "MELANIN":
        kinds.append("melanin")
    film = node.inputs.get("Thin Film Thickness")
    if film and (film.default_value > 0 or film.is_linked):
        kinds.append("thin film")
    return [f"{owner}: {node.name}: {kind}: RGB used as bands" for kind in kinds]


def _emits_nothing(role: ColourRole, owner) -> bool:
    """The colour is of an emission without strength."""
    return role.emitter is not None and isinstance(owner, bpy.types.NodeSocket) and _is_dark(owner.node)


def _is_dark(node) -> bool:
    """A shader whose emission has the constant strength 0, as a principled one has by default."""
    strength = next((node.inputs[n] for n in ("Emission Strength", "Strength") if n in node.inputs), None)
    if strength is None or strength.is_linked or strength.default_value:
        return False
    return not is_animated(node.id_data)


def _unlink(tree, socket) -> None:
    for link in list(socket.links):
        tree.links.remove(link)


def _blackbody(node) -> str | None:
    """A blackbody node of constant temperature, as a spectrum's name."""
    if node.bl_idname != "ShaderNodeBlackbody" or node.inputs[0].is_linked:
        return None
    return f"blackbody:{min(max(node.inputs[0].default_value, 800.0), 12000.0):g}"  # the range of Cycles


def is_animated(id_block) -> bool:
    """Whether anything animates any of its properties."""
    animation = id_block.animation_data
    return bool(animation and (animation.action or animation.drivers or animation.nla_tracks))


def movers(id_block, path: str) -> list:
    """Drivers, curves and NLA tracks that animate a property; each has `mute`."""
    animation = id_block.animation_data
    if not animation:
        return []
    curves = [*animation.drivers, *_slot_curves(animation.action, animation.action_slot)]
    tracks = animation.nla_tracks if animation.use_nla else ()
    moving = [curve for curve in curves if curve.data_path == path]
    moving += [track for track in tracks if any(_strip_moves(strip, path) for strip in track.strips)]
    return [mover for mover in moving if not mover.mute]


def curves(id_block) -> list:
    """All drivers and curves that animate it, those of NLA strips included."""
    if not (animation := id_block.animation_data):
        return []
    found, strips = [*animation.drivers, *_slot_curves(animation.action, animation.action_slot)], []
    for track in animation.nla_tracks:
        strips += track.strips
    for strip in strips:  # the loop appends to it
        strips += strip.strips  # of a meta strip
        found += _slot_curves(strip.action, strip.action_slot)
    return found


def _slot_curves(action, slot) -> list:
    """Curves of one slot; `action.fcurves` are those of the first slot only."""
    if not action or not slot:
        return []
    bags = (strip.channelbag(slot) for layer in action.layers for strip in layer.strips)
    return [curve for bag in bags if bag for curve in bag.fcurves]


def _strip_moves(strip, path) -> bool:
    inside = any(_strip_moves(s, path) for s in strip.strips)  # of a meta strip
    return inside or any(curve.data_path == path for curve in _slot_curves(strip.action, strip.action_slot))
