# SPDX-License-Identifier: GPL-3.0-or-later
"""The lab's checkerboard on a slide: the lab's box, a plate with 4x4 squares that moves from right to left.

World: x right, y away from the camera, z up, metres; the camera's entrance pupil is the origin and looks along +y.
"""

from pecs_blender.scene.build import SceneParts, diffuse, lab_box, mesh_object


def build(p):
    """p: resolved parameters of scene.json, spectra loaded. Returns SceneParts."""
    white = diffuse("white", p["white_reflectance"])
    black = diffuse("black", p["black_reflectance"])
    lab_box(p)
    distance_m, up_m = p["board_distance_mm"] * 1e-3, p["board_up_mm"] * 1e-3
    board = _board(int(p["squares"]), p["square_mm"] * 1e-3, p["plate_mm"] * 1e-3, white, black)

    def pose(t_s):
        board.location = (p["start_right_mm"] * 1e-3 - p["speed_m_per_s"] * t_s, distance_m, up_m)

    return SceneParts(
        pose=pose,
        target=((0.0, distance_m - 0.001, 0.0), (0.0, -1.0, 0.0)),
        illuminance_lux=p["illuminance_lux"],
    )


def _board(n, square_m, plate_m, white, black):
    """In the x-z plane, seen from -y: one sheet, so that the edges between squares are edges and nothing else."""
    half = n * square_m / 2
    rim = max(plate_m / 2, half)
    lines = [-rim] + [-half + i * square_m for i in range(n + 1)] + [rim]
    vertices = [(x, 0.0, z) for z in lines for x in lines]
    faces, colours = [], []
    for row in range(n + 2):  # upwards
        for column in range(n + 2):
            a = row * (n + 3) + column
            faces.append((a, a + 1, a + n + 4, a + n + 3))
            on_squares = 1 <= row <= n and 1 <= column <= n
            colours.append(int(on_squares and (n - row + column - 1) % 2))  # top left (row n, column 1) is white
    board = mesh_object("board", vertices, faces, [white, black])
    board.data.polygons.foreach_set("material_index", colours)
    board.data.update()
    return board
