"""Frames whose content, not their container, says when and where they are: times, numbers, windows, rotation."""

import json
import struct
import zlib

import cv2
import numpy as np
import pecs
import pytest
from support.small_stacks import write, write_exr

W, H, N = 64, 48, 20
IDEAL = ["--chip", "ideal"]


def light(i):
    frame = np.tile(np.linspace(0.06, 0.2, W, dtype=np.float32), (H, 1))
    frame[H // 4 : 3 * H // 4, 8 + i : 16 + i] = 0.8
    return frame


FRAMES = np.stack([light(i) for i in range(N)])


def simulated(program, folder, output, *args):
    done = program("sense", folder, "-o", output, *IDEAL, *args)
    assert done.returncode == 0, done.stderr
    return pecs.read(output)


def refused(program, folder, words, *args):
    done = program("sense", folder, "-o", folder.parent / "n.npz", *IDEAL, *args)
    assert done.returncode == 4 and words in done.stderr and len(done.stderr.splitlines()) == 1, done.stderr


def assert_same(a, b):
    for name in "txyp":
        np.testing.assert_array_equal(a[name], b[name])
    assert len(a) > 100


# --- video ------------------------------------------------------------------------------------------------------------


def boxes(data, begin, end):
    """Type, begin and end of the boxes of an MP4 file."""
    while begin < end:
        size, kind = struct.unpack(">I4s", data[begin : begin + 8])
        yield kind, begin, begin + size
        begin += size


def with_table(path, name, change):
    """Replaces a table of an MP4 file, whose index is at its end, by change(its bytes without the header)."""
    data, begin, end, parents = path.read_bytes(), 0, path.stat().st_size, []
    for part in (b"moov", b"trak", b"mdia", b"minf", b"stbl", name):
        begin, end = next((b, e) for kind, b, e in boxes(data, begin, end) if kind == part)
        parents.append(begin)
        begin += 8
    table = change(data[begin:end])
    out = bytearray(data[:begin] + table + data[end:])
    for at in parents:
        size = struct.unpack(">I", out[at : at + 4])[0] + len(table) - (end - begin)
        out[at : at + 4] = struct.pack(">I", size)
    path.write_bytes(out)


def with_durations(path, durations):
    """Gives the frames of an MP4 file these durations in ticks (ISO 14496-12, stts)."""
    runs = b"".join(struct.pack(">II", 1, d) for d in durations)
    with_table(path, b"stts", lambda _: struct.pack(">II", 0, len(durations)) + runs)


def with_colour(path, curve=1, matrix=9, full_range=False):
    """States a transfer curve and a matrix of ITU-T H.273, and a range (ISO 14496-12, colr)."""
    describe(path, struct.pack(">I4s4sHHHB", 19, b"colr", b"nclx", 9, curve, matrix, full_range << 7))


def describe(path, box):
    """Adds a box to the description of the samples (stsd)."""

    def change(table):
        (size,) = struct.unpack(">I", table[8:12])
        return table[:8] + struct.pack(">I", size + len(box)) + table[12 : 8 + size] + box + table[8 + size :]

    with_table(path, b"stsd", change)


GREY = [np.dstack([np.round(255 * np.sqrt(frame)).astype(np.uint8)] * 3) for frame in FRAMES]


def encode(path, frames=GREY):
    video = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter_fourcc(*"mp4v"), 100, (W, H))
    if not video.isOpened():
        pytest.skip("needs an MPEG-4 encoder")
    for frame in frames:
        video.write(frame)
    video.release()


def test_video_of_high_dynamic_range(tmp_path, pecs_program):
    """As phones record it: its values are not sRGB."""
    for curve, name in ((1, None), (16, "PQ"), (18, "HLG")):
        path = tmp_path / f"{curve}.mp4"
        encode(path)
        with_colour(path, curve)
        if name:
            refused(pecs_program, path, f"{curve}.mp4: transfer curve: got {name} (high dynamic range), wanted BT.709")
        simulated(pecs_program, path, tmp_path / "o.npz", "--no-flow", *(("--colorspace", "srgb") if name else ()))


