#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""A DAVIS240C, recorded and simulated: tables of docs/reference/sensor.md and docs/studies/validation.md.

The recording (EDI's camerashake, Pan et al., CVPR 2019) is not in the repository: FOLDER has events.npz, still.npz (t
in us, x, y, p) and frames/NNNN.png. Window k begins with the exposure of frame k, and lasts until the next one.

still: windows 32 to 34, the light of the mean frame. moving: the sharp frames as one texture, moved to where the events
of each 4 ms have its edges; thresholds and numbers of events have no part in that. A lamp flickers in both. cups:
a DAVIS346 with exposures_us.csv (in FOLDER); all frames are blurred, and deconvolved along such a path. --windows:
first and last of moving.
"""

from pathlib import Path

import cv2
import numpy as np
import pecs
from pecs_lab.blurred_twin import BlurredTwin, without_pattern
from pecs_lab.measure import command
from PIL import Image
from scipy.ndimage import gaussian_filter1d

CHIP, WIDTH, HEIGHT, PERIOD_US, BEGIN_US = "davis240c", 240, 180, 138121.3, -471.0
WHITE_A, BLACK_DN, WHITE_DN, DARKEST = 4.5e-13, 4, 235, 0.03
LAMP_HZ, LAMP_DEPTH, LAMP_TURN = 100.146, 0.1125, -0.008
SHARED, SHARED_TURN = 0.0294, 0.467  # a current that all pixels share, of white, and its lag behind the lamp
SHARP, CENTRE, MUG_DN = (2, 6, 7, 8, 13, 17, 20, 23, 26), 20, 28  # frames; grey value of the mug in frames of still.npz
EDGE_PX, SLICE_US, SMOOTH, DRAG, CHANCE = 40, 4000, 2.5, 0.3, 0.02  # CHANCE: of noise events
LEAD_US = 2 * PERIOD_US
CUPS_BLACK_DN, CUPS_WHITE_DN = -24, 130  # the frames were darkened
CUPS_WHITE_A = 7.5e-13  # both fitted to maps of frames 11, 13 and 15, with thresholds, which came out at 0.20 and 0.21
CUPS_LEAD_US, CUPS_SKIP_US = 120e3, 2000  # before an exposure; of it, where frames may act on events
SHAKE_PX, SHAKE_HZ = 5, 2.5


def grey(folder, k):
    """A frame whose darkest pixels have the mug's value: the value without light differs from frame to frame."""
    values = np.asarray(Image.open(folder / f"frames/{k:04}.png"), np.float32)
    return values - np.quantile(values, 0.02) + MUG_DN


def light(values):
    return np.clip((values - BLACK_DN) / (WHITE_DN - BLACK_DN), DARKEST, None)


def pushed(sensor, t_us, light_at):
    """Events before light_at(t_us), and their times."""
    found = []
    with sensor:
        for some_us in np.split(t_us, range(64, len(t_us), 64)):
            found.append(sensor.push(np.array([light_at(t) for t in some_us], np.float32), some_us - t_us[0]))
        found.append(sensor.finish())
    events = np.concatenate(found)
    return events["t"] + t_us[0], events


def simulate(light_at, first, last, seed):
    """Events of windows first to last; light_at(t_us): relative light. Window 2 begins at 0."""
    begin_us, end_us = (first - 2) * PERIOD_US, (last - 1) * PERIOD_US
    t_us = np.arange(begin_us - LEAD_US + BEGIN_US, end_us + 2000, 1000)

    def lit(now_us):
        turn = 2 * np.pi * (1e-6 * LAMP_HZ * now_us - LAMP_TURN)
        shared = SHARED * np.cos(turn - 2 * np.pi * SHARED_TURN)
        return np.maximum(light_at(now_us) * (1 + LAMP_DEPTH * np.cos(turn)) + shared, 1e-3)

    how = {"seed": seed, "photocurrent_a": WHITE_A, "chip_frames": True, "time_unit": "us"}
    return of_windows(*pushed(pecs.Sensor(WIDTH, HEIGHT, CHIP, **how), t_us, lit), first, last)


def of_windows(t_us, events, first, last):
    return between(t_us, events, (first - 2) * PERIOD_US, (last - 1) * PERIOD_US)


def between(t_us, events, begin_us, end_us, width=WIDTH):
    """Times, pixels and polarities."""
    inside = (t_us >= begin_us) & (t_us < end_us)
    pixels = events["y"].astype(int) * width + events["x"]
    return np.asarray(t_us, float)[inside], pixels[inside], np.asarray(events["p"], int)[inside]


