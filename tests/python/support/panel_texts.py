"""Every text of the panel that Blender shows: `written` reads the sources, main(FILE) in bpy asks the classes."""

import ast
import json
import re
from pathlib import Path

# Names of data, of a keymap, in Python and in a shader, and parts of what programs say: nobody reads them in the panel.
NAMES = {
    "PECS preview",
    "Property Editor",
    "Image",
    "ModelViewProjectionMatrix",
    "Sequence[float]",
    "render: into (.*)",
    "exists and differs",
}
SENTENCE = r"[A-Z][a-z]|.*[a-z},:;] [a-z{]"
WORDS, UNITS = r"[a-z]{2,}[,:;]? |[,:;]? [a-z]{2,}", r"\b(mm|ms)\b"


def written(folder):
    """(texts, faults) of the sources. faults: f-strings that hold words, which nobody can translate."""
    texts, faults = set(), []
    for path in sorted(folder.glob("*.py")):
        tree = ast.parse(path.read_text())
        skipped = {id(node.body[0].value) for node in ast.walk(tree) if _is_documented(node)}
        for node in ast.walk(tree):
            if isinstance(node, ast.JoinedStr):
                parts = [part for part in node.values if isinstance(part, ast.Constant)]
                skipped |= set(map(id, parts))
                faults += [
                    f"{path.name}:{node.lineno}: {p.value!r}"
                    for p in parts
                    if re.search(WORDS, re.sub(UNITS, "", p.value))
                ]
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "say":
                texts |= {c.value for c in _chosen(node.args[0]) if isinstance(c, ast.Constant)}
        constants = (n.value for n in ast.walk(tree) if isinstance(n, ast.Constant) and id(n) not in skipped)
        texts |= {text for text in constants if isinstance(text, str) and _is_sentence(text)}
    return texts - NAMES, faults


def _is_documented(node):
    kinds = ast.Module | ast.ClassDef | ast.FunctionDef
    return (
        isinstance(node, kinds) and isinstance(node.body[0], ast.Expr) and isinstance(node.body[0].value, ast.Constant)
    )


def _chosen(node):
    return [node.body, node.orelse] if isinstance(node, ast.IfExp) else [node]


def _is_sentence(text):
    return bool(re.match(SENTENCE, text)) and "\n" not in text and not text.startswith(("-", "("))


def main(file):
    import bpy
    from pecs_blender import ui
    from pecs_blender.ui import panel_spectra

    ui.register()
    texts = set()
    for module in ui._MODULES:
        for cls in getattr(module, "CLASSES", ()):
            of = cls.bl_rna
            if issubclass(cls, bpy.types.Operator):
                of = getattr(bpy.ops.pecs, cls.bl_idname.removeprefix("pecs.")).get_rna_type()
                texts |= {of.name, of.description}
            texts |= {getattr(cls, "bl_label", "")}
            shown = (of.properties[name] for name in getattr(cls, "__annotations__", ()))
            texts |= {text for prop in shown if prop.name != prop.identifier for text in _of(prop)}
    for holder, keys in panel_spectra._HOLDERS.items():
        for key in keys:
            texts |= _of(holder.bl_rna.properties[panel_spectra.field(key)])
    ui.unregister()
    Path(file).write_text(json.dumps(sorted(text for text in texts if re.search("[a-z]", text))))


def _of(prop):
    items = {text for item in getattr(prop, "enum_items_static", ()) for text in (item.name, item.description)}
    return {prop.name, prop.description, *items} - {"Unique name used in the code and scripting"}  # Blender's own
