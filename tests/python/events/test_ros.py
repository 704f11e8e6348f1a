"""ROS bags of pecs.ros, read back by rosbags, mcap and the format's other readers, and bags that are wrong."""

import array
import json
import runpy
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pecs
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from pecs import ros
from rosbags.highlevel import AnyReader
from support import ROOT
from support.event_readers import HEIGHT, STREAMS, WIDTH, assert_same, by_evt3

ENDS = (".bag", ".mcap", "")


def same(found, wanted):
    assert (found.width, found.height) == (WIDTH, HEIGHT)
    assert_same([found[name] for name in "txyp"], wanted)


def messages(path):
    """By rosbags: [(topic, time, message)]"""
    with AnyReader([path]) as reader:
        return [(c.topic, t, reader.deserialize(raw, c.msgtype)) for c, t, raw in reader.messages()]


@pytest.mark.parametrize("kind", ros.MESSAGES)
@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("stream", ["bursts", "empty", "late_start"])
def test_round_trip(stream, end, kind, tmp_path):
    events, path = STREAMS[stream], tmp_path / f"e{end}"
    ros.write_bag(path, events, WIDTH, HEIGHT, messages=kind)
    same(ros.read_bag(path), events)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("end", ENDS)
def test_arrays_by_rosbags(end, tmp_path):
    """EventArray: every event, stamps of the first one, 10 ms at most."""
    events = STREAMS["bursts"][:5000]
    ros.write_bag(tmp_path / f"e{end}", events, WIDTH, HEIGHT, messages="dvs_msgs", topic="/left/events")
    found = []
    for topic, t_ns, message in messages(tmp_path / f"e{end}"):
        rows = [(1_000_000 * e.ts.sec + e.ts.nanosec // 1000, e.x, e.y, e.polarity) for e in message.events]
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        assert topic == "/left/events" and (message.width, message.height) == (WIDTH, HEIGHT)
        assert stamp == 1000 * rows[0][0] and t_ns == max(stamp, 1)
        assert rows[0][0] // 10_000 == rows[-1][0] // 10_000
        found += rows
    assert_same(np.array(found).T, events)


def test_the_definitions_are_those_of_ros():
    """The checksums that ROS 1 compares, as in generated code of rpg_dvs_ros and rpg_esim."""
    store = ros._store(True)
    assert store.generate_msgdef("dvs_msgs/msg/EventArray")[1] == "5e8beee5a6c107e504c2e78903c224b8"
    assert store.generate_msgdef("esim_msgs/msg/OpticFlow")[1] == "1d447e443e01be233472e6f68c671fd7"


def test_packets_by_mcap_and_evt3(tmp_path):
    """EventPacket, decoded by mcap: the words are an EVT3 stream, of which each message is what TIME_HIGH covers."""
    ros.write_bag(tmp_path / "e.mcap", STREAMS["bursts"], WIDTH, HEIGHT)
    words, firsts = b"", []
    with (tmp_path / "e.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for i, (schema, channel, _, packet) in enumerate(reader.iter_decoded_messages()):
            assert (schema.name, channel.topic) == ("event_camera_msgs/msg/EventPacket", "/event_camera/events")
            assert (packet.encoding, packet.seq, packet.time_base, packet.is_bigendian) == ("evt3", i, 0, False)
            assert (packet.width, packet.height) == (WIDTH, HEIGHT)
            words += bytes(packet.events)
            firsts.append(packet.header.stamp.sec * 1_000_000 + packet.header.stamp.nanosec // 1000)
    t = STREAMS["bursts"]["t"]
    assert firsts == t[np.unique(t >> 12, return_index=True)[1]].tolist()
    header = f"% evt 3.0\n% format EVT3;height={HEIGHT};width={WIDTH}\n% end\n".encode()
    (tmp_path / "e.raw").write_bytes(header + words)
    assert_same(by_evt3(tmp_path / "e.raw"), STREAMS["bursts"])


def test_large_windows_are_divided(tmp_path):
    events = np.zeros(250_000, pecs.EVENT_DTYPE)
    ros.write_bag(tmp_path / "e.bag", iter(np.split(events, 10)), 8, 8)
    assert [len(m.events) for _, _, m in messages(tmp_path / "e.bag")] == [100_000, 100_000, 50_000]
    assert len(ros.read_bag(tmp_path / "e.bag")) == len(events)


def packet(path, encoding, content, topic="/event_camera/events"):
    """A bag of one EventPacket by rosbags' own serialiser."""
    with ros.Bag(path, "sqlite3") as bag:
        fields = {"height": 8, "width": 8, "seq": 0, "time_base": 2_000_500, "encoding": encoding}
        fields |= {"is_bigendian": False, "events": np.asarray(content).view(np.uint8)}
        message = bag.message(ros.PACKETS[0], header=bag.header(5, "c"), **fields)
        bag.write(topic, ros.PACKETS[0], 5, bag.serialized(message))


def test_mono(tmp_path):
    packet(tmp_path / "e", "mono", np.array([1 << 63 | 3 << 48 | 5 << 32 | 1_000_000], "<u8"))
    assert ros.read_bag(tmp_path / "e").tolist() == [(3001, 5, 3, 1)]  # 3000.5 us


def test_convert(pecs_program, tmp_path):
    pecs.write(tmp_path / "in.raw", STREAMS["bursts"], WIDTH, HEIGHT)
    for end in (".bag", ".mcap", "/"):
        out = f"{tmp_path}/out{end}"
        said = pecs_program("convert", tmp_path / "in.raw", out, "--topic", "/a", check=True).stdout
        assert said == f"{out}: {len(STREAMS['bursts'])} of {len(STREAMS['bursts'])} events, 1280x720 pixels, ROS bag\n"
        pecs_program("convert", out, tmp_path / "back.raw", "--topic", "/a", check=True)
        same(pecs.read(tmp_path / "back.raw"), STREAMS["bursts"])
        (tmp_path / "back.raw").unlink()
    words = ("--t-start", "1ms", "--rezero", "--format", "dvs_msgs")
    pecs_program("convert", tmp_path / "out.mcap", tmp_path / "part.mcap", *words, check=True)
    kept = STREAMS["bursts"][STREAMS["bursts"]["t"] >= 1000]
    found = ros.read_bag(tmp_path / "part.mcap")
    assert len(found) == len(kept) > 1000 and found["t"][0] == 0
    record = json.loads((tmp_path / "part.mcap.run.json").read_text())
    assert record["inputs"][0]["path"] == f"{tmp_path}/out.mcap" and record["inputs"][0]["sha256"]
    assert record["output"] == f"{tmp_path}/part.mcap" and record["config"]["rezero"]
    assert record["arguments"][1:3] == [f"{tmp_path}/out.mcap", f"{tmp_path}/part.mcap"]


def test_bags_that_are_wrong(pecs_program, tmp_path):
    def fails(code, wanted, *words):
        done = pecs_program("convert", *words, timeout=60)
        assert done.returncode == code and wanted in done.stderr and done.stderr.count("\n") == 1, done

    bag, out = tmp_path / "e.bag", tmp_path / "out.raw"
    ros.write_bag(bag, STREAMS["bursts"][:100], WIDTH, HEIGHT)
    fails(4, f"{bag}: topic: got /a, wanted /dvs/events", bag, out, "--topic", "/a")
    fails(2, "--topic: got no ROS bag, wanted one", out, tmp_path / "e.csv", "--topic", "/a")
    fails(2, "messages: got foo_msgs, wanted dvs_msgs or event_camera_msgs", bag, out, "--format", "foo_msgs")
    fails(2, "got the input itself", bag, bag)
    fails(3, "no.bag: cannot be opened", tmp_path / "no.bag", out)
    (tmp_path / "cut.bag").write_bytes(bag.read_bytes()[:5000])
    fails(4, "cut.bag: got ", tmp_path / "cut.bag", out)
    packet(tmp_path / "other", "libcaer", [0])
    fails(6, "topic /event_camera/events: got encoding libcaer, wanted evt3 or mono", tmp_path / "other", out)
    with ros.Bag(tmp_path / "two.bag", "ros1") as two:
        for topic in ("/l", "/r"):
            for t_ns, data in two.event_messages([STREAMS["bursts"][:9]], WIDTH, HEIGHT, "dvs_msgs", "c"):
                two.write(topic, ros.ARRAYS[0], t_ns, data)
    fails(4, "topics: got events on /l and /r, wanted --topic /l or another of them", tmp_path / "two.bag", out)
    with ros.Bag(tmp_path / "none.bag", "ros1") as none:
        none.write("/t", "std_msgs/msg/Header", 1, none.serialized(none.header(1, "c")))
    fails(4, "topics: got /t (std_msgs/Header), wanted one of dvs_msgs/EventArray", tmp_path / "none.bag", out)

    def one(name, kind, data, count=1):
        with ros.Bag(tmp_path / name, "ros1") as made:
            for i in range(count):
                made.write("/e", kind, i + 1, data(made, i))
        return tmp_path / name

    def array_of(made, change):  # 2 events, with bytes of their own
        (_, data), *_ = made.event_messages([STREAMS["bursts"][:2]], WIDTH, HEIGHT, "dvs_msgs", "c")
        return change(data)

    more = one("more.bag", ros.ARRAYS[0], lambda made, _: array_of(made, lambda data: data + b"\0"))
    fails(4, "topic /e: got 27 bytes of 2 events, wanted 26", more, out)
    late = one("late.bag", ros.ARRAYS[0], lambda made, _: array_of(made, lambda data: data[:-5] + b"\xff" * 5))
    fails(4, "topic /e: ts: got 4294967295 ns, wanted less than a second", late, out)

    def packet_of(**fields):
        content = {"height": 8, "width": 8, "seq": 0, "time_base": 0, "encoding": "evt3", "is_bigendian": False}
        content |= {"events": np.array([0x8000, 0x6001, 0x0001, 0x2001], "<u2").view(np.uint8), **fields}
        return lambda made, i: made.serialized(
            made.message(ros.PACKETS[0], header=made.header(1, "c"), **content | {"seq": 3 * i})
        )

    for fields, code, wanted in (
        ({"is_bigendian": True}, 6, "got evt3 with is_bigendian, wanted little-endian words"),
        ({"width": 4096}, 4, "size: got 4096x8, wanted at most 2048 pixels"),
        ({"encoding": "mono", "time_base": 1 << 63}, 4, "time_base: got 9223372036854775808, wanted a time in ns"),
    ):
        fails(code, f"topic /e: {wanted}", one("packet.bag", ros.PACKETS[0], packet_of(**fields)), out)
        (tmp_path / "packet.bag").unlink()
    gaps = one("gaps.bag", ros.PACKETS[0], packet_of(), 3)
    done = pecs_program("convert", gaps, tmp_path / "gaps.csv", check=True)
    assert done.stderr == f"pecs: warning: {gaps}: topic /e: 4 packets are missing (gaps in seq), and their events\n"
    with pytest.warns(UserWarning, match="4 packets are missing"):
        assert len(ros.read_bag(gaps)) == 3
    fails(2, 'topic: got "/a b", wanted a name of ROS', tmp_path / "gaps.csv", tmp_path / "e.mcap", "--topic", "/a b")
    info = pecs_program("info", bag)
    assert info.returncode == 4 and "got a ROS bag, wanted an event file (pecs convert IN OUT.raw)" in info.stderr
    (tmp_path / "folder").mkdir()
    pecs.write(tmp_path / "in.raw", STREAMS["bursts"][:9], WIDTH, HEIGHT)
    fails(5, "folder: exists", tmp_path / "in.raw", f"{tmp_path}/folder/")
    assert not out.exists()


def test_events_that_a_bag_cannot_contain(tmp_path):
    good = STREAMS["bursts"][:100]
    for field, value, wanted in (("t", -1, "times from 0 on"), ("x", 2000, "x and y on"), ("p", 2, "p of 0 or 1")):
        bad = good.copy()
        bad[field][50 if field != "t" else 0] = value
        with pytest.raises(pecs.PecsInputError, match=wanted):
            ros.write_bag(tmp_path / "e.bag", bad, WIDTH, HEIGHT)
    with pytest.raises(pecs.PecsInputError, match="4096x8, wanted 1 to 2048 pixels .dvs_msgs has no limit"):
        ros.write_bag(tmp_path / "e.mcap", good, 4096, 8)
    with pytest.raises(pecs.PecsInputError, match="size: got 0x0"):
        ros.write_bag(tmp_path / "e.bag", good)
    assert not list(tmp_path.iterdir())


def test_the_node_on_stand_ins(monkeypatch):
    """The example publishes the events of pecs.simulate; ROS itself is replaced."""

    class Node:
        def __init__(self, name):
            self.published = []

        def declare_parameter(self, name, value):
            return SimpleNamespace(value=value)

        def create_publisher(self, kind, topic, depth):
            return SimpleNamespace(publish=self.published.append)

        def create_subscription(self, *_):
            pass

        def get_logger(self):
            return SimpleNamespace(warning=lambda text: None)

    def header(t_ns=0):
        return SimpleNamespace(stamp=SimpleNamespace(sec=t_ns // 10**9, nanosec=t_ns % 10**9), frame_id="c")

    def event_packet(**fields):
        return SimpleNamespace(header=header(), events=array.array("B"), is_bigendian=False, **fields)

    parts = {"rclpy": {}, "rclpy.node": {"Node": Node}, "sensor_msgs.msg": {"Image": None}}
    parts |= {"event_camera_msgs.msg": {"EventPacket": event_packet}}
    for name, content in parts.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setitem(sys.modules, "sensor_msgs", ModuleType("sensor_msgs"))
    monkeypatch.setitem(sys.modules, "event_camera_msgs", ModuleType("event_camera_msgs"))
    node = runpy.run_path(ROOT / "scripts/tools/ros/event_camera_node.py")["EventCamera"]()
    x = np.arange(64)
    frames = [np.tile(128 + 100 * np.sin(0.2 * x - 0.1 * i), (48, 1)).astype(np.uint8) for i in range(20)]
    start_ns = 1_700_000_000 * 10**9
    for i, frame in enumerate(frames):
        fields = {"width": 64, "height": 48, "step": 192, "encoding": "rgb8", "header": header(start_ns + i * 10**6)}
        node.on_image(SimpleNamespace(**fields, data=np.repeat(frame, 3).tobytes()))
    found = []
    for message in node.published:
        message.events = np.array(message.events, np.uint8)
        found.append(ros._mono(None, "", message))
    found = np.concatenate(found)
    wanted = pecs.simulate(np.array(frames), 1000.0 * np.arange(20), chip="imx636", photocurrent_a=1e-12, seed=1)
    found["t"] -= start_ns // 1000
    assert 1000 < len(found) <= len(wanted)
    assert_same([found[name] for name in "txyp"], wanted[: len(found)])
