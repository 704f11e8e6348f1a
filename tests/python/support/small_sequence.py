"""A native sequence whose truth is known in closed form: a wall, and before it a textured card that moves, seen through
lenses with distortion by two event cameras, an RGB camera next to them, and one on the pixels of the left."""

import json
from pathlib import Path

import cv2
import numpy as np
import pecs
from pecs.stack import StackWriter

from support.small_stacks import stack_json

DURATION_US = 100_000
TRUTH_US = np.arange(0, DURATION_US + 1, 10_000)
CARD, WALL = 1, 2  # ids; the wall has no class
CARD_SIZE = np.array([0.9, 0.7])  # m, in x and up
WALL_Y, WALL_SLOPE = 4.0, 0.2  # y = WALL_Y + WALL_SLOPE x
RIG_SPEED = np.array([0.4, 0.5, 0.1])  # m/s
CARD_CENTRE, CARD_SPEED = np.array([-0.1, 2.2, 0.05]), np.array([1.5, -0.8, 0.3])
WORLD_FROM_RIG = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], float)  # looks along y


def turned(x=0.0, degrees=(0, 0, 0)):
    out = np.eye(4)
    out[:3, :3] = cv2.Rodrigues(np.radians(np.array(degrees, float)))[0]
    out[0, 3] = x
    return out


class Eye:
    """A camera of the rig: projects, and sees the scene. `bent_px`: how far its lens is from OpenCV's model."""

    def __init__(self, name, kind, size, focal, distortion, rig_from_camera, bent_px=0.0):
        self.name, self.kind, (self.width, self.height) = name, kind, size
        self.K = np.array([[focal, 0, size[0] / 2 + 0.8], [0, focal * 1.01, size[1] / 2 - 1.3], [0, 0, 1]])
        self.distortion, self.bent_px = np.array(distortion, float), bent_px
        self.rig_from_camera = rig_from_camera
        self.K_rect, self.R_rect, self.partner, self.baseline_m = self.K, np.eye(3), None, None
        grid = np.stack(np.meshgrid(np.arange(self.width), np.arange(self.height)), -1).reshape(-1, 1, 2).astype(float)
        stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-14)
        straight = grid
        for _ in range(60):
            straight = grid - self.bend(straight)
        xy = cv2.undistortPointsIter(straight, self.K, self.distortion, None, None, stop)[:, 0]
        self.rays = np.concatenate([xy, np.ones((len(xy), 1))], 1)
        self.grid = grid[:, 0]

    def bend(self, pixels):
        return self.bent_px * np.stack([np.sin(pixels[..., 1] / 9), np.cos(pixels[..., 0] / 11)], -1)

    def world_from_camera(self, t_us):
        out = WORLD_FROM_RIG.copy()
        out[:3, 3] = RIG_SPEED * t_us * 1e-6
        return out @ self.rig_from_camera

    def project(self, world, t_us):
        """OpenCV's pixels [n, 2] and z [n]."""
        camera_from_world = np.linalg.inv(self.world_from_camera(t_us))
        points = world @ camera_from_world[:3, :3].T + camera_from_world[:3, 3]
        pixels = cv2.projectPoints(points, np.zeros(3), np.zeros(3), self.K, self.distortion)[0][:, 0]
        return pixels + self.bend(pixels), points[:, 2]

    def look(self, t_us, rays=None):
        """Points of the world [n, 3], z [n], id [n], normals in the camera's axes [n, 3]; of rays with z = 1."""
        pose = self.world_from_camera(t_us)
        eye, rays = pose[:3, 3], (self.rays if rays is None else rays) @ pose[:3, :3].T
        card = CARD_CENTRE + CARD_SPEED * t_us * 1e-6
        z_wall = (WALL_Y + WALL_SLOPE * eye[0] - eye[1]) / (rays[:, 1] - WALL_SLOPE * rays[:, 0])
        z_card = (card[1] - eye[1]) / rays[:, 1]
        at = eye + z_card[:, None] * rays - card
        on_card = (np.abs(at[:, [0, 2]]) <= CARD_SIZE / 2).all(1)
        z = np.where(on_card, z_card, z_wall)
        wall = np.array([WALL_SLOPE, -1, 0]) / np.hypot(WALL_SLOPE, 1)
        normals = np.where(on_card[:, None], [0.0, -1, 0], wall) @ pose[:3, :3]
        return eye + z[:, None] * rays, z, np.where(on_card, CARD, WALL), normals

    def moved(self, world, ids, from_us, to_us):
        """Where points of the scene are at another time."""
        return world + np.where(ids[:, None] == CARD, CARD_SPEED * (to_us - from_us) * 1e-6, 0)

    def flow(self, from_us, to_us):
        world, _, ids, _ = self.look(from_us)
        pixels, z = self.project(self.moved(world, ids, from_us, to_us), to_us)
        return self.picture(pixels - self.grid), self.picture(z)

    def light(self, t_us, rays=None):
        world, _, ids, _ = self.look(t_us, rays)
        at = world - np.where(ids[:, None] == CARD, CARD_SPEED * t_us * 1e-6, 0)
        wave = np.sin(at[:, 0] * 23) * np.sin(at[:, 2] * 19 + 1) + np.where(ids == CARD, 0.6 * np.sin(at[:, 0] * 61), 0)
        return np.exp(wave).astype(np.float32).reshape(*((self.height, self.width) if rays is None else (-1,)))

    def picture(self, values):
        return values.reshape(self.height, self.width, *values.shape[1:])

    def boxes(self, t_us):
        """{id: (modal, amodal, pixels seen)}, edges of pixels."""
        ids = self.picture(self.look(t_us)[2])
        out = {}
        for number in (CARD, WALL):
            y, x = np.nonzero(ids == number)
            modal = [float(v) for v in (x.min(), y.min(), x.max() + 1, y.max() + 1)] if len(x) else None
            out[number] = modal, modal, len(x)
        half = np.array([[sx * CARD_SIZE[0], 0, sz * CARD_SIZE[1]] for sx in (-0.5, 0.5) for sz in (-0.5, 0.5)])
        corners, _ = self.project(CARD_CENTRE + CARD_SPEED * t_us * 1e-6 + half, t_us)
        amodal = [*(corners.min(0) + 0.5).tolist(), *(corners.max(0) + 0.5).tolist()]
        out[CARD] = out[CARD][0], amodal, out[CARD][2]
        return out


