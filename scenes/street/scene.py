# SPDX-License-Identifier: GPL-3.0-or-later
"""A street of primitives and procedural textures: houses, road with marks, pavements, trees, lamps, parked and moving
cars, walking people, sun and sky. Every object has its class in `pecs_class`.

World: x right, y along the street, z up, metres; the camera's entrance pupil is the origin, 1.5 m above the road, and
looks along +y. Nothing is smooth-shaded: Blender's smooth normals differ from run to run in the last bits.
"""

import math
from random import Random

import bpy
from mathutils import Matrix, Vector
from pecs_blender.scene.build import SceneParts, sun_lamp
from pecs_blender.scene.paint import Paint, ramp
from pecs_blender.scene.solids import Shape

GROUND_M, KERB_M, BACK_M, AHEAD_M = -1.5, 0.12, -45.0, 110.0
ROAD_M, PAVEMENT_M = 5.5, 9.0  # half widths; houses begin where the pavement ends
LANE_M, PARKED_M, TREES_M, WALK_M = 1.75, 4.4, 6.0, 7.9  # |x| of what stands and moves
CAR_M = (4.3, 1.76, 1.46)
CAR_COLOURS = ((0.5, 0.02, 0.02), (0.02, 0.06, 0.3), (0.6, 0.6, 0.58), (0.03, 0.03, 0.035))
CAR_COLOURS += ((0.75, 0.75, 0.72), (0.08, 0.2, 0.1))
CLOTHES = ((0.5, 0.1, 0.08), (0.08, 0.12, 0.35), (0.6, 0.5, 0.1), (0.1, 0.3, 0.15), (0.7, 0.7, 0.7), (0.05, 0.05, 0.06))
SKIN = ((0.55, 0.32, 0.22), (0.3, 0.16, 0.1), (0.12, 0.06, 0.04))


def build(p):
    """p: resolved parameters of scene.json, spectra loaded. Returns SceneParts."""
    rng = Random(int(p["texture_seed"]))
    paint = Paint(rng)
    sky_and_sun(p, rng)
    road(paint)
    houses(paint, rng)
    for k in range(int(p["trees"])):
        tree(f"tree {k:02d}", ((-1) ** k * TREES_M, BACK_M / 3 + 6.5 * k + rng.uniform(-1, 1)), paint, rng)
    furniture(paint, rng)
    parked = [(side, y) for y in (13, 6.5, 21, 32, -7, 40, 52, -15) for side in (1, -1)]
    for k, (side, y) in enumerate(parked[: int(p["parked_cars"])]):
        where = placed(side * PARKED_M, y + rng.uniform(-0.8, 0.8), side > 0)
        car(f"parked car {k:02d}", paint, rng).matrix_world = where
    movers = [moving_car(k, p["car_speed_m_per_s"], paint, rng) for k in range(int(p["cars"]))]
    movers += [walker(k, p["walk_speed_m_per_s"], paint, rng) for k in range(int(p["people"]))]

    def pose(t_s):
        for move in movers:
            move(t_s)

    return SceneParts(
        pose=pose,
        target=((-1.0, 10.0, 0.0), (0.0, -1.0, 0.0)),
        illuminance_lux=p["illuminance_lux"],
        bounces=1,
    )


def mirrored(side, start, end):
    """An interval on the right (side 1) or left (side -1), lower end first."""
    return sorted((side * start, side * end))


def placed(x, y, away):
    """A thing on the road whose front is +y, or turned about."""
    return Matrix.Translation((x, y, GROUND_M)) @ Matrix.Rotation(0.0 if away else math.pi, 4, "Z")


