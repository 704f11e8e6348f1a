# SPDX-License-Identifier: GPL-3.0-or-later
"""Translations of the panel. LOCALE.json (Blender's name of the language, such as de_DE) maps English texts to
translations, which keep the {names}; a missing text stays English. Messages of the programs, and names of lenses, chips
and formats, are not translated."""

import json
from pathlib import Path

import bpy

from ..interface import CONTEXT

CONTEXTS = ("*", "Operator", CONTEXT)  # of labels and tooltips, of buttons, of interface.say


def texts(path: Path) -> dict[str, str]:
    return json.loads(path.read_text(encoding="utf-8"))


def register() -> None:
    found = {path.stem: texts(path) for path in Path(__file__).parent.glob("*.json")}
    by_context = {
        locale: {(context, text): translation for text, translation in table.items() for context in CONTEXTS}
        for locale, table in found.items()
    }
    bpy.app.translations.register(__name__, by_context)


def unregister() -> None:
    bpy.app.translations.unregister(__name__)
