# SPDX-License-Identifier: GPL-3.0-or-later
"""The lab's rotating disk: a closed grey box, a long ceiling lamp, a disk of black and white sectors on the far side.

World: x right, y away from the camera, z up, metres; the camera's entrance pupil is the origin and looks along +y.
"""

import math

from pecs_blender.scene.build import SceneParts, area_lamp, box, diffuse, mesh_object

RIM_SEGMENTS_PER_SECTOR = 512  # sagitta R(1 - cos(pi/2048)) = 0.0004 px at R = 303 px
ROOM_X_M, ROOM_Y_M, ROOM_Z_M = (-1.2, 1.2), (-0.4, 1.8), (-0.9, 0.9)


def build(p):
    """p: resolved parameters of scene.json, spectra loaded. Returns SceneParts."""
    white = diffuse("white", p["white_reflectance"])
    black = diffuse("black", p["black_reflectance"])
    walls = diffuse("walls", p["wall_reflectance"])
    box("room", ROOM_X_M, ROOM_Y_M, ROOM_Z_M, walls)
    lamp = area_lamp("ceiling lamp", (0.0, 0.9, ROOM_Z_M[1] - 0.01), size_m=(1.5, 0.12), spectrum=p["lamp_spectrum"])
    disk = _disk(int(p["sectors"]), p["disk_radius_mm"] * 1e-3, white.material, black.material)
    centre = (p["disk_right_mm"] * 1e-3, p["disk_distance_mm"] * 1e-3, p["disk_up_mm"] * 1e-3)
    disk.location = centre
    disk.rotation_mode = "XYZ"

    speed_rad_per_s = p["rpm"] * 2 * math.pi / 60

    def pose(t_s):
        # Euler y turns x towards -z, clockwise as the camera sees it: hence the sign.
        disk.rotation_euler = (0.0, -(math.radians(p["phase_deg"]) + speed_rad_per_s * t_s), 0.0)

    return SceneParts(
        materials=[white, black, walls],
        lamps=[lamp],
        pose=pose,
        period_s=2 * math.pi / speed_rad_per_s / (p["sectors"] / 2) if speed_rad_per_s else None,
        target=(centre, (0.0, -1.0, 0.0)),
        illuminance_lux=p["illuminance_lux"],
    )


def _disk(sectors, radius_m, white, black):
    """A disk in the x-z plane, seen from -y. At angle 0 a white sector's leading edge points to +x: white lies
    clockwise of that edge, so that turning counter-clockwise brings white.

    Rings halve the number of segments inwards, so that triangles stay compact (a fan of slivers renders slowly)."""
    vertices, faces, colours = [(0.0, 0.0, 0.0)], [], []
    n, radius = sectors * RIM_SEGMENTS_PER_SECTOR, radius_m
    ring = _ring(vertices, n, radius)
    while n // sectors > 4:
        radius -= 2 * math.pi * radius / n  # as thick as its segments are long
        inner = _ring(vertices, n // 2, radius)
        for i in range(n // 2):
            a, b, c = ring[2 * i], ring[2 * i + 1], ring[(2 * i + 2) % n]
            d, e = inner[i], inner[(i + 1) % (n // 2)]
            faces += [(a, b, d), (b, e, d), (b, c, e)]
            colours += [i // (n // 2 // sectors)] * 3
        ring, n = inner, n // 2
    for i in range(n):
        faces.append((0, ring[i], ring[(i + 1) % n]))
        colours.append(i // (n // sectors))
    disk = mesh_object("disk", vertices, faces, [white, black])
    # Counter-clockwise from angle 0: black first; white lies behind the leading edge (the last sector).
    disk.data.polygons.foreach_set("material_index", [1 - c % 2 for c in colours])
    disk.data.update()
    return disk


def _ring(vertices, n, radius_m):
    """Appends n vertices of a circle; returns their indices."""
    first = len(vertices)
    angles = (2 * math.pi * i / n for i in range(n))
    vertices += [(radius_m * math.cos(a), 0.0, radius_m * math.sin(a)) for a in angles]
    return range(first, first + n)