def pose_of(reference, frame):
    """x, y [px] and turn of a frame against the reference."""
    window = cv2.createHanningWindow((WIDTH, HEIGHT), cv2.CV_32F)
    start = np.float32([[1, 0, 0], [0, 1, 0]])
    start[:, 2] = cv2.phaseCorrelate(reference.copy(), frame.copy(), window)[0]  # it changes its arguments
    steps = cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-7
    _, m = cv2.findTransformECC(reference, frame, start, cv2.MOTION_EUCLIDEAN, steps, None, 3)
    return np.array([m[0, 2], m[1, 2], np.arctan2(m[1, 0], m[0, 0])])


def frame_from_texture(pose):
    turn = np.array([[np.cos(pose[2]), -np.sin(pose[2])], [np.sin(pose[2]), np.cos(pose[2])]])
    return np.c_[turn, pose[:2] - turn @ [EDGE_PX, EDGE_PX]]


def view(texture, pose):
    m = cv2.invertAffineTransform(frame_from_texture(pose))
    how = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    return cv2.warpAffine(texture, m, (WIDTH, HEIGHT), flags=how, borderMode=cv2.BORDER_REPLICATE)


def texture_of(folder, poses):
    """The mean of the sharp frames, at the centre's pose; less of each frame's border counts."""
    size = WIDTH + 2 * EDGE_PX, HEIGHT + 2 * EDGE_PX
    inside = [np.minimum(np.arange(n) + 1, n - np.arange(n)) for n in (HEIGHT, WIDTH)]
    inside = np.minimum(np.minimum.outer(*inside), 20).astype(np.float32)
    total, weights = np.zeros(size[::-1]), np.zeros(size[::-1])
    for k, pose in poses.items():
        m, how = frame_from_texture(pose), cv2.WARP_INVERSE_MAP
        weight = cv2.warpAffine(inside, m, size, flags=how | cv2.INTER_LINEAR)
        frame = cv2.warpAffine(grey(folder, k), m, size, flags=how | cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        if weights.any():
            both = (weight > 5) & (weights > 5)
            gain, offset = np.polyfit(frame[both], total[both] / weights[both], 1)
            frame = gain * frame + offset
        total, weights = total + weight * frame, weights + weight
    mean = (total / np.maximum(weights, 1e-6)).astype(np.float32)
    return cv2.inpaint(mean, (weights < 1).astype(np.uint8), 3, cv2.INPAINT_NS)


def path_of(texture, poses, events):
    """Pose every SLICE_US from 0 on: x where the events of a slice correlate most with the texture's slope in x, if
    they do, else at the speed so far; y and turn between those of the sharp frames."""
    middles_us = [(k - 2) * PERIOD_US + BEGIN_US + 50e3 for k in poses]
    t_us = np.arange(0, events["t"][-1], SLICE_US)
    path = np.stack([np.interp(t_us, middles_us, [pose[i] for pose in poses.values()]) for i in range(3)], 1)
    clock_us = (events["t"] - BEGIN_US) % PERIOD_US
    calm = ~(((clock_us > 99.5e3) & (clock_us < 102e3)) | (clock_us < 2e3))  # without the bursts by frames
    first = np.searchsorted(events["t"], [*t_us, np.inf])
    x, speed, shifts = path[0, 0], 0.0, np.arange(-3, 4)
    for i in range(len(t_us)):
        mine = slice(first[i], first[i + 1])
        y_px, x_px, sign = (events[c][mine][calm[mine]].astype(int) for c in "yxp")
        change = np.zeros((HEIGHT, WIDTH), np.float32)
        np.add.at(change, (y_px, x_px), 2 * sign - 1)
        change = cv2.GaussianBlur(change, (0, 0), 1)[8:-8, 8:-8]
        seen = cv2.GaussianBlur(np.log(light(view(texture, (x, *path[i, 1:])))), (0, 0), 1)
        slope = cv2.Sobel(seen, cv2.CV_32F, 1, 0)[8:-8]
        slopes = [slope[:, 8 - d : WIDTH - 8 - d] for d in shifts]
        agrees = np.array([np.sum(change * s) ** 2 / max(np.sum(s**2) * np.sum(change**2), 1e-9) for s in slopes])
        k = np.clip(np.argmax(agrees), 1, len(shifts) - 2)
        bend = agrees[k - 1] - 2 * agrees[k] + agrees[k + 1]
        best = shifts[k] + np.clip((agrees[k - 1] - agrees[k + 1]) / (2 * bend) if bend < 0 else 0, -1, 1)
        weight = np.clip((agrees.max() - CHANCE) / 0.1, 0, 1)
        path[i, 0] = x + DRAG * weight * best
        speed = (speed + 0.25 * DRAG * weight * best) * (0.8 + 0.2 * weight)
        x = path[i, 0] + speed
    t_us = t_us + SLICE_US / 2
    for i in range(3):
        path[:, i] = gaussian_filter1d(path[:, i], SMOOTH)
    misses = [pose[0] - np.interp(t, t_us, path[:, 0]) for t, pose in zip(middles_us, poses.values(), strict=True)]
    path[:, 0] += np.interp(t_us, middles_us, misses)
    return t_us, path


def still_scores(t_us, pixel, p):
    """Numbers of each window, and of the pixels' counts."""
    window, phase_us = (t_us // PERIOD_US).astype(int) - 30, t_us % PERIOD_US
    bursts = {"OFF burst": (phase_us > 99000) & (phase_us < 101000), "ON burst": phase_us > 137000}
    bursts["after"] = phase_us < 6000
    bursts["between"] = ~np.any(list(bursts.values()), 0)
    rows = {}
    for name, which in bursts.items():
        rows[name] = [int((which & (window == k)).sum()) for k in range(3)]
        rows[name + ", ON share"] = [round(float(p[which & (window == k)].mean()), 3) for k in range(3)]
        rows[name + ", median time [ms]"] = [
            round(float(np.median(phase_us[which & (window == k)])) / 1000, 2) for k in range(3)
        ]
    counts = np.bincount(pixel, minlength=WIDTH * HEIGHT)
    rows["silent pixels"] = round(float((counts == 0).mean()), 3)
    rows["counts at 50, 75, 90, 99, 99.9 %"] = np.quantile(counts, [0.5, 0.75, 0.9, 0.99, 0.999]).round(1).tolist()
    return rows


def fired_back(t_us, pixel, p, dark):
    """Of the dark pixels with an ON event where window 33 begins: shares with an OFF event in its first 6 and 30 ms."""
    phase_us = t_us - 31 * PERIOD_US
    fired = np.unique(pixel[(phase_us > -700) & (phase_us < 300) & (p == 1) & dark[pixel]])
    back = [pixel[(phase_us >= 300) & (phase_us < end_us) & (p == 0)] for end_us in (6000, 30000)]
    return len(fired), [round(float(np.isin(fired, pixels).mean()), 2) for pixels in back]


def of_window(events, k):
    mine = events[0] // PERIOD_US == k - 2
    return tuple(of[mine] for of in events)


def same_maps(one, other, shape):
    """Correlation of the numbers of events in 8x8 pixels."""
    maps = []
    for _, pixel, _ in (one, other):
        edges = [np.arange(0, n + 1, 8) for n in shape]
        maps.append(np.histogram2d(*np.divmod(pixel, shape[1]), edges)[0].ravel())
    return np.corrcoef(maps)[0, 1]


def moving_scores(recorded, simulated, other, shape):
    """Of a window: numbers of events, their ratio, correlation of maps and that of two seeds, ON shares, and the
    simulated less the recorded logarithm (base 10) of a pixel's intervals at 10, 25, 50, 75 and 90 %."""
    intervals, shares = [], []
    for t_us, pixel, p in (recorded, simulated):
        order = np.lexsort((t_us, pixel))
        gaps_us = np.diff(t_us[order])[np.diff(pixel[order]) == 0]
        intervals.append(np.quantile(np.log10(np.maximum(gaps_us, 1)), [0.1, 0.25, 0.5, 0.75, 0.9]))
        shares.append(float(p.mean()))
    numbers = [len(e[0]) for e in (recorded, simulated)]
    maps = same_maps(recorded, simulated, shape), same_maps(simulated, other, shape)
    return *numbers, numbers[1] / numbers[0], *maps, *shares, intervals[1] - intervals[0]


def print_moving(first, scores):
    """scores: of each window, with the correlation of the re-blurred frame; from window `first` on."""
    print("window  recorded simulated ratio  map seeds ON rec  sim  intervals [decades]      re-blurred frame")
    rows = []
    for k, (row, same) in enumerate(scores, first):
        n, m, ratio, maps, best, on, on_sim, gaps = row
        rows.append(row)
        print(
            f"{k:6} {n:9} {m:9} {ratio:5.2f} {maps:5.3f} {best:5.3f} {on:5.3f} {on_sim:5.3f} "
            f"{np.round(gaps, 2)!s:32} {same:.4f}",
            flush=True,
        )
    ratio, maps, best, gaps = (np.array([row[i] for row in rows]) for i in (2, 3, 4, 7))
    print(f"within 15 %: {np.sum(np.abs(ratio - 1) < 0.15)}, maps of 0.9: {np.sum(maps >= 0.9)} (of two seeds "
          f"{np.sum(best >= 0.9)}), "
          f"median interval within 0.1 decades: {np.sum(np.abs(gaps[:, 2]) < 0.1)} of {len(rows)} windows; "
          f"all events {sum(row[1] for row in rows) / sum(row[0] for row in rows):.3f}")  # fmt: skip


def shaken(picture, t_us):
    """Before time 0, the picture moves as the camera did: pixels begin far from equilibrium."""
    x_px = SHAKE_PX * (1 - np.cos(2e-6 * np.pi * SHAKE_HZ * t_us)) if t_us < 0 else 0.0
    m = np.float32([[1, 0, x_px], [0, 1, 0]])
    return cv2.warpAffine(picture, m, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REPLICATE) if x_px else picture


def still(folder, seed):
    events = np.load(folder / "still.npz")
    mean = light(np.mean([grey(folder, k) for k in (32, 33, 34)], 0))
    simulated = simulate(lambda t_us: shaken(mean, t_us - 30 * PERIOD_US), 32, 34, seed)
    recorded = of_windows(events["t"], events, 32, 34)
    for name, of_recording in still_scores(*recorded).items():
        print(f"{name:35} {of_recording!s:32} {still_scores(*simulated)[name]}")
    dark = (mean < np.quantile(mean, 0.2)).ravel()
    print("dark pixels that fire back", fired_back(*recorded, dark), fired_back(*simulated, dark))


def moving(folder, seed, first, last):
    events = dict(np.load(folder / "events.npz"))
    centre = grey(folder, CENTRE)
    poses = {k: pose_of(centre, grey(folder, k)) for k in SHARP}
    texture = texture_of(folder, poses)
    t_us, path = path_of(texture, poses, events)

    def seen(now_us):
        return view(texture, [np.interp(now_us, t_us, path[:, i]) for i in range(3)])

    simulated, other = (simulate(lambda now_us: light(seen(now_us)), first, last, seed + i) for i in (0, 1))
    recorded = of_windows(events["t"], events, first, last)

    def scores(k):
        exposed_us = (k - 2) * PERIOD_US + BEGIN_US + np.linspace(2e3, 98e3, 25)
        blurred = np.mean([seen(now_us) for now_us in exposed_us], 0)
        same = np.corrcoef(blurred[10:-10, 10:-10].ravel(), grey(folder, k)[10:-10, 10:-10].ravel())[0, 1]
        return moving_scores(*(of_window(e, k) for e in (recorded, simulated, other)), (HEIGHT, WIDTH)), same

    print_moving(first, (scores(k) for k in range(first, last + 1)))


def cups(folder, seed):
    events = dict(np.load(folder / "events.npz"))
    numbers, *exposures_us = np.loadtxt(folder / "exposures_us.csv", delimiter=",", skiprows=1).T
    frames = [np.asarray(Image.open(folder / f"frames/{int(k):04}.png"), np.float32) for k in numbers]

    def cups_light(values):
        return np.clip((values - CUPS_BLACK_DN) / (CUPS_WHITE_DN - CUPS_BLACK_DN), DARKEST, None)

    twin = BlurredTwin(
        without_pattern(frames), np.transpose(exposures_us), events, lambda values: np.log(cups_light(values))
    )
    height, width = twin.size

    def simulate_frame(texture, k, seed):
        begin_us, end_us = twin.exposures_us[k]
        t_us = np.arange(begin_us - CUPS_LEAD_US, end_us + 1500, 1000)
        sensor = pecs.Sensor(width, height, "davis346", seed=seed, photocurrent_a=CUPS_WHITE_A, time_unit="us")
        return exposed(*pushed(sensor, t_us, lambda t: cups_light(twin.view(texture, twin.pose(k, t)))), k)

    def exposed(t_us, of, k):
        begin_us, end_us = twin.exposures_us[k]
        return between(t_us, of, begin_us + CUPS_SKIP_US, end_us, width)

    def scores(k):
        texture = twin.texture(k)
        of_seeds = [simulate_frame(texture, k, seed + i) for i in (0, 1)]
        recorded = exposed(events["t"], events, k)
        blurred, frame = (f[10:-10, 10:-10].ravel() for f in (twin.blurred(texture, k, k), twin.frames[k]))
        return moving_scores(recorded, *of_seeds, (height, width)), np.corrcoef(blurred, frame)[0, 1]

    print_moving(int(numbers[0]), (scores(k) for k in range(len(frames))))


def main(kind: str, recording: Path, *, seed: int = 1, windows: list[int] = (3, 30)) -> None:
    {
        "still": lambda: still(recording, seed),
        "moving": lambda: moving(recording, seed, *windows),
        "cups": lambda: cups(recording, seed),
    }[kind]()


if __name__ == "__main__":
    command(main)
