"""Glasses and apertures of Zemax files: another program's placeholders are no data."""

import pecs
import pytest

FILE = """MODE SEQ
NAME plano-convex
{aperture}
UNIT MM X W X CM MR CPMM
GCAT {catalogs}
SURF 0
  TYPE STANDARD
  CURV 0.0
  DISZ INFINITY
SURF 1
  STOP
  TYPE STANDARD
  CURV 0.04
  DISZ 5
  GLAS {glass}
  DIAM 8
SURF 2
  TYPE STANDARD
  CURV 0.0
  DISZ 40
  DIAM 8
SURF 3
  TYPE STANDARD
  CURV 0.0
  DISZ 0
"""


def write(folder, glass, catalogs="SCHOTT", aperture="FLOA"):
    path = folder / "lens.zmx"
    path.write_text(FILE.format(glass=glass, catalogs=catalogs, aperture=aperture))
    return path


def info(path):
    found = pecs.Lens(path).info()
    return found["efl_mm"], found["notes"]


# n_d of the manufacturers' data sheets; a plano-convex lens has the focal length 1 / ((n - 1) c).
@pytest.mark.parametrize(
    ("glass", "catalogs", "nd", "note"),
    [
        ("N-SK4", "SCHOTT", 1.61272, None),
        ("S-LAH64", "OHARA", 1.78800, None),
        ("L-BAL35", "OHARA", 1.58913, None),
        ("TAFD30", "HOYA", 1.88300, None),
        ("S-LAH64", "SCHOTT", 1.78800, "line 10: glass S-LAH64 read as S-LAH64 of ohara"),
        ("BK7", "SCHOTT", 1.51680, "line 10: glass BK7 read as N-BK7 of SCHOTT"),
        ("L-TIM28_MOLD", "OHARA", 1.68948, "line 10: glass L-TIM28_MOLD read as L-TIM28 of OHARA"),
    ],
)
def test_glass_by_name(tmp_path, glass, catalogs, nd, note):
    for numbers in ("0 0 1.5 4.0E+1 0 0 0 0 0 0", "0 0 1.5 40", ""):
        efl, notes = info(write(tmp_path, f"{glass} {numbers}", catalogs))
        assert efl == pytest.approx(25 / (nd - 1), rel=2e-5)
        assert notes == ([note] if note else [])


@pytest.mark.parametrize("numbers", ["0 0 1.5 4.0E+1 0 0 0", "2 3 1.62 36.4", "0 0 0 0", ""])
def test_unknown_glass(tmp_path, numbers):
    with pytest.raises(pecs.PecsInputError, match='unknown glass "B270"') as error:
        pecs.Lens(write(tmp_path, "B270 " + numbers))
    assert ("placeholder" in str(error.value)) == ("4.0E+1" in numbers)


def test_numbers_of_a_model_glass_are_data(tmp_path):
    assert info(write(tmp_path, "___BLANK 1 0 1.5 40")) == (pytest.approx(50, rel=1e-5), [])
    efl, notes = info(write(tmp_path, "B270 0 0 1.5230 58.5"))
    assert efl == pytest.approx(47.80, abs=0.005) and "unknown glass B270 replaced by nd 1.523" in notes[0]


@pytest.mark.parametrize(("aperture", "diameter_mm"), [("ENPD 10", 10), ("FNUM 4 0", 25 / 0.5168 / 4), ("FLOA", 16)])
def test_the_system_s_aperture_opens_the_stop(tmp_path, pecs_program, aperture, diameter_mm):
    path = write(tmp_path, "N-BK7 0 0 1.5 40", aperture=aperture)
    lens = pecs.Lens(path)
    assert lens.info()["entrance_pupil_diameter_mm"] == pytest.approx(diameter_mm, rel=1e-4)
    assert bool(info(path)[1]) == (aperture != "FLOA")
    pecs_program("lens", "convert", path, "-o", tmp_path / "lens.json", check=True)
    there = pecs.Lens(tmp_path / "lens.json").info()
    assert there | {"file": None, "sha256": None} == lens.info() | {"file": None, "sha256": None}