def sky_and_sun(p, rng):
    """Sky: whiter towards the horizon, with clouds; a level plane gets about pi from it, and `sun_to_sky` times that
    from the sun."""
    world = bpy.context.scene.world = bpy.data.worlds.new("sky")
    world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    nodes.clear()
    background, output = nodes.new("ShaderNodeBackground"), nodes.new("ShaderNodeOutputWorld")
    where, parts, clouds = (nodes.new(f"ShaderNode{kind}") for kind in ("TexCoord", "SeparateXYZ", "TexNoise"))
    mapping, mix = nodes.new("ShaderNodeMapping"), nodes.new("ShaderNodeMixRGB")
    links.new(where.outputs["Generated"], parts.inputs[0])
    links.new(where.outputs["Generated"], mapping.inputs["Vector"])
    mapping.inputs["Location"].default_value = [rng.uniform(-50, 50) for _ in range(3)]
    mapping.inputs["Scale"].default_value = (2.0, 2.0, 5.0)
    links.new(mapping.outputs["Vector"], clouds.inputs["Vector"])
    clouds.inputs["Detail"].default_value = 8.0
    blue = ramp(world.node_tree, parts.outputs["Z"], 0.0, 0.7, (0.95, 1.05, 1.15), (0.3, 0.55, 1.1))
    cover = ramp(world.node_tree, clouds.outputs["Fac"], 0.5, 0.72, (0.0, 0.0, 0.0), (0.8, 0.8, 0.8))
    links.new(cover, mix.inputs["Fac"])
    links.new(blue, mix.inputs["Color1"])
    mix.inputs["Color2"].default_value = (1.5, 1.5, 1.5, 1.0)
    links.new(mix.outputs["Color"], background.inputs["Color"])
    links.new(background.outputs[0], output.inputs["Surface"])
    world.cycles.sampling_method, world.cycles.sample_map_resolution = "MANUAL", 128
    if not p["sun_to_sky"]:
        return
    elevation, azimuth = math.radians(p["sun_elevation_deg"]), math.radians(p["sun_azimuth_deg"])
    level = math.cos(elevation)
    towards = math.sin(azimuth) * level, -math.cos(azimuth) * level, math.sin(elevation)
    light = sun_lamp(towards, math.pi * p["sun_to_sky"] / math.sin(elevation), p["sun_spectrum"])
    light.angle = math.radians(0.53)


def road(paint):
    asphalt = paint.noise("asphalt", (0.035, 0.035, 0.037), (0.13, 0.13, 0.125), (0.35, 9.0, 90.0), contrast=0.22)
    ground = Shape()
    ground.box((-ROAD_M, ROAD_M), (BACK_M, AHEAD_M), (GROUND_M - 0.1, GROUND_M), asphalt)
    for y, side in ((3, 1), (26, -1), (47, 1)):  # patches and manholes
        patch = paint.noise("patch", (0.02, 0.02, 0.02), (0.06, 0.06, 0.06), (30.0,), contrast=0.3)
        ground.box((side * 0.4, side * 2.6), (y, y + 2.5), (GROUND_M, GROUND_M + 0.002), patch)
        ends = ((side * 1.5, y + 5, GROUND_M + z) for z in (-0.01, 0.004))
        ground.tube(*ends, (0.32, 0.32), paint.plain((0.09, 0.08, 0.07)), 20)
    ground.object("road", "road")
    white = paint.noise("paint", (0.5, 0.5, 0.48), (0.75, 0.75, 0.73), (60.0, 5.0), contrast=0.15)
    marks = Shape()
    height = (GROUND_M, GROUND_M + 0.004)
    for x, half, step, length in ((0.0, 0.06, 6.0, 3.0), (-3.4, 0.05, 2.5, 1.6), (3.4, 0.05, 2.5, 1.6)):
        for k in range(int((AHEAD_M - BACK_M) / step)):
            y = BACK_M + step * k
            if not 15.5 - length < y < 19.5:  # not on the crossing
                marks.box((x - half, x + half), (y, y + length), height, white)
    for k in range(11):  # a crossing
        marks.box((-5.2 + 0.98 * k, -4.7 + 0.98 * k), (16.0, 19.0), height, white)
    marks.object("lane marks", "lane_mark")
    slabs = paint.bricks("slabs", (0.3, 0.29, 0.27), (0.38, 0.37, 0.35), (0.1, 0.1, 0.1), (0.6, 0.4), 0.008, level=True)
    stone = paint.noise("kerb", (0.3, 0.3, 0.3), (0.5, 0.5, 0.48), (25.0, 2.0))
    for name, side in (("right", 1), ("left", -1)):
        walk, height = Shape(), (GROUND_M, GROUND_M + KERB_M)
        walk.box(mirrored(side, ROAD_M + 0.15, PAVEMENT_M + 0.5), (BACK_M, AHEAD_M), height, slabs)
        for k in range(155):
            at = BACK_M + k
            walk.box(mirrored(side, ROAD_M, ROAD_M + 0.15), (at + 0.01, at + 0.99), height, stone)
        walk.object(f"pavement {name}", "pavement")


