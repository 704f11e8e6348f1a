# SPDX-License-Identifier: GPL-3.0-or-later
"""A desk near a window: books, papers, a keyboard, a screen, a mug with pencils, a plant, a desk lamp, a fan, a
metronome. Every object has its class in `pecs_class`.

World: x right, y away from the camera, z up, metres; the camera's entrance pupil is the origin and looks along +y.
Nothing is smooth-shaded: Blender's smooth normals differ from run to run in the last bits.
"""

import math
from random import Random

import bpy
from mathutils import Matrix, Vector
from pecs_blender.scene.build import SceneParts, area_lamp, material_of, mesh_object
from pecs_blender.scene.paint import Paint
from pecs_blender.scene.solids import Shape

DESK_M, WALL_M = -0.24, 1.35  # height of the desk, distance of the wall behind it
COLOURS = ((0.5, 0.04, 0.03), (0.03, 0.1, 0.35), (0.6, 0.42, 0.05), (0.05, 0.25, 0.1), (0.7, 0.68, 0.6))
COLOURS += ((0.04, 0.04, 0.05), (0.3, 0.12, 0.3), (0.1, 0.35, 0.4))
WHITE, INK = (0.8, 0.8, 0.77), (0.02, 0.02, 0.025)
WORDS = "OPTICS Events Signals ATLAS Noise Light TABLES Motion Lenses Colour PIXELS Time".split()
LAMP_M, LAMP_SIDE_M = (0.42, 0.62, 0.16), 0.08  # light of the desk lamp
WINDOW_M, WINDOW_SIZE_M = (-1.49, 0.5, 0.4), (1.2, 1.0)
CARD_M = (0.0, 0.9, DESK_M + 0.1)  # where the illuminance is set, on a card that faces -y


def build(p):
    """p: resolved parameters of scene.json, spectra loaded. Returns SceneParts."""
    rng = Random(int(p["texture_seed"]))
    paint = Paint(rng)
    surroundings(paint)
    lamp = lights(p, paint)
    books(paint, rng)
    papers(paint, rng)
    keyboard(paint)
    screen(paint, rng)
    mug(paint, rng)
    plant(paint, rng)
    movers = [fan(p["fan_hz"], paint, rng), metronome(p["metronome_hz"], paint, rng)]
    strength, flicker_rad_s = lamp.energy, 2 * math.pi * p["flicker_hz"]

    def pose(t_s):
        for move in movers:
            move(t_s)
        lamp.energy = strength * (1 + p["flicker_depth"] * math.sin(flicker_rad_s * t_s))

    return SceneParts(
        pose=pose,
        target=(CARD_M, (0.0, -1.0, 0.0)),
        illuminance_lux=p["illuminance_lux"],
        bounces=3,
        lamps=(lamp,) if p["flicker_hz"] else (),
    )


def surroundings(paint):
    wood = paint.noise("wood", (0.16, 0.08, 0.035), (0.42, 0.25, 0.12), (4.0, 70.0), roughness=0.5, contrast=0.3)
    desk = Shape()
    desk.box((-1.0, 1.0), (0.2, WALL_M - 0.05), (DESK_M - 0.03, DESK_M), wood)
    desk.object("desk", "desk")
    room, plaster = Shape(), paint.noise("plaster", (0.5, 0.49, 0.46), (0.62, 0.61, 0.58), (8.0, 150.0), contrast=0.5)
    room.box((-1.6, 2.5), (WALL_M, WALL_M + 0.1), (-1.0, 2.0), plaster)
    for x in (-1.6, 2.4):
        room.box((x, x + 0.1), (-2.5, WALL_M), (-1.0, 2.0), plaster)
    room.box((-1.6, 2.5), (-2.6, -2.5), (-1.0, 2.0), plaster)
    room.box((-1.6, 2.5), (-2.5, WALL_M), (2.0, 2.1), plaster)
    room.object("walls", "wall")
    floor = Shape()
    floor.box((-1.6, 2.5), (-2.5, WALL_M), (-1.1, -1.0), paint.plain((0.12, 0.11, 0.1)))
    floor.object("floor", "floor")
    board = Shape()
    cork = paint.noise("cork", (0.2, 0.11, 0.05), (0.45, 0.28, 0.15), (40.0, 200.0), contrast=0.2)
    board.box((-0.75, -0.05), (WALL_M - 0.015, WALL_M), (0.08, 0.5), cork)
    board.object("pinboard", "board")


