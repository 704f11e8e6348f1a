"""EXR stacks through Python: round trip, resume, other software's reader, damage."""

import ctypes
import json

import numpy as np
import pecs
import pytest
from pecs import _library
from pecs.stack import StackReader, StackWriter
from support import small_stacks
from support.moving_scene import Scene, write_stack

BANDS = [{"lambda_nm": 486.25, "weight_nm": 120.0}, {"lambda_nm": 550.0, "weight_nm": 80.5}]


def stack_json(frames=3, width=20, height=17):
    times_ns = [i * 100_001 for i in range(frames)]
    return small_stacks.stack_json(width, height, times_ns, bands=BANDS, scene={"name": "test"}, render={"seed": 1})


def frame(seed=0, shape=(2, 17, 20)):
    return (np.random.default_rng(seed).random(shape) * 3e-7).astype(np.float32)


def test_round_trip_within_12_bits(tmp_path):
    values = frame()
    values[0, 0, :4] = [0, -1e-9, np.nan, np.inf]
    with StackWriter(tmp_path / "s", stack_json()) as stack:
        assert not stack.has_frame(0)
        stack.write_frame(0, values)
        assert stack.has_frame(0)
    back = StackReader(tmp_path / "s").read_frame(0)
    finite = np.isfinite(values)
    np.testing.assert_array_equal(np.isfinite(back), finite)
    np.testing.assert_allclose(back[finite], values[finite], rtol=2**-13)
    assert (back[finite] != values[finite]).any()


def test_pecs_info_of_a_stack(tmp_path, pecs_program):
    values = frame()
    with StackWriter(tmp_path, stack_json()) as stack:
        stack.write_frame(0, values)
        stack.write_frame(1, values)
    info = json.loads(pecs_program("info", tmp_path, "--json").stdout)
    assert (info["format"], info["width"], info["height"]) == ("exr-stack", 20, 17)
    assert (info["frames"], info["frames_planned"], info["t_last_us"]) == (2, 3, 100.001)
    assert [b["lambda_nm"] for b in info["bands"]] == [b["lambda_nm"] for b in BANDS]
    assert info["bands"][1]["first_frame"]["mean"] == pytest.approx(values[1].mean(), rel=1e-3)
    assert info["scene"] == {"name": "test"}
    assert "frames       2 of 3" in pecs_program("info", tmp_path).stdout
    failed = pecs_program("info", tmp_path / "none")
    assert failed.returncode == 3 and len(failed.stderr.splitlines()) == 1


def test_resume_only_if_stack_json_agrees(tmp_path):
    StackWriter(tmp_path, stack_json()).write_frame(0, frame())
    assert StackWriter(tmp_path, stack_json()).has_frame(0)
    other = stack_json() | {"render": {"seed": 2}}
    with pytest.raises(pecs.PecsError, match="render.seed") as e:
        StackWriter(tmp_path, other)
    assert e.value.code == 5


def test_a_damaged_frame_is_not_had(tmp_path):
    stack = StackWriter(tmp_path, stack_json())
    stack.write_frame(1, frame())
    path = tmp_path / "frame_000001.exr"
    path.write_bytes(path.read_bytes()[:-100])
    assert not stack.has_frame(1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"times_ns": [0, 5, 5]}, r"times_ns\[2\]: got 5, wanted more than 5"),
        ({"width": 1 << 20}, "width"),
        ({"bands": BANDS[::-1]}, "increasing wavelengths"),
        ({"colour": 1}, "colour: got an unknown key"),
        ({"period_ns": 100}, "period_ns"),
        ({"pixel_pitch_m": None}, "pixel_pitch_m"),
    ],
)
def test_bad_stack_json(tmp_path, change, message):
    with pytest.raises(pecs.PecsError, match=message):
        StackWriter(tmp_path, stack_json() | change)
    assert not (tmp_path / "stack.json").exists()