def houses(paint, rng):
    """Two rows, and one across at each end."""
    for name, side in (("right", 1), ("left", -1)):
        y, k = BACK_M, 0
        while y < AHEAD_M:
            width = min(rng.choice((8.0, 10.0, 12.0, 14.0)), max(AHEAD_M - y, 6.0))
            house(f"house {name} {k:02d}", (side * PAVEMENT_M, y), (0, 1), side, width, paint, rng)
            y, k = y + width, k + 1
    for name, y, out in (("ahead", AHEAD_M, 1), ("behind", BACK_M, -1)):
        house(f"house {name}", (-PAVEMENT_M - 3, y), (1, 0), out, 2 * PAVEMENT_M + 6, paint, rng)


def house(name, corner, along, away, width, paint, rng):
    """A block whose front begins at a corner, runs `along` x or y and looks against `away`: rows of windows, shops or a
    door below."""
    one = rng.choice(((0.35, 0.1, 0.06), (0.5, 0.4, 0.26), (0.42, 0.36, 0.33), (0.62, 0.58, 0.5), (0.25, 0.13, 0.1)))
    wall = paint.bricks(f"bricks {rng.randrange(4)}", one, tuple(0.8 * c for c in one), (0.45, 0.43, 0.4), (0.24, 0.08))
    frame, glass = paint.plain(rng.choice(((0.7, 0.7, 0.68), (0.1, 0.08, 0.06), (0.08, 0.15, 0.12)))), paint.glass()
    floors, floor_m = rng.randrange(2, 5), rng.uniform(2.9, 3.4)
    shape = Shape()

    def block(u_m, out_m, z_m, material):
        """u along the front, out of it towards the street, z above the pavement."""
        u = [corner[0 if along[0] else 1] + c for c in u_m]
        n = sorted(corner[1 if along[0] else 0] - away * c for c in out_m)
        z = [GROUND_M + KERB_M + c for c in z_m]
        shape.box(*((u, n) if along[0] else (n, u)), z, material)

    top = floor_m * floors + 0.8
    block((0, width), (-10, 0), (-0.2, top), wall)
    block((0, width), (0, 0.25), (top - 0.35, top), frame)
    count = max(int(width / 2.2), 1)
    pitch = width / count
    for floor in range(floors):
        z = floor * floor_m + (0.9 if floor else 0.3)
        for k in range(count):
            u = (k + 0.5) * pitch
            tall, half = (2.2, 0.85) if floor == 0 else (1.55, 0.55)
            block((u - half - 0.08, u + half + 0.08), (0, 0.05), (z - 0.08, z + tall + 0.08), frame)
            block((u - half, u + half), (0, 0.06), (z, z + tall), glass)
            block((u - 0.03, u + 0.03), (0, 0.08), (z, z + tall), frame)
            block((u - half, u + half), (0, 0.08), (z + 0.65 * tall, z + 0.65 * tall + 0.05), frame)
            block((u - half - 0.15, u + half + 0.15), (0, 0.16), (z - 0.16, z - 0.08), frame)
    if rng.random() < 0.6:  # a shop's sign and stripes of its awning
        colour = rng.choice(((0.5, 0.03, 0.03), (0.03, 0.15, 0.4), (0.05, 0.3, 0.1), (0.6, 0.35, 0.02)))
        block((0.4, width - 0.4), (0, 0.12), (2.62, 2.85), paint.plain(colour))
        for k in range(int(width / 0.6)):
            stripe = paint.plain(colour if k % 2 else (0.75, 0.73, 0.68))
            block((0.3 + 0.6 * k, min(0.9 + 0.6 * k, width)), (0, 1.0), (2.5, 2.56), stripe)
    shape.object(name, "building")