def luma_and_differences(red, blue):
    """Y'PbPr of B'G'R' (ITU-R BT.601 and BT.709)."""
    y = np.array([blue, 1 - red - blue, red])
    return np.stack([y, (np.eye(3)[0] - y) / (2 - 2 * blue), (np.eye(3)[2] - y) / (2 - 2 * red)])


def test_video_of_another_matrix_or_range(tmp_path, pecs_program):
    """OpenCV decodes all video by BT.601, and YUV that is not named yuvj as limited range: green of BT.709 had 1.37
    times its light, grey 32 of full range was 17."""
    bt601, bt709 = luma_and_differences(0.299, 0.114), luma_and_differences(0.2126, 0.0722)
    colour, light = np.array([32, 192, 32]), []
    for name, shown in ("601", colour), ("709", np.linalg.inv(bt601) @ bt709 @ colour):
        encode(tmp_path / f"{name}.mp4", [np.full((H, W, 3), np.round(shown).astype(np.uint8))] * 3)
        if name == "709":
            with_colour(tmp_path / "709.mp4", matrix=1)
        simulated(pecs_program, tmp_path / f"{name}.mp4", tmp_path / "o.npz", "--no-flow")
        record = json.loads((tmp_path / "o.npz.run.json").read_text())
        light.append(record["results"]["photocurrent_a"]["median"])
    assert light[1] == pytest.approx(light[0], rel=0.03)
    with_colour(tmp_path / "601.mp4", full_range=True)
    refused(pecs_program, tmp_path / "601.mp4", "601.mp4: range: got full range, which OpenCV reads as limited range")


def test_interlaced_video_is_a_warning(tmp_path, pecs_program):
    encode(tmp_path / "v.mp4")
    describe(tmp_path / "v.mp4", struct.pack(">I4sBB", 10, b"fiel", 2, 1))
    done = pecs_program("sense", tmp_path / "v.mp4", "-o", tmp_path / "o.npz", *IDEAL, "--no-flow", check=True)
    assert "v.mp4: interlaced, so that the rows of a frame are of two times" in done.stderr


