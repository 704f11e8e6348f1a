"""ROS bags, read and written by rosbags (extra `ros`); ROS itself is not required.

    pecs.ros.write_bag("events.mcap", events)        # also .bag, or a folder
    events = pecs.ros.read_bag("recording.bag")

The end of the path selects the bag: `.bag` is ROS 1, `.mcap` ROS 2 in one MCAP file, any other name ROS 2 in a folder
with metadata.yaml and an SQLite file. Two kinds of messages contain events:

    dvs_msgs            dvs_msgs/EventArray, 13 or 16 bytes per event: the events of 10 ms, at most 100,000. Topic
                        /dvs/events. ROS 1's default.
    event_camera_msgs   event_camera_msgs/EventPacket of encoding evt3: the words of the RAW file between two TIME_HIGH,
                        4.096 ms; time_base 0, as metavision_driver has it. Topic /event_camera/events. ROS 2's default.

The stamp of a message is the time of its first event; times are those of the events, so 0 is 1970.
"""

from __future__ import annotations

import re
import shutil
import sqlite3
import struct
import tempfile
import warnings
import zipfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from itertools import chain
from os import PathLike
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._errors import (
    ExitCode,
    PecsError,
    PecsInputError,
    PecsOutputError,
    UsageError,
    bad_input,
    existing,
    optional_module,
    shown,
)
from ._files import whole, whole_folder
from .events import EVENT_DTYPE, Events, EventWriter, as_events, read

ARRAYS = ("dvs_msgs/msg/EventArray", "prophesee_event_msgs/msg/EventArray")
IMAGE = "sensor_msgs/msg/Image"
PACKETS = ("event_camera_msgs/msg/EventPacket", "event_array_msgs/msg/EventArray")
MESSAGES = {"dvs_msgs": (ARRAYS[0], "/dvs/events"), "event_camera_msgs": (PACKETS[0], "/event_camera/events")}
STORAGES = ("ros1", "mcap", "sqlite3")
PERIOD_US, MOST_EVENTS = 10_000, 100_000  # of an EventArray
MOST_PIXELS = 2048  # of a side, in EVT3
MOST_PADDING = 7  # bytes behind a serialised message of CDR
_TOPIC = re.compile(r"[/~]?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*", re.ASCII)
_BLOCK = 1 << 16

_EVENT = "uint16 x\nuint16 y\ntime ts\nbool polarity\n"
_ARRAY = "std_msgs/Header header\nuint32 height\nuint32 width\n{}/Event[] events\n"
_PACKET = """std_msgs/Header header
uint32 height
uint32 width
uint64 seq
uint64 time_base
string encoding
bool is_bigendian
uint8[] events
"""
_FLOW = "std_msgs/Header header\nuint32 height\nuint32 width\nfloat32[] flow_x\nfloat32[] flow_y\n"
# Beyond ROS's own. Source of the definitions: rpg_dvs_ros, event_camera_msgs, rpg_esim.
DEFINITIONS = {
    **{f"{package}/msg/Event": _EVENT for package in ("dvs_msgs", "prophesee_event_msgs")},
    **{name: _ARRAY.format(name.partition("/")[0]) for name in ARRAYS},
    **dict.fromkeys(PACKETS, _PACKET),
    "esim_msgs/msg/OpticFlow": _FLOW,
}
# Events of a serialised EventArray. CDR aligns x to 2 bytes and ts to 4: from the second event on, x is before a
# multiple of 16 bytes and the rest behind it.
_ROS1 = np.dtype({"names": ["x", "y", "s", "ns", "p"], "formats": ["<u2", "<u2", "<u4", "<u4", "u1"]})
_CDR = np.dtype(
    {
        "names": ["y", "s", "ns", "p", "next_x"],
        "formats": ["<u2", "<i4", "<u4", "u1", "<u2"],
        "offsets": [0, 4, 8, 12, 14],
        "itemsize": 16,
    }
)


def _rosbags(part: str) -> Any:
    return optional_module(f"rosbags.{part}", "rosbags", "a ROS bag", "ros")


def _store(ros1: bool) -> Any:
    """The types of messages."""
    typesys = _rosbags("typesys")
    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if ros1 else typesys.Stores.ROS2_HUMBLE)
    for name, text in DEFINITIONS.items():
        store.register(typesys.get_types_from_msg(text, name))
    return store


# Writing


