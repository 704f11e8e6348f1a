"""A sequence's page (report.html: pictures, checks, counts) and the set's index (index.html), each one file."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from .._errors import optional_module
from .._files import write_json, write_text, write_whole
from .._text import html
from . import preview
from .checks import check, recorded_rates
from .files import png_bytes, read_picture
from .manifest import sealed
from .report_pictures import flow_picture
from .sequence import Camera, Sequence
from .writers._pictures import depth_picture, event_picture

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2em auto; max-width: 1180px; padding: 0 1em; color: #222; }
table { border-collapse: collapse; margin: 0.5em 0 1.5em; } td, th { padding: 0.25em 0.8em; text-align: left;
border-bottom: 1px solid #ddd; }
figure { display: inline-block; margin: 0 1em 1em 0; } figcaption { font-size: 13px; color: #555; }
img { image-rendering: pixelated; background: #eee; } .card { display: inline-block; margin: 0 1em 1.2em 0;
vertical-align: top; width: 960px; } svg { background: #fafafa; }
.moving { background-size: 100% auto; animation: play 6s steps(12) infinite; }
@keyframes play { to { background-position-y: var(--end); } }
"""
SHOWN = 640  # pixels wide at most


def write(sequence: Sequence) -> dict[str, Any]:
    """report.html and checks.json of a sequence; the checks' numbers."""
    checks = check(sequence)
    write_json(sequence.folder / "checks.json", checks)
    parts = [f"<h1>Sequence {html(sequence.name)}</h1>", _facts(sequence)]
    parts += [f"<p><b>Outside the limits:</b> {html(line)}</p>" for line in checks["outside_limits"]]
    columns = preview.strip(sequence)
    if columns:
        strip = np.concatenate(list(columns.values()), 1)
        write_whole(sequence.folder / "preview.png", png_bytes(strip, 9))
        parts += [_moving("preview.png", strip.shape), f"<p>{', '.join(columns).capitalize()}</p>"]
    for camera in sequence.cameras.values():
        parts.append(f"<h2>{html(camera.name)}: {camera.kind}, {camera.width} x {camera.height}</h2>")
        parts += [_figure(picture, caption) for caption, picture in _pictures(sequence, camera)]
        parts.append(_numbers(checks["cameras"][camera.name]))
        rate = checks["cameras"][camera.name].get("events", {}).get("rate_over_time_hz")
        if rate:
            recorded = {
                k: v["rate_per_pixel_hz"] * camera.width * camera.height for k, v in checks["recorded_sets"].items()
            }
            others = ", ".join(f"{name} ({hz / 1e6:.3g} million)" for name, hz in recorded.items())
            parts.append(
                "<p>Events per second over the sequence (red), and at the mean rates per pixel of recorded sets: "
                f"{html(others)}, green and blue</p>{_curve([rate, *([hz] * len(rate) for hz in recorded.values())])}"
            )
    if checks["stereo"]:
        parts += ["<h2>Stereo: depth of both cameras</h2>", _numbers(checks["stereo"])]
    samples = sequence.imu()
    if samples is not None:
        parts += ["<h2>IMU</h2>", "<p>Angular rate [rad/s], specific force [m/s²]: x red, y green, z blue</p>"]
        parts += [_curve(samples[name].T.tolist()) for name in ("gyro", "accel")]
        parts.append(_numbers({"against the poses": checks["imu"]}))
    _page(sequence.folder / "report.html", f"Sequence {sequence.name}", parts)
    return checks


def write_index(folder: Path, manifest: dict[str, Any]) -> None:
    """SET/index.html: thumbnails with filters by split and scene, and what the set is made of."""
    cards = []
    for row in manifest["sequences"]:
        sequence = Sequence(folder / "sequences" / row["name"])
        checks = sealed(sequence.folder, "checks.json")
        rates = [c["events"]["rate_hz"] for c in checks["cameras"].values() if "events" in c]
        seen = [c.truth for c in sequence.cameras.values() if c.has_truth and "objects" in c.truth.layers]
        objects = [o for truth in seen for o in truth.objects]
        classes = sorted({o["class"] for o in objects if o["class"]})
        cards.append(
            f'<div class="card" data-split="{html(row["split"])}" data-scene="{html(row["scene"])}">'
            f'<a href="{html(quote("sequences/" + row["name"]))}/report.html">{_card_picture(sequence)}</a>'
            f"<br><b>{html(row['name'])}</b> {html(row['split'])}, {html(row['scene'])}, "
            f"{sequence.duration_us / 1e6:g} s, {sum(rates) / 1e6:.2f} Mevents/s"
            f"<br>{_quality(checks)}<br>{html(', '.join(classes))}</div>"
        )
    picks = "".join(
        f'<label>{what} <select data-what="{what}"><option value="">all</option>'
        + "".join(f"<option>{html(v)}</option>" for v in sorted({row[what] for row in manifest["sequences"]}))
        + "</select></label> "
        for what in ("split", "scene")
    )
    script = (
        "<script>const picks=[...document.querySelectorAll('select')];picks.forEach(p=>p.onchange=()=>"
        "document.querySelectorAll('.card').forEach(c=>c.style.display=picks.every(q=>!q.value||"
        "c.dataset[q.dataset.what]===q.value)?'':'none'));</script>"
    )
    recorded = "; ".join(
        f"<a href='{html(one['source'])}'>{html(name)}</a> {one['rate_per_pixel_hz']:.3g} ({html(one['what'])})"
        for name, one in recorded_rates().items()
    )
    about = "".join(f"<li>{html(k)}: {html(v)}</li>" for k, v in manifest["about"].items())
    parts = [
        f"<h1>{html(manifest['name'])}</h1>",
        f"<p>{len(cards)} sequences. <a href='dataset.json'>dataset.json</a> has the check sums, "
        "<a href='croissant.json'>croissant.json</a> the description for machines.</p>",
        f"<ul>{about}</ul>",
        f"<p>Recorded sets, events/s per pixel: {recorded}</p><p>{picks}</p>",
        *cards,
        script,
        f"<h2>Recipe</h2><pre>{html(manifest['recipe'])}</pre>",
    ]
    _page(folder / "index.html", manifest["name"], parts)


