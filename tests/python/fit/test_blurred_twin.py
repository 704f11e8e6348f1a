"""The path of a camera that shakes within exposures, from blurred frames and events (scripts/lab)."""

import cv2
import numpy as np
import pecs
from pecs_lab import blurred_twin, davis_scene

WIDTH, HEIGHT = 96, 72
EXPOSURES_US = np.array([[k * 70e3, k * 70e3 + 60e3] for k in range(4)])


def place(t_us):
    """Of the picture: a drift, and a shake of half a period in each exposure, which the frames' places do not show."""
    return 8 * np.sin(2e-6 * np.pi * t_us) + 2 * np.sin(2e-6 * np.pi * 8 * t_us), 30e-6 * t_us


def test_path_and_texture_of_blurred_frames(monkeypatch):
    scene = davis_scene.texture(np.random.default_rng(3), 0.5)[500:800, 500:800]

    def view(t_us):
        x, y = place(t_us)
        return cv2.getRectSubPix(scene, (WIDTH, HEIGHT), (150 - x, 150 - y))

    t_us = np.arange(0.0, 272e3, 1000)
    light = np.stack([view(t) for t in t_us])
    events = pecs.simulate(light, t_us, chip="ideal", photocurrent_a=1e-12, seed=1)
    events = {c: np.asarray(events[c]) for c in "txyp"}
    exposed = [(t_us >= begin) & (t_us <= end) for begin, end in EXPOSURES_US]
    frames = [100 * light[inside].mean(0).astype(np.float32) for inside in exposed]

    def made(rounds):
        monkeypatch.setattr(blurred_twin, "ROUNDS", rounds)
        twin = blurred_twin.BlurredTwin(frames, EXPOSURES_US, events, lambda values: np.log(np.maximum(values, 1)))
        known = np.any((twin.t_us > EXPOSURES_US[:, :1]) & (twin.t_us < EXPOSURES_US[:, 1:]), axis=0)
        misses = twin.path[known, :2] - np.transpose(place(twin.t_us[known]))
        misses -= misses.mean(0)  # the frame in the middle is blurred, so its place is any in its exposure
        return twin, np.sqrt((misses**2).mean(0))

    (_, of_frames_px), (twin, with_events_px) = made(0), made(3)
    assert with_events_px[0] < 0.6 * of_frames_px[0]
    assert with_events_px.max() < 1.2
    blurred, frame = (f[8:-8, 8:-8].ravel() for f in (twin.blurred(twin.texture(1), 1, 1), frames[1]))
    assert np.corrcoef(blurred, frame)[0, 1] > 0.99


def test_pattern_of_all_frames():
    rng = np.random.default_rng(1)
    scene = 50 * davis_scene.texture(rng, 0.3)
    pattern = 1 + 0.05 * rng.standard_normal((HEIGHT, WIDTH)).astype(np.float32)
    places = rng.integers(200, 1200, (15, 2)).astype(float)
    pictures = [cv2.GaussianBlur(cv2.getRectSubPix(scene, (WIDTH, HEIGHT), tuple(p)), (0, 0), 3) for p in places]
    clean = blurred_twin.without_pattern([picture * pattern for picture in pictures])
    misses = [np.std((c / picture)[4:-4, 4:-4]) for c, picture in zip(clean, pictures, strict=True)]
    assert np.median(misses) < 0.5 * np.std(pattern)
