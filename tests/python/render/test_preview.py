"""pecs render-preview: colours through CIE 1931, judged against colour-science; exposure; false colour; video."""

import json
from pathlib import Path

import cv2
import numpy as np
import pecs
import pytest
from support.moving_scene import Scene, write_stack
from support.small_stacks import stack_json

WIDTH, HEIGHT = 24, 4  # a column per patch


def checker_stack(root, folder, bands=12, frames=1, lamp="d65", scene=None):
    """The 24 patches under a lamp, as spectral radiance."""
    spectra = root / "lens_data" / "spectra"
    read = lambda name: np.loadtxt(spectra / f"{name}.csv", delimiter=",", skiprows=2).T  # noqa: E731
    patches = [read(f"colorchecker/{p.stem}") for p in sorted((spectra / "colorchecker").glob("*.csv"))]
    light = read(lamp)
    chosen = pecs.bands(n=bands, illuminant=light.T)
    nm = [b["lambda_nm"] for b in chosen]
    rows = np.array([np.interp(nm, *patch) * np.interp(nm, *light) for patch in patches]).T
    values = np.repeat(rows[:, None, :], HEIGHT, axis=1)
    more = {"quantity": "radiance", "pixel_pitch_m": None, "bands": chosen, "scene": scene or {}}
    stack = stack_json(WIDTH, HEIGHT, [i * 1000 for i in range(frames)], **more)
    with pecs.StackWriter(folder, stack) as writer:
        for i in range(frames):
            writer.write_frame(i, values * (i + 1))
    return patches, light


@pytest.mark.parametrize("bands, most", [(12, 3.5), (31, 1.5)])
def test_colours_are_those_of_the_chart(root, pecs_program, tmp_path, bands, most):
    """CIE76 difference from the chart's colours under D65, from a 5 nm sum of colour-science's tables."""
    colour = pytest.importorskip("colour")
    patches, light = checker_stack(root, tmp_path / "s", bands)
    pecs_program("render-preview", tmp_path / "s", "-o", tmp_path / "x.png", "--json", check=True)
    seen = cv2.imread(str(tmp_path / "x.png"))[1, :, ::-1] / 255.0
    nm = np.arange(380.0, 781.0, 5)
    cmfs = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    xyz_bar = np.array([cmfs[x] for x in nm])
    xyz = np.array([(np.interp(nm, *p) * np.interp(nm, *light)) @ xyz_bar for p in patches])
    white = np.interp(nm, *light) @ xyz_bar
    linear = np.where(seen <= 0.04045, seen / 12.92, ((seen + 0.055) / 1.055) ** 2.4)
    seen_xyz = linear @ np.array(colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ).T
    scale = xyz[:, 1].sum() / seen_xyz[:, 1].sum()
    xy = colour.XYZ_to_xy(white)
    lab = colour.XYZ_to_Lab(xyz / white[1], xy)
    seen_lab = colour.XYZ_to_Lab(seen_xyz * scale / white[1], xy)
    inside = (seen > 0).all(axis=1) & (seen < 1).all(axis=1)  # cyan lies outside sRGB
    difference = np.linalg.norm(lab - seen_lab, axis=1)[inside]
    print(f"{bands} bands, CIE76: mean {difference.mean():.2f}, largest {difference.max():.2f}")
    assert inside.sum() >= 20 and difference.mean() < most


@pytest.mark.parametrize("lamp", ["d65", "led_b3", "a"])
def test_few_bands_have_the_charts_colours(root, pecs_program, tmp_path, lamp):
    """Three bands: patches have about the colours that 31 bands under D65 give, and greys are neutral."""

    def seen(folder, *options, **stack):
        checker_stack(root, folder, **stack)
        pecs_program("render-preview", folder, "-o", tmp_path / "x.png", *options, check=True)
        shown = cv2.imread(str(tmp_path / "x.png"))[1] / 255
        linear = np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)
        return linear / linear[white].mean()

    names = [p.stem for p in sorted((root / "lens_data/spectra/colorchecker").glob("*.csv"))]
    greys = [i for i, name in enumerate(names) if name.startswith(("white", "neutral", "black"))]
    white = names.index("neutral_6p5")
    assert len(greys) == 6
    truth = seen(tmp_path / "truth", bands=31)
    few = seen(tmp_path / "few", bands=3, lamp=lamp, scene={"parameters": {"lamp_spectrum": lamp}})
    assert np.array_equal(few, seen(tmp_path / "asked", "--illuminant", lamp, bands=3, lamp=lamp))
    assert np.abs(few[greys] - few[greys].mean(axis=1, keepdims=True)).max() < 0.2  # they are not quite flat
    print(f"{lamp}: mean difference {np.abs(few - truth).mean():.3f}, the grey is 1")
    if lamp == "a":  # two of its bands lie beyond 640 nm
        return
    for kind in ("red", "green", "blue", "yellow"):
        i = names.index(kind)
        assert np.argsort(few[i])[-1] == np.argsort(truth[i])[-1], kind
    assert np.abs(few - truth).mean() < 0.6


def test_exposure_is_in_stops(root, pecs_program, tmp_path):
    checker_stack(root, tmp_path / "s")
    scales = []
    for ev in (0, -2):
        args = ("-o", tmp_path / "x.png", "--exposure", ev, "--json")
        scales.append(json.loads(pecs_program("render-preview", tmp_path / "s", *args).stdout)["scale"])
    assert scales[0] / scales[1] == pytest.approx(4)


def test_a_band_in_false_colour(root, pecs_program, tmp_path):
    checker_stack(root, tmp_path / "s", bands=6)
    args = ("-o", tmp_path / "x.png", "--band", 650, "--json")
    result = json.loads(pecs_program("render-preview", tmp_path / "s", *args).stdout)
    assert abs(result["band_nm"] - 650) < 40
    assert cv2.imread(str(tmp_path / "x.png")).shape == (HEIGHT, WIDTH, 3)


