"""Pages quote the studies: tables as the scripts print them from their JSON, and numbers of README and of the first
words of Validation."""

import json
import re

import pytest
from pecs_lab.over_light import nist_fa
from pecs_lab.report import cell
from support import ROOT, load_script

STUDIES, PAGES = ROOT / "scripts/studies", ROOT / "docs/studies"
TABLES = {
    "fitted_peers": "validation",
    "fitted_programs": "validation",
    "fitted_folds": "validation",
    "fitted_over_light": "validation",
    "fitted_blind_spots": "blind_spots",
}
READMES_MEASURES = {
    "deviance": "deviance per event",
    "earth_mover_on_deg": "delays of ON events",
    "chamfer": "Chamfer distance",
}
COMPARISONS = {
    "deviance": "deviance per event",
    "chamfer": "Chamfer distance",
    "earth_mover_on_deg": "ON delays, degrees",
    "rate_rms": "rate over time, RMS / mean",
}
PEERS = ("esim", "v2e", "voltmeter", "icns")


def result(name):
    return json.loads((STUDIES / f"{name}.json").read_text())


def measured():
    """Of each measure: its values by model."""
    halves = {name: row["second_half"] for name, row in result("fitted_peers")["models"].items()}
    found = {key: {name: of[key] for name, of in halves.items()} for key in READMES_MEASURES}
    return found | {"delay_factor": {name: row["delay_factor"] for name, row in result("fitted_over_light").items()}}


@pytest.mark.parametrize(("name", "page"), TABLES.items())
def test_pages_have_the_tables_of_the_studies(name, page):
    text = (PAGES / f"{page}.md").read_text()
    tables = load_script(STUDIES / f"{name}.py").tables(result(name))
    assert tables
    for table in tables:
        assert table in text, f"{page}.md lacks this table of {name}.json:\n{table}"


def test_readme_quotes_the_studies():
    """Of each measure: of `pecs`, least and largest of the peers, the floor."""
    lines = (ROOT / "README.md").read_text().splitlines()
    for key, words in (READMES_MEASURES | {"delay_factor": "first-event delays"}).items():
        (line,) = [line for line in lines if line.startswith("|") and words in line]
        of = measured()[key]
        peers = [of[m] for m in PEERS]
        assert line.split("|")[2].strip() == cell(of["pecs"]), line
        assert line.split("|")[3].strip() == f"{cell(min(peers))} to {cell(max(peers))}", line
        assert "recording" not in of or f"floor {cell(of['recording'])}" in line, line
    low, high = nist_fa()[[0, -1]] / result("fitted_over_light")["pecs"]["white_fa"]
    assert f"{low:.0f} to {float(f'{high:.2g}'):,.0f} times as bright" in line


def test_comparison_quotes_the_studies():
    lines = (ROOT / "docs/concepts/comparison.md").read_text().splitlines()
    models = result("fitted_peers")["models"]
    for key, title in COMPARISONS.items():
        (line,) = [line for line in lines if line.startswith(f"| {title} |")]
        values = [cell(models[m]["second_half"][key]) for m in ("recording", "pecs", *PEERS)]
        assert line == f"| {title} | {' | '.join(values)} |"


def test_validation_begins_with_the_result():
    """In its first paragraph: `pecs`, the nearest peer and the floor."""
    first = re.search(r"^# Validation\n\n(.+?)\n\n", (PAGES / "validation.md").read_text(), re.DOTALL)[1]
    for key in ("deviance", "chamfer"):
        of = measured()[key]
        numbers = [of["pecs"], min(of[m] for m in PEERS), of["recording"]]
        assert all(cell(n) in first for n in numbers), (key, numbers)
    light, words = result("fitted_over_light"), " ".join(first.split())
    assert f"factor of {cell(light['pecs']['delay_factor'])}" in words
    assert f"{100 * (1 - min(light['pecs']['delay_ratio']['off'])):.0f} % short" in words
