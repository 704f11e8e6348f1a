"""The depth layer against geometry, through a lens and for the scene's own camera; layers are resumed and merged."""

import json

import numpy as np
import pecs
import pytest
from support import make_blends, pecs_blender

SIZE = WIDTH, HEIGHT = 48, 32
LENS = ("--lens", "cmount_8mm_f2p8", "--focus", 3, "--fnumber", 2.8)
COMMON = ("--bands", 1, "--frames", 1, "--samples", 1)


@pytest.fixture(scope="module")
def blends(tmp_path_factory):
    return make_blends("files", tmp_path_factory.mktemp("depth"), "measured", "centimetres")


def layers(folder):
    with pecs.StackReader(folder) as reader:
        return reader.read_frame(0), reader.read_layer("depth", 0)


def expected(directions):
    """Distance and z [m] along rays [h, w, 3] (x right, y down, z forward) in the scene `measured`; and where it
    is certain: a ball of facets has another rim."""
    from math import cos, radians, sin

    right, down, ahead = np.moveaxis(directions, -1, 0)
    # World x right, y ahead, z up. The wall: turned about z; 4 m wide
    normal, along = np.array([-sin(radians(20)), cos(radians(20))]), np.array([cos(radians(20)), sin(radians(20))])
    wall = (normal @ [0, 5]) / (normal[0] * right + normal[1] * ahead)
    x, y, z = wall * right, wall * ahead, wall * -down
    edge = np.maximum(np.abs(along[0] * x + along[1] * (y - 5)), np.abs(z)) - 2
    wall[edge > 0] = np.inf
    centre = np.array([0.3, 3, -0.2])
    b = right * centre[0] + ahead * centre[1] - down * centre[2]
    discriminant = b**2 - centre @ centre + 0.25
    ball = np.where(discriminant > 0, b - np.sqrt(np.maximum(discriminant, 0)), np.inf)
    distance = np.minimum(wall, ball)
    return distance, distance * ahead, (np.abs(discriminant) > 0.03) & (np.abs(edge) > 0.02)


def check(depth, directions):
    distance, z, certain = expected(directions)
    assert 0.8 < certain.mean() < 1 and np.isinf(distance[certain]).any() and (distance < 3).any()
    for seen, wanted in ((depth[0], distance), (depth[1], z)):
        assert (np.isinf(seen) == np.isinf(wanted))[certain].all()
        near = certain & np.isfinite(wanted)
        error = np.abs(seen[near] / wanted[near] - 1)
        print(f"{error.max():.2e}, median {np.median(error):.2e}")
        assert error.max() < 1e-4


def pixel_centres():
    return np.stack(np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5), -1)


@pytest.fixture(scope="module")
def own(blends):
    """Renders with the file's own camera, out of focus and shifted."""
    for name in ("measured", "centimetres"):
        pecs_blender("render", blends / f"{name}.blend", "-o", blends / f"own_{name}", *COMMON, "--layers", "depth")
    return blends


@pytest.mark.parametrize("name", ["measured", "centimetres"])
def test_depth_of_the_scenes_own_camera(own, name):
    pixels = pixel_centres()
    focal_px = 40 / 36 * WIDTH
    x = (pixels[..., 0] - WIDTH / 2) / focal_px + 0.05 * 36 / 40
    y = (pixels[..., 1] - HEIGHT / 2) / focal_px
    directions = np.stack([x, y, np.ones_like(x)], -1)
    check(layers(own / f"own_{name}")[1], directions / np.linalg.norm(directions, axis=-1, keepdims=True))


@pytest.fixture(scope="module")
def lensed(blends):
    for name in ("measured", "centimetres"):
        args = ("--layers", "depth", "--samples", 8, "--film-shift", 0.3, -0.2)
        pecs_blender("render", blends / f"{name}.blend", "-o", blends / f"lens_{name}", *COMMON, *LENS, *args)
    return blends