def lights(p, paint):
    """A window in the left wall, and the desk lamp, whose light is returned. Each alone gives the card at CARD_M its
    share of pi, unless something hides it."""
    window = area_lamp("window", WINDOW_M, WINDOW_SIZE_M, p["window_spectrum"])
    window.rotation_euler = (0.0, -math.pi / 2, 0.0)  # looks along +x
    lamp = area_lamp("desk lamp", LAMP_M, (LAMP_SIDE_M, LAMP_SIDE_M), p["lamp_spectrum"])
    shares = (p["window_to_lamp"] / (1 + p["window_to_lamp"]), 1 / (1 + p["window_to_lamp"]))
    for light, centre, away, share in ((window, WINDOW_M, (1, 0, 0), shares[0]), (lamp, LAMP_M, (0, 0, -1), shares[1])):
        way = Vector(CARD_M) - Vector(centre)
        light.data.energy *= (
            share * math.pi / (light.data.size * light.data.size_y * way.dot(Vector(away)) * way.y / way.length**4)
        )
    steel, shade = paint.plain((0.2, 0.2, 0.21), 0.3), Shape()
    x, y, z = LAMP_M
    foot, elbow, head = (0.75, 0.75, DESK_M), (0.7, 0.72, DESK_M + 0.3), (x, y, z + 0.07)
    shade.tube(foot, (*foot[:2], DESK_M + 0.015), (0.09, 0.085), steel, 24)
    shade.tube(foot, elbow, (0.008, 0.008), steel, 8)
    shade.tube(elbow, head, (0.008, 0.008), steel, 8)
    around = [2 * math.pi * k / 24 for k in range(24)]
    rings = [[(x + r * math.cos(a), y + r * math.sin(a), h) for a in around] for r, h in ((0.03, head[2]), (0.08, z))]
    shade.band(*rings, steel)
    shade.object("lamp", "lamp")
    return lamp.data


def text(words, height_m, material, place, kind):
    """A line of letters, each a flat face, in the x-y plane of `place`, from its origin to the right."""
    curve = bpy.data.curves.new("text", "FONT")
    curve.body, curve.size, curve.fill_mode = words, height_m, "FRONT"
    curve.resolution_u = 3
    thing = bpy.data.objects.new(f"text {words}", curve)
    mesh = bpy.data.meshes.new_from_object(thing)
    bpy.data.objects.remove(thing)
    bpy.data.curves.remove(curve)
    points = [tuple(place @ v.co) for v in mesh.vertices]
    faces = [tuple(face.vertices) for face in mesh.polygons]
    bpy.data.meshes.remove(mesh)
    printed = mesh_object(f"text {words}", points, faces, [material])
    printed["pecs_class"] = kind


def books(paint, rng):
    """A row that stands, and a stack in front of it; titles on their spines."""
    x = -0.62
    for k in range(9):
        thick, deep, tall = rng.uniform(0.018, 0.045), rng.uniform(0.13, 0.17), rng.uniform(0.18, 0.26)
        book(f"book {k:02d}", (x, 1.0 - deep), (thick, deep, tall), paint, rng)
        x += thick + 0.002
    z = 0.0
    for k in range(9, 12):
        thick, deep, tall = rng.uniform(0.015, 0.035), 0.14, rng.uniform(0.18, 0.22)
        book(f"book {k:02d}", (-0.45 + rng.uniform(-0.02, 0.02), 0.62), (thick, deep, tall), paint, rng, z)
        z += thick + 0.001


def book(name, corner, size_m, paint, rng, lies_m=None):
    """Its spine looks towards the camera. lies_m: height above the desk at which it lies; None: it stands."""
    thick, deep, tall = size_m
    colour = rng.choice(COLOURS)
    cover, pages = paint.plain(colour, 0.35), paint.plain((0.75, 0.72, 0.62), 0.9)
    shape, board = Shape(), 0.002
    place = Matrix.Translation((*corner, DESK_M))
    if lies_m is not None:
        place = Matrix.Translation((corner[0], corner[1], DESK_M + lies_m + thick)) @ Matrix.Rotation(
            math.pi / 2, 4, "Y"
        )
    for x in ((0, board), (thick - board, thick)):
        shape.box(x, (0, deep), (0, tall), cover)
    shape.box((0, thick), (0, board), (0, tall), cover)
    shape.box((board, thick - board), (board, deep - 0.004), (0.003, tall - 0.003), pages)
    shape.vertices = [tuple(place @ Vector(v)) for v in shape.vertices]
    shape.object(name, "book")
    bright = sum(colour) > 0.8
    ink = paint.plain(INK if bright else (0.75, 0.65, 0.3), 0.4)
    upright = Matrix(((0, -1, 0, 0.75 * thick), (0, 0, -1, -0.0005), (1, 0, 0, 0.03), (0, 0, 0, 1)))
    text(rng.choice(WORDS), 0.65 * thick, ink, place @ upright, "book")


