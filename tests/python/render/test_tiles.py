"""Where two pictures differ (pecs_blender.camera.tiles), and which rectangles cover that."""

import numpy as np
import pytest
from pecs_blender.camera import tiles
from support import in_bpy

SHAPE = 90, 150  # no multiple of a tile


def differing(*args, **options):
    return tiles.of_blocks(tiles.differing_blocks(*args, **options))


@pytest.mark.parametrize("call_px", [0, 1000, 1e6])
@pytest.mark.parametrize("share", [0.02, 0.3, 0.8, 1.0])
def test_boxes_cover_all_tiles_once_at_the_least_cost(share, call_px):
    wanted = np.random.default_rng(3).random(tiles.tiles_of(150, 90)) < share
    count = np.zeros(SHAPE, int)
    boxes = tiles.boxes(wanted, 150, 90, call_px)
    for left, top, right, bottom in boxes:
        count[top:bottom, left:right] += 1
    assert count.max() <= 1
    for row, column in np.argwhere(wanted):
        tile = slice(row * tiles.TILE_PX, (row + 1) * tiles.TILE_PX)
        assert (count[tile, column * tiles.TILE_PX : (column + 1) * tiles.TILE_PX] == 1).all()
    alone = wanted.sum() * (tiles.TILE_PX**2 + call_px)
    assert count.sum() + len(boxes) * call_px <= min(alone, wanted.size * tiles.TILE_PX**2 + call_px)
    assert call_px > 0 or count.sum() == tiles.pixels_of(wanted, SHAPE[::-1]).sum()


def test_neighbours():
    one = np.zeros((5, 6), bool)
    one[0, 3] = True
    assert np.argwhere(tiles.grown(one)).tolist() == [[y, x] for y in (0, 1) for x in (2, 3, 4)]
    pixels = np.zeros(SHAPE, bool)
    pixels[89, 149] = True
    assert np.argwhere(tiles.tiles_with(pixels)).tolist() == [[5, 9]]


def test_weights_of_tiles_fade_at_others():
    wanted = np.ones((4, 5), bool)
    wanted[1, 2] = False
    weights = tiles.faded(wanted, (5 * 16 - 3, 4 * 16 - 1))
    of_tiles = tiles.pixels_of(wanted, weights.shape[::-1])
    assert weights.shape == (63, 77) and (weights[~of_tiles] == 0).all() and (weights[of_tiles] > 0).all()
    assert max(np.abs(np.diff(weights, axis=axis)).max() for axis in (0, 1)) <= 2 / 16 + 1e-6
    assert (weights[:, :8] == 1).all() and (weights[40:, -8:] == 1).all()  # no border at those of the picture


def test_noise_does_not_differ_and_light_does():
    rng = np.random.default_rng(5)
    light = 1 + 0.5 * np.sin(np.arange(150) / 3) * np.sin(np.arange(90) / 4)[:, None]
    noisy = [light * (1 + 0.1 * rng.standard_normal(SHAPE)) for _ in range(2)]
    assert differing(*noisy, 0.05, 1).mean() < 0.05
    changed = noisy[1].copy()
    changed[32:48, 64:80] *= 1.3
    found = differing(noisy[0], changed, 0.05, 1)
    assert found[2, 4] and found.sum() <= 4
    changed[32:48, 64:80] = np.nan  # says nothing
    assert not differing(noisy[0], changed, 0.05, 1)[2, 4]


def test_a_bright_path_in_one_half_of_the_samples_is_no_difference():
    rng = np.random.default_rng(7)
    own, *halves = (1 + 0.02 * rng.standard_normal(SHAPE) for _ in range(3))
    halves[0][20, 30] += 40  # far above the noise of its neighbours
    halves[0][60, 100] += 40
    halves[1][60, 100] += 39
    other, half_difference = (halves[0] + halves[1]) / 2, (halves[0] - halves[1]) / 2
    assert np.argwhere(differing(own, other, 0.05, 1)).tolist() == [[1, 1], [3, 6]]
    assert np.argwhere(differing(own, other, 0.05, 1, halves=half_difference)).tolist() == [[3, 6]]


def test_blocks_of_the_same_samples_change_by_more_than_a_share():
    one = np.random.default_rng(8).random(SHAPE)
    other = one.copy()
    other[41, 82] += 0.3
    other[10:14, 10:14] = one[10:14, 10:14][::-1]  # the mean stays
    other[-1, -1] += 0.3  # of a block that is smaller than others
    found = tiles.changed_blocks(one, other, 0.01)
    assert found[10, 20] and found[2, 2] and found[-1, -1] and not found[:, :2].any() and found.sum() <= 6


def test_a_thin_shadow_of_the_same_samples_is_no_noise():
    rng = np.random.default_rng(9)
    own = np.ones(SHAPE)
    other = np.where(rng.random(SHAPE) < 0.03, 5.0, own)  # bright paths
    other[20:40, 63:65] = 0  # across a border of blocks
    assert np.argwhere(tiles.of_blocks(tiles.clearly_changed_blocks(own, other))).tolist() == [[1, 3], [2, 3]]
    noisy = [np.where(rng.random(SHAPE) < 0.5, 3.0, own) for _ in range(2)]
    assert not tiles.clearly_changed_blocks(*noisy).any()


def test_whole_tiles_show_what_noise_hides_from_blocks():
    rng = np.random.default_rng(6)
    own, other = (1 + 0.3 * rng.standard_normal(SHAPE) for _ in range(2))
    assert tiles.differing_tiles(own, other, 0.02, 1, 3).mean() < 0.05
    other[32:64, 64:96] *= 1.15
    found = tiles.differing_tiles(own, other, 0.02, 1, 3)
    assert found[2:4, 4:6].all() and found.sum() <= 6
    assert not differing(own, other, 0.02, 1)[2:4, 4:6].all()


@pytest.mark.parametrize("shift_px, differs", [(0.1, False), (0.5, True)])
def test_edges_may_lie_a_little_elsewhere(shift_px, differs):
    x = np.arange(150) - 75.3
    step, moved = (1 + 9 * np.clip(x - shift, 0, 1) * np.ones(SHAPE) for shift in (0, shift_px))
    assert differing(step, moved, 0.05, 1).any() == differs


def test_a_box_has_the_pixels_of_the_whole_picture():
    """Also for sizes whose quotients round down."""
    pytest.importorskip("bpy")
    in_bpy("""
import bpy, numpy as np
from pecs_blender.scene import cycles
from pecs_blender.camera import tiles
scene, sampling = bpy.context.scene, cycles.Sampling(samples=1, seed=1, bounces={})
film = cycles.Film(scene)
for width, height in ((346, 260), (1280, 720)):
    cycles.configure(scene, width, height, sampling)
    cycles.set_border(scene, None)
    whole = film.render()
    for k in range(12):
        box = (16 * k, 17 * k, width - 13 * k, min(height, 17 * k + 1 + k % 4))
        cycles.set_border(scene, box)
        part = film.render()
        assert np.array_equal(part, whole[tiles.at(box)]), (width, height, box, part.shape)
assert np.ptp(whole) > 0
""")