DEPTH = {"name": "depth", "files": "depth_%06d.exr", "channels": ["distance", "z"], "unit": "m", "at": "instant"}
FLOW = {"name": "flow", "files": "flow_%06d.exr", "channels": ["x", "y"], "unit": "px", "at": "interval"}


def test_layers_lie_beside_the_light(tmp_path, pecs_program):
    values = frame(1) * np.float32(1.2345678)
    values[0, 0, :3] = [np.inf, -np.inf, np.nan]
    with StackWriter(tmp_path, stack_json() | {"layers": [DEPTH, FLOW]}) as stack:
        stack.write_frame(0, frame())
        assert not stack.has_layer("depth", 0)
        stack.write_layer("depth", 0, values)
        stack.write_layer("flow", 1, values)
        assert stack.has_layer("depth", 0) and stack.has_layer("light", 0) and not stack.has_layer("depth", 1)
        assert stack.has_layer("flow", 1) and not stack.has_layer("flow", 2)
        with pytest.raises(pecs.PecsError, match="frame: got 2, wanted 0 to 1"):
            stack.write_layer("flow", 2, values)  # three instants have two intervals
        with pytest.raises(ValueError, match="depth: got shape"):
            stack.write_layer("depth", 0, values[:1])
        with pytest.raises(pecs.PecsError, match="layer: got normals, wanted one of light, depth, flow"):
            stack.has_layer("normals", 0)
    with StackReader(tmp_path) as reader:
        assert [layer["name"] for layer in reader.layers] == ["light", "depth", "flow"]
        assert reader.layers[0]["unit"] == "W.m^-2.nm^-1" and reader.layers[2]["at"] == "interval"
        np.testing.assert_array_equal(reader.read_layer("depth", 0), values)  # every bit
        np.testing.assert_array_equal(reader.read_layer("light", 0), reader.read_frame(0))
        with pytest.raises(pecs.PecsError, match=r"depth_000001.exr: cannot be opened: no such file") as e:
            reader.read_layer("depth", 1)
        assert e.value.code == 3
        (tmp_path / "depth_000001.exr").write_bytes((tmp_path / "depth_000000.exr").read_bytes())
        with pytest.raises(pecs.PecsError, match="pecsTimeNs: got 0, wanted 100001"):
            reader.read_layer("depth", 1)
        (tmp_path / "depth_000001.exr").write_bytes((tmp_path / "frame_000000.exr").read_bytes())
        with pytest.raises(pecs.PecsError, match="channels: got 2 others, wanted distance"):
            reader.read_layer("depth", 1)
        with pytest.raises(pecs.PecsError, match="wanted one of light, depth, flow"):
            reader.read_layer("normals", 0)
    assert "layer        depth: distance, z [m], per instant" in pecs_program("info", tmp_path).stdout


def test_a_periodic_stack_has_an_interval_more(tmp_path):
    stack = StackWriter(tmp_path, stack_json() | {"period_ns": 300_003, "layers": [FLOW]})
    stack.write_layer("flow", 2, frame())
    assert stack.has_layer("flow", 2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": "light"}, r"layers\[0\].name: got light, wanted one that no other layer has"),
        ({"name": "../x"}, "name"),
        ({"files": "/tmp/%06d.exr"}, "files"),
        ({"files": "frame_%06d.exr"}, "files"),
        ({"files": "depth.exr"}, "depth_%06d.exr"),
        ({"channels": []}, "channels"),
        ({"channels": ["a", "a"]}, "a twice"),
        ({"channels": [1]}, "channels"),
        ({"at": "frame"}, "at"),
        ({"colour": 1}, "colour"),
    ],
)
def test_bad_layers(tmp_path, change, message):
    with pytest.raises(pecs.PecsError, match=message):
        StackWriter(tmp_path, stack_json() | {"layers": [DEPTH | change]})
    assert not (tmp_path / "stack.json").exists()