def papers(paint, rng):
    """Printed sheets on the desk and on the pinboard."""
    white, ink = paint.plain(WHITE, 0.9), paint.plain(INK, 0.9)
    flat = [((-0.16, 0.38), -0.15), ((0.2, 0.36), 0.22)]
    places = [Matrix.Translation((*xy, DESK_M + 0.001)) @ Matrix.Rotation(turn, 4, "Z") for xy, turn in flat]
    upright = Matrix.Rotation(math.pi / 2, 4, "X")
    places += [
        Matrix.Translation((x, WALL_M - 0.02, z)) @ Matrix.Rotation(rng.uniform(-0.1, 0.1), 4, "Y") @ upright
        for x, z in ((-0.68, 0.14), (-0.44, 0.16), (-0.24, 0.2))
    ]
    for k, place in enumerate(places):
        wide, high = (0.21, 0.28) if k < 2 else (0.15, rng.uniform(0.15, 0.21))
        corners = [tuple(place @ Vector((x, y, 0))) for x, y in ((0, 0), (wide, 0), (wide, high), (0, high))]
        mesh_object(f"paper {k}", corners, [(0, 1, 2, 3)], [white])["pecs_class"] = "paper"
        text(rng.choice(WORDS), 0.024, ink, place @ Matrix.Translation((0.02, high - 0.035, 0.0004)), "paper")
        lines, y = Shape(), high - 0.055
        while y > 0.02:  # words as bars, as they look from afar
            x, end = 0.02, wide - 0.02 - (rng.random() < 0.2) * rng.uniform(0.03, 0.1)
            while x < end:
                long = min(rng.uniform(0.006, 0.022), end - x)
                bar = ((x, y), (x + long, y), (x + long, y + 0.003), (x, y + 0.003))
                lines.add([place @ Vector((*c, 0.0004)) for c in bar], [(0, 1, 2, 3)], ink)
                x += long + 0.004
            y -= 0.0075
        lines.object(f"lines {k}", "paper")


def keyboard(paint):
    dark, light = paint.plain((0.03, 0.03, 0.035), 0.5), paint.plain((0.6, 0.6, 0.58), 0.5)
    shape, (left, near) = Shape(), (-0.17, 0.68)
    shape.box((left, left + 0.34), (near, near + 0.13), (DESK_M, DESK_M + 0.012), dark)
    for row in range(5):
        for column in range(16):
            x, y = left + 0.012 + 0.0199 * column, near + 0.011 + 0.0222 * row
            if row or not 4 <= column <= 9:
                shape.box((x, x + 0.0165), (y, y + 0.018), (DESK_M + 0.012, DESK_M + 0.018), light)
    x = left + 0.012 + 4 * 0.0199
    shape.box((x, x + 0.116), (near + 0.011, near + 0.029), (DESK_M + 0.012, DESK_M + 0.018), light)
    shape.object("keyboard", "keyboard")


def screen(paint, rng):
    """A screen that shows lines of a program, and emits about as much as a white card reflects."""
    black, (x, y, z) = paint.plain((0.02, 0.02, 0.022), 0.3), (0.0, 1.02, DESK_M + 0.09)
    shape = Shape()
    shape.box((x - 0.27, x + 0.27), (y, y + 0.03), (z, z + 0.32), black)
    shape.box((x - 0.02, x + 0.02), (y + 0.03, y + 0.06), (DESK_M, z + 0.15), black)
    shape.box((x - 0.12, x + 0.12), (y - 0.04, y + 0.12), (DESK_M, DESK_M + 0.012), black)
    shape.object("screen", "screen")
    shown, columns, rows = Shape(), 56, 26
    colours = ((0.9, 0.9, 0.9), (0.2, 0.5, 1.0), (0.2, 0.8, 0.3), (1.0, 0.5, 0.1))
    inks = [glowing(f"light {k}", rgb) for k, rgb in enumerate(colours)]
    wide, high = 0.51 / columns, 0.29 / rows

    def bar(column, row, cells, thick, out_m, material):
        left, top = x - 0.255 + column * wide, z + 0.305 - row * high
        cell = ((left, top), (left + cells * wide, top), (left + cells * wide, top - thick), (left, top - thick))
        shown.add([(u, y - out_m, v) for u, v in cell], [(0, 1, 2, 3)], material)

    bar(0, 0, columns, 0.29, 0.0005, glowing("background", (0.03, 0.03, 0.04)))
    for row in range(1, rows - 1):
        column = 2 + 2 * rng.randrange(4)
        end = column + rng.randrange(8, 40)
        while column < min(end, columns - 2) and row % 7:
            cells = min(rng.randrange(2, 8), columns - 1 - column)
            bar(column, row + 0.25, cells, 0.5 * high, 0.001, rng.choice(inks))
            column += cells + 1
    shown.object("picture", "screen")