def tree(name, where, paint, rng):
    """A trunk, boughs, and leaves: single small quads, so that edges are fine."""
    bark = paint.noise("bark", (0.03, 0.02, 0.012), (0.14, 0.1, 0.07), (14.0, 60.0))
    greens = [paint.plain(rgb, 0.6) for rgb in ((0.05, 0.13, 0.02), (0.09, 0.2, 0.04), (0.16, 0.26, 0.06))]
    shape, height = Shape(), rng.uniform(2.2, 2.6)
    foot, fork = Vector((0, 0, 0)), Vector((rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.1), height))
    shape.tube(foot, fork, (0.14, 0.09), bark, 10)
    for _ in range(7):
        tip = fork + Vector((rng.uniform(-0.7, 0.7), rng.uniform(-0.9, 0.9), rng.uniform(0.7, 1.7)))
        shape.tube(fork, tip, (0.05, 0.015), bark, 6)
    for _ in range(1100):
        place = Vector(rng.gauss(0, 1) for _ in range(3)).normalized() * rng.random() ** 0.4
        place = fork + Vector((1.05 * place.x, 1.15 * place.y, 1.0 + 1.15 * place.z))
        turn = Vector(rng.gauss(0, 1) for _ in range(3)).normalized().to_track_quat("Z", "Y")
        a, b = rng.uniform(0.07, 0.13), rng.uniform(0.04, 0.07)
        leaf = [place + turn @ Vector(c) for c in ((-a, 0, 0), (0, -b, 0.02), (a, 0, 0), (0, b, 0.02))]
        shape.add(leaf, [(0, 1, 2, 3)], rng.choice(greens))
    shape.object(name, "tree").location = (*where, GROUND_M + KERB_M)


def furniture(paint, rng):
    """Lamps, traffic signs and bins along the kerbs."""
    steel, low = paint.plain((0.12, 0.13, 0.13), 0.4), GROUND_M + KERB_M
    for k, y in enumerate(range(-38, 100, 17)):
        side = (-1) ** k
        lamp = Shape()
        lamp.tube((side * 5.9, y, low), (side * 5.9, y, low + 6), (0.07, 0.05), steel, 10)
        lamp.tube((side * 5.9, y, low + 6), (side * 4.6, y, low + 6.3), (0.04, 0.03), steel, 8)
        lamp.box(mirrored(side, 4.1, 4.7), (y - 0.12, y + 0.12), (low + 6.25, low + 6.35), steel)
        lamp.object(f"lamp {k:02d}", "pole")
    for k, (side, y) in enumerate(((1, 11.0), (-1, 23.5), (1, 35.0), (-1, -4.0))):
        sign = Shape()
        sign.tube((side * 5.85, y, low), (side * 5.85, y, low + 2.5), (0.03, 0.03), steel, 8)
        for radius, out, rgb in ((0.32, 0.04, (0.55, 0.02, 0.02)), (0.24, 0.055, (0.75, 0.75, 0.73))):
            for face in (-1, 1):
                disk = (side * 5.85, y, low + 2.3), (side * 5.85, y + face * out, low + 2.3)
                sign.tube(*disk, (radius, radius), paint.plain(rgb), 24)
        bar, black = (side * 5.85 - 0.16, side * 5.85 + 0.16), paint.plain((0.02, 0.02, 0.02))
        sign.box(bar, (y - 0.06, y + 0.06), (low + 2.26, low + 2.34), black)
        sign.object(f"sign {k:02d}", "traffic_sign")
    for k in range(5):
        bin_shape = Shape()
        x, y = (-1) ** k * 8.6, 4.0 + 9 * k + rng.uniform(-1, 1)
        green = paint.noise("bin", (0.02, 0.08, 0.04), (0.06, 0.2, 0.1), (8.0,))
        bin_shape.tube((x, y, low), (x, y, low + 0.9), (0.22, 0.27), green, 16)
        bin_shape.object(f"bin {k:02d}", "bin")


