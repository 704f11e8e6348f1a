"""Twelve .blend files that together use every kind of colour socket, and others (with bpy):
`python blend_files.py FOLDER [NAME...]`."""

import math
import sys
from pathlib import Path

import bpy
from pecs_lab import blend
from pecs_lab.blend import BLUE, GREEN, GREY, RED, ball, box, floor, lamp, material, put


def closures():
    """Every surface closure with constant colours, and materials without nodes."""
    lamp("AREA", energy=100)
    kinds = [
        [("ShaderNodeBsdfDiffuse", {"Color": RED})],
        [("ShaderNodeBsdfAnisotropic", {"Color": GREEN})],
        [("ShaderNodeBsdfGlass", {"Color": BLUE})],
        [("ShaderNodeBsdfRefraction", {"Color": RED})],
        [("ShaderNodeBsdfTranslucent", {"Color": GREEN}), ("ShaderNodeBsdfTransparent", {"Color": RED})],
        [("ShaderNodeBsdfSheen", {"Color": BLUE}), ("ShaderNodeBsdfToon", {"Color": RED})],
        [("ShaderNodeSubsurfaceScattering", {"Color": RED, "Radius": (1, 0.2, 0.1), "Scale": 0.1})],
        [("ShaderNodeBsdfMetallic", {"Base Color": RED, "Edge Tint": GREEN})],
        [("ShaderNodeBsdfPrincipled", {"Base Color": RED, "Coat Weight": 1, "Coat Tint": GREEN, "Sheen Weight": 1,
                                       "Sheen Tint": BLUE, "Specular Tint": GREEN, "Subsurface Weight": 0.3})],
        [("ShaderNodeBsdfPrincipled", {"Base Color": GREEN, "Transmission Weight": 0.8, "Roughness": 0.2})],
    ]  # fmt: skip
    for i, kind in enumerate(kinds):
        ball(material(f"m{i}", *kind)[0], (-1.6 + 0.8 * (i % 5), (i // 5) * 1.0, 0.4), 0.38)
    plain = bpy.data.materials.new("no nodes")
    plain.use_nodes = False
    plain.diffuse_color = (0.3, 0.6, 0.2, 1)
    floor(plain)


def textures():
    """Image texture (packed), vertex colours, procedural textures, colour ramps and mix chains."""
    lamp("SUN", energy=3)
    image = bpy.data.images.new("checks", 8, 8)
    image.pixels = [v for i in range(64) for v in ((0.9, 0.1, 0.3, 1) if (i + i // 8) % 2 else (0.1, 0.6, 0.8, 1))]
    image.pack()
    m, tree, _ = material("image", ("ShaderNodeBsdfPrincipled", {}))
    picture, noise, ramp = (tree.nodes.new(f"ShaderNode{k}") for k in ("TexImage", "TexNoise", "ValToRGB"))
    picture.image = image
    mix = tree.nodes.new("ShaderNodeMix")
    mix.data_type, mix.blend_type = "RGBA", "MULTIPLY"
    mix.inputs["Factor"].default_value = 0.7
    ramp.color_ramp.elements[0].color, ramp.color_ramp.elements[1].color = RED, BLUE
    tree.links.new(noise.outputs["Fac"], ramp.inputs["Fac"])
    tree.links.new(picture.outputs["Color"], mix.inputs[6])
    tree.links.new(ramp.outputs["Color"], mix.inputs[7])
    hue = tree.nodes.new("ShaderNodeHueSaturation")
    hue.inputs["Hue"].default_value = 0.6
    tree.links.new(mix.outputs[2], hue.inputs["Color"])
    tree.links.new(hue.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    floor(m)
    m2, tree, _ = material("vertex", ("ShaderNodeBsdfDiffuse", {}))
    attribute = tree.nodes.new("ShaderNodeAttribute")
    attribute.attribute_name = "paint"
    tree.links.new(attribute.outputs["Color"], tree.nodes["Diffuse BSDF"].inputs["Color"])
    thing = ball(m2)
    paint = thing.data.color_attributes.new("paint", "FLOAT_COLOR", "POINT")
    for i, item in enumerate(paint.data):
        item.color = (i % 7 / 7, i % 5 / 5, i % 3 / 3, 1)


def groups():
    """Nested node groups with closures and colours inside, a colour through a group's input, a bare colour."""
    lamp()
    inner = bpy.data.node_groups.new("inner", "ShaderNodeTree")
    inner.interface.new_socket("Tint", in_out="INPUT", socket_type="NodeSocketColor")
    inner.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    enter, leave = inner.nodes.new("NodeGroupInput"), inner.nodes.new("NodeGroupOutput")
    diffuse, glossy, mix = (inner.nodes.new(f"ShaderNode{k}") for k in ("BsdfDiffuse", "BsdfAnisotropic", "MixShader"))
    glossy.inputs["Color"].default_value = GREEN
    inner.links.new(enter.outputs[0], diffuse.inputs["Color"])
    inner.links.new(diffuse.outputs[0], mix.inputs[1])
    inner.links.new(glossy.outputs[0], mix.inputs[2])
    inner.links.new(mix.outputs[0], leave.inputs[0])
    outer = bpy.data.node_groups.new("outer", "ShaderNodeTree")
    outer.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    holder, colour, leave = (outer.nodes.new(k) for k in ("ShaderNodeGroup", "ShaderNodeRGB", "NodeGroupOutput"))
    holder.node_tree = inner
    colour.outputs[0].default_value = RED
    outer.links.new(colour.outputs[0], holder.inputs[0])
    outer.links.new(holder.outputs[0], leave.inputs[0])
    m, tree, out = material("grouped")
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree = outer
    tree.links.new(node.outputs[0], out.inputs["Surface"])
    ball(m)
    m, tree, out = material("bare colour")
    checker = tree.nodes.new("ShaderNodeTexChecker")
    checker.inputs["Color1"].default_value, checker.inputs["Color2"].default_value = RED, BLUE
    tree.links.new(checker.outputs["Color"], out.inputs["Surface"])
    floor(m)


def volumes():
    """Absorption, scattering, principled volume and a volume in the world."""
    lamp()
    for i, (kind, values) in enumerate(
        [
            ("ShaderNodeVolumeAbsorption", {"Color": RED, "Density": 2}),
            ("ShaderNodeVolumeScatter", {"Color": GREEN, "Density": 2}),
            ("ShaderNodeVolumePrincipled", {"Color": BLUE, "Density": 3, "Absorption Color": RED,
                                            "Emission Strength": 0.5, "Emission Color": GREEN}),
            ("ShaderNodeVolumeCoefficients", {"Absorption Coefficients": (1, 2, 3),
                                              "Emission Coefficients": (0.5, 0.2, 0.1)}),
        ]
    ):  # fmt: skip
        ball(material(f"v{i}", (kind, values), end="Volume")[0], (-1.5 + i, 0, 0.6), 0.45)
    floor()
    blend.world("haze", BLUE)


def emission():
    """Emitting surfaces (constant, textured), a lamp with nodes, a sky."""
    light = lamp("SPOT", energy=500)
    light.use_nodes = True
    light.node_tree.nodes["Emission"].inputs["Color"].default_value = GREEN
    m, tree, _ = material("glow", ("ShaderNodeEmission", {"Color": RED, "Strength": 2}))
    ball(m, (-1, 0, 0.5), 0.4)
    m, tree, _ = material("screen", ("ShaderNodeBsdfPrincipled", {"Emission Strength": 1}))
    wave = tree.nodes.new("ShaderNodeTexMagic")
    tree.links.new(wave.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Emission Color"])
    ball(m, (1, 0, 0.5), 0.4)
    floor()
    tree = blend.world("sky", strength=0.2)
    sky = tree.nodes.new("ShaderNodeTexSky")
    sky.sun_disc = False
    tree.links.new(sky.outputs[0], tree.nodes["Background"].inputs["Color"])


def temperatures():
    """Not one of the ten: a blackbody that fills the picture, and a lamp with a colour temperature."""
    warm = lamp("AREA", energy=50)
    warm.use_temperature, warm.temperature = True, 3000
    m, tree, _ = material("black body", ("ShaderNodeEmission", {"Strength": 2}))
    node = tree.nodes.new("ShaderNodeBlackbody")
    node.inputs[0].default_value = 2500
    tree.links.new(node.outputs[0], tree.nodes["Emission"].inputs["Color"])
    ball(m, (0, 0, 0), 3)


def spectra():
    """Not one of the ten: a material, an emitter and a world that name spectra, and a glass."""
    wall, _, _ = material("wall", ("ShaderNodeBsdfDiffuse", {"Color": RED}))
    wall["pecs_reflectance"] = "colorchecker/blue"
    floor(wall, 40, (0, 3, 0), (90, 0, 0))
    blend.world("white", (1, 1, 1, 1))
    bpy.context.scene.world["pecs_spectrum"] = "a"


def python_driver():
    """Not one of the ten: a driver that only Python can run."""
    light = lamp()
    light.driver_add("energy").driver.expression = "__import__('os').getpid()"
    floor()


def late():
    """Its frames are so late that Blender knows their times to a third of a millisecond."""
    bpy.context.scene.frame_end = bpy.context.scene.frame_start = 100_000


def disk_cache():
    """Cloth that is not baked, with a cache on the disk."""
    cache = floor().modifiers.new("cloth", "CLOTH").point_cache
    blend.save(sys.argv[1], "disk_cache")  # only a saved file may have one
    cache.use_disk_cache = True


def fluid():
    """A domain that is not baked."""
    box().modifiers.new("fluid", "FLUID").fluid_type = "DOMAIN"


def missing_texture():
    m, tree, _ = material("image", ("ShaderNodeBsdfDiffuse", {}))
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = bpy.data.images.new("gone", 4, 4)
    node.image.filepath, node.image.source = "//gone.png", "FILE"
    tree.links.new(node.outputs[0], tree.nodes["Diffuse BSDF"].inputs[0])
    floor(m)


def no_camera():
    bpy.context.scene.camera = None


def hair():
    """Curves with hair closures."""
    lamp(energy=400)
    curve = bpy.data.hair_curves.new("hair")
    curve.add_curves([4] * 60)
    for i, point in enumerate(curve.points):
        strand, k = divmod(i, 4)
        point.position = (-1.5 + strand * 0.05, 0.1 * math.sin(strand), 0.4 * k)
        point.radius = 0.02
    for i, kind in enumerate(("ShaderNodeBsdfHairPrincipled", "ShaderNodeBsdfHair")):
        m, _, _ = material(f"hair{i}", (kind, {"Color": RED}))
        if i == 0:
            curve.materials.append(m)
    other = curve.copy()
    other.materials.clear()
    other.materials.append(m)
    put(curve)
    put(other, (0, 0.5, 0), name="hair2")
    floor()


def instances():
    """Collection instances, object colours, per-object materials, a particle system."""
    lamp()
    m, tree, _ = material("object colour", ("ShaderNodeBsdfDiffuse", {}))
    info = tree.nodes.new("ShaderNodeObjectInfo")
    tree.links.new(info.outputs["Color"], tree.nodes["Diffuse BSDF"].inputs["Color"])
    thing = ball(m, (0, 0, 0.3), 0.3)
    thing.color = RED
    collection = bpy.data.collections.new("many")
    collection.objects.link(thing)
    for i in range(4):
        empty = put(None, (-1.5 + i, 0.5, 0), name=f"instance{i}")
        empty.instance_type, empty.instance_collection = "COLLECTION", collection
    floor(material("floor", ("ShaderNodeBsdfDiffuse", {"Color": GREEN}))[0])


def drivers():
    """Simple-expression drivers and keyframes on shader colours, a lamp and the world; motion blur and a compositor."""
    scene = bpy.context.scene
    light = lamp()
    for frame, colour in ((1, (1, 0, 0)), (10, (0, 1, 1))):
        light.color = colour
        light.keyframe_insert("color", frame=frame)
    m, tree, _ = material("driven", ("ShaderNodeBsdfDiffuse", {"Color": RED}))
    socket = tree.nodes["Diffuse BSDF"].inputs["Color"]
    driver = socket.driver_add("default_value", 1).driver
    driver.type, driver.expression = "SCRIPTED", "frame / 12"
    thing = ball(m)
    thing.keyframe_insert("location", frame=1)
    thing.location.x = 1
    thing.keyframe_insert("location", frame=10)
    scene.render.use_motion_blur = True
    if hasattr(scene, "node_tree"):
        scene.use_nodes = True
        tree = scene.node_tree
        layers, out = tree.nodes["Render Layers"], tree.nodes["Composite"]
    else:  # Blender 5
        tree = scene.compositing_node_group = bpy.data.node_groups.new("compositor", "CompositorNodeTree")
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        layers, out = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("NodeGroupOutput")
    invert = tree.nodes.new("CompositorNodeInvert")
    tree.links.new(layers.outputs[0], invert.inputs["Color"])
    tree.links.new(invert.outputs[0], out.inputs[0])
    floor()
    scene.frame_set(4)


def _keyed(thing, action, slot, path, values):
    """Keyframes of frames 1 and 10 in a slot of an action that others share."""
    animation = thing.animation_data or thing.animation_data_create()
    animation.action, animation.action_slot = action, slot
    holder, key = (thing, path) if isinstance(path, str) else path
    for frame, value in zip((1, 10), values, strict=True):
        setattr(holder, key, value)
        assert holder.keyframe_insert(key, frame=frame)


def _animated_things():
    """Each with what moves its colour: a lamp, a node tree, one without nodes, a world; and shape keys."""
    light = lamp()
    m, tree, _ = material("moving", ("ShaderNodeBsdfDiffuse", {"Color": GREY}))
    plain = bpy.data.materials.new("no nodes")
    plain.use_nodes = False
    sky = blend.world("sky")
    thing = ball(m)
    thing.shape_key_add(name="rest")
    key = thing.shape_key_add(name="tall")
    for point in key.data:
        point.co.z *= 1.5
    floor(plain)
    return [
        ("LIGHT", light, "color", ((1, 0, 0), (0, 1, 1))),
        ("NODETREE", tree, (tree.nodes["Diffuse BSDF"].inputs["Color"], "default_value"), (GREY, GREEN)),
        ("MATERIAL", plain, "diffuse_color", (GREY, RED)),
        ("NODETREE", sky, (sky.nodes["Background"].inputs["Color"], "default_value"), (GREY, BLUE)),
        ("KEY", thing.data.shape_keys, (key, "value"), (0.0, 1.0)),
    ]


def slots():
    """One action moves everything, each thing by a slot of its own."""
    action = bpy.data.actions.new("all")
    for i, (kind, thing, path, values) in enumerate(_animated_things()):
        _keyed(thing, action, action.slots.new(kind, f"slot {i}"), path, values)
    bpy.context.scene.frame_set(1)


def strips():
    """The same in strips; above each lies a track that is off."""
    action = bpy.data.actions.new("all")
    for i, (kind, thing, path, values) in enumerate(_animated_things()):
        slot = action.slots.new(kind, f"slot {i}")
        _keyed(thing, action, slot, path, values)
        animation = thing.animation_data
        animation.action = None
        for on in (True, False):
            track = animation.nla_tracks.new()
            strip = track.strips.new("strip", 1 if on else 4, action)
            strip.action_slot = slot
            strip.action_frame_start, strip.action_frame_end = 1, 10
            strip.frame_end = strip.frame_start + 9
            track.mute = not on
    bpy.context.scene.frame_set(1)


def world():
    """A textured environment (packed image) and a world without nodes in a second scene."""
    image = bpy.data.images.new("sky", 16, 8, float_buffer=True)
    image.pixels = [v for i in range(128) for v in (i % 16 / 8, 0.3, 1 - i / 128, 1)]
    image.pack()
    tree = blend.world("env")
    node = tree.nodes.new("ShaderNodeTexEnvironment")
    node.image = image
    tree.links.new(node.outputs[0], tree.nodes["Background"].inputs["Color"])
    ball(material("mirror", ("ShaderNodeBsdfAnisotropic", {"Color": GREY, "Roughness": 0.1}))[0])
    floor(material("matte", ("ShaderNodeBsdfDiffuse", {"Color": RED}))[0])
    other = bpy.data.scenes.new("../other/scene")  # a name that is a path
    other.world = bpy.data.worlds.new("../plain")
    other.world.use_nodes = False


def linked():
    """Objects, materials and node groups linked from another file."""
    lamp()
    with bpy.data.libraries.load(str(LIBRARY / "groups.blend"), link=True) as (there, here):
        here.objects = [name for name in there.objects if name != "camera"]
    for thing in here.objects:
        bpy.context.scene.collection.objects.link(thing)


PLANE, BALL, BALL_RADIUS = ((0, 5, 0), 20), (0.3, 3, -0.2), 0.5  # a wall turned about z by so many degrees


def measured(unit_m=1.0):
    """A wall and a ball before a camera in the origin that looks along +y, in metres whatever the unit; two lamps, one
    of a power that grows with its area."""
    scene = bpy.context.scene
    scene.unit_settings.scale_length = unit_m
    camera = scene.camera
    camera.location, camera.rotation_euler = (0, 0, 0), (math.radians(90), 0, 0)
    camera.data.lens, camera.data.sensor_width, camera.data.shift_x = 40, 36, 0.05
    camera.data.dof.use_dof, camera.data.dof.focus_distance, camera.data.dof.aperture_fstop = True, 3 / unit_m, 1.0
    location, turn_deg = PLANE
    floor(None, 4 / unit_m, [v / unit_m for v in location], (90, 0, turn_deg))
    ball(None, [v / unit_m for v in BALL], BALL_RADIUS / unit_m, segments=256)
    light = lamp("POINT", (1, 1, 1), 100, (1 / unit_m, 0, 1 / unit_m))
    other = lamp("SPOT", (1, 1, 1), 1000, (-1 / unit_m, 0, 1 / unit_m))
    light.shadow_soft_size, other.shadow_soft_size, other.normalize = 0.1 / unit_m, 0.1 / unit_m, False
    bpy.context.scene.objects[other.name].rotation_euler.x = math.radians(80)
    scene.cycles.diffuse_bounces = 0


def centimetres():
    measured(0.01)


FILES = [closures, textures, groups, volumes, emission, hair, instances, drivers, slots, strips, world, linked]
LIBRARY = Path()

OTHERS = [
    temperatures,
    spectra,
    python_driver,
    late,
    disk_cache,
    fluid,
    missing_texture,
    no_camera,
    measured,
    centimetres,
]


def main(folder, *names):
    global LIBRARY
    LIBRARY = Path(folder).absolute()
    for make in FILES + OTHERS:
        if names and make.__name__ not in names:
            continue
        blend.start()
        make()
        blend.save(LIBRARY, make.__name__)


if __name__ == "__main__":
    main(*sys.argv[1:])