def glowing(name, rgb):
    material, shader = material_of(name, "ShaderNodeEmission")
    shader.inputs["Color"].default_value = (*rgb, 1.0)
    return material


def mug(paint, rng):
    """With pencils in it, and stripes around it."""
    x, y = 0.28, 0.78
    body, stripe = (paint.plain(colour, 0.12) for colour in rng.sample(COLOURS, 2))
    shape = Shape()
    heights = [DESK_M, DESK_M + 0.015, DESK_M + 0.04, DESK_M + 0.05, DESK_M + 0.07, DESK_M + 0.095]
    around = [2 * math.pi * k / 48 for k in range(48)]
    rings = [[(x + 0.04 * math.cos(a), y + 0.04 * math.sin(a), z) for a in around] for z in heights]
    rings += [
        [(x + 0.036 * math.cos(a), y + 0.036 * math.sin(a), z) for a in around] for z in (heights[-1], DESK_M + 0.01)
    ]
    for k, (low, high) in enumerate(zip(rings[:-1], rings[1:], strict=True)):
        shape.band(low, high, stripe if k in (1, 3) else body)
    shape.add(rings[-1], [tuple(range(48))], body)
    for k in range(7):  # a handle of short tubes
        a, b = (math.pi * (n / 7 - 0.5) for n in (k, k + 1))
        ends = [(x + 0.038 + 0.026 * math.cos(c), y, DESK_M + 0.05 + 0.028 * math.sin(c)) for c in (a, b)]
        shape.tube(*ends, (0.005, 0.005), body, 10)
    shape.object("mug", "mug")
    pencils = Shape()
    for k in range(6):
        angle, colour = k * math.pi / 3 + rng.uniform(-0.3, 0.3), rng.choice(COLOURS)
        foot = Vector((x - 0.02 * math.cos(angle), y - 0.02 * math.sin(angle), DESK_M + 0.011))
        way = (Vector((x + 0.03 * math.cos(angle), y + 0.03 * math.sin(angle), DESK_M + 0.095)) - foot).normalized()
        tip = foot + rng.uniform(0.13, 0.17) * way
        pencils.tube(foot, tip, (0.0035, 0.0035), paint.plain(colour, 0.3), 6)
        pencils.tube(tip, tip + 0.012 * way, (0.0035, 0.0015), paint.plain((0.6, 0.42, 0.25), 0.8), 6)
        pencils.tube(tip + 0.012 * way, tip + 0.017 * way, (0.0015, 0.0002), paint.plain(INK, 0.5), 6)
    pencils.object("pencils", "pencil")


def plant(paint, rng):
    """Leaves that bend, in a pot."""
    greens = [paint.plain(rgb, 0.4) for rgb in ((0.04, 0.14, 0.03), (0.08, 0.24, 0.05), (0.16, 0.32, 0.08))]
    pot = paint.noise("clay", (0.3, 0.12, 0.06), (0.5, 0.24, 0.13), (30.0, 150.0))
    x, y = 0.63, 1.05
    shape = Shape()
    shape.tube((x, y, DESK_M), (x, y, DESK_M + 0.1), (0.05, 0.065), pot, 32)
    shape.tube((x, y, DESK_M + 0.1), (x, y, DESK_M + 0.102), (0.058, 0.058), paint.plain((0.05, 0.03, 0.02), 0.9), 32)
    for _ in range(42):
        turn, long, wide = rng.uniform(0, 2 * math.pi), rng.uniform(0.12, 0.26), rng.uniform(0.008, 0.016)
        lean = rng.uniform(0.15, 0.9)
        out, side = Vector((math.cos(turn), math.sin(turn), 0)), Vector((-math.sin(turn), math.cos(turn), 0))
        points, steps = [], 7
        for k in range(steps + 1):
            s = k / steps
            middle = Vector((x, y, DESK_M + 0.1)) + long * (
                lean * s * out + Vector((0, 0, s * (1 - 0.55 * lean * s * s)))
            )
            half = wide * math.sin(math.pi * min(0.12 + 0.88 * s, 0.999))
            points += [middle - half * side, middle + half * side]
        faces = [(2 * k, 2 * k + 1, 2 * k + 3, 2 * k + 2) for k in range(steps)]
        shape.add(points, faces, rng.choice(greens))
    shape.object("plant", "plant")


