# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel in other languages. LOCALE.json (Blender's name of the language, such as de_DE) has each English text and
its translation; {names} stay as they are. What the programs say, and names of lenses, chips and formats, stays English.
"""

import json
from pathlib import Path

import bpy

from ..interface import CONTEXT

CONTEXTS = ("*", "Operator", CONTEXT)  # where Blender looks for labels and tooltips, for buttons, and for ours


def texts(path: Path) -> dict[str, str]:
    return json.loads(path.read_text(encoding="utf-8"))


def register() -> None:
    found = {path.stem: texts(path) for path in Path(__file__).parent.glob("*.json")}
    by_context = {
        locale: {(context, text): said for text, said in of.items() for context in CONTEXTS}
        for locale, of in found.items()
    }
    bpy.app.translations.register(__name__, by_context)


def unregister() -> None:
    bpy.app.translations.unregister(__name__)
