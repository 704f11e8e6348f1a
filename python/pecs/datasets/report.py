"""A sequence's page (report.html: pictures, checks, counts) and the set's index (index.html), each one file."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from .._errors import optional_module
from .._files import write_json, write_whole
from .._pages import Node, figure, image, plot, png_bytes, row, table, write_page
from ..representations import event_picture
from . import preview
from .checks import check, recorded_rates
from .files import read_picture
from .manifest import sealed
from .sequence import Camera, Sequence
from .writers._pictures import depth_picture, flow_picture

SHOWN = 640  # pixels wide at most


def write(sequence: Sequence) -> dict[str, Any]:
    """report.html and checks.json of a sequence; the checks' numbers."""
    checks = check(sequence)
    write_json(sequence.folder / "checks.json", checks)
    body: list[Node] = [["h1", f"Sequence {sequence.name}"], _facts(sequence, checks["motion"])]
    body += [["p", ["b", "Outside the limits: "], line] for line in checks["outside_limits"]]
    columns = preview.strip(sequence)
    if columns:
        strip = np.concatenate(list(columns.values()), 1)
        write_whole(sequence.folder / "preview.png", png_bytes(strip, 9))
        body += [_film("preview.png", strip.shape), ["p", ", ".join(columns).capitalize()]]
    for camera in sequence.cameras.values():
        found = checks["cameras"][camera.name]
        body.append(["h2", f"{camera.name}: {camera.kind}, {camera.width} x {camera.height}"])
        pictures = _pictures(sequence, camera)
        body.append(row(figure(image(p, min(SHOWN, max(346, p.shape[1]))), caption) for caption, p in pictures))
        body.append(_numbers(found))
        rate = found.get("events", {}).get("rate_over_time_hz")
        if rate:
            pixels = camera.width * camera.height
            recorded = {k: v["rate_per_pixel_hz"] * pixels for k, v in checks["recorded_sets"].items()}
            names = {f"{name} ({hz / 1e6:.3g} million)": [hz] * len(rate) for name, hz in recorded.items()}
            time_s = np.linspace(0, sequence.duration_us / 1e6, len(rate))
            drawn = plot(time_s, {"sequence": rate, **names}, ("time (s)", "events per second"), small=False)
            body.append(figure(drawn, "Events over the sequence, and at the mean rates per pixel of recorded sets"))
    if checks["stereo"]:
        body += [["h2", "Stereo: depth of both cameras"], _numbers(checks["stereo"])]
    samples = sequence.imu()
    if samples is not None:
        units = {"gyro": "angular rate (rad/s)", "accel": "specific force (m/s²)"}
        shown = samples[:: max(1, len(samples) // 900)]
        lines = {key: dict(zip("xyz", shown[key].T, strict=True)) for key in units}
        plots = (plot(shown["t_us"] / 1e6, lines[key], ("time (s)", unit)) for key, unit in units.items())
        body += [["h2", "IMU"], row(plots), _numbers({"against the poses": checks["imu"]})]
    write_page(sequence.folder / "report.html", f"Sequence {sequence.name}", body)
    return checks


def write_index(folder: Path, manifest: dict[str, Any]) -> None:
    """SET/index.html: thumbnails with filters by split and scene, and what the set is made of."""
    cards = []
    for entry in manifest["sequences"]:
        sequence = Sequence(folder / "sequences" / entry["name"])
        checks = sealed(sequence.folder, "checks.json")
        rates = [c["events"]["rate_hz"] for c in checks["cameras"].values() if "events" in c]
        seen = [c.truth for c in sequence.cameras.values() if c.has_truth and "objects" in c.truth.layers]
        objects = [o for truth in seen for o in truth.objects]
        classes = sorted({o["class"] for o in objects if o["class"]})
        link = ["a", {"href": quote("sequences/" + entry["name"]) + "/report.html"}, entry["name"]]
        seconds, rate = sequence.duration_us / 1e6, sum(rates) / 1e6
        facts = f" {entry['split']}, {entry['scene']}, {seconds:g} s, {rate:.2f} Mevents/s"
        lines = (part for line in [*_quality(checks), ", ".join(classes)] for part in (["br"], line))
        item = {"class": "item"} | {f"data-{key}": entry[key] for key in ("split", "scene")}
        cards.append(["div", item, _card_picture(sequence), ["p", ["b", link], facts, *lines]])
    recorded = [
        (["td", ["a", {"href": one["source"]}, name]], one["rate_per_pixel_hz"], one["what"])
        for name, one in recorded_rates().items()
    ]
    listed = {"dataset.json": "checksums", "croissant.json": "description for machines"}
    links = ([f", {what}: ", ["a", {"href": name}, name]] for name, what in listed.items())
    body = [
        ["h1", manifest["name"]],
        ["p", f"{len(cards)} sequences", *(part for link in links for part in link)],
        table(manifest["about"].items()),
        table(recorded, ("recorded set", "events/s per pixel", "")),
        ["p", {"id": "filter"}],
        *cards,
        ["h2", "Recipe"],
        ["pre", manifest["recipe"]],
    ]
    write_page(folder / "index.html", manifest["name"], body)


def _card_picture(sequence: Sequence) -> Node:
    """Its moving pictures; without an event camera, a picture."""
    path = sequence.folder / "preview.png"
    if not path.exists():
        return image(_events_picture(sequence, next(iter(sequence.cameras.values()))), 346)
    return _film(quote(f"sequences/{sequence.folder.name}/preview.png"), read_picture(path).shape)


def _film(path: str, shape: tuple[int, ...]) -> Node:
    """The rows of a preview.png one after the other, half a second each."""
    size = f"width:{shape[1]}px;height:{shape[0] // preview.ROWS}px"
    return ["div", {"class": "film", "style": f"{size};background-image:url({path});--end:-{shape[0]}px"}]


def _quality(checks: dict[str, Any]) -> list[str]:
    """Rate, shares of noise and of dropped events of each camera, speed, and what is outside the limits."""
    words = []
    for name, camera in checks["cameras"].items():
        events = camera.get("events", {})
        shares = [f"{events['rate_per_pixel_hz']:.3g} events/s per pixel"] if events else []
        shares += [
            f"{k} {100 * events[f'{k}_share']:.1f} %"
            for k in ("render_noise", "camera_noise", "dropped")
            if f"{k}_share" in events
        ]
        words += [f"{name}: {', '.join(shares)}"] if shares else []
    words.append(f"speed up to {checks['motion']['speed_most_m_s']:.2f} m/s")
    words += [f"outside the limits: {line}" for line in checks["outside_limits"]]
    return [word.replace("_", " ") for word in words]


def _facts(sequence: Sequence, motion: dict[str, float]) -> Node:
    drawn = sequence.info["drawn"]
    groups = {"": {"split": sequence.split, "duration_s": drawn["duration_s"], "scene": drawn["scene"]}}
    groups |= {"scene": drawn["parameters"], "path": {k: _text(v) for k, v in drawn["trajectory"].items()}}
    for name, camera in drawn["cameras"].items():
        values = camera | camera["overrides"]
        groups[name] = {k: v for k, v in values.items() if v not in (None, {}) and k != "overrides"}
    groups["rig"] = {"speed_m_s": "{speed_least_m_s:.2f} to {speed_most_m_s:.2f}".format_map(motion)}
    return _numbers(groups)


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else f"{value}"


def _numbers(groups: dict[str, Any]) -> Node:
    named = [(group, name, value) for group, values in groups.items() for name, value in (values or {}).items()]
    shown = (one for one in named if not isinstance(one[2], list))
    return table((["td", ["key", group]], ["td", ["key", name]], value) for group, name, value in shown)


# Pictures: RGB arrays [H, W, 3] u1


def _pictures(sequence: Sequence, camera: Camera) -> list[tuple[str, NDArray[np.uint8]]]:
    found: list[tuple[str, NDArray[np.uint8]]] = []
    frames = camera.frames()
    if frames:
        frame = frames[len(frames) // 2]
        found.append((f"picture, {frame.start_us / 1e3:g} to {frame.end_us / 1e3:g} ms", read_picture(frame.path)))
        if frame.sharp_path.exists():
            found.append(("the same instant, sharp", read_picture(frame.sharp_path)))
    if camera.kind == "events":
        found.append(("events of 10 ms in the middle: ON blue, OFF orange", _events_picture(sequence, camera)))
        if camera.has_truth and "objects" in camera.truth.layers:
            objects = _events_picture(sequence, camera, by_object=True)
            found.append(("the same events, by the object that each pixel saw", objects))
    if camera.has_truth and not camera.info["pixels_of"]:
        found += _truth_pictures(camera)
    return found


def _truth_pictures(camera: Camera) -> list[tuple[str, NDArray[np.uint8]]]:
    """Captions and pictures of the truth at the instant in the middle."""
    truth, found = camera.truth, []
    i = (len(truth) - 1) // 2
    if "depth" in truth.layers:
        z = truth.depth(i)[1]
        near = z.min(initial=np.inf, where=z > 0)
        found.append((f"1 / depth along the axis, from {near:.2f} m (white)", depth_picture(z)))
    if "normal" in truth.layers:
        normal = np.moveaxis(truth.normal(i), 0, -1) * 127.5 + 127.5
        found.append(("normals: x red, y green, z blue", normal.clip(0, 255).astype(np.uint8)))
    if "motion" in truth.layers and len(truth) > 1:
        flow = truth.flow(min(i, len(truth) - 2))
        most = np.nanmax(np.hypot(flow[..., 0], flow[..., 1]), initial=0)
        found.append((f"flow until the next instant, up to {most:.1f} px", flow_picture(flow)))
    if "objects" in truth.layers:
        found.append(("objects, and boxes of those with a class", _boxes_picture(camera, i)))
    return found


def _colours(ids: NDArray[Any]) -> NDArray[np.uint8]:
    """A colour for each id, 0 is light grey."""
    table = np.random.default_rng(5).integers(40, 230, (4096, 3)).astype(np.uint8)
    table[0] = 235
    return table[np.asarray(ids, np.int64) % 4096]


def _events_picture(sequence: Sequence, camera: Camera, by_object: bool = False) -> NDArray[np.uint8]:
    if camera.kind != "events":
        return read_picture(camera.frames()[0].path)
    with camera.event_file() as file:
        middle = sequence.duration_us / 2
        first, last = file.index(middle - 5000), file.index(middle + 5000)
        events = file.read(first, last)
    if not by_object:
        return event_picture(events, camera.width, camera.height)
    out = np.full((camera.height, camera.width, 3), 255, np.uint8)
    out[events["y"], events["x"]] = _colours(camera.objects()[first:last])
    return out


def _boxes_picture(camera: Camera, i: int) -> NDArray[np.uint8]:
    cv2 = optional_module("cv2", "opencv-python-headless", "the report")
    out = np.ascontiguousarray(_colours(camera.truth.instances(i)))
    names = {o["id"]: o["class"] for o in camera.truth.objects}
    for box in camera.truth.boxes(i):
        if names.get(int(box["id"])) and box["visible_px"]:
            x0, y0, x1, y1 = (round(float(box[k])) for k in ("x0", "y0", "x1", "y1"))
            cv2.rectangle(out, (x0, y0), (x1 - 1, y1 - 1), (255, 255, 255), 1)
            cv2.putText(out, names[int(box["id"])], (x0 + 2, y0 + 10), cv2.FONT_HERSHEY_SIMPLEX, 0.33, (0, 0, 0), 1)
    return out
