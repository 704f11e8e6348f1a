"""Translations of the panel: a text keeps its {names}, else drawing it fails in that language."""

import json
import re

import pytest
from support import ROOT

FILES = sorted((ROOT / "blender_addon/pecs_blender/ui/languages").glob("*.json"))


def names(text):
    return sorted(re.findall(r"{.*?}", text))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_translations_keep_the_names_in_braces(path):
    texts = json.loads(path.read_text())
    assert texts
    assert not [text for text, translated in texts.items() if names(text) != names(translated) or not translated]
