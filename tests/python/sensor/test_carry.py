"""Light carried along motion: against a scene that is known at every instant."""

import numpy as np
import pecs
import pytest
from support.moving_scene import Scene


def test_bands_are_carried_alike_and_sides_can_be_had_alone():
    scene = Scene(80, 60, radii=(15.0, 12.0))
    first, second, motion = scene.frame(0), scene.frame(1), scene.motion()
    both = pecs.carry(np.stack([first, 3 * first]), np.stack([second, 3 * second]), motion, 0.3)
    assert both.shape == (2, 60, 80) and both.dtype == np.float32
    assert np.array_equal(both[0], pecs.carry(first, second, motion, 0.3))
    np.testing.assert_allclose(both[1], 3 * both[0], rtol=1e-4)
    alone = [pecs.carry(first, second, motion, 0.3, side=side) for side in ("first", "second")]
    hidden = [np.isnan(plane) for plane in alone]
    assert all(0 < plane.sum() < 400 for plane in hidden) and (hidden[0] & hidden[1]).sum() < 20


def test_one_motion_carries_at_any_number_of_instants():
    scene = Scene(80, 60)
    first, second, motion = scene.frame(0), scene.frame(1), scene.motion()
    boxes = [(0, 0, 10, 20), (30, 40, 80, 60)]
    with pecs.Carrier(motion) as carrier:
        light = pecs.CarriedLight(carrier, first, second)
        for fraction in (0.7, 0.2, 0.7):
            carried = pecs.carry(first, second, motion, fraction)
            assert np.array_equal(light.at(fraction), carried)
            parts = light.at(fraction, boxes)
            for left, top, right, bottom in boxes:
                assert np.array_equal(parts[top:bottom, left:right], carried[top:bottom, left:right])
            ids = np.round(100 * first), np.round(100 * second)
            assert np.array_equal(carrier.labels(*ids, fraction), pecs.carry_labels(*ids, motion, fraction))
    for out in (np.zeros((60, 80)), np.zeros((60, 160), np.float32)[:, ::2], np.broadcast_to(np.float32(0), (60, 80))):
        with pytest.raises(ValueError, match="out: got"):
            light.at(0.5, out=out)
    with pytest.raises(ValueError, match="closed"):
        pecs.CarriedLight(carrier, first, second)
    assert np.array_equal(light.at(0.7), carried)  # keeps what it needs


def test_wrong_arguments_are_refused():
    plane, motion = np.ones((4, 6)), np.zeros((20, 4, 6))
    for arguments in (
        (plane, plane[:3], motion, 0.5),
        (plane, plane, motion[:5], 0.5),
        (plane, plane, motion[:, :3], 0.5),
        (plane, plane, motion, 1.5),
        (plane, plane, motion, float("nan")),
    ):
        with pytest.raises(ValueError):
            pecs.carry(*arguments)
    with pytest.raises(ValueError, match="side: got left"):
        pecs.carry(plane, plane, motion, 0.5, side="left")
