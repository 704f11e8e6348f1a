"""Do the parts of a sequence say the same? Each check compares two of them that were made on different ways."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._poses import interpolate, position_quaternion
from ..sensor import LABELS
from ._bilinear import neighbours
from .files import read_object
from .imu import integrate
from .rig import along, transformed
from .sequence import Camera, Sequence, rig_from_imu

SUMMARY = {"least": np.min, "median": np.median, "most": np.max}
EDGE_PX = 1  # how far an event may lie from a pixel whose light changes
WINDOW_US = 100_000  # of the IMU
RECORDED = Path(__file__).parent / "recorded_rates.json"
LIMITS = {"render_noise_share": 0.1, "dropped_share": 0.02}  # of a recipe without any


def check(sequence: Sequence) -> dict[str, Any]:
    """Numbers of all checks, by name; None where the sequence lacks what it needs."""
    cameras = {c.name: _camera(sequence, c) for c in sequence.cameras.values()}
    pairs = {
        f"{a.name}, {b.name}": disparity(a, b)
        for a, b in sequence.stereo_pairs("events") + sequence.stereo_pairs("rgb")
        if _has(a, "depth") and _has(b, "depth")
    }
    found = {"cameras": cameras, "stereo": pairs, "imu": imu(sequence), "motion": motion(sequence)}
    found["recorded_sets"] = recorded_rates()
    return found | {"outside_limits": outside(found, sequence.info.get("limits", LIMITS))}


def recorded_rates() -> dict[str, dict[str, Any]]:
    """Mean event rates of recorded sets, from their published numbers of events, which are of all cameras together."""
    sets = read_object(RECORDED, "recorded rates")["sets"]
    per_pixel = [s["events"] / (s["seconds"] * s["cameras"] * s["width"] * s["height"]) for s in sets]
    return {
        s["name"]: {"rate_per_pixel_hz": rate, "what": s["what"], "source": s["source"]}
        for s, rate in zip(sets, per_pixel, strict=True)
    }


def _has(camera: Camera, *layers: str) -> bool:
    return camera.has_truth and set(layers) <= set(camera.truth.layers)


def _camera(sequence: Sequence, camera: Camera) -> dict[str, Any]:
    found: dict[str, Any] = {}
    if _has(camera, "depth", "objects", "motion"):
        found |= flow(camera) | left_out(camera)
        found["boxes"] = boxes(camera)
    if camera.kind == "events":
        found["events"] = events(sequence, camera)
    return found


def motion(sequence: Sequence) -> dict[str, float]:
    """Realised speeds of the rig."""
    t_us, world = sequence.poses()
    t_s = np.diff(t_us) * 1e-6
    speed = np.linalg.norm(np.diff(world[:, :3, 3], axis=0), axis=1) / t_s
    turned = np.clip((np.einsum("nij,nij->n", world[1:, :3, :3], world[:-1, :3, :3]) - 1) / 2, -1, 1)
    rate = np.degrees(np.arccos(turned)) / t_s
    both = {"speed": ("m_s", speed), "turn_rate": ("deg_s", rate)}
    return {f"{name}_{at}_{u}": float(of(v)) for name, (u, v) in both.items() for at, of in SUMMARY.items()}


def outside(found: dict[str, Any], limits: dict[str, float]) -> list[str]:
    """Values beyond the limits of the recipe, one line each. Noise of the renderer below the camera's own is within
    them."""
    lines = []
    for name, camera in found["cameras"].items():
        for key in ("render_noise_share", "dropped_share"):
            value = camera.get("events", {}).get(key)
            own = camera.get("events", {}).get("camera_noise_share", 0.0) if key == "render_noise_share" else 0.0
            if value is not None and value > max(limits[key], own):
                more = f" (of the camera's own noise: {own:.3g})" if own else ""
                more += "; more [render] samples reduce it" if key == "render_noise_share" else ""
                lines.append(f"{name}: {key} is {value:.3g}, limit {limits[key]:g}{more}")
    fastest, limit = found["motion"]["speed_most_m_s"], limits.get("speed_m_per_s")
    if limit is not None and fastest > limit:
        lines.append(f"speed of the rig is {fastest:.3g} m/s, limit {limit:g}")
    return lines


def left_out(camera: Camera) -> dict[str, Any]:
    """Truth that `flow` and `boxes` do not compare: objects that deform, and pixels of the flow that are hidden,
    outside or unknown at the next instant. Speeds of the picture are the median of the pixels and that of 90 %."""
    truth, shares, hidden, moved = camera.truth, [], [], []
    for i in range(len(truth)):
        shares.append(float(np.isin(truth.instances(i), list(truth.deforming)).mean()))
        if i + 1 < len(truth):
            hidden.append(float(1 - truth.visible_at(i).mean()))
            px_s = np.hypot(*np.moveaxis(truth.flow(i), -1, 0)) * 1e6 / (truth.times_us[i + 1] - truth.times_us[i])
            if (known := px_s[np.isfinite(px_s)]).size:
                moved.append(np.percentile(known, (50, 90)))
    names = sorted(o["name"] for o in truth.objects if o["id"] in truth.deforming)
    found = {"objects_that_deform": ", ".join(names), "share_of_pixels": float(np.mean(shares))}
    found["flow_hidden_or_outside"] = float(np.mean(hidden)) if hidden else None
    speeds = dict(zip(("median_px_s", "p90_px_s"), np.mean(moved, 0).tolist(), strict=True)) if moved else None
    return {"not_compared": found, "motion": speeds}


def flow(camera: Camera) -> dict[str, Any]:
    """Flow against the projection, at the next instant, of each pixel's point: carried by its object's pose there and
    back by the camera's; scene flow against how far that carries it. Objects that deform are left out."""
    truth = camera.truth
    if len(truth.times_us) < 2:
        return {"flow": None, "scene_flow": None}
    missed, missed_m, cameras = [], [], camera.poses_at(truth.times_us)
    rigid = {o["id"] for o in truth.objects} - truth.deforming
    for i in range(len(truth.times_us) - 1):
        here, there = truth.object_poses(i), truth.object_poses(i + 1)
        z, ids = truth.depth(i)[1], truth.instances(i)
        world = transformed(cameras[i], along(camera.view.directions, z).reshape(-1, 3))
        moved = np.full_like(world, np.nan)
        for k in rigid & here.keys() & there.keys():
            at = np.flatnonzero(ids.ravel() == k)
            moved[at] = transformed(there[k] @ np.linalg.inv(here[k]), world[at])
        pixels = camera.view.pixels(transformed(np.linalg.inv(cameras[i + 1]), moved)).reshape(*z.shape, 2)
        y, x = np.mgrid[: z.shape[0], : z.shape[1]] + 0.5
        error = np.hypot(*np.moveaxis(truth.flow(i) + np.stack([x, y], -1) - pixels, -1, 0))
        missed.append(error[np.isfinite(error)])
        error = np.linalg.norm(camera.scene_flow(i).reshape(-1, 3) - (moved - world), axis=-1)
        missed_m.append(error[np.isfinite(error)])
    return {"flow": _spread(np.concatenate(missed), "px"), "scene_flow": _spread(np.concatenate(missed_m), "m")}