def test_bad_folders(tmp_path):
    with pytest.raises(pecs.PecsError, match="no such folder") as e:
        StackReader(tmp_path / "none")
    assert e.value.code == 3
    with pytest.raises(pecs.PecsError, match="holds no EXR files"):
        StackReader(tmp_path)
    stack = StackWriter(tmp_path, stack_json())
    stack.write_frame(0, frame())
    stack.write_frame(2, frame())
    with pytest.raises(pecs.PecsError, match="frame_000001.exr missing") as e:
        StackReader(tmp_path)
    assert e.value.code == 4


def test_frame_that_is_not_of_the_stack(tmp_path):
    a = StackWriter(tmp_path / "a", stack_json())
    b = StackWriter(tmp_path / "b", stack_json(width=21))
    a.write_frame(0, frame())
    a.write_frame(1, frame())
    b.write_frame(0, frame(shape=(2, 17, 21)))
    (tmp_path / "a/frame_000001.exr").write_bytes((tmp_path / "a/frame_000000.exr").read_bytes())
    with pytest.raises(pecs.PecsError, match="pecsTimeNs: got 0, wanted 100001"):
        StackReader(tmp_path / "a").read_frame(1)
    (tmp_path / "a/frame_000001.exr").write_bytes((tmp_path / "b/frame_000000.exr").read_bytes())
    with pytest.raises(pecs.PecsError, match="got 21x17, wanted 20x17"):
        StackReader(tmp_path / "a").read_frame(1)
    (tmp_path / "a/stack.json").write_text(json.dumps(stack_json() | {"quantity": "radiance"}))
    with pytest.raises(pecs.PecsError, match=r"emissiveUnits: got W.m\^-2.nm\^-1, wanted W.m\^-2.sr"):
        StackReader(tmp_path / "a").read_frame(0)


def test_colour_science_reads_our_frames(tmp_path):
    pytest.importorskip("colour", reason="needs colour-science")
    pytest.importorskip("OpenImageIO")
    from colour.io import read_spectral_image_Fichet2021

    values = frame()
    StackWriter(tmp_path, stack_json()).write_frame(0, values)
    components = read_spectral_image_Fichet2021(tmp_path / "frame_000000.exr")
    wavelengths, image = components["S0"]
    np.testing.assert_allclose(wavelengths, [486.25, 550])
    np.testing.assert_allclose(np.moveaxis(image, -1, 0), values, rtol=2**-12)


def test_subpixels_are_averaged_for_the_sensor(tmp_path):
    fine = 1e-7 * (1 + frame(7, (3, 2, 34, 40)) / 3e-7)
    stack = stack_json() | {"subpixels": 2}
    with StackWriter(tmp_path / "fine", stack) as writer:
        for i, values in enumerate(fine):
            writer.write_frame(i, values)
    with pytest.raises(ValueError, match="wanted"):
        StackWriter(tmp_path / "fine", stack).write_frame(0, frame())
    coarse = fine.reshape(3, 2, 17, 2, 20, 2).mean((3, 5))
    with StackReader(tmp_path / "fine") as reader, pecs.Chip("imx636") as chip:
        assert reader.shape == (2, 34, 40)
        assert (reader.info["width"], reader.info["height"], reader.info["subpixels"]) == (20, 17, 2)
        np.testing.assert_allclose(reader.read_frame(1), fine[1], rtol=2**-12)
        seen_a = chip.photocurrent(reader, 1)
    with StackWriter(tmp_path / "coarse", stack_json()) as writer:
        for i, values in enumerate(coarse):
            writer.write_frame(i, values)
    with StackReader(tmp_path / "coarse") as reader, pecs.Chip("imx636") as chip:
        np.testing.assert_allclose(seen_a, chip.photocurrent(reader, 1), rtol=2**-11)
    with pytest.raises(pecs.PecsError, match="subpixels: got 3, wanted 1, 2 or 4"):
        StackWriter(tmp_path / "three", stack_json() | {"subpixels": 3})