def _card_picture(sequence: Sequence) -> str:
    """Its moving pictures; without an event camera, a picture."""
    path = sequence.folder / "preview.png"
    if not path.exists():
        return _img(_events_picture(sequence, next(iter(sequence.cameras.values()))), 346)
    return _moving(quote(f"sequences/{sequence.folder.name}/preview.png"), read_picture(path).shape)


def _moving(path: str, shape: tuple[int, ...]) -> str:
    """The rows of a preview.png one after the other, half a second each."""
    size = f"width:{shape[1]}px;height:{shape[0] // preview.ROWS}px"
    return f'<div class="moving" style="{size};background-image:url({html(path)});--end:-{shape[0]}px"></div>'


def _quality(checks: dict[str, Any]) -> str:
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
    return "<br>".join(html(word.replace("_", " ")) for word in words)


def _page(path: Path, title: str, parts: list[str]) -> None:
    head = f"<!doctype html><html lang='en'><meta charset='utf-8'><title>{html(title)}</title><style>{STYLE}</style>"
    write_text(path, head + "\n".join(parts) + "</html>\n")


def _facts(sequence: Sequence) -> str:
    drawn = sequence.info["drawn"]
    flat = {"split": sequence.split, "duration_s": drawn["duration_s"], "scene": drawn["scene"]}
    flat |= {f"scene: {k}": v for k, v in drawn["parameters"].items()}
    flat |= {f"path: {k}": v for k, v in drawn["trajectory"].items()}
    for name, camera in drawn["cameras"].items():
        values = camera | camera["overrides"]
        flat |= {f"{name}: {k}": v for k, v in values.items() if v is not None and k != "overrides"}
    times, world = sequence.poses()
    speed = np.linalg.norm(np.diff(world[:, :3, 3], axis=0), axis=1) / np.diff(times) * 1e6
    flat["speed of the rig [m/s]"] = f"{speed.min():.2f} to {speed.max():.2f}"
    return _table(flat.items())


def _numbers(groups: dict[str, Any]) -> str:
    named = [(group, name, value) for group, values in groups.items() for name, value in (values or {}).items()]
    return _table(row for row in named if not isinstance(row[2], list))


def _table(rows: Iterable[tuple[Any, ...]]) -> str:
    cells = ("".join(f"<td>{html(_short(value))}</td>" for value in row) for row in rows)
    return f"<table>{''.join(f'<tr>{row}</tr>' for row in cells)}</table>"


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _curve(lines: list[list[float]], width: int = 900, height: int = 110) -> str:
    values = np.array(lines, float)
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    scale = (height - 10) / max(high - low, 1e-12)
    step = max(1, values.shape[1] // width)
    out = []
    for line, colour in zip(values, ("#c22", "#292", "#23c") if len(values) > 1 else ("#333",), strict=False):
        points = " ".join(
            f"{i * width / max(1, len(line) - 1):.1f},{height - 5 - (v - low) * scale:.1f}"
            for i, v in list(enumerate(line))[::step]
        )
        out.append(f'<polyline points="{points}" fill="none" stroke="{colour}"/>')
    for y, value in ((14, high), (height - 4, low)):
        out.append(f'<text x="4" y="{y}" font-size="12">{_short(value)}</text>')
    return f'<p><svg width="{width}" height="{height}">{"".join(out)}</svg></p>'


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
        objects = _events_picture(sequence, camera, by_object=True)
        found.append(("the same events, by the object that each pixel saw", objects))
    if camera.has_truth and not camera.info["pixels_of"]:
        found += _truth_pictures(camera)
    return found


def _truth_pictures(camera: Camera) -> list[tuple[str, NDArray[np.uint8]]]:
    """Of the instant in the middle."""
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
        return event_picture(events, camera.height, camera.width)
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


def _figure(picture: NDArray[np.uint8], caption: str) -> str:
    width = min(SHOWN, max(346, picture.shape[1]))
    return f"<figure>{_img(picture, width)}<figcaption>{html(caption)}</figcaption></figure>"


def _img(picture: NDArray[np.uint8], width: int) -> str:
    return f'<img width="{width}" src="data:image/png;base64,{base64.b64encode(png_bytes(picture)).decode()}">'