def disparity(left: Camera, right: Camera) -> dict[str, float] | None:
    """The right camera's depth against that of the left one's points, where both see the same surface."""
    if not np.array_equal(left.truth.times_us, right.truth.times_us):
        return None
    found, seen = [], []
    right_from_left = np.linalg.inv(right.rig_from_camera) @ left.rig_from_camera
    for i in range(len(left.truth.times_us)):
        points = transformed(right_from_left, along(left.view.directions, left.truth.depth(i)[1]).reshape(-1, 3))
        with np.errstate(invalid="ignore"):
            pixels = right.view.pixels(np.where(np.isfinite(points), points, np.nan))
            inside = ((pixels >= 1) & (pixels < np.array([right.width, right.height]) - 1)).all(1)
        x, y = pixels[inside].T - 0.5
        depth = _smooth(right.truth.depth(i)[1], x, y)
        ratio = points[inside, 2] / depth - 1
        same = np.isfinite(ratio)
        seen.append(np.mean(np.abs(ratio[same]) < 0.01) if same.any() else np.nan)
        focal, base = left.K_rect[0, 0], float(left.baseline_m or 0)
        near = same & (np.abs(ratio) < 0.01)
        found.append(focal * base / points[inside, 2][near] * np.abs(ratio[near]))
    return _spread(np.concatenate(found), "px") | {"same_surface": float(np.nanmean(seen))}