def rig(bent_px=0.0):
    left = Eye("left", "events", (96, 72), 90, (-0.12, 0.03, 0.001, -0.0005, 0), np.eye(4), bent_px)
    right = Eye("right", "events", (96, 72), 92, (-0.1, 0.02, 0, 0.001, 0), turned(0.12, (0.5, -1.2, 0.8)))
    rgb = Eye("rgb", "rgb", (80, 60), 80, (-0.05, 0, 0, 0, 0), turned(0.05))
    camera = np.linalg.inv(right.rig_from_camera) @ left.rig_from_camera
    R1, R2, P1, P2, *_ = cv2.stereoRectify(
        left.K, left.distortion, right.K, right.distortion, (96, 72), camera[:3, :3], camera[:3, 3], alpha=0.5
    )
    for eye, other, R, P in ((left, right, R1, P1), (right, left, R2, P2)):
        eye.R_rect, eye.K_rect, eye.partner, eye.baseline_m = R, P[:, :3], other.name, 0.12
    frame = Eye("frame", "rgb", (96, 72), 90, left.distortion, np.eye(4), bent_px)  # behind the same lens as the left
    return left, right, rgb, frame


def write_truth(folder, eye):
    layers = [
        ("depth", ["distance", "z"], "m", "instant"),
        ("normal", ["x", "y", "z"], "1", "instant"),
        ("objects", ["instance"], "1", "instant"),
        ("motion", MOTION, "px", "interval"),
    ]
    listed = [
        {"name": name, "files": name + "_%06d.exr", "channels": channels, "unit": unit, "at": at}
        for name, channels, unit, at in layers
    ]
    more = {"light": False, "quantity": "radiance", "pixel_pitch_m": 1e-5, "layers": listed}
    stack = stack_json(eye.width, eye.height, (TRUTH_US * 1000).tolist(), **more)
    with StackWriter(folder, stack) as writer:
        for i, t in enumerate(TRUTH_US):
            _, z, ids, normals = eye.look(t)
            distance = z * np.linalg.norm(eye.rays, axis=1)
            writer.write_layer("depth", i, np.stack([eye.picture(distance), eye.picture(z)]))
            writer.write_layer("normal", i, np.moveaxis(eye.picture(normals), -1, 0))
            writer.write_layer("objects", i, eye.picture(ids)[None])
            if i + 1 < len(TRUTH_US):
                writer.write_layer("motion", i, motion(eye, t, TRUTH_US[i + 1]))
    instants = [instant(eye, t) for t in TRUTH_US]
    objects = [
        {
            "id": CARD,
            "name": "card",
            "class": "card",
            "class_id": 1,
            "size_m": [*CARD_SIZE, 0],
            "centre_local": [0] * 3,
        },
        {"id": WALL, "name": "wall", "class": None, "class_id": 0, "size_m": [9, 0, 9], "centre_local": [0] * 3},
    ]
    text = {"format": 1, "classes": {"1": "card"}, "objects": objects, "instants": instants}
    (folder / "objects.json").write_text(json.dumps(text))


MOTION = ["x_q1", "y_q1", "x_mid", "y_mid", "x_q3", "y_q3", "x_end", "y_end", "z", "z_end"]
MOTION += ["back_" + name for name in MOTION]


def motion(eye, start, end):
    out = []
    for a, b in ((start, end), (end, start)):
        flows = [eye.flow(a, a + k / 4 * (b - a)) for k in (1, 2, 3, 4)]
        out += [flow[..., i] for flow, _ in flows for i in (0, 1)] + [eye.picture(eye.look(a)[1]), flows[-1][1]]
    return np.stack(out)


