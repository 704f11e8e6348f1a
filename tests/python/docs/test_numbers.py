"""Pages quote the studies: tables as the scripts print them from their JSON, and the numbers of README's table."""

import json

import pytest
from support import ROOT, load_script

STUDIES = ROOT / "scripts/studies"
PAGE = ROOT / "docs/studies/validation.md"
READMES_MEASURES = {
    "deviance": "deviance per event",
    "earth_mover_on_deg": "delays of ON events",
    "chamfer": "Chamfer distance",
}


@pytest.mark.parametrize("name", ["fitted_peers", "fitted_over_light"])
def test_validation_has_the_tables_of_the_studies(name):
    report = json.loads((STUDIES / f"{name}.json").read_text())
    tables, page = load_script(STUDIES / f"{name}.py").tables(report), PAGE.read_text()
    assert len(tables) > 1
    for table in tables:
        assert table in page, f"{PAGE.name} lacks this table of {name}.json:\n{table}"


def test_readme_quotes_the_studies():
    """Of each measure: of `pecs`, least and largest of the peers, the floor."""
    cell = load_script(STUDIES / "fitted_peers.py").cell
    scores = json.loads((STUDIES / "fitted_peers.json").read_text())["models"]
    light = json.loads((STUDIES / "fitted_over_light.json").read_text())
    halves = {name: row["second_half"] for name, row in scores.items()}
    measures = {key: {name: of[key] for name, of in halves.items()} for key in READMES_MEASURES}
    measures["delay_factor"] = {name: row["delay_factor"] for name, row in light.items()}
    lines = (ROOT / "README.md").read_text().splitlines()
    for key, words in (READMES_MEASURES | {"delay_factor": "first-event delays"}).items():
        (line,) = [line for line in lines if line.startswith("|") and words in line]
        of, peers = measures[key], [measures[key][m] for m in ("esim", "v2e", "voltmeter", "icns")]
        assert line.split("|")[2].strip() == cell(of["pecs"]), line
        assert line.split("|")[3].strip() == f"{cell(min(peers))} to {cell(max(peers))}", line
        assert "recording" not in of or f"floor {cell(of['recording'])}" in line, line