def _smooth(depth: NDArray[np.floating[Any]], x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Depth between four pixels' centres, by its inverse (linear on planes); NaN where these see several surfaces."""
    with np.errstate(divide="ignore"):
        inverse = 1 / depth.astype(np.float64)
    around, weights = neighbours(np.stack([x, y], -1), depth.shape[1], depth.shape[0])
    corners = np.stack([inverse[pixel] for pixel in around])
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = (weights[..., 0] * corners).sum(0)
        flat = np.ptp(corners, 0) < 0.02 * mean
        return np.where(flat & (mean > 0), 1 / mean, np.nan)


def boxes(camera: Camera) -> dict[str, float] | None:
    """Corners of the 3-D boxes, projected by the calibration written beside: how far the modal boxes reach beyond."""
    truth, beyond = camera.truth, []
    rigid = {o["id"]: o for o in truth.objects if o["id"] not in truth.deforming}
    cube = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1).T
    for i, back in enumerate(np.linalg.inv(camera.poses_at(truth.times_us))):
        poses = truth.object_poses(i)
        for box in truth.boxes(i):
            if not box["visible_px"] or (entry := rigid.get(int(box["id"]))) is None:
                continue
            corners = cube * entry["size_m"] + np.array(entry["centre_local"])
            corners = transformed(back @ poses[entry["id"]], corners)
            if not (corners[:, 2] > 0.05).all():
                continue
            pixels = camera.view.pixels(corners)
            if np.isfinite(pixels).all():
                low, high = pixels.min(0), pixels.max(0)
                x0, y0, x1, y1 = (float(box[k]) for k in ("x0", "y0", "x1", "y1"))
                beyond.append(max(low[0] - x0, low[1] - y0, x1 - high[0], y1 - high[1], 0.0))
    return _spread(np.array(beyond), "px") if beyond else None


def imu(sequence: Sequence) -> dict[str, float] | None:
    """The IMU's samples integrated over WINDOW_US from a pose, against the pose there."""
    samples = sequence.imu()
    if samples is None or len(samples) < 3:
        return None
    from scipy.interpolate import make_interp_spline

    t_us, world = sequence.poses()
    world = world @ rig_from_imu(sequence)
    velocity = make_interp_spline(t_us * 1e-6, world[:, :3, 3], 5).derivative()
    count = np.searchsorted(samples["t_us"], WINDOW_US, "right")
    metres, degrees = [], []
    for first in range(0, len(samples) - count + 1, count):
        part = samples[first : first + count]
        start, end = interpolate(part["t_us"][[0, -1]], t_us, *position_quaternion(world))
        t_s = part["t_us"] * 1e-6
        poses, _ = integrate(t_s, part["gyro"], part["accel"], start, velocity(t_s[0]))
        metres.append(float(np.linalg.norm(poses[-1, :3, 3] - end[:3, 3])))
        turn = np.clip((np.trace(poses[-1, :3, :3].T @ end[:3, :3]) - 1) / 2, -1, 1)
        degrees.append(float(np.degrees(np.arccos(turn))))
    return {"windows": len(metres), "worst_m": max(metres), "worst_deg": max(degrees)}


