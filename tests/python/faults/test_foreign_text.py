"""Text of foreign files in pages, tables and paths: each target has one function, in pecs._text."""

import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser

import pytest
from pecs._config import Fields
from pecs._errors import PecsInputError
from pecs._text import is_file_name, is_plain, markdown
from pecs.datasets import Sequence, card, manifest, recipe, report
from support import ROOT

EVIL = "<script>alert(1)</script>\"'`&[x](y)"


@pytest.mark.parametrize("control", ["\0", "\n", "\r", "\x1b", "\x7f", "\x85", "\u2028", "\u2029", "\ud800"])
def test_control_characters_are_refused_in_all_text(control):
    assert not is_plain(f"a{control}b") and not is_file_name(f"a{control}b")
    for read, value in (("text", f"a{control}b"), ("texts", [f"a{control}b"]), ("file_name", f"a{control}b")):
        with pytest.raises(PecsInputError) as error:
            getattr(Fields({"name": value}, "f"), read)("name")
        assert str(error.value).startswith("f: name: got ") and is_plain(str(error.value))
    assert Fields({"about": "a\n\tb"}, "f").text("about", lines=True) == "a\n\tb"


def test_names_of_files():
    for good in ("0000", "Büro 1", "a.b", "<b>", "n" * 100):
        assert is_file_name(good)
    for bad in ("", ".", "..", "/a", "a/b", "../a", "n" * 101, "ü" * 51):
        assert not is_file_name(bad)


def test_escapes():
    assert markdown("a\n# b <i> [x](y) `c` *d* | e") == r"a # b \<i\> \[x\](y) \`c\` \*d\* \| e"


class Tags(HTMLParser):
    def __init__(self):
        super().__init__()
        self.found, self.attributes = [], set()

    def handle_starttag(self, tag, attrs):
        self.found.append(tag)
        self.attributes |= {name for name, _ in attrs}


def tags(path):
    parser = Tags()
    parser.feed(path.read_text())
    return parser


def checks(name, cameras):
    """As checks.json has them."""
    events = {"rate_hz": 1.0, "rate_per_pixel_hz": 1.0, "rate_over_time_hz": [1.0, 2.0], name: name}
    found = {"outside_limits": [name], "cameras": {camera: {"events": events} for camera in cameras}, "stereo": {}}
    recorded = {name: {"rate_per_pixel_hz": 1.0}}
    motion = {"speed_least_m_s": 0.5, "speed_most_m_s": 1.0}
    return found | {"recorded_sets": recorded, "imu": {name: name}, "motion": motion}


def test_pages_of_a_set_with_evil_names(sequence, tmp_path, monkeypatch):
    """Every text of sequence.json, of the recipe and of objects; the same elements as with plain names."""
    pages = {}
    for kind, name in (("plain", "plain"), ("evil", EVIL.replace("/", "_"))):
        folder = shutil.copytree(sequence.folder, tmp_path / kind / "sequences/0000")
        info = json.loads((folder / "sequence.json").read_text())
        info |= {"name": name, "split": name, "scene": name}
        info["drawn"] = {"duration_s": 1, "scene": name, "parameters": {name: name}, "trajectory": {"kind": name}}
        info["drawn"]["cameras"] = {name: {"overrides": {name: name}}}
        info["cameras"][0] |= {"chip": name, "lens": name}
        info["imu"] |= {"part": name}
        (folder / "sequence.json").write_text(json.dumps(info))
        for objects in folder.glob("*/truth/objects.json"):
            content = json.loads(objects.read_text())
            content["classes"] = dict.fromkeys(content["classes"], name)
            objects.write_text(json.dumps(content))
        found = Sequence(folder)
        monkeypatch.setattr(report, "check", lambda s, name=name: checks(name, s.cameras))
        report.write(found)
        manifest.seal(folder)
        row = {"name": "0000", "split": name, "scene": name, "outside_limits": [name]}
        set_ = {"sequences": [row], "name": name, "about": {name: name}, "recipe": name, "versions": {"pecs": "0"}}
        report.write_index(tmp_path / kind, set_)
        (tmp_path / "r.toml").write_text(TOML)
        made = replace(recipe.load(tmp_path / "r.toml"), name=name, about={name: name, "more": f"a\n# {name}"})
        text = card._datasheet(made, set_, [found])
        bare = re.sub(r"\\.", "", text)  # without what is escaped
        assert [line for line in bare.splitlines() if set("<[`|*") & set(line)] == [] and "\n# " not in bare
        pages[kind] = [tags(folder / "report.html"), tags(tmp_path / kind / "index.html")]
    for plain, evil in zip(*pages.values(), strict=True):
        assert evil.found == plain.found and evil.attributes == plain.attributes


TOML = f"""
duration_s = 1
[[scene]]
path = "{ROOT}/scenes/rotating_disk"
[scene.trajectory]
kind = "still"
[[rig.camera]]
name = "a"
kind = "events"
chip = "imx636"
lens = "cmount_8mm_f2p8"
"""