CONFIG = """ocio_profile_version: 2
roles: {scene_linear: lin, default: lin}
displays:
  sRGB:
    - !<View> {name: Plain, colorspace: lin}
    - !<View> {name: Half, colorspace: half}
colorspaces:
  - !<ColorSpace> {name: lin}
  - !<ColorSpace>
    name: half
    from_scene_reference: !<MatrixTransform> {matrix: [0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 1]}
"""


def test_views_of_a_config(root, pecs_program, tmp_path):
    checker_stack(root, tmp_path / "s")
    (tmp_path / "config.ocio").write_text(CONFIG)
    shown = {}
    for view in ("Plain", "Half"):
        args = ("-o", tmp_path / "x.png", "--ocio", tmp_path / "config.ocio", "--view", view, "--exposure", -0.5)
        result = pecs_program("render-preview", tmp_path / "s", *args, check=True)
        shown[view] = cv2.imread(str(tmp_path / "x.png")).astype(int)
    assert shown["Plain"].max() > 150
    assert np.abs(shown["Plain"] - 2 * shown["Half"]).max() <= 2
    args = ("-o", tmp_path / "x.png", "--ocio", tmp_path / "config.ocio", "--view", "AgX")
    result = pecs_program("render-preview", tmp_path / "s", *args)
    assert result.returncode == 2 and "Plain, Half" in result.stderr and len(result.stderr.strip().splitlines()) == 1


def test_blenders_own_config(root, pecs_program, tmp_path):
    """Its Standard view is sRGB's curve; AgX is another picture."""
    bpy = Path(np.__file__).parents[1] / "bpy"
    config = next(bpy.glob("4.*/datafiles/colormanagement/config.ocio"), None)
    if not config:
        pytest.skip("needs bpy 4")
    checker_stack(root, tmp_path / "s")
    pictures = []
    for args in ((), ("--ocio", config, "--view", "Standard"), ("--ocio", config, "--view", "AgX")):
        pecs_program("render-preview", tmp_path / "s", "-o", tmp_path / "x.png", *args, check=True)
        pictures.append(cv2.imread(str(tmp_path / "x.png")).astype(int))
    plain, standard, agx = pictures
    assert np.abs(plain - standard).max() <= 2
    assert np.abs(plain - agx).mean() > 10


def test_subpixels_are_averaged(root, pecs_program, tmp_path):
    """The files of such a stack are larger than its picture; the picture is that of their means."""
    checker_stack(root, tmp_path / "plain")
    stack = json.loads((tmp_path / "plain/stack.json").read_text()) | {"subpixels": 2}
    with pecs.StackReader(tmp_path / "plain") as reader:
        frame = reader.read_frame(0)
    fine = np.repeat(np.repeat(frame, 2, 1), 2, 2) * np.tile([0.5, 1.5], WIDTH)  # a pixel's mean stays
    with pecs.StackWriter(tmp_path / "fine", stack) as writer:
        writer.write_frame(0, fine)
    pictures = []
    for folder in ("plain", "fine"):
        pecs_program("render-preview", tmp_path / folder, "-o", tmp_path / "x.png", check=True)
        pictures.append(cv2.imread(str(tmp_path / "x.png")).astype(int))
    assert pictures[0].shape == pictures[1].shape == (HEIGHT, WIDTH, 3)
    assert pictures[0].max() > 150 and np.abs(pictures[0] - pictures[1]).max() <= 1


def video_of(pecs_program, stack, *args):
    """Its pictures, [time, height, width]."""
    path = stack.with_suffix(".mp4")
    pecs_program("render-preview", stack, "-o", path, *args, check=True)
    video, pictures = cv2.VideoCapture(str(path)), []
    while (read := video.read())[0]:
        pictures.append(read[1].mean(axis=2))
    return np.array(pictures)


def test_video_has_every_frame(root, pecs_program, tmp_path):
    checker_stack(root, tmp_path / "s", frames=5)
    assert len(video_of(pecs_program, tmp_path / "s")) == 5


def test_video_of_keyframes_follows_the_motion(pecs_program, tmp_path):
    """Against the video of as many rendered frames; blended keyframes are far from it."""
    scene = Scene(96, 72, step=(8.0, 2.0), finest_px=12.0, radii=(22.0, 16.0), samples=8)
    times = np.linspace(0, 1, 9)
    ends = [scene.frame(0.0), scene.frame(1.0)]
    keys = write_stack(tmp_path / "keys", ends, [0, 8_000_000], [scene.motion()])
    blend = write_stack(tmp_path / "blend", ends, [0, 8_000_000])
    dense = write_stack(tmp_path / "dense", [scene.frame(t) for t in times], [round(t * 8e6) for t in times])
    truth = video_of(pecs_program, dense)
    found, blended = (video_of(pecs_program, stack, "--every", "1ms") for stack in (keys, blend))
    assert found.shape == blended.shape == truth.shape == (9, 72, 96)
    assert np.abs(found - truth)[4].mean() < 0.3 * np.abs(blended - truth)[4].mean()
    assert len(video_of(pecs_program, keys)) == 100


@pytest.mark.parametrize(
    "args, code",
    [(["-o", "x.gif"], 2), (["-o", "x.png", "--frame", "9"], 2), (["-o", "x.png", "--every", "1ms"], 2)],
)
def test_bad_input_is_one_line(root, pecs_program, tmp_path, args, code):
    checker_stack(root, tmp_path / "s")
    result = pecs_program("render-preview", tmp_path / "s", *args, cwd=tmp_path)
    assert result.returncode == code and len(result.stderr.strip().splitlines()) == 1
