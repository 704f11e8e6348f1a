"""Judge.mixed: of a picture between keyframes, only what its noise does not explain replaces what was expected."""

import numpy as np
import pytest
from pecs_blender.adaptive.judge import Judge

JUDGE = Judge(np.array([1.0, 2.0]), 0.1, 2)
NOISE, OF_EXPECTED = 0.05, 0.02
SHAPE = 96, 128


def picture(log_light, noise, rng):
    """[2 bands and noise, height, width] with this noise of ln(light), known from a second, independent half."""
    error, other = noise * rng.standard_normal((2, *SHAPE))
    light = np.exp(log_light + (error + other) / 2)
    return np.stack([light, light, (error - other) / 2]).astype(np.float32)


def error(mixed, log_light, where=np.s_[:]):
    return float(np.sqrt(np.mean((np.log(JUDGE.photocurrent(mixed) / 3) - log_light)[where] ** 2)))


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def test_where_nothing_changed_the_expected_light_stays(rng):
    still = np.zeros(SHAPE)
    expected, rendered = picture(still, OF_EXPECTED, rng), picture(still, NOISE, rng)
    mixed = JUDGE.mixed(expected, rendered)
    assert error(mixed, still) < 1.2 * error(expected, still) < 0.6 * error(rendered, still)
    assert np.std(mixed[-1]) < 1.2 * np.std(expected[-1])


@pytest.mark.parametrize("part", ["everywhere", "edge", "texture"])
def test_light_that_changed_is_the_rendered_one(rng, part):
    change = np.zeros(SHAPE)
    if part == "everywhere":  # a lamp: below the noise of a pixel
        change += 0.03
    elif part == "edge":  # a shadow
        change[:, 50:] = -0.6
    else:  # a reflection that moves
        change += 0.3 * rng.choice([-1, 1], SHAPE)
    expected, rendered = picture(np.zeros(SHAPE), OF_EXPECTED, rng), picture(change, NOISE, rng)
    mixed = JUDGE.mixed(expected, rendered)
    assert error(mixed, change) < 1.05 * error(rendered, change)
    assert abs(np.mean(np.log(JUDGE.photocurrent(mixed) / 3) - change)) < 0.003


def test_what_no_keyframe_shows_is_rendered(rng):
    expected, rendered = picture(np.zeros(SHAPE), OF_EXPECTED, rng), picture(np.zeros(SHAPE), NOISE, rng)
    expected[:, 20:40, 30:60] = np.nan
    mixed = JUDGE.mixed(expected, rendered)
    assert np.array_equal(mixed[:, 20:40, 30:60], rendered[:, 20:40, 30:60])
    assert np.isfinite(mixed).all()
