# SPDX-License-Identifier: GPL-3.0-or-later
"""The lab's box with a disk of 24 sectors, the patches of a ColorChecker in the chart's order, counter-clockwise from
the right. World: x right, y away from the camera, z up, metres; the entrance pupil is the origin and looks along +y.
"""

import math

from pecs_blender.scene.build import SceneParts, diffuse, lab_box, sector_disk
from pecs_blender.spectral.spectra import constant, load

PATCHES = (
    "dark_skin light_skin blue_sky foliage blue_flower bluish_green "
    "orange purplish_blue moderate_red purple yellow_green orange_yellow "
    "blue green red yellow magenta cyan "
    "white_9p5 neutral_8 neutral_6p5 neutral_5 neutral_3p5 black_2"
).split()


def build(p):
    """p: resolved parameters of scene.json, spectra loaded. Returns SceneParts."""
    spectra = [load(f"colorchecker/{patch}") for patch in PATCHES]
    if p["grey"]:
        spectra = [constant(round(float(s.value.mean()), 6)) for s in spectra]
    materials = [diffuse(patch, s) for patch, s in zip(PATCHES, spectra, strict=True)]
    lab_box(p)
    disk = sector_disk("disk", len(PATCHES), p["disk_radius_mm"] * 1e-3, materials)
    disk.location = (p["disk_right_mm"] * 1e-3, p["disk_distance_mm"] * 1e-3, 0.0)
    speed_rad_per_s = p["rpm"] * 2 * math.pi / 60

    def pose(t_s):
        disk.rotation_euler = (0.0, -(math.radians(p["phase_deg"]) + speed_rad_per_s * t_s), 0.0)

    return SceneParts(
        pose=pose,
        period_s=2 * math.pi / speed_rad_per_s if speed_rad_per_s else None,
        target=(tuple(disk.location), (0.0, -1.0, 0.0)),
        illuminance_lux=p["illuminance_lux"],
    )