def test_variable_frame_rate(tmp_path, pecs_program):
    path = tmp_path / "v.mp4"
    encode(path)
    constant = simulated(pecs_program, path, tmp_path / "c.npz", "--no-flow")
    assert json.loads((tmp_path / "c.npz.run.json").read_text())["config"]["input"] == "video"
    capture = cv2.VideoCapture(str(path))
    frames = np.stack([capture.read()[1][..., ::-1] for _ in range(N)])
    with_durations(path, [64] * (N // 2) + [192] * (N // 2))  # ticks of 1/12800 s: 5 ms, then 15 ms
    events = simulated(pecs_program, path, tmp_path / "o.npz", "--no-flow")
    assert "variable" in json.loads((tmp_path / "o.npz.run.json").read_text())["config"]["input"]
    times = 5e3 * np.concatenate([np.arange(N // 2), N // 2 + 3 * np.arange(N // 2)])
    grey = pecs.simulate(frames[..., 1], times, "ideal", photocurrent_a=1e-12)
    assert abs(len(events) - len(grey)) < 0.02 * len(grey)
    early = [np.count_nonzero(e["t"] < times[N // 2]) / len(e) for e in (events, grey, constant)]
    assert early[0] == pytest.approx(early[1], abs=0.02) and early[2] < early[1] - 0.1
    assert_same(simulated(pecs_program, path, tmp_path / "o.npz", "--fps", 100, "--no-flow"), constant)


def test_a_video_with_b_frames(tmp_path, pecs_program):
    """H.264 as most encoders write it, PECS too."""
    write(tmp_path / "s", frames=N)
    path = tmp_path / "v.mp4"
    assert pecs_program("render-preview", tmp_path / "s", "-o", path, "--fps", 100).returncode == 0
    if b"ctts" not in path.read_bytes():
        pytest.skip("needs an encoder of B frames")
    simulated(pecs_program, path, tmp_path / "c.npz")
    found = json.loads((tmp_path / "c.npz.run.json").read_text())
    assert (found["config"]["input"], found["results"]["frames"]) == ("video", N)
    assert_same(pecs.read(tmp_path / "c.npz"), simulated(pecs_program, path, tmp_path / "o.npz", "--fps", 100))
    data, durations = path.read_bytes(), [128] * (N // 2) + [112] * (N // 2)
    at = data.index(b"ctts") + 8
    (number,) = struct.unpack(">I", data[at : at + 4])
    runs = np.frombuffer(data, ">u4", 2 * number, at + 4).reshape(-1, 2)
    ticks = np.sort(np.concatenate([[0], np.cumsum(durations)[:-1]]) + np.repeat(runs[:, 1], runs[:, 0]))
    with_durations(path, durations)
    variable = simulated(pecs_program, path, tmp_path / "v.npz", "--no-flow")
    np.savetxt(tmp_path / "times.txt", (ticks - ticks[0]) * 1e6 / 12800, "%.3f")
    assert_same(
        variable, simulated(pecs_program, path, tmp_path / "w.npz", "--times", tmp_path / "times.txt", "--no-flow")
    )
    found = json.loads((tmp_path / "v.npz.run.json").read_text())
    assert (found["config"]["input"], found["results"]["frames"]) == ("video of variable frame rate", N)


# --- pictures ---------------------------------------------------------------------------------------------------------


def write_pictures(folder, names):
    folder.mkdir()
    for i, name in enumerate(names):
        cv2.imwrite(str(folder / name), FRAMES[i])
    return folder


def test_pictures_turned_by_exif(tmp_path, pecs_program):
    image = pytest.importorskip("PIL.Image")
    exif = image.Exif()
    exif[0x0112] = 6  # the top of the picture is at its right
    plain, turned = tmp_path / "a", tmp_path / "b"
    for folder, turn, how in ((plain, -1, None), (turned, 0, exif)):
        folder.mkdir()
        for i, frame in enumerate(FRAMES):
            picture = np.ascontiguousarray(np.rot90(np.round(255 * frame).astype(np.uint8), turn))
            image.fromarray(picture).save(folder / f"{i}.jpg", quality=100, **({"exif": how} if how else {}))
    a = simulated(pecs_program, plain, tmp_path / "a.npz", "--fps", 1000)
    b = simulated(pecs_program, turned, tmp_path / "b.npz", "--fps", 1000)
    assert (b.width, b.height) == (H, W) == (a.width, a.height)
    assert len(b) == pytest.approx(len(a), rel=0.05) and len(a) > 1000
    assert np.median(b["x"]) == pytest.approx(np.median(a["x"]), abs=1)


def test_gaps_in_the_numbers(tmp_path, pecs_program):
    every = write_pictures(tmp_path / "a", [f"frame_{2 * i:06}.tif" for i in range(N)])  # every other one is no gap
    wanted = simulated(pecs_program, every, tmp_path / "o.npz", "--fps", 1000)
    (every / "frame_000014.tif").unlink()
    words = "frame_000016.tif: got number 16 after 12, wanted steps of 2"
    refused(pecs_program, every, words, "--fps", 1000)
    (tmp_path / "t.txt").write_text("".join(f"{1000 * i}\n" for i in range(N) if i != 7))
    part = simulated(pecs_program, every, tmp_path / "p.npz", "--times", tmp_path / "t.txt")
    assert part["t"].max() == pytest.approx(wanted["t"].max(), abs=1000)
    signed = write_pictures(tmp_path / "c", [f"f_{i - N:05}.tif" for i in range(N)])
    assert_same(simulated(pecs_program, signed, tmp_path / "o.npz", "--fps", 1000), wanted)  # not in reverse
    masks = write_pictures(tmp_path / "b", [f"{i // 2:04}{'_mask' * (i % 2)}.tif" for i in range(N)])
    refused(pecs_program, masks, "got number 1 after 0", "--fps", 1000)
    seconds = write_pictures(tmp_path / "d", [f"t_{i / 8}.tif" for i in range(N)])  # in the order of 0.5, 0.25
    refused(pecs_program, seconds, "t_0.25.tif: got 0.25 after 0.5, wanted names", "--fps", 1000)
    clock = [f"12.{t // 600}.{t // 10 % 60:02}.{t % 10}00.tif" for t in range(1195, 1195 + N)]  # 59.900 before 00.000
    for names in ([f"take1.{i}.tif" for i in range(N)], clock):
        folder = write_pictures(tmp_path / names[-1], names)
        assert_same(simulated(pecs_program, folder, tmp_path / "o.npz", "--fps", 1000), wanted)


def test_hidden_files_are_left_out(tmp_path, pecs_program):
    folder = write_pictures(tmp_path / "a", [f"{i}.tif" for i in range(N)])
    wanted = simulated(pecs_program, folder, tmp_path / "o.npz", "--fps", 1000)
    for i in range(N):
        (folder / f"._{i}.tif").write_bytes(b"\0\5\x16\7")
    assert_same(simulated(pecs_program, folder, tmp_path / "o.npz", "--fps", 1000), wanted)


def test_pictures_of_any_size_are_simulated(tmp_path, pecs_program):
    """Also with the motion between them, which DIS estimates from 8 x 12 pixels on."""
    image = pytest.importorskip("PIL.Image")
    for i, (width, height) in enumerate(((1, 30), (30, 1), (16, 2), (30, 7), (8, 11), (8, 12), (12, 8), (13, 13))):
        folder = tmp_path / str(i)
        folder.mkdir()
        for k, frame in enumerate(FRAMES[:4]):
            part = np.round(255 * np.sqrt(frame[12 : 12 + height, 8 : 8 + width])).astype(np.uint8)
            image.fromarray(part).save(folder / f"{k}.png")
        done = pecs_program("sense", folder, "-o", tmp_path / "o.npz", "--fps", 100, *IDEAL)
        assert done.returncode == 0 and f"{width}x{height}" in done.stdout, done.stderr


@pytest.mark.parametrize("end", ["png", "tif", "jpg", "bmp"])
def test_the_resolution_states_the_shape_of_pixels(tmp_path, pecs_program, end):
    image = pytest.importorskip("PIL.Image")
    for name, dpi in (("tall", (200, 100)), ("square", (300, 300)), ("none", None)):
        (tmp_path / name).mkdir()
        for i, frame in enumerate(FRAMES[:6]):
            more = {"dpi": dpi} if dpi else {}
            picture = image.fromarray(np.dstack([np.round(255 * np.sqrt(frame)).astype(np.uint8)] * 3))
            picture.save(tmp_path / name / f"{i}.{end}", **more)
    refused(pecs_program, tmp_path / "tall", f"0.{end}: pixel aspect: got 0.5, wanted 1", "--fps", 100)
    none = simulated(pecs_program, tmp_path / "none", tmp_path / "o.npz", "--fps", 1000)
    assert_same(simulated(pecs_program, tmp_path / "square", tmp_path / "o.npz", "--fps", 1000), none)


@pytest.mark.parametrize("kind", ["RGBA png", "LA png", "P png", "L png", "RGBA tif", "RGBA webp"])
def test_transparent_pictures_have_no_light(tmp_path, pecs_program, kind):
    """Colours under transparent pixels are whatever the program that wrote them left there. Opaque alpha is none."""
    image = pytest.importorskip("PIL.Image")
    mode, end = kind.split()
    for name in ("opaque", "clear"):
        (tmp_path / name).mkdir()
        for i, frame in enumerate(FRAMES[:6]):
            grey, more = np.round(255 * np.sqrt(frame)).astype(np.uint8), {"lossless": True} if end == "webp" else {}
            opacity = np.full_like(grey, 255)
            opacity[:5] = 255 if name == "opaque" else 100
            picture = image.fromarray(grey)
            if mode in ("P", "L"):
                picture = picture.convert(mode)
                more = {"transparency": picture.getpixel((0, 0))} if name == "clear" else {}
            else:
                picture = picture.convert(mode)
                picture.putalpha(image.fromarray(opacity))
            picture.save(tmp_path / name / f"{i}.{end}", **more)
    refused(pecs_program, tmp_path / "clear", f"0.{end}: alpha: got ", "--fps", 100)
    simulated(pecs_program, tmp_path / "opaque", tmp_path / "o.npz", "--fps", 1000)


def srgb_of(values):
    return np.where(values <= 0.0031308, 12.92 * values, 1.055 * values ** (1 / 2.4) - 0.055)


@pytest.mark.parametrize("white", [100, 1023, 4095, 65535])
def test_the_greatest_value_of_a_pgm_is_white(tmp_path, pecs_program, white):
    """Cameras of 10 and 12 bits write it. Taken as 16 bits, their light was linear and 1/16 as bright."""
    kind = np.dtype(">u2" if white > 255 else "u1")
    for i, frame in enumerate(FRAMES):
        header = f"P5 # {i}\n#\n{W} {H}\n{white}\n".encode()
        (tmp_path / f"{i}.pgm").write_bytes(header + np.round(white * srgb_of(frame)).astype(kind).tobytes())
    found = simulated(pecs_program, tmp_path, tmp_path / "o.npz", "--fps", 1000, "--no-flow")
    wanted = pecs.simulate(FRAMES, 1000 * np.arange(N), "ideal")
    assert len(found) == pytest.approx(len(wanted), rel=0.05) and len(wanted) > 1000


def test_values_that_are_not_known_are_refused(tmp_path, pecs_program):
    """Integers that are neither of 8 nor of 16 bits were linear light of up to 2^31; pages behind the first one, a
    file's own gamma and its inversion had no effect."""
    image, cv2 = pytest.importorskip("PIL.Image"), pytest.importorskip("cv2")
    deep = np.round(65535 * srgb_of(FRAMES[0])).astype(np.uint16)
    for name in ("signed", "long", "pages", "animated", "inverse", "linear", "pq"):
        (tmp_path / name).mkdir()
    cv2.imwrite(str(tmp_path / "signed/0.tif"), (deep // 2).astype(np.int16))
    cv2.imwrite(str(tmp_path / "long/0.tif"), deep.astype(np.int32))
    pages = [image.fromarray(deep) for _ in range(3)]
    pages[0].save(tmp_path / "pages/0.tif", save_all=True, append_images=pages[1:])
    pages[0].save(tmp_path / "animated/0.png", save_all=True, append_images=[image.fromarray(deep // 2)])
    pages[0].save(tmp_path / "inverse/0.tif", tiffinfo={262: 0})
    png = cv2.imencode(".png", deep)[1].tobytes()
    for name, chunk in ("linear", b"gAMA" + struct.pack(">I", 100_000)), ("pq", b"cICP" + bytes((9, 16, 0, 1))):
        chunk = struct.pack(">I", 4) + chunk + struct.pack(">I", zlib.crc32(chunk))
        (tmp_path / name / "0.png").write_bytes(png[:33] + chunk + png[33:])
    for name, words in {
        "signed": "0.tif: values: got CV_16S, wanted unsigned integers of 8 or 16 bits, or floating point",
        "long": "0.tif: values: got CV_32S, wanted",
        "pages": "0.tif: got several pictures, wanted one",
        "animated": "0.png: got several pictures, wanted one",
        "inverse": "0.tif: photometric: got white is 0, wanted black is 0",
        "linear": "0.png: transfer curve: got gamma 1, wanted 2.2, or --colorspace",
        "pq": "0.png: transfer curve: got PQ (high dynamic range), wanted BT.709",
    }.items():
        refused(pecs_program, tmp_path / name, words, "--fps", 1000)
    refused(pecs_program, tmp_path / "linear", "frames: got 1", "--fps", 1000, "--colorspace", "linear")


def icc(kind):
    """A profile with a curve of green, or the tag that replaces one."""
    curve = {
        "linear": b"curv" + struct.pack(">4xI", 0),
        "1.8": b"curv" + struct.pack(">4xIH", 1, round(1.8 * 256)),
        "table": b"curv" + struct.pack(">4xI1024H", 1024, *np.linspace(0, 65535, 1024).astype(int)),
        "hlg": b"cicp" + bytes((0, 0, 0, 0, 9, 18, 0, 1)),
        "p3": b"XYZ " + struct.pack(">4x3i", *(round(65536 * v) for v in (0.5151, 0.2412, -0.0011))),
        "red": b"XYZ " + struct.pack(">4x3i", *(round(65536 * v) for v in (0.4361, 0.2225, 0.0139))),
        "srgb": b"para"
        + struct.pack(">4xH2x5i", 3, *(round(65536 * v) for v in (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045))),
    }[kind] + np.random.default_rng(1).bytes(2000)  # libpng warns of streams that are very short
    tag = {"hlg": b"cicp", "p3": b"rXYZ", "red": b"rXYZ"}.get(kind, b"gTRC")
    head = (144 + len(curve), b"mntr", b"RGB ", b"XYZ ", b"acsp", 63190, 65536, 54061, 1, tag, 144, len(curve))
    return struct.pack(">I8x4s4s4s12x4s28x3i48xI4sII", *head) + curve


@pytest.mark.parametrize("end", ["png", "tif", "jpg", "webp"])
def test_the_curve_of_a_profile(tmp_path, pecs_program, end):
    """Raw developers write linear pictures of integers, which were decoded as sRGB."""
    image = pytest.importorskip("PIL.Image")
    refusals = {"linear": "gamma 1", "1.8": "gamma 1.8", "table": "gamma 1", "hlg": "HLG"}
    refusals = {kind: f"transfer curve: got {got}" for kind, got in refusals.items()}
    for kind, words in (refusals | {"p3": "primaries: got others", "red": "", "srgb": ""}).items():
        (tmp_path / kind).mkdir()
        picture = image.fromarray(np.repeat(np.round(255 * srgb_of(FRAMES[0])).astype(np.uint8)[..., None], 3, 2))
        picture.save(tmp_path / f"{kind}/0.{end}", icc_profile=icc(kind))
        words = f"0.{end}: {words}" if words else "frames: got 1, wanted"
        refused(pecs_program, tmp_path / kind, words, "--fps", 1000)
    if end == "tif":  # floating point is linear
        for kind, words in {
            "linear": "frames: got 1",
            "srgb": "0.tif: transfer curve: got gamma 2.22, wanted 1",
        }.items():
            (tmp_path / f"{kind}_float").mkdir()
            image.fromarray(FRAMES[0]).save(tmp_path / f"{kind}_float/0.tif", icc_profile=icc(kind))
            refused(pecs_program, tmp_path / f"{kind}_float", words, "--fps", 1000)
    turned = image.Exif()
    turned[274] = 6
    (tmp_path / "turned").mkdir()
    picture.save(tmp_path / f"turned/0.{end}", exif=turned)
    words = "0.webp: Exif: got an orientation, wanted WebP" if end == "webp" else "frames: got 1, wanted"
    refused(pecs_program, tmp_path / "turned", words, "--fps", 1000)


# --- OpenEXR ----------------------------------------------------------------------------------------------------------


def exr_folder(folder, windows, frames=FRAMES, **attributes):
    """windows(i): left, top, right, bottom of the data window; frames beyond the picture are 9."""
    folder.mkdir()
    for i, frame in enumerate(frames):
        left, top, right, bottom = windows(i)
        wide = np.pad(frame, 8, constant_values=9)[top + 8 : bottom + 8, left + 8 : right + 8]
        write_exr(folder / f"{i:03}.exr", {c: wide for c in "RGB"}, corner=(left, top), full=(W, H), **attributes)
    return folder


def test_the_display_window_is_the_frame(tmp_path, pecs_program):
    plain = simulated(
        pecs_program, exr_folder(tmp_path / "a", lambda i: (0, 0, W, H)), tmp_path / "a.npz", "--fps", 100
    )
    overscan = exr_folder(tmp_path / "b", lambda i: (-4, -3, W + 5, H + 6))
    assert_same(simulated(pecs_program, overscan, tmp_path / "b.npz", "--fps", 100), plain)

    def region(i):  # of a compositor that crops to what moves, of changing size
        return (8 + i - 4, H // 4 - i % 3, 8 + i + 12 + i % 4, 3 * H // 4)

    black = np.zeros_like(FRAMES)
    for i, frame in enumerate(FRAMES):
        left, top, right, bottom = region(i)
        black[i, top:bottom, left:right] = frame[top:bottom, left:right]
    cropped = exr_folder(tmp_path / "c", region)
    full = exr_folder(tmp_path / "d", lambda i: (0, 0, W, H), black)
    moved = simulated(pecs_program, cropped, tmp_path / "c.npz", "--fps", 100)
    assert_same(moved, simulated(pecs_program, full, tmp_path / "d.npz", "--fps", 100))
    assert (moved.width, moved.height) == (W, H)


def test_windows_that_cannot_be_one_camera(tmp_path, pecs_program):
    crop = exr_folder(tmp_path / "a", lambda i: (4 + (i == 7), 2, 44 + (i == 7), 32), samplesPerPixel=16)  # pbrt's
    refused(pecs_program, crop, "007.exr: window: got (5, 2), wanted (4, 2)", "--fps", 100)
    stretched = exr_folder(tmp_path / "b", lambda i: (0, 0, W, H), PixelAspectRatio=2.0)
    refused(pecs_program, stretched, "pixelAspectRatio: got 2, wanted 1", "--fps", 100)


@pytest.mark.parametrize(
    ("channels", "attributes", "said"),
    [
        (
            "RGB",
            {"chromaticities": (1, 0, 0, 1, 0, 0, 1 / 3, 1 / 3)},
            "chromaticities: got a primary at (1, 0), wanted",
        ),
        ("RGB", {"chromaticities": (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)}, ""),
        (["R", "G", "B", "T.500,0nm"], {}, "channels: got a reflectance, T.500,0nm, wanted light"),
        (["S0.500,0nm", "T.500,0nm"], {"emissiveUnits": "W.m^-2.sr^-1"}, ""),
        (["S0.500,0nm"], {"emissiveUnits": "cd.m^-2"}, "emissiveUnits: got cd.m^-2, wanted W.m^-2.sr^-1.nm^-1"),
    ],
)
def test_what_exr_channels_mean(tmp_path, pecs_program, channels, attributes, said):
    for i, frame in enumerate(FRAMES):
        write_exr(tmp_path / f"{i:03}.exr", dict.fromkeys(channels, frame), **attributes)
    words = ["--fps", 100, *([] if "R" in channels else ["--gain", 1e-15])]
    if said:
        refused(pecs_program, tmp_path, said, *words)
    else:
        simulated(pecs_program, tmp_path, tmp_path / "o.npz", *words)


def test_every_exr_file_has_the_unit_of_the_first(tmp_path, pecs_program):
    for i, frame in enumerate(FRAMES):
        blue = {"chromaticities": (1, 0, 0, 1, 0, 0, 1 / 3, 1 / 3)} if i == 5 else {}
        write_exr(tmp_path / f"{i:03}.exr", dict.fromkeys("RGB", frame), **blue)
    refused(pecs_program, tmp_path, "005.exr: chromaticities: got a primary at (1, 0)", "--fps", 100)


def test_two_parts_of_light_are_refused(tmp_path, pecs_program):
    """The two eyes of a stereo render: the first part counted, whichever it was."""
    oiio = pytest.importorskip("OpenImageIO")
    for name, channels in (("eyes", "RGB"), ("depth", "Z")):
        (tmp_path / name).mkdir()
        for i, frame in enumerate(FRAMES):
            specs = [oiio.ImageSpec(W, H, len(part), "float") for part in ("RGB", channels)]
            for spec, part in zip(specs, ("RGB", channels), strict=True):
                spec.channelnames = list(part)
                spec.attribute("oiio:subimagename", "left" if spec is specs[0] else "right")
            out = oiio.ImageOutput.create(str(tmp_path / name / f"{i:03}.exr"))
            assert out.open(str(tmp_path / name / f"{i:03}.exr"), specs)
            for k, spec in enumerate(specs):
                assert k == 0 or out.open(str(tmp_path / name / f"{i:03}.exr"), spec, "AppendSubimage")
                assert out.write_image(np.repeat(frame[..., None], spec.nchannels, axis=-1))
            assert out.close()
    refused(pecs_program, tmp_path / "eyes", "parts: got light in part 0 and in part 1, wanted one", "--fps", 100)
    simulated(pecs_program, tmp_path / "depth", tmp_path / "o.npz", "--fps", 100)


def test_lossy_exr_files_are_named(tmp_path, pecs_program):
    cases = {
        "dwaa": ("float", 1, "compression with loss"),
        "half": ("half", 1e-6, "a step of a half"),
        "zip": ("half", 1, ""),
    }
    for name, (kind, level, words) in cases.items():
        (tmp_path / name).mkdir()
        for i, frame in enumerate(FRAMES):
            packed = {"compression": "dwaa" if name == "dwaa" else "zip"}
            write_exr(tmp_path / name / f"{i:03}.exr", dict.fromkeys("RGB", frame * level), kind, **packed)
        done = pecs_program("sense", tmp_path / name, "-o", tmp_path / "o.npz", "--fps", 100, *IDEAL)
        assert done.returncode == 0 and ("warning" in done.stderr) == bool(words) and words in done.stderr, done.stderr


# --- numbers of a window ----------------------------------------------------------------------------------------------


def test_counts_are_those_of_the_output_s_window(tmp_path):
    """The readout and the region of interest also lose events before the window."""
    stack = write(tmp_path / "s", level=1e-3)
    slow = {"readout_rate_hz": 2e5, "readout_row_s": 1e-5}
    options = {"chip": "imx636", "overrides": slow, "roi": [(0, 0, 20, 30)], "seed": 3}

    def counted(**window):
        results = pecs.sense(stack, tmp_path / "o.npz", **options, **window)["results"]
        return np.array([results["dropped"], results["dropped_by_stage"]["roi"]])

    whole, first, second = counted(), counted(duration_us=9000), counted(start_us=9000)
    assert (first > 0).all() and (second > 0).all()
    np.testing.assert_array_equal(first + second, whole)


def test_light_of_another_unit(tmp_path, pecs_program):
    refused(pecs_program, write(tmp_path / "s", level=1e32), "wanted less than 1 A: the unit of the light")


def test_a_time_in_another_unit_does_not_poison_what_follows():
    frame = np.full((4, 5), 0.5, np.float32)
    good = pecs.simulate(np.stack([frame * 2**i for i in range(4)]), 1e3 * np.arange(4), "ideal")
    with pecs.Sensor(5, 4, "ideal") as sensor:
        out = [sensor.push(frame * 2**i, 1e3 * i) for i in range(3)]
        for far in (1.2e9, 3e9):
            with pytest.raises(pecs.PecsInputError, match="at most 1000000000 us after the frame before"):
                sensor.push(frame, far)
        out += [sensor.push(frame * 8, 3e3), sensor.finish()]
    assert_same(np.concatenate(out), good)
