"""Renders .blend files as they are, and through the band matrix: `python band_pass.py OUT.npz FILE.blend...`

Per file, all [3, height, width]: plain (the file under our fixed sampling), identity (rewritten, matrix 1), grey
(rewritten, three equal rows), spectral (a pass at 620, 540, 460 nm), radiance (the same, not relative to the lamps).
"""

import sys
from pathlib import Path

import bpy  # noqa: F401  before pecs
import numpy as np
from pecs_blender.scene import cycles
from pecs_blender.scene.blend import BlendScene
from pecs_blender.spectral import spectral_scene
from pecs_blender.spectral.bands import points
from pecs_blender.spectral.spectra import load

SAMPLES, T_S = 8, 0.125
MATRICES = {
    "identity": lambda bands, lamp: np.eye(3),
    "grey": lambda bands, lamp: np.full((3, 3), 1 / 3),
    "spectral": spectral_scene.band_matrix,
}


def open_scene(path):
    source = BlendScene(Path(path), None, load("d65"), False)
    cycles.configure(source.scene, *source.size, cycles.Sampling(samples=SAMPLES, seed=1, bounces=source.bounces))
    return source


def plain(path):
    source = open_scene(path)
    source.set_time(T_S)
    return cycles.Film(source.scene).render()


def banded(path, kind):
    source = open_scene(path)
    spectral_scene.band_matrix = MATRICES[kind]
    spectral = spectral_scene.SpectralScene(load("d65"), source.folder)
    spectral.before_instant()
    source.set_time(T_S)
    spectral.after_instant()
    spectral.set_pass(points([620.0, 540.0, 460.0] if kind == "spectral" else [560.0] * 3))
    return cycles.Film(source.scene).render(), spectral.emitters.norm(points([620.0, 540.0, 460.0]))


def main(out, paths):
    pictures = {}
    for path in paths:
        name = Path(path).stem
        pictures[f"{name}/plain"] = plain(path)
        for kind in MATRICES:
            pictures[f"{name}/{kind}"], norm = banded(path, kind)
        pictures[f"{name}/radiance"] = pictures[f"{name}/spectral"] * norm[:, None, None]
    np.savez(out, **pictures)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