def car(name, paint, rng):
    """Its front is +y; the origin is on the ground below its middle."""
    body, dark = paint.plain(rng.choice(CAR_COLOURS), 0.25), paint.plain((0.015, 0.015, 0.015), 0.6)
    length, width, height = CAR_M
    h, w = length / 2, width / 2
    shape = Shape()
    back = [(-h + 0.2, 0.24), (-h, 0.32), (-h, 0.82), (-h + 0.25, 0.93)]
    front = [(h - 1.3, 0.93), (h - 0.15, 0.74), (h, 0.6), (h, 0.32), (h - 0.2, 0.24)]
    shape.prism([*back[1:], *front, back[0]], (-w, w), body)
    cabin = [(-h + 0.35, 0.93), (-h + 0.75, height - 0.04), (h - 2.05, height - 0.04), (h - 1.25, 0.93)]
    shape.prism(cabin, (-w + 0.1, w - 0.1), paint.glass())
    shape.box((-w + 0.1, w - 0.1), (-h + 0.72, h - 2.0), (height - 0.05, height), body)
    for side in (-1, 1):
        shape.box(mirrored(side, w - 0.11, w - 0.08), (-0.42, -0.34), (0.93, height - 0.04), body)  # pillar
        shape.box(mirrored(side, w, w + 0.012), (-0.3, -0.14), (0.78, 0.82), dark)  # handle
        shape.box(mirrored(side, w - 0.02, w + 0.16), (0.72, 0.8), (0.92, 1.05), body)  # mirror
        for y in (-h + 0.8, h - 0.8):
            tyre, rim = ([(side * (w + x), y, 0.32) for x in ends] for ends in ((-0.2, 0.015), (-0.1, 0.025)))
            shape.tube(*tyre, (0.32, 0.32), dark, 20)
            shape.tube(*rim, (0.2, 0.2), paint.plain((0.45, 0.45, 0.45), 0.3), 10)
        white, red = paint.plain((0.8, 0.8, 0.75), 0.1), paint.plain((0.45, 0.01, 0.01), 0.2)
        shape.box(mirrored(side, w - 0.45, w - 0.08), (h - 0.2, h + 0.01), (0.58, 0.7), white)
        shape.box(mirrored(side, w - 0.35, w - 0.05), (-h - 0.01, -h + 0.2), (0.66, 0.8), red)
    for end in (-1, 1):
        shape.box((-0.26, 0.26), sorted((end * h, end * (h + 0.015))), (0.42, 0.53), paint.plain((0.75, 0.75, 0.7)))
        shape.box((-w + 0.05, w - 0.05), sorted((end * h, end * (h + 0.008))), (0.32, 0.38), dark)
    return shape.object(name, "car")


