"""An empty floor for objects of other files, under lamps at random places, with or without walls.

World: x right, y away from the camera, z up, metres; the camera's entrance pupil is the origin and looks along +y.
"""

from random import Random

from pecs_blender.scene.build import SceneParts, area_lamp, diffuse, mesh_object

FLOOR_M = -1.0
LAMP_X_M, LAMP_Y_M, LAMP_Z_M, LAMP_SIDE_M = (-4.0, 4.0), (-2.0, 6.0), (2.0, 4.0), (0.2, 1.0)


def build(p):
    """p: resolved parameters of scene.json, spectra loaded. Returns SceneParts."""
    rng, half = Random(int(p["lamp_seed"])), p["floor_m"] / 2
    grey = diffuse("floor", p["floor_reflectance"])
    low = [(-half, -half), (half, -half), (half, half), (-half, half)]
    mesh_object("floor", [(x, y, FLOOR_M) for x, y in low], [(0, 1, 2, 3)], [grey])["pecs_class"] = "floor"
    if p["walls_m"]:
        corners = [(x, y, z) for z in (FLOOR_M, FLOOR_M + p["walls_m"]) for x, y in low]
        sides = [(i, (i + 1) % 4, 4 + (i + 1) % 4, 4 + i) for i in range(4)]
        mesh_object("walls", corners, sides, [grey])["pecs_class"] = "wall"
    for number in range(int(p["lamps"])):
        place = tuple(rng.uniform(*ends) for ends in (LAMP_X_M, LAMP_Y_M, LAMP_Z_M))
        side = rng.uniform(*LAMP_SIDE_M)
        lamp = area_lamp(f"lamp {number}", place, (side, side), p["lamp_spectrum"])
        lamp.data.energy *= rng.uniform(0.3, 1.0)
    return SceneParts(
        pose=lambda t_s: None,
        target=((0.0, 3.0, 0.0), (0.0, -1.0, 0.0)),
        illuminance_lux=p["illuminance_lux"],
    )
