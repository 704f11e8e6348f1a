"""Reports as HTML, one file each, of the nodes that calibration/page/include/pecs/page/page.h describes; and their
pictures. The library writes the HTML and escapes all text."""

from __future__ import annotations

import base64
import json
import struct
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._c_types import POINTER, TEXT
from ._files import write_text
from ._library import function, take_text

Node = list[Any] | str

_page = function("pecs_page", POINTER, TEXT)


def write_page(path: Path, title: str, body: Iterable[Node]) -> None:
    """Raises PecsOutputError."""
    page = {"title": title, "body": list(body)}
    write_text(path, take_text(_page(json.dumps(page, allow_nan=False).encode())))


def table(rows: Iterable[Iterable[Any]], head: Iterable[str] = ()) -> Node:
    """Cells are values of any type, or whole cells ["td", ...]. Floating-point numbers have four digits."""
    lines = [["tr", *(["th", name] for name in head)]] if head else []
    return ["table", *lines, *(["tr", *map(_cell, row)] for row in rows)]


def _cell(value: Any) -> Node:
    if isinstance(value, list) and value[:1] == ["td"]:
        return value
    return ["td", f"{value:.4g}" if isinstance(value, float) else str(value)]


def figure(node: Node, caption: str) -> Node:
    return ["figure", node, ["figcaption", caption]]


def image(pixels: NDArray[np.uint8], width: int) -> Node:
    """pixels: [H, W] or [H, W, 3] RGB. width: on the page."""
    source = f"data:image/png;base64,{base64.b64encode(png_bytes(pixels, 6)).decode()}"
    return ["img", {"src": source, "width": str(width), "alt": ""}]


def plot(x: Any, lines: Mapping[str, Any], labels: tuple[str, str], small: bool = True) -> Node:
    """Lines by name over x. labels: of x and y."""
    series = []
    for (name, y), style in zip(lines.items(), ("on", "off", "third"), strict=False):
        numbers = [v if np.isfinite(v) else None for v in map(float, y)]
        series.append({"name": name, "style": style, "x": list(map(float, x)), "y": numbers})
    return ["plot", {"plot": series, "x": labels[0], "y": labels[1], "small": small}]


def row(nodes: Iterable[Node]) -> Node:
    """Nodes side by side."""
    return ["div", {"class": "row"}, *nodes]


def png_bytes(pixels: NDArray[Any], level: int = 1) -> bytes:
    """A PNG of uint8 or uint16, [H, W] or [H, W, 3] RGB. level: of compression, 1 to 9."""
    height, width = pixels.shape[:2]
    rows = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder(">")).view(np.uint8).reshape(height, -1)
    filtered = np.empty((height, rows.shape[1] + 1), np.uint8)
    filtered[:, 0], filtered[:1, 1:] = 2, rows[:1]  # each row as its difference to the one above
    np.subtract(rows[1:], rows[:-1], out=filtered[1:, 1:])
    kind = struct.pack(">IIBBBBB", width, height, 8 * pixels.itemsize, 2 if pixels.ndim == 3 else 0, 0, 0, 0)
    out = b"\x89PNG\r\n\x1a\n"
    for name, data in ((b"IHDR", kind), (b"IDAT", zlib.compress(filtered, level)), (b"IEND", b"")):
        out += struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
    return out