def test_pictures_between_frames(tmp_path):
    part = frame(shape=(2, 17, 20))
    part[:, 5:] = np.nan
    with StackWriter(tmp_path / "s", stack_json() | {"between": True}) as stack:
        stack.write_between(1, 4, 150_000, part)
        assert stack.has_between(1, 4, 150_000)
        assert not stack.has_between(1, 4, 150_001) and not stack.has_between(0, 4, 50_000)
        stack.write_frame(0, frame())
        with StackReader(tmp_path / "s") as reader:
            assert reader.between_ns(0) == [] and reader.between_ns(1) == [150_000]
            np.testing.assert_allclose(reader.read_between(1, 0), part, rtol=2**-12)
            with pytest.raises(pecs.PecsError, match="between: got 1, wanted one of the interval's 1"):
                reader.read_between(1, 1)
        for interval, time_ns, message in (
            (1, 200_002, "got 200002 ns, wanted more than 100001 and less than 200002"),
            (2, 250_000, "interval: got 2, wanted 0 to 1"),
        ):
            with pytest.raises(pecs.PecsError, match=message):
                stack.write_between(interval, 0, time_ns, part)
    with StackWriter(tmp_path / "none", stack_json()) as stack:
        with pytest.raises(pecs.PecsError, match="between"):
            stack.write_between(1, 4, 150_000, part)


def test_noise_beside_the_light(tmp_path):
    oiio = pytest.importorskip("OpenImageIO")
    light, noise = frame(), np.random.default_rng(1).normal(0, 0.1, (1, 17, 20)).astype(np.float32)
    with StackWriter(tmp_path, stack_json() | {"between": True, "noise": True}) as stack:
        stack.write_frame(0, np.concatenate([light, noise]))
        stack.write_between(0, 1, 50_000, np.concatenate([2 * light, noise]))
        assert stack.has_frame(0) and stack.has_between(0, 1, 50_000)
        with pytest.raises(ValueError, match="wanted"):
            stack.write_frame(1, light)
        with pytest.raises(pecs.PecsError, match="got noise, wanted the light, whose last channel it is"):
            stack.write_layer("noise", 0, np.concatenate([light, noise]))
    with StackReader(tmp_path) as reader:
        assert [layer["name"] for layer in reader.layers] == ["light", "noise"]
        np.testing.assert_allclose(reader.read_frame(0), light, rtol=2**-12)
        np.testing.assert_allclose(reader.read_layer("noise", 0), noise, rtol=2**-5)
        np.testing.assert_allclose(reader.read_between(0, 0), 2 * light, rtol=2**-12)
    for name in ("frame_000000.exr", "between_000000_000001.exr"):
        file = oiio.ImageBuf(str(tmp_path / name))
        seen = file.get_pixels(oiio.FLOAT)[..., file.spec().channelnames.index("noise")]
        np.testing.assert_allclose(seen, noise[0], rtol=2**-5)


def test_the_times_of_pictures_between_need_an_array(tmp_path):
    scene = Scene(24, 16, samples=1)
    between = [(0, 0, 1_000, scene.frame(0.25)), (0, 1, 3_000, scene.frame(0.75))]
    motion = [scene.motion()]
    folder = write_stack(tmp_path / "s", [scene.frame(0), scene.frame(1)], [0, 4_000], motion, between=between)
    library = ctypes.CDLL(str(_library._find()))
    library.pecs_stack_reader_open.restype = ctypes.c_void_p
    library.pecs_stack_reader_open.argtypes = [ctypes.c_char_p, ctypes.c_double, ctypes.c_void_p]
    stack = ctypes.c_void_p(library.pecs_stack_reader_open(str(folder).encode(), 0, None))
    times_of = _library.function(
        "pecs_stack_reader_between", ctypes.c_int64, ctypes.c_void_p, ctypes.c_int64, ctypes.c_void_p, ctypes.c_int64
    )
    with pytest.raises(pecs.PecsInputError, match="times_ns: got NULL"):
        times_of(stack, 0, None, 8)
    times = (ctypes.c_int64 * 2)()
    assert times_of(stack, 0, None, 0) == 2 == times_of(stack, 0, times, 2) and list(times) == [1_000, 3_000]
    library.pecs_stack_reader_close(stack)