class Bag:
    """A bag to write. `path` must not exist: a file for storage "ros1", a folder for "mcap" and "sqlite3"."""

    def __init__(self, path: Path, storage: str):
        self.path, self.ros1 = path, storage == "ros1"
        self._store, self._connections = _store(self.ros1), {}
        if self.ros1:
            self._writer = _rosbags("rosbag1").Writer(path)
        else:
            rosbag2 = _rosbags("rosbag2")
            plugin = rosbag2.StoragePlugin[storage.upper()]
            self._writer = rosbag2.Writer(path, version=8, storage_plugin=plugin)
        with self._writing():
            self._writer.open()

    def __enter__(self) -> Bag:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None:
            with self._writing():
                self._writer.close()

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as e:
            raise PecsOutputError(f"{self.path}: cannot be written: {e}") from None

    def message(self, name: str, *values: Any, **fields: Any) -> Any:
        return self._store.types[name](*values, **fields)

    def stamp(self, t_ns: int) -> Any:
        return self.message("builtin_interfaces/msg/Time", t_ns // 10**9, t_ns % 10**9)

    def header(self, t_ns: int, frame: str) -> Any:
        more = {"seq": 0} if self.ros1 else {}
        return self.message("std_msgs/msg/Header", stamp=self.stamp(t_ns), frame_id=frame, **more)

    def serialized(self, message: Any) -> bytes:
        serialize = self._store.serialize_ros1 if self.ros1 else self._store.serialize_cdr
        return bytes(serialize(message, message.__msgtype__))

    def write(self, topic: str, name: str, t_ns: int, data: bytes) -> None:
        """`name`: of the type; `data`: serialised."""
        with self._writing():
            if topic not in self._connections:
                self._connections[topic] = self._writer.add_connection(topic, name, typestore=self._store)
            self._writer.write(self._connections[topic], max(t_ns, 1), data)  # ROS 1 has no time 0

    def event_messages(
        self, blocks: Iterable[NDArray[Any]], width: int, height: int, messages: str, frame: str
    ) -> Iterator[tuple[int, bytes]]:
        """(time [ns], serialised message) of events in blocks, of the kind `messages`; at least one message."""
        seq = 0
        if messages == "event_camera_msgs":
            for t_us, words in _packets(blocks, width, height):
                fields = {"height": height, "width": width, "seq": seq, "time_base": 0, "encoding": "evt3"}
                fields |= {"is_bigendian": False, "events": words.view(np.uint8)}
                header = self.header(1000 * t_us, frame)
                yield 1000 * t_us, self.serialized(self.message(PACKETS[0], header=header, **fields))
                seq += 1
            return
        for events in _arrays(blocks):
            t_ns = 1000 * int(events["t"][0]) if len(events) else 0
            empty = self.message(ARRAYS[0], header=self.header(t_ns, frame), height=height, width=width, events=[])
            head = self.serialized(empty)[:-4]  # without the number of events
            body = _ros1_bytes(events) if self.ros1 else _cdr_bytes(events)
            yield t_ns, head + struct.pack("<I", len(events)) + body


def _arrays(blocks: Iterable[NDArray[Any]]) -> Iterator[NDArray[np.void]]:
    """Events of each EventArray."""
    rest, count = np.zeros(0, EVENT_DTYPE), 0
    for block in blocks:
        rest = np.concatenate([rest, np.asarray(block)])
        cuts = np.flatnonzero(np.diff(rest["t"] // PERIOD_US)) + 1
        *done, rest = np.split(rest, cuts)
        for part in [*done, rest]:
            while len(part) >= MOST_EVENTS or (len(part) and part is not rest):
                yield part[:MOST_EVENTS]
                count += 1
                part = part[MOST_EVENTS:]
        rest = part
    if len(rest) or not count:
        yield rest


def _seconds(events: NDArray[np.void], out: NDArray[np.void]) -> None:
    out["s"], us = np.divmod(events["t"], 1_000_000)
    out["ns"], out["y"], out["p"] = 1000 * us, events["y"], events["p"]


def _ros1_bytes(events: NDArray[np.void]) -> bytes:
    out = np.zeros(len(events), _ROS1)
    _seconds(events, out)
    out["x"] = events["x"]
    return out.tobytes()


def _cdr_bytes(events: NDArray[np.void]) -> bytes:
    if not len(events):
        return b""
    out = np.zeros(len(events), _CDR)
    _seconds(events, out)
    out["next_x"][:-1] = events["x"][1:]
    out.view("<u2")[:2] = events["x"][0], events["y"][0]
    return out.tobytes()[:-3]


def _packets(blocks: Iterable[NDArray[Any]], width: int, height: int) -> Iterator[tuple[int, NDArray[np.uint16]]]:
    """(time of the first event [us], EVT3 words) of each value of TIME_HIGH that has events."""
    firsts, last = [np.zeros(0, np.int64)], np.int64(-1)
    with tempfile.TemporaryDirectory(prefix="pecs-") as folder:
        path = Path(folder) / "events.raw"
        with EventWriter(path, width, height, "evt3") as writer:
            for block in blocks:
                writer.write(block)
                high = block["t"] >> 12
                firsts.append(block["t"][np.diff(high, prepend=last) != 0])
                last = high[-1] if len(high) else last
        times = np.concatenate(firsts).tolist()
        yield from zip(times or [0], _words(path), strict=True)


def _words(path: Path) -> Iterator[NDArray[np.uint16]]:
    """The words of an EVT3 file, cut before a TIME_HIGH that follows an event."""
    with path.open("rb") as file:
        while file.readline() != b"% end\n":
            pass
        rest = np.zeros(0, "<u2")
        while block := file.read(1 << 20):
            rest = np.concatenate([rest, np.frombuffer(block, "<u2")])
            kind = rest >> 12
            cuts = np.flatnonzero((kind[1:] == 8) & (kind[:-1] != 8) & (kind[:-1] != 6)) + 1
            *done, rest = np.split(rest, cuts)
            yield from done
        yield rest


def write_bag(
    path: str | PathLike[str],
    events: NDArray[Any] | Iterable[NDArray[Any]],
    width: int = 0,
    height: int = 0,
    *,
    messages: str | None = None,
    topic: str | None = None,
) -> None:
    """Write events to a bag; an existing folder is not replaced.

    Parameters
    ----------
    path : str or path
        `.bag` (ROS 1), `.mcap` (ROS 2), or a folder (ROS 2, SQLite).
    events : array or iterable of arrays
        Structured arrays with t, x, y and p by increasing t, or their blocks, such as an `EventReader`.
    width, height : int
        Size of the sensor [pixels]. Default: that of `events`.
    messages : str, optional
        "dvs_msgs" or "event_camera_msgs". Default: the first for `.bag`, otherwise the second.
    topic : str, optional
        Default: "/dvs/events" or "/event_camera/events".

    Raises
    ------
    PecsInputError
        A bag cannot contain these events: times below 0, pixels outside the sensor, sides above 2048 pixels in EVT3.
    PecsOutputError
        The bag cannot be written.
    """
    path = Path(path)
    storage = {".bag": "ros1", ".mcap": "mcap"}.get(path.suffix.lower(), "sqlite3")
    messages = messages or ("dvs_msgs" if storage == "ros1" else "event_camera_msgs")
    check_messages(str(path), messages)
    if topic is not None and not _TOPIC.fullmatch(topic):
        raise UsageError(f"{path}: topic: got {shown(topic)}, wanted a name of ROS, such as /dvs/events")
    width, height = width or getattr(events, "width", 0), height or getattr(events, "height", 0)
    check_size(path, width, height, messages)
    given = (events[i : i + _BLOCK] for i in range(0, len(events), _BLOCK)) if hasattr(events, "dtype") else events
    blocks = _checked(path, given, width, height)
    name, usual = MESSAGES[messages]

    def fill(at: Path) -> None:
        with Bag(at, storage) as bag:
            for t_ns, data in bag.event_messages(blocks, width, height, messages, "event_camera"):
                bag.write(topic or usual, name, t_ns, data)

    if storage == "sqlite3":
        with whole_folder(path) as partial:
            fill(partial / path.name)
            for file in (partial / path.name).iterdir():
                shutil.move(file, partial)
            (partial / path.name).rmdir()
        return
    with tempfile.TemporaryDirectory(prefix="pecs-") as folder:
        at = Path(folder) / "events"
        fill(at)
        with (at if storage == "ros1" else at / "events.mcap").open("rb") as made, whole(path) as file:
            shutil.copyfileobj(made, file, 1 << 20)


def check_messages(what: str, messages: str) -> None:
    if messages not in MESSAGES:
        raise UsageError(f"{what}: messages: got {messages}, wanted {' or '.join(MESSAGES)}")


def check_size(path: Path, width: int, height: int, messages: str) -> None:
    """Raises PecsInputError for a sensor that the messages cannot describe."""
    most = MOST_PIXELS if messages == "event_camera_msgs" else 1 << 16
    if not (1 <= width <= most and 1 <= height <= most):
        hint = "" if max(width, height) <= MOST_PIXELS else " (dvs_msgs has no limit)"
        raise bad_input(path, "size", f"{width}x{height}", f"1 to {most} pixels{hint}")


def _checked(path: Path, blocks: Iterable[NDArray[Any]], width: int, height: int) -> Iterator[NDArray[np.void]]:
    """The blocks as plain arrays. Raises PecsInputError for an event that a bag cannot contain."""
    first, least = 0, 0
    for block in blocks:
        block = as_events(block)
        t, x, y, p = (block[name] for name in "txyp")
        before = np.concatenate([[least], t[:-1]]) if len(t) else t
        for wrong, wanted in (
            (t < before, "times from 0 on that do not decrease"),
            ((x >= width) | (y >= height), f"x and y on {width}x{height} pixels"),
            (p > 1, "p of 0 or 1"),
            (t >= 1_000_000 << 31, "times before 2038"),
        ):
            if wrong.any():
                i = int(wrong.argmax())
                got = f"t = {t[i]} us after {before[i]}, x = {x[i]}, y = {y[i]}, p = {p[i]}"
                raise bad_input(path, f"event {first + i}", got, wanted)
        first, least = first + len(t), t[-1] if len(t) else least
        yield block


# Reading


def is_bag(path: Path) -> bool:
    """Whether the content is a bag's: of ROS 1, MCAP, or a folder with metadata.yaml."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file()
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(16).startswith((b"#ROSBAG V2.0", b"\x89MCAP0\r\n", b"SQLite format 3"))


def read_bag(path: str | PathLike[str], topic: str | None = None, *, late: str | None = None) -> Events:
    """Read all events of a topic of a bag.

    Times [us] are those of EventArray, rounded to the nearest, and the camera's own of EventPacket.

    Parameters
    ----------
    path : str or path
        A bag of ROS 1, an MCAP file, or a folder of ROS 2.
    topic : str, optional
        Required if several topics have events.
    late : str, optional
        As in `pecs.read`.

    Raises
    ------
    PecsNotFoundError
        There is no such bag.
    PecsInputError
        It has no such topic, no or several topics of events, or is damaged.
    PecsError
        The encoding of the events is not supported.
    """
    with tempfile.TemporaryDirectory(prefix="pecs-") as folder:
        file = unpack(Path(path), Path(folder), topic)
        try:
            return read(file, late=late)
        except PecsInputError as e:
            raise PecsInputError(str(e).replace(str(file), str(path)), e.code) from None


def read_images(path: Path) -> tuple[list[NDArray[Any]], NDArray[np.float64]]:
    """Grey pictures of the only topic that has them, [H, W] of 8 or 16 bits, and the stamps of their headers [us].
    Raises PecsInputError."""
    with _open(path) as (reader, store, ros1):
        topics = sorted({c.topic for c in reader.connections if c.msgtype == IMAGE})
        if len(topics) != 1:
            raise bad_input(path, "topics", f"pictures on {' and '.join(topics) or 'none'}", "one topic of pictures")
        connections = [c for c in reader.connections if c.topic == topics[0]]
        deserialize = store.deserialize_ros1 if ros1 else store.deserialize_cdr
        pictures, times_us = [], []
        for message in _messages(path, reader, connections, lambda raw: deserialize(raw, IMAGE)):
            bits = {"mono8": 8, "8UC1": 8, "mono16": 16, "16UC1": 16}.get(message.encoding)
            if bits is None:
                raise bad_input(path, f"topic {topics[0]}: encoding", message.encoding, "mono8 or mono16")
            order = ">" if message.is_bigendian else "<"
            values = np.frombuffer(bytes(message.data), f"{order}u{bits // 8}")
            if message.step * message.height != len(message.data) or message.step * 8 < message.width * bits:
                raise bad_input(path, f"topic {topics[0]}", f"{len(message.data)} bytes", "as many as rows of step")
            rows = values.reshape(message.height, -1)[:, : message.width]
            pictures.append(rows.astype(rows.dtype.newbyteorder("=")))
            times_us.append(1e6 * message.header.stamp.sec + message.header.stamp.nanosec / 1000)
        return pictures, np.array(times_us)


def unpack(bag: Path, folder: Path, topic: str | None = None) -> Path:
    """Writes the events of a topic to a file of events in the folder: RAW for packets of EVT3, otherwise NPZ."""
    with _open(bag) as (reader, store, ros1):
        connections = _connections(bag, reader, topic)
        topic, name = connections[0].topic, connections[0].msgtype
        deserialize = store.deserialize_ros1 if ros1 else store.deserialize_cdr
        place = f"topic {topic}"
        if name in ARRAYS:
            messages = _messages(bag, reader, connections, lambda raw: _array(bag, place, raw, ros1))
        else:
            messages = _messages(bag, reader, connections, lambda raw: deserialize(raw, name))
        first = next(messages, None)
        if first is None:
            raise bad_input(bag, place, "no message", "events")
        messages = _alike(bag, place, chain([first], messages))
        encoding = getattr(first, "encoding", "")
        if encoding == "evt3":
            if first.is_bigendian:
                raise PecsError(
                    f"{bag}: {place}: got evt3 with is_bigendian, wanted little-endian words", ExitCode.UNSUPPORTED
                )
            if max(first.width, first.height) > MOST_PIXELS:
                raise bad_input(bag, f"{place}: size", f"{first.width}x{first.height}", f"at most {MOST_PIXELS} pixels")
            return _raw_file(folder / "events.raw", messages, first.width, first.height)
        if encoding not in ("", "mono"):
            error = f"{bag}: {place}: got encoding {encoding}, wanted evt3 or mono"
            raise PecsError(error, ExitCode.UNSUPPORTED)
        blocks = (m.events for m in messages) if not encoding else (_mono(bag, place, m) for m in messages)
        return _npz_file(folder / "events.npz", blocks, first.width, first.height)


@contextmanager
def _open(path: Path) -> Iterator[tuple[Any, Any, bool]]:
    """(reader, types, whether it is ROS 1)"""
    if not is_bag(existing(path, "a ROS bag")):
        raise bad_input(path, "", "neither #ROSBAG V2.0, MCAP nor a folder with metadata.yaml", "a ROS bag")
    ros1 = path.is_file() and path.open("rb").read(1) == b"#"
    store = _store(ros1)
    reader = _rosbags("rosbag1" if ros1 else "rosbag2").Reader
    try:
        opened = reader(path)
        opened.open()
    except Exception as e:  # also struct.error, zlib's and others of a damaged file
        raise _damaged(path, "", e) from None
    try:
        yield opened, store, ros1
    finally:
        opened.close()


def _damaged(path: Path, place: str, error: Exception) -> PecsInputError:
    text = " ".join(f"{type(error).__name__} {error}".split())
    return bad_input(path, place, text, "an undamaged ROS bag")


def _messages(path: Path, reader: Any, connections: list[Any], parsed: Callable[[bytes], Any]) -> Iterator[Any]:
    messages, count = reader.messages(connections), 0
    while True:
        try:
            message = parsed(next(messages)[2])
        except StopIteration:
            return
        except (PecsError, MemoryError):
            raise
        except Exception as e:
            raise _damaged(path, f"topic {connections[0].topic}: message {count}", e) from None
        yield message
        count += 1


def _connections(path: Path, reader: Any, topic: str | None) -> list[Any]:
    """Those of the topic, or of the only topic with events."""
    have = {c.topic: c.msgtype for c in reader.connections}
    events = sorted(t for t, name in have.items() if name in (*ARRAYS, *PACKETS))
    if not events:
        found = ", ".join(f"{t} ({name.replace('/msg/', '/')})" for t, name in sorted(have.items()))
        wanted = f"one of {', '.join(name.replace('/msg/', '/') for name, _ in MESSAGES.values())}"
        raise bad_input(path, "topics", found or "none", wanted)
    if topic is None and len(events) > 1:
        raise bad_input(path, "topics", f"events on {' and '.join(events)}", f"--topic {events[0]} or another of them")
    if topic is not None and topic not in events:
        raise bad_input(path, "topic", topic, f"{' or '.join(events)}, which have events")
    return [c for c in reader.connections if c.topic == (topic or events[0])]


def _alike(path: Path, place: str, messages: Iterable[Any]) -> Iterator[Any]:
    """Raises PecsInputError where the size or the encoding changes. Warns of packets that are missing."""
    first: tuple[Any, ...] | None = None
    lost, seq = 0, None
    for i, message in enumerate(messages):
        lost += max(0, message.seq - seq - 1) if seq is not None else 0
        seq = getattr(message, "seq", None)
        this = (message.width, message.height, getattr(message, "encoding", ""))
        first = first or this
        if this != first:
            raise bad_input(path, f"{place}: message {i}", "{}x{} {}".format(*this), "{}x{} {}".format(*first))
        yield message
    if lost:
        warnings.warn(f"{path}: {place}: {lost} packets are missing (gaps in seq), and their events", stacklevel=2)


def _array(path: Path, place: str, raw: bytes, ros1: bool) -> Any:
    """width, height and events of a serialised EventArray, read at once and not event by event."""
    if not ros1 and raw[:2] != b"\0\1":
        raise bad_input(path, f"{place}: encapsulation", raw[:2].hex(), "0001, little-endian CDR")
    at = 16 + struct.unpack_from("<I", raw, 12)[0]  # behind the frame's name
    at = at if ros1 else -(-at // 4) * 4
    height, width, count = struct.unpack_from("<III", raw, at)
    body = memoryview(raw)[at + 12 :]
    wanted = 13 * count if ros1 else max(16 * count - 3, 0)
    if not 0 <= len(body) - wanted <= (0 if ros1 else MOST_PADDING):
        raise bad_input(path, place, f"{len(body)} bytes of {count} events", f"{wanted}")
    out = np.zeros(count, EVENT_DTYPE)
    if ros1:
        rows = np.frombuffer(body[:wanted], _ROS1)
        out["x"] = rows["x"]
    else:
        rows = np.frombuffer(bytes(body[:wanted]) + bytes(3) * (count > 0), _CDR)
        out["x"][1:] = rows["next_x"][:-1]
    out["y"], out["p"] = rows["y"], rows["p"] != 0
    if count and not ros1:
        out["x"][0], out["y"][0] = rows.view("<u2")[:2]
    if (rows["ns"] >= 10**9).any():
        raise bad_input(path, f"{place}: ts", f"{rows['ns'].max()} ns", "less than a second")
    out["t"] = rows["s"].astype(np.int64) * 1_000_000 + (rows["ns"].astype(np.int64) + 500) // 1000
    return SimpleNamespace(width=width, height=height, events=out)


def _mono(path: Path, place: str, message: Any) -> NDArray[np.void]:
    """Events of an EventPacket of encoding mono: p in bit 63, y in 62..48, x in 47..32, ns after time_base in 31..0."""
    if len(message.events) % 8:
        raise bad_input(path, place, f"{len(message.events)} bytes", "a multiple of 8")
    if message.time_base >= 1 << 62:
        raise bad_input(path, f"{place}: time_base", str(message.time_base), "a time in ns")
    words = message.events.view(">u8" if message.is_bigendian else "<u8").astype(np.uint64)
    out = np.zeros(len(words), EVENT_DTYPE)
    out["p"], out["y"], out["x"] = words >> 63, words >> 48 & 0x7FFF, words >> 32 & 0xFFFF
    out["t"] = (message.time_base + (words & 0xFFFFFFFF).astype(np.int64) + 500) // 1000
    return out


def _raw_file(path: Path, messages: Iterable[Any], width: int, height: int) -> Path:
    with whole(path) as file:
        file.write(
            f"% evt 3.0\n% format EVT3;height={height};width={width}\n% geometry {width}x{height}\n% end\n".encode()
        )
        for message in messages:
            file.write(message.events.tobytes())
    return path


def _npz_file(path: Path, blocks: Iterable[NDArray[np.void]], width: int, height: int) -> Path:
    """Events in their order, which `pecs.write` would refuse where a time decreases."""
    columns = {name: tempfile.TemporaryFile() for name in "txyp"}
    count = 0
    for block in blocks:
        count += len(block)
        for name, column in columns.items():
            column.write(block[name].tobytes())
    with whole(path) as file, zipfile.ZipFile(file, "w") as archive:
        for name, column in columns.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as out:
                header = {"descr": EVENT_DTYPE[name].str, "fortran_order": False, "shape": (count,)}
                np.lib.format.write_array_header_1_0(out, header)
                column.seek(0)
                shutil.copyfileobj(column, out, 1 << 20)
            column.close()
        for name, value in (("width", width), ("height", height)):
            if width and height:
                with archive.open(f"{name}.npy", "w") as out:
                    np.lib.format.write_array(out, np.array(value, np.int64))
    return path