def instant(eye, t):
    entries = []
    for number, (modal, amodal, count) in eye.boxes(t).items():
        pose = np.eye(4)
        if number == CARD:
            pose[:3, 3] = CARD_CENTRE + CARD_SPEED * t * 1e-6
        entries.append({"id": number, "world_from_object": pose.tolist(), "box_px": modal, "amodal_px": amodal})
        entries[-1] |= {"visible_px": count, "occluded": 0.0, "truncated": 0.0}
    return {"t_ns": int(t) * 1000, "objects": entries}


def write_events(folder, eye, seed):
    times = np.arange(0, DURATION_US + 1, 1000)
    frames = np.stack([eye.light(t) for t in times])
    events = pecs.simulate(frames, times, chip="davis346", seed=seed, labels=True, readout="ideal")
    events = events[events["t"] < DURATION_US]
    pecs.write(folder / "events.h5", events, format="dsec")
    np.save(folder / "causes.npy", events["label"])
    seen = np.stack([eye.picture(eye.look(t)[2]) for t in times])
    np.save(folder / "objects.npy", seen[events["t"] // 1000, events["y"], events["x"]].astype(np.uint16))


def write_pictures(folder, eye):
    rows = ["index,start_us,end_us"]
    for name in ("rgb", "sharp"):
        (folder / name).mkdir()
    for i, t in enumerate(range(10_000, DURATION_US, 20_000)):
        grey = np.clip(60 * eye.light(t), 0, 255).astype(np.uint8)
        for name in ("rgb", "sharp"):
            cv2.imwrite(str(folder / name / f"{i:06d}.png"), np.stack([grey // 2, grey, 255 - grey], -1))
        rows.append(f"{i},{t - 2500},{t + 2500}")
    (folder / "rgb.csv").write_text("\n".join(rows) + "\n")


def tum(times_us, poses):
    """Axis-aligned by construction or nearly so: quaternions by trace, w far from 0."""
    rows = []
    for t, pose in zip(times_us, poses, strict=True):
        R, w = pose[:3, :3], np.sqrt(1 + np.trace(pose[:3, :3])) / 2
        q = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / (4 * w)
        rows.append(" ".join(f"{v:.12g}" for v in (t * 1e-6, *pose[:3, 3], *q, w)))
    return "# t_s tx ty tz qx qy qz qw\n" + "\n".join(rows) + "\n"


def write(folder: Path, name="0000", split="train", bent_px=0.0):
    """The folder of the sequence."""
    eyes = rig(bent_px)
    folder.mkdir(parents=True)
    entries = []
    times = np.arange(0, DURATION_US + 1, 1000)
    for i, eye in enumerate(eyes):
        at = folder / eye.name
        at.mkdir()
        (at / "camera_path.txt").write_text(tum(times, [eye.world_from_camera(t) for t in times]))
        rect = eye.rays @ eye.R_rect.T @ eye.K_rect.T
        np.save(at / "rectify_map.npy", eye.picture(rect[:, :2] / rect[:, 2:]).astype(np.float32))
        if eye.kind == "events":
            write_truth(at / "truth", eye)
            write_events(at, eye, seed=i + 1)
        else:
            write_pictures(at, eye)
        entries.append(
            {
                **{"name": eye.name, "kind": eye.kind, "width": eye.width, "height": eye.height, "chip": "davis346"},
                **{"lens": None, "pixel_pitch_um": 10.0, "rig_from_camera": eye.rig_from_camera.tolist()},
                **{"K": eye.K.tolist(), "distortion": eye.distortion.tolist(), "distortion_model": "radtan"},
                **{"K_rect": eye.K_rect.tolist(), "R_rect": eye.R_rect.tolist(), "partner": eye.partner},
                **{"baseline_m": eye.baseline_m, "truth_times_us": TRUTH_US.tolist()},
                "pixels_of": "left" if eye.name == "frame" else None,
            }
        )
    (folder / "poses.txt").write_text(tum(times, [eyes[0].world_from_camera(t) for t in times]))
    imu = ["#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"]
    imu[0] += "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]"
    imu += [f"{t * 1000},0,0,0,0,-9.81,0" for t in times]  # no turning, no acceleration: gravity alone
    (folder / "imu.csv").write_text("\n".join(imu) + "\n")
    info = {"format": 1, "name": name, "split": split, "seed": 1, "duration_us": DURATION_US, "drawn": {}}
    info |= {
        "scene": "card",
        "cameras": entries,
        "imu": {"rate_hz": 1000, "rig_from_imu": np.eye(4).tolist()},
        "versions": {},
    }
    (folder / "sequence.json").write_text(json.dumps(info, indent=1))
    return folder


def same_events(found, events, seconds=True):
    """found: (t, x, y, p), t in seconds or us."""
    t, x, y, p = (np.asarray(v) for v in found)
    assert len(t) == len(events) > 0
    np.testing.assert_array_equal(np.rint(t * 1e6).astype(np.int64) if seconds else t, events["t"])
    np.testing.assert_array_equal(x, events["x"])
    np.testing.assert_array_equal(y, events["y"])
    np.testing.assert_array_equal(p.astype(np.uint8), events["p"])
