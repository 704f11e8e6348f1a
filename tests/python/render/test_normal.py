"""The layer `normal` against a plane, a ball and a room, through a pinhole and a lens (scenes of blend_things.py)."""

import numpy as np
import pecs
import pytest
from scipy.spatial.transform import Rotation
from support import make_blends, pecs_blender
from support.views import LensCamera, Pinhole

SIZE = WIDTH, HEIGHT = 64, 36
ARGS = ("--frames", 1, "--bands", 1, "--no-light", "--layers", "normal,depth,objects", "--width", WIDTH)
LENS = ("--lens", "cmount_8mm_f2p8", "--focus", 4, "--fnumber", 4)
CAMERA_FROM_WORLD = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]])


@pytest.fixture(scope="module")
def blends(tmp_path_factory):
    folder = make_blends("things", tmp_path_factory.mktemp("normal"), "centimetres")
    return make_blends("motion", folder, "holes", "clay")


@pytest.mark.parametrize("lens", [(), LENS])
def test_a_ball_and_a_plane(blends, tmp_path, lens):
    args = (*ARGS, "--height", HEIGHT, *lens)
    pecs_blender("render", blends / "centimetres.blend", "-o", tmp_path / "s", *args)
    with pecs.StackReader(tmp_path / "s") as stack:
        normal, (_, z), ids = (stack.read_layer(name, 0).astype(float) for name in ("normal", "depth", "objects"))
    surface, ids = np.isfinite(z), ids[0].astype(int)
    assert np.allclose(np.linalg.norm(normal, axis=0)[surface], 1, atol=1e-6) and (normal[:, ~surface] == 0).all()
    assert 0.02 < surface.mean() < 0.6
    camera = LensCamera(tmp_path / "s") if lens else Pinhole()
    ball, _, plane = (ids == k for k in (1, 2, 3))  # ball, cube, plane
    points = np.vstack([camera.rays(), np.ones((1, HEIGHT, WIDTH))]) * np.where(surface, z, 0)
    centre = CAMERA_FROM_WORLD @ [-0.8, 4, 0.2]
    wanted = (points - centre[:, None, None])[:, ball] / 0.5
    assert ball.sum() > 20 and np.abs(normal[:, ball] - wanted).max() < 0.02
    wanted = CAMERA_FROM_WORLD @ Rotation.from_euler("xyz", [20, 10, 30], degrees=True).as_matrix() @ [0, -1, 0]
    assert plane.sum() > 50 and np.abs(normal[:, plane] - wanted[:, None]).max() < 1e-5
    assert (np.einsum("iyx,iyx->yx", normal, points)[surface] < 0).all()  # towards the camera


@pytest.mark.parametrize(("name", "surfaces"), [("holes", 2), ("clay", 1)])
def test_holes_are_looked_through(blends, tmp_path, name, surfaces):
    """A plate and a wall behind, both perpendicular to y; a material that replaces all others closes the holes."""
    pecs_blender("render", blends / f"{name}.blend", "-o", tmp_path / "s", *ARGS)
    with pecs.StackReader(tmp_path / "s") as stack:
        normal, (_, z), ids = (stack.read_layer(one, 0) for one in ("normal", "depth", "objects"))
    surface = np.isfinite(z)
    assert len(np.unique(z[surface].round(1))) == len(np.unique(ids[0, surface])) == surfaces
    assert np.allclose(normal[:, surface].T, [0, 0, -1], atol=1e-6)
