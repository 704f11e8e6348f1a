"""Facts that stand in more than one place, compared with their source."""

import re

import pytest
from support import ROOT

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def text(name):
    return (ROOT / name).read_text()


def cells(line):
    return [cell.strip().strip("`") for cell in line.strip("|").split("|")]


def table(page, first_cell):
    """Rows of the table whose first row begins so: name -> cell by column."""
    lines = text(page).splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("|") and cells(line)[0] == first_cell)
    head, rows = cells(lines[start]), {}
    for line in lines[start + 2 :]:
        if not line.startswith("|"):
            break
        rows[cells(line)[0]] = dict(zip(head, cells(line), strict=True))
    return rows


@pytest.mark.parametrize(
    ("short", "long"),
    [
        ("deviance per event", "deviance per event"),
        ("Chamfer distance", "Chamfer (shared normalisation)"),
        ("ON delays, degrees", "delays, ON, earth mover's distance, °"),
    ],
)
def test_the_comparison_has_the_numbers_of_the_validation(short, long):
    validation = table("docs/studies/validation.md", "")[long]
    validation = {name: value.split(" (")[0] for name, value in validation.items()}
    validation["floor"] = validation["recording"]
    rows = text("docs/concepts/comparison.md").split("## Numbers")[1]
    head = next(cells(line) for line in rows.splitlines() if line.startswith("|"))
    row = next(cells(line) for line in rows.splitlines() if line.startswith(f"| {short} "))
    assert row[1:] == [validation[name] for name in head[1:]]


def test_the_readme_has_the_numbers_of_the_validation():
    """PECS: noise in continuous time (Limits); the nearest other and the floor: the tables."""
    rows = list(table("README.md", "question").values())
    limits = " ".join(text("docs/studies/validation.md").split("## Limits")[1].split("\n## ")[0].split())
    now = re.search(
        r"`pecs` a deviance of ([\d.]+), .* delays of ([\d.]+)° \(ON\).* a delay factor of ([\d.]+),", limits
    )
    assert [row["PECS"] for row in rows[:3]] == list(now.groups())
    fitted = table("docs/studies/validation.md", "")
    for row, measure in zip(rows, ("deviance per event", "delays, ON, earth mover's distance, °"), strict=False):
        scores = {name: cell.split(" (")[0] for name, cell in fitted[measure].items() if " (" in cell}
        others = {name: float(scores[name]) for name in ("esim", "v2e", "voltmeter", "icns")}
        nearest = min(others, key=others.get)
        value, name = re.fullmatch(r"([\d.]+) \((\w+)\)", row["nearest other"]).groups()
        assert (float(value), name.lower()) == (others[nearest], nearest)
        assert row["recording against itself"] == scores["recording"]
    factors = re.findall(
        r"^\| (\w+) \| ON \|(?:[^|]*\|){5} ([\d.]+) \| [^|]+\|$", text("docs/studies/validation.md"), re.MULTILINE
    )
    others = {name: float(value) for name, value in factors if name in ("v2e", "voltmeter", "icns", "esim")}
    nearest = min(others, key=others.get)
    assert rows[2]["nearest other"] == f"{others[nearest]:.1f} ({nearest.upper()})"
    seen = table("docs/studies/validation.md", "simulation")
    area = {name: seen[name]["area"].split(" (")[0] for name in ("pecs", "esim", "v2e", "voltmeter", "icns")}
    nearest = min(area.keys() - {"pecs"}, key=lambda name: float(area[name]))
    floor = seen["pecs"]["recording against itself"].split(" (")[0]
    shown = [rows[3][key] for key in ("PECS", "nearest other", "recording against itself")]
    assert shown == [area["pecs"], f"{area[nearest]} ({nearest})", floor]


def test_scenes_chips_and_formats_are_listed():
    scenes = {path.parent.name for path in (ROOT / "scenes").glob("*/scene.json")}
    assert set(re.findall(r"^\|? ?.*?`(\w+)`: ", text("scenes/README.md"), re.MULTILINE)) <= scenes
    for scene in scenes:
        assert f"`{scene}`: " in text("scenes/README.md") and f"]({scene}/picture.png)" in text("scenes/README.md")
        assert f"/{scene}/README.md" in text("docs/gallery.md"), scene
    for chip in (ROOT / "sensor/chips").glob("*.json"):
        assert chip.stem in text("docs/reference/chips.md") + text("docs/reference/sensor.md"), chip.stem
    reads = {name: row for name, row in table("docs/reference/event_file.md", "name").items()}
    assert reads["aedat2"]["read"] == "yes" and reads["aedat2"]["written"] == "no"
    assert "AEDAT 2.0 is read only" in text("docs/reference/limitations.md")