def events(sequence: Sequence, camera: Camera) -> dict[str, Any]:
    """Rates, causes, and the share of signal events that lie where the picture's light changes. noise_share: of the
    sensor's noise; render_noise_share, camera_noise_share: events that would not come again in another render, or in
    another recording by the same camera, as `pecs sense` estimates them; dropped_share: events that the readout
    dropped, of all that pixels fired, also those that stages behind it dropped; corner_hz: of photoreceptors in the
    light of the first frame."""
    found, causes = camera.events(), np.asarray(camera.causes())
    seconds = sequence.duration_us * 1e-6
    bins = np.histogram(found["t"], bins=50, range=(0, sequence.duration_us))[0] / (seconds / 50)
    signal, render = causes == LABELS.index("signal"), causes == LABELS.index("render")
    out: dict[str, Any] = {
        "count": len(found),
        "rate_hz": len(found) / seconds,
        "rate_over_time_hz": bins.tolist(),
        "on_share": float(np.mean(found["p"])) if len(found) else 0.0,
        "noise_share": float(np.mean(~signal & ~render)) if len(found) else 0.0,
        "render_noise_share": float(np.mean(render)) if len(found) else 0.0,
        "rate_per_pixel_hz": len(found) / seconds / (camera.width * camera.height),
        "pixels_with_events": len(np.unique(_at(found, camera))) / (camera.width * camera.height),
    }
    record = camera.folder / "events.h5.run.json"
    if record.exists():
        results = read_object(record, "the record of the events")["results"]
        dropped, stages = results["dropped"], results["dropped_by_stage"]
        fired = dropped + sum(stages.values()) - stages["roi"] + len(found)
        out |= {"dropped": dropped, "dropped_share": dropped / max(fired, 1)}
        for key in ("corner_hz", "photocurrent_a"):
            out |= {f"{key}_{part}": value for part, value in results[key].items()}
        for key in ("render_noise", "camera_noise"):
            if (share := results.get(key, {}).get("share")) is not None:
                out[f"{key}_share"] = share
    if _has(camera, "motion") and len(camera.truth) > 1 and signal.any():
        out |= _on_edges(camera, found[signal])
    return out


def _at(found: Any, camera: Camera) -> NDArray[np.int64]:
    return found["y"].astype(np.int64) * camera.width + found["x"]


def _on_edges(camera: Camera, found: Any) -> dict[str, float]:
    """The share of events where something moves, whatever its texture."""
    import cv2

    truth = camera.truth
    where = np.clip(np.searchsorted(truth.times_us, found["t"], "right") - 1, 0, len(truth.times_us) - 2)
    hits, area = 0, []
    for i in np.unique(where):
        moving = np.hypot(*np.moveaxis(truth.flow(int(i)), -1, 0))
        back = np.hypot(*np.moveaxis(truth.flow_back(int(i)), -1, 0))
        moves = np.maximum(np.nan_to_num(moving, nan=9), np.nan_to_num(back, nan=9)) > 0.05
        moves = cv2.dilate(moves.astype(np.uint8), np.ones((2 * EDGE_PX + 1,) * 2, np.uint8))
        area.append(float(moves.mean()))
        hits += int(moves.ravel()[_at(found[where == i], camera)].sum())
    return {"signal_on_motion": hits / len(found), "moving_area": float(np.mean(area))}


def _spread(values: NDArray[np.float64], unit: str) -> dict[str, float]:
    if not len(values):
        return {"count": 0}
    rms, ends = float(np.sqrt(np.mean(values**2))), np.percentile(values, (50, 99))
    return {"count": len(values), f"rms_{unit}": rms, f"median_{unit}": float(ends[0]), f"p99_{unit}": float(ends[1])}
