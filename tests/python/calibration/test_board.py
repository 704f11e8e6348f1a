"""pecs board: what is printed is what OpenCV finds, in millimetres."""

import re

import cv2
import numpy as np
import pytest

PX_PER_MM = 8


def drawn(pecs_program, tmp_path, *args):
    """The picture at 8 pixels a millimetre, and the page's size in mm."""
    svg, png = tmp_path / "x.svg", tmp_path / "x.png"
    assert pecs_program("board", *args, "-o", svg).returncode == 0
    size = tuple(float(v) for v in re.search(r'width="([\d.]+)mm" height="([\d.]+)mm"', svg.read_text()).groups())
    pecs_program("board", *args, "-o", png, "--width", round(size[0] * PX_PER_MM), check=True)
    return cv2.imread(str(png), cv2.IMREAD_GRAYSCALE), size


def test_a_checkerboard(pecs_program, tmp_path):
    picture, _ = drawn(pecs_program, tmp_path, "--squares", "9x6", "--square", 25)
    found, corners = cv2.findChessboardCornersSB(picture, (8, 5))
    assert found
    grid = corners.reshape(5, 8, 2) / PX_PER_MM
    np.testing.assert_allclose(np.abs(np.diff(grid, axis=1)), np.broadcast_to((25, 0), (5, 7, 2)), atol=0.05)
    np.testing.assert_allclose(np.abs(np.diff(grid, axis=0)), np.broadcast_to((0, 25), (4, 8, 2)), atol=0.05)


@pytest.mark.parametrize("asymmetric", [False, True])
def test_circles(pecs_program, tmp_path, asymmetric):
    words = ["--asymmetric"] if asymmetric else []
    picture, _ = drawn(pecs_program, tmp_path, "--circles", "4x7", "--spacing", 20, *words)
    flag = cv2.CALIB_CB_ASYMMETRIC_GRID if asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
    found, centres = cv2.findCirclesGrid(picture, (4, 7), flags=flag)
    assert found
    rows = centres.reshape(7, 4, 2) / PX_PER_MM
    np.testing.assert_allclose(np.abs(np.diff(rows, axis=1)).max(axis=2), 20, atol=0.05)
    between = np.linalg.norm(rows[1:] - rows[:-1], axis=2)
    assert between == pytest.approx(10 * np.sqrt(2) if asymmetric else 20, abs=0.05)


def test_a_disk(pecs_program, tmp_path):
    picture, size = drawn(pecs_program, tmp_path, "--disk", 120, "--sectors", 8)
    centre = 65 * PX_PER_MM
    angles = np.radians(np.arange(0, 360, 45) + 22.5)  # counter-clockwise, the first is black
    x, y = (centre + 50 * PX_PER_MM * f for f in (np.cos(angles), -np.sin(angles)))
    assert [picture[round(b), round(a)] < 128 for a, b in zip(x, y, strict=True)] == [True, False] * 4
    assert size[0] == 130


def test_a_page_has_its_size(pecs_program, tmp_path):
    pdf = tmp_path / "x.pdf"
    assert pecs_program("board", "--squares", "9x6", "--square", 20, "-o", pdf).returncode == 0
    box = re.search(rb"/MediaBox \[ *0 0 ([\d.]+) ([\d.]+)", pdf.read_bytes())
    assert float(box[1]) == pytest.approx(220 / 25.4 * 72, abs=0.1)


@pytest.mark.parametrize(
    "args", [["--squares", "9"], ["--squares", "9x6", "--disk", "3"], [], ["--disk", "100", "--sectors", "3"]]
)
def test_wrong_uses(pecs_program, tmp_path, args):
    assert pecs_program("board", *args, "-o", tmp_path / "x.svg").returncode == 2
