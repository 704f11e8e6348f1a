"""The panel in other languages: each file has every text that Blender shows, and none that is gone."""

import ast
import json
import re

import pytest
from support import ROOT, in_bpy, panel_texts

pytest.importorskip("bpy")
pytest.importorskip("pecs")
EXTENSION = ROOT / "blender_addon/pecs_blender"
FILES = sorted((EXTENSION / "ui/languages").glob("*.json"))
FOUND = {
    name: {"median": 1.0, "p5": 1.0, "p95": 1.0} for name in ("lux", "luminance_cd_m2", "photocurrent_a", "corner_hz")
} | {"noise_thresholds": 0.1, "samples": 4, "events_per_s": 9.0}


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """Texts of the classes, of the sources, and of what the light's probe finds."""
    from pecs_blender.render.brightness import light_rows

    file = tmp_path_factory.mktemp("texts") / "texts.json"
    in_bpy("import sys\nfrom support import panel_texts\npanel_texts.main(sys.argv[1])", file)
    texts, faults = panel_texts.written(EXTENSION / "ui")
    assert not faults, faults
    asked = set()
    for found in (FOUND, FOUND | {"lux": None, "photocurrent_a": None}):
        light_rows(found, say=lambda text, **values: asked.add(text) or text.format(**values))
    return {*json.loads(file.read_text()), *texts, *asked}


def test_there_is_something_to_look_at(shown):
    assert FILES and len(shown) > 300
    for text in ("Render and simulate", "Simulate the events of the rendered stack", "What is sharp; 0: infinity"):
        assert text in shown  # a label, a tooltip, a property's
    assert {"{path}: no stack; render it first", "Adaptive", "luminance", "none"} <= shown


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_text_has_its_translation(shown, path):
    known = json.loads(path.read_text())
    in_a_text = lambda text: text[0] in ".;" or any(whole.startswith(f"{text}.") for whole in known)  # noqa: E731
    missing = [text for text in shown if text not in known and not in_a_text(text)]
    assert not missing, sorted(missing)
    sources = [path.read_text() for path in (*EXTENSION.glob("ui/*.py"), EXTENSION / "render/brightness.py")]
    words = {n.value for source in sources for n in ast.walk(ast.parse(source)) if isinstance(n, ast.Constant)}
    assert not (gone := set(known) - shown - words), gone
    names = lambda text: sorted(re.findall(r"{.*?}", text))  # noqa: E731
    wrong = [text for text, said in known.items() if names(text) != names(said) or not said.strip()]
    assert not wrong, wrong
    assert list(known) == sorted(known)
    same = [text for text, said in known.items() if text == said]
    assert len(same) < 20, same  # such as "Chip"
