"""The panel in other languages: Blender's language chooses the file, and a text that it lacks stays English."""

import json
import re

import pytest
from support import ROOT, in_bpy

FILES = sorted((ROOT / "blender_addon/pecs_blender/ui/languages").glob("*.json"))

BLENDER = """
import bpy
from pecs_blender import ui
from pecs_blender.ui.interface import say

ui.register()
assert say("{path}: rendered", path="a.stack") == "a.stack: rendered"
bpy.context.preferences.view.language = "de_DE"
assert say("{path}: rendered", path="a.stack") == "a.stack: gerendert"
assert say("{count} new texts", count=3) == "3 new texts"
assert bpy.app.translations.pgettext_iface("Light scale") == "Lichtfaktor"
ui.unregister()
"""


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_translations_keep_the_names_in_braces(path):
    def names(text):
        return sorted(re.findall(r"{.*?}", text))

    texts = json.loads(path.read_text())
    assert texts
    assert not [text for text, translated in texts.items() if names(text) != names(translated) or not translated]


def test_the_panel_speaks_the_language_of_blender():
    pytest.importorskip("bpy")
    pytest.importorskip("pecs")
    in_bpy(BLENDER)
