"""Widths of the panel's texts, in bpy and without a window: `cut` lists those that Blender would cut at WIDTH_PX. Sizes
are those of Blender's widgets (interface_intern.hh, UI_UNIT_X) at a resolution scale of 1."""

from types import SimpleNamespace

import blf
import bpy
from pecs_blender.ui import interface

REGION_PX = 252  # of the panels in a window of 1600 px, whose Properties editor is 282 px wide
WIDTH_PX = REGION_PX - 20 - 14  # less a panel's margins and the scroll bar
GAP_PX = 8  # between the columns of a split
POINTS, ICON_PX, PADDING_PX, BOX_PX, SPLIT = 11, 20, 8, 10, 0.4


class Item:
    """A text with an icon or not; without a text it is a square button."""

    def __init__(self, text, icon="NONE", padding_px=PADDING_PX):
        blf.size(0, POINTS)
        self.text, self.is_icon = text, not text
        self.needs_px = blf.dimensions(0, text)[0] + (ICON_PX if icon != "NONE" else 0) + (padding_px if text else 0)

    def cut(self, width_px):
        return [(self.text, round(self.needs_px), round(width_px))] if self.text and self.needs_px > width_px else []


class Layout:
    """A bpy.types.UILayout that keeps what is drawn into it. kind: "column", "row", "split" or "box"."""

    def __init__(self, kind="column", factor=0.0, split=False):
        self.kind, self.factor, self.items, self.is_icon = kind, factor, [], False
        self.use_property_split = split

    def _add(self, item):
        self.items.append(item)
        return item

    def _child(self, kind, factor=0.0):
        return self._add(Layout(kind, factor, self.use_property_split))

    def row(self, **_):
        return self._child("row")

    def column(self, **_):
        return self._child("column")

    def box(self):
        return self._child("box")

    def split(self, factor=0.0, **_):
        return self._child("split", factor)

    def separator(self, **_):
        pass

    def label(self, text="", icon="NONE", **_):
        self._add(Item(text, icon, 4))

    def operator(self, name, text=None, icon="NONE", **_):
        module, _dot, verb = name.partition(".")
        title = getattr(getattr(bpy.ops, module), verb).get_rna_type().name
        self._add(Item(title if text is None else text, icon))
        return SimpleNamespace()

    def menu(self, name, text=None, icon="NONE", **_):
        self._add(Item(text or getattr(bpy.types, name).bl_label, icon, PADDING_PX + 12))  # an arrow

    def progress(self, factor, text):
        self._add(Item(text))

    def prop(self, owner, name, text=None, **_):
        one = owner.bl_rna.properties[name]
        title = one.name if text is None else text
        if one.type == "ENUM" and one.is_enum_flag:
            for item in one.enum_items:
                self._add(Item(item.name))
            return
        if one.type == "BOOLEAN":
            value = [Item(title, "CHECKBOX")]
        elif one.type == "ENUM":
            value = [Item(i.name, padding_px=PADDING_PX + 12) for i in one.enum_items]
        else:
            value = []
        if not self.use_property_split:
            self.items += value or [Item(title, padding_px=60)]  # the name in the field, next to its number
            return
        split = self._child("split", SPLIT)
        split.items = [Item("" if one.type == "BOOLEAN" else title, padding_px=4), Layout("column")]
        split.items[1].items = value

    def cut(self, width_px):
        """Texts that need more than they have: (text, needed px, available px)."""
        if self.kind == "box":
            width_px -= BOX_PX
        if self.kind == "split" and self.factor and len(self.items) > 1:
            first, rest = self.items[0], self.items[1:]
            width_px -= GAP_PX
            share = (1 - self.factor) * width_px / len(rest)
            return first.cut(self.factor * width_px) + [c for one in rest for c in one.cut(share)]
        if self.kind in ("row", "split"):
            wide = [one for one in self.items if not one.is_icon]
            share = (width_px - ICON_PX * (len(self.items) - len(wide))) / max(len(wide), 1)
            return [c for one in wide for c in one.cut(share)]
        return [c for one in self.items for c in one.cut(width_px)]


def cut(panels, context):
    """Texts of panels that are cut: {panel: [(text, needed px, available px), …]}."""
    narrow = SimpleNamespace(
        region=SimpleNamespace(width=REGION_PX),
        preferences=context.preferences,
        window_manager=context.window_manager,
    )
    interface.bpy = SimpleNamespace(context=narrow)
    found = {}
    for cls in panels:
        layout = Layout()
        fake = SimpleNamespace(layout=layout)
        fake.fill = lambda *words, cls=cls, fake=fake: cls.fill(fake, *words)
        cls.draw(fake, context)
        if texts := layout.cut(WIDTH_PX):
            found[cls.__name__] = texts
    return found