@pytest.mark.parametrize("name", ["measured", "centimetres"])
def test_depth_through_a_lens(lensed, name):
    stack = json.loads((lensed / f"lens_{name}" / "stack.json").read_text())
    lambda_nm = stack["bands"][0]["lambda_nm"]
    directions = pecs.Lens("cmount_8mm_f2p8").directions(
        pixel_centres(),
        width=WIDTH,
        height=HEIGHT,
        pixel_pitch_mm=1e3 * stack["pixel_pitch_m"],
        lambda_nm=lambda_nm,
        focus_bands_nm=[lambda_nm],
        focus_m=3,
        fnumber=2.8,
        film_shift_mm=(0.3, -0.2),
    )
    check(layers(lensed / f"lens_{name}")[1], directions)


def test_a_scene_in_centimetres_is_the_same_scene(lensed, own):
    """Its lens, focus, lamp's distance and depth; only rounding differs."""
    for kind in ("lens", "own"):
        metres, centimetres = (layers(own / f"{kind}_{name}")[0][0] for name in ("measured", "centimetres"))
        lit = metres > 0.05 * metres.max()
        assert np.median(centimetres[lit] / metres[lit]) == pytest.approx(1, abs=1e-3), kind
        assert np.abs(centimetres[lit] / metres[lit] - 1).mean() < 0.02, kind


def test_an_instant_is_done_when_all_its_layers_are(blends, tmp_path):
    args = ("render", blends / "measured.blend", *COMMON[:2], "--samples", 1, "--width", 12)
    pecs_blender(*args, "-o", tmp_path / "light", "--frames", 4)
    pecs_blender(*args, "-o", tmp_path / "s", "--frames", 4, "--layers", "depth")
    whole = {p.name: p.read_bytes() for p in (tmp_path / "s").iterdir()}
    for path in (tmp_path / "light").glob("*.exr"):  # the light does not depend on other files of its folder
        assert path.read_bytes() == whole[path.name]
    (tmp_path / "s/depth_000001.exr").unlink()
    (tmp_path / "s/depth_000002.exr").write_bytes(whole["depth_000002.exr"][:-50])
    before = {p.name: p.stat().st_mtime_ns for p in (tmp_path / "s").glob("frame_*")}
    result = pecs_blender(*args, "-o", tmp_path / "s", "--frames", 4, "--layers", "depth")
    assert "2 of 4 exist already" in result.stderr
    assert {p.name: p.read_bytes() for p in (tmp_path / "s").iterdir()} == whole
    assert {p.name: p.stat().st_mtime_ns for p in (tmp_path / "s").glob("frame_*")} == before

    for name, frames in (("a", "0:3"), ("b", "3:4")):
        pecs_blender(*args, "-o", tmp_path / name, "--frames", frames, "--layers", "depth")
    pecs_blender("merge", tmp_path / "b", tmp_path / "a", "-o", tmp_path / "merged")
    assert {p.name: p.read_bytes() for p in (tmp_path / "merged").iterdir()} == whole
    (tmp_path / "b/depth_000000.exr").unlink()
    result = pecs_blender("merge", tmp_path / "b", tmp_path / "a", "-o", tmp_path / "x", check=False)
    assert result.returncode == 4 and "depth: instant" in result.stderr

    result = pecs_blender(*args, "-o", tmp_path / "s", "--frames", 4, check=False)
    assert result.returncode == 5 and "layers" in result.stderr and "--overwrite" in result.stderr
    pecs_blender(*args, "-o", tmp_path / "s", "--frames", 2, "--overwrite")
    assert sorted(p.name for p in (tmp_path / "s").iterdir()) == ["frame_000000.exr", "frame_000001.exr", "stack.json"]
    result = pecs_blender(*args, "-o", tmp_path / "x", "--layers", "flow", check=False)
    assert result.returncode == 2 and len(result.stderr.splitlines()) == 1
