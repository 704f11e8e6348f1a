# SPDX-License-Identifier: GPL-3.0-or-later
"""The lab's rotating disk: a closed grey box, a long ceiling lamp, a disk of black and white sectors on the far side.

World: x right, y away from the camera, z up, metres; the camera's entrance pupil is the origin and looks along +y.
"""

import math

from pecs_blender.scene.build import SceneParts, diffuse, lab_box, sector_disk


def build(p):
    """p: resolved parameters of scene.json, spectra loaded. Returns SceneParts."""
    white = diffuse("white", p["white_reflectance"])
    black = diffuse("black", p["black_reflectance"])
    lab_box(p)
    # Black begins at angle 0: turning counter-clockwise brings white behind its leading edge.
    disk = sector_disk("disk", int(p["sectors"]), p["disk_radius_mm"] * 1e-3, [black, white])
    centre = (p["disk_right_mm"] * 1e-3, p["disk_distance_mm"] * 1e-3, p["disk_up_mm"] * 1e-3)
    disk.location = centre
    disk.rotation_mode = "XYZ"

    speed_rad_per_s = p["rpm"] * 2 * math.pi / 60

    def pose(t_s):
        # Euler y turns x towards -z, clockwise as the camera sees it: hence the sign.
        disk.rotation_euler = (0.0, -(math.radians(p["phase_deg"]) + speed_rad_per_s * t_s), 0.0)

    return SceneParts(
        pose=pose,
        period_s=2 * math.pi / speed_rad_per_s / (p["sectors"] / 2) if speed_rad_per_s else None,
        target=(centre, (0.0, -1.0, 0.0)),
        illuminance_lux=p["illuminance_lux"],
    )