def moving_car(k, speed, paint, rng):
    """Right lane: first two ahead, then behind; left lane: from far ahead. None starts next to the camera."""
    thing, row = car(f"car {k:02d}", paint, rng), k // 2
    away = k % 2 == 0
    if away:
        start, rate = (16 if row % 2 == 0 else -14) + 13 * (-1) ** row * (row // 2) + rng.uniform(-2, 2), speed
    else:
        start, rate = 20 + 16 * row + rng.uniform(-3, 3), -1.2 * speed
    x = (LANE_M if away else -LANE_M) + rng.uniform(-0.15, 0.15)

    def move(t_s):
        thing.matrix_world = placed(x, start + rate * t_s, away)

    return move


def walker(k, speed, paint, rng):
    """A person of capsules in one mesh, whose vertices walk: along the pavements, every third across the street."""
    top, legs, skin = (paint.plain(rng.choice(c), 0.8) for c in (CLOTHES, CLOTHES, SKIN))
    shape, limbs = Shape(), []  # limbs: first vertex, joints

    def limb(parent, joint, ends, radii_m, material, swing=None):
        first = len(shape.vertices)
        shape.tube(*ends, radii_m, material, 10, round_ends=True)
        limbs.append((first, len(shape.vertices), parent, Vector(joint), swing))
        return len(limbs) - 1

    body = limb(None, (0, 0, 0.95), ((0, 0, 0.95), (0, 0, 1.42)), (0.15, 0.19), top)
    limb(body, (0, 0, 1.5), ((0, 0, 1.6), (0, 0.02, 1.68)), (0.1, 0.1), skin)
    for side in (-1, 1):
        hip, shoulder = 0.1 * side, 0.25 * side
        shoes, ends = paint.plain((0.03, 0.02, 0.02)), ((hip, 0, 0.88), (hip, 0, 0.52))
        thigh = limb(None, (hip, 0, 0.92), ends, (0.09, 0.065), legs, lambda a, s=side: 0.45 * s * math.sin(a))
        ends, knee = ((hip, 0, 0.47), (hip, 0, 0.12)), lambda a, s=side: -0.35 * (1 + math.sin(s * a - 1.2 * s))
        shin = limb(thigh, (hip, 0, 0.5), ends, (0.06, 0.045), legs, knee)
        limb(shin, (hip, 0, 0.08), ((hip, -0.04, 0.06), (hip, 0.15, 0.05)), (0.05, 0.04), shoes)
        ends = (shoulder, 0, 1.4), (shoulder, 0, 1.15)
        arm = limb(body, (shoulder, 0, 1.42), ends, (0.055, 0.045), top, lambda a, s=side: -0.4 * s * math.sin(a))
        ends, elbow = ((shoulder, 0, 1.11), (shoulder, 0.03, 0.86)), lambda a, s=side: 0.3 - 0.2 * s * math.sin(a)
        limb(arm, (shoulder, 0, 1.12), ends, (0.042, 0.035), skin, elbow)
    thing = shape.object(f"person {k:02d}", "person")
    rest, rate, phase = [Vector(v) for v in shape.vertices], speed * rng.uniform(0.8, 1.2), rng.uniform(0, 2 * math.pi)
    across, side, away = k % 3 == 2, (-1) ** k, rng.random() < 0.5
    start = rng.uniform(-6, -2) if across else rng.uniform(3, 30)
    line = rng.uniform(16.3, 18.7) if across else side * (WALK_M + rng.uniform(-0.35, 0.35))

    def move(t_s):
        swing = 2 * math.pi * rate / 1.45 * t_s + phase  # a double step is 1.45 m
        turns, moved = [], []
        for first, last, parent, joint, bend in limbs:
            own = Matrix.Rotation(bend(swing), 4, "X") if bend else Matrix.Identity(4)
            own = Matrix.Translation(joint) @ own @ Matrix.Translation(-joint)
            turns.append(turns[parent] @ own if parent is not None else own)
            moved += [turns[-1] @ v for v in rest[first:last]]
        thing.data.vertices.foreach_set("co", [c for v in moved for c in v])
        thing.data.update()
        bob = 0.02 * math.cos(2 * swing)
        if across:
            kerb_m, turn = (KERB_M if abs(start + rate * t_s) > ROAD_M else 0.0), -math.pi / 2
            x, y = start + rate * t_s, line
        else:
            kerb_m, turn = KERB_M, 0 if away else math.pi
            x, y = line, start + (rate if away else -rate) * t_s
        place = Matrix.Translation((x, y, GROUND_M + kerb_m + bob))
        thing.matrix_world = place @ Matrix.Rotation(turn, 4, "Z")

    return move
