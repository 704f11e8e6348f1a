"""Cameras whose projection is known, and the motion layer of moving things against them (scenes of blend_motion.py).

World: x right, y ahead, z up. Camera axes: x right, y down, z ahead."""

import json

import numpy as np
import pecs

SIZE = WIDTH, HEIGHT = 64, 36
TOLERANCE_PX = 1e-3
FLIP = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])  # from the world


def motion(folder, interval=0):
    """There and back: x and y after each quarter, z z_end."""
    with pecs.StackReader(folder) as stack:
        return stack.read_layer("motion", interval).astype(float).reshape(2, 10, HEIGHT, WIDTH)


def turn(axis, angle):
    """[4, 4] about a world axis."""
    m, (a, b) = np.eye(4), ((axis + 1) % 3, (axis + 2) % 3)
    m[a, a] = m[b, b] = np.cos(angle)
    m[a, b], m[b, a] = -np.sin(angle), np.sin(angle)
    return m


def shift(*xyz):
    m = np.eye(4)
    m[:3, 3] = xyz
    return m


def pixel_centres():
    return np.stack(np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5))


class Pinhole:
    """Focal length: the picture's width. Points [3, ...]: x right, y down, z ahead."""

    def film(self, points):
        return points[:2] / points[2] * WIDTH + np.array([WIDTH / 2, HEIGHT / 2])[:, None, None]

    def rays(self):
        """x, y per z."""
        return (pixel_centres() - np.array([WIDTH / 2, HEIGHT / 2])[:, None, None]) / WIDTH


class LensCamera:
    """The lens of a stack."""

    def __init__(self, folder):
        stack = json.loads((folder / "stack.json").read_text())
        lens, render, bands_nm = stack["lens"], stack["render"], [band["lambda_nm"] for band in stack["bands"]]
        self._lens = pecs.Lens(lens["file"].removesuffix(".json"))
        size = {"width": stack["width"], "height": stack["height"], "pixel_pitch_mm": 1e3 * stack["pixel_pitch_m"]}
        light = {"lambda_nm": float(np.mean(bands_nm)), "focus_bands_nm": bands_nm}
        stop = {key: lens[key] for key in ("focus_m", "stop_diameter_mm")}
        self._setting = {**size, **light, **stop, "film_shift_mm": tuple(render["film_shift_mm"])}

    def film(self, points):
        return np.moveaxis(self._lens.pixels(np.moveaxis(points, 0, -1), **self._setting), -1, 0)

    def rays(self):
        x, y, z = np.moveaxis(self._lens.directions(np.moveaxis(pixel_centres(), 0, -1), **self._setting), -1, 0)
        return np.stack([x, y]) / z


def still(t):
    return np.eye(4)


def quarters(begin, end):
    """Times and channels of displacements."""
    return [(begin + k / 4 * (end - begin), slice(2 * k - 2, 2 * k)) for k in (1, 2, 3, 4)]


def check_way(way, camera, things, times, camera_from_world=lambda t: FLIP, least=0.3, depth_rtol=1e-5):
    """One half of the layer of an interval against the poses of things by their distance; returns its displacement."""
    begin, end = times
    rays, z = camera.rays(), way[8]
    points = np.stack([*(rays * z), z, np.ones_like(z)])
    found = np.zeros(z.shape, bool)
    for (low, high), pose in things.items():
        there = (z > low) & (z < high)
        assert there.any(), (low, high)
        found |= there
        for t, channels in quarters(begin, end):
            back = np.linalg.inv(camera_from_world(begin) @ pose(begin))
            now = np.einsum("ij,jyx->iyx", camera_from_world(t) @ pose(t) @ back, np.where(there, points, 1))
            wanted = np.where(there, camera.film(now[:3]) - pixel_centres(), np.nan)
            known = there & np.isfinite(wanted).all(0)
            assert known.sum() > least * there.sum()
            error = np.abs(way[channels] - wanted)[:, known].max()
            print(f"{low} m: {np.abs(wanted[:, known]).max():.3f} px, off by {error:.1e} px")
            assert error < TOLERANCE_PX
            if t == end:
                assert np.allclose(way[9][known], now[2][known], rtol=depth_rtol)
    assert (np.isfinite(z) == found).all()
    return way[:8]


def check_travel(way, camera, times, camera_from_world, depth_rtol=1e-5):
    """A near square and a wall, both perpendicular to y; the sky behind turns alone."""
    begin = times[0]
    surface = np.isfinite(way[8])
    z = np.where(surface, way[8], 1)
    points = np.stack([*(camera.rays() * z), z, np.ones_like(z)])
    ahead = np.einsum("j,jyx->yx", np.linalg.inv(camera_from_world(begin))[1], points)[surface]
    distance = np.abs(ahead[:, None] - [3, 8]).min(1)
    assert distance.max() < 1e-4 and 0.2 < surface.mean() < 0.9
    check_way(way, camera, {(2, 9): still}, times, camera_from_world, least=0.9, depth_rtol=depth_rtol)
    sky = np.isinf(way[8])
    along = np.vstack([camera.rays(), np.ones_like(way[8:9])])
    for t, channels in quarters(*times):
        turned = np.einsum(
            "ij,jyx->iyx", (camera_from_world(t) @ np.linalg.inv(camera_from_world(begin)))[:3, :3], along
        )
        wanted = camera.film(turned) - pixel_centres()
        known = sky & np.isfinite(wanted).all(0)
        assert known.sum() > 0.8 * sky.sum() and (t != times[1] or np.abs(wanted[:, known]).max() > 1)
        assert np.abs(way[channels] - wanted)[:, known].max() < TOLERANCE_PX
    assert np.isfinite(way[:8]).all()  # also of what leaves the picture