def fan(turns_hz, paint, rng):
    """Four blades behind a guard of wires, towards the camera."""
    place = Vector((0.4, 1.05, DESK_M + 0.24))
    steel, dark = paint.plain((0.4, 0.4, 0.41), 0.3), paint.plain((0.05, 0.05, 0.055), 0.5)
    stand = Shape()
    stand.tube((place.x, place.y + 0.05, DESK_M), (place.x, place.y + 0.05, DESK_M + 0.02), (0.08, 0.075), dark, 24)
    stand.tube((place.x, place.y + 0.05, DESK_M), (place.x, place.y + 0.05, place.z), (0.012, 0.012), dark, 12)
    stand.tube(place + Vector((0, 0.02, 0)), place + Vector((0, 0.11, 0)), (0.035, 0.03), dark, 20)
    segments = 40
    for radius in (0.04, 0.08, 0.12):
        circle = [
            place + Vector((radius * math.cos(a), -0.03 if radius < 0.12 else 0.0, radius * math.sin(a)))
            for a in (2 * math.pi * k / segments for k in range(segments + 1))
        ]
        for a, b in zip(circle[:-1], circle[1:], strict=True):
            stand.tube(a, b, (0.0013, 0.0013), steel, 5)
    for k in range(12):
        way = Vector((math.cos(k * math.pi / 6), 0, math.sin(k * math.pi / 6)))
        stand.tube(place + 0.04 * way + Vector((0, -0.03, 0)), place + 0.12 * way, (0.0011, 0.0011), steel, 5)
    stand.object("fan", "fan")
    blades, colour = Shape(), paint.plain(rng.choice(COLOURS), 0.3)
    for k in range(4):
        turn, points = Matrix.Rotation(k * math.pi / 2, 4, "Y"), []
        for r in (0.02, 0.045, 0.075, 0.105):
            half, pitch = 0.3 * r + 0.012, math.radians(55 - 250 * r)
            edge = Vector((0, math.sin(pitch) * half, math.cos(pitch) * half))
            points += [turn @ (Vector((r, 0, 0)) - edge), turn @ (Vector((r, 0, 0)) + edge)]
        blades.add(points, [(2 * j, 2 * j + 1, 2 * j + 3, 2 * j + 2) for j in range(3)], colour)
    blades.tube((0, -0.015, 0), (0, 0.02, 0), (0.022, 0.026), dark, 20)
    wheel = blades.object("blades", "fan")
    wheel.location = place

    def move(t_s):
        wheel.rotation_euler = (0.0, 2 * math.pi * turns_hz * t_s, 0.0)

    return move


def metronome(swings_hz, paint, rng):
    """A pyramid of wood, and before it a rod with a weight that swings by 25 degrees."""
    wood = paint.noise("polished wood", (0.12, 0.04, 0.02), (0.3, 0.12, 0.06), (15.0, 120.0), roughness=0.25)
    x, y = 0.08, 0.47
    shape = Shape()
    corners = [
        (x + w * s, y + w * t, DESK_M + h)
        for w, h in ((0.055, 0.0), (0.022, 0.21))
        for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    shape.add(corners, [(0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7), (0, 3, 2, 1), (4, 5, 6, 7)], wood)
    shape.object("metronome", "metronome")
    rod, steel = Shape(), paint.plain((0.6, 0.6, 0.58), 0.2)
    rod.tube((0, 0, 0), (0, 0, 0.25), (0.0018, 0.0018), steel, 8)
    weight = [(-0.012, 0.17), (0.012, 0.17), (0.009, 0.2), (-0.009, 0.2)]
    rod.add(
        [(u, s, v) for s in (-0.005, 0.005) for u, v in weight],
        [(0, 1, 2, 3), (7, 6, 5, 4), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)],
        paint.plain((0.7, 0.55, 0.2), 0.25),
    )
    pendulum = rod.object("pendulum", "metronome")
    pendulum.location = (x, y - 0.062, DESK_M + 0.02)
    phase = rng.uniform(0, 2 * math.pi)

    def move(t_s):
        pendulum.rotation_euler = (0.0, math.radians(25) * math.sin(2 * math.pi * swings_hz * t_s + phase), 0.0)

    return move
