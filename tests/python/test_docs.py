"""docs/reference/python.md as a user reads it: its Python runs from top to bottom."""

import re

from test_carry_labels import Rectangle, write_truth
from test_sensor_sense import write


def test_python_page(root, tmp_path, monkeypatch):
    write(tmp_path / "stack")
    write_truth(tmp_path / "truth", Rectangle(), 1, light=False)
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", (root / "docs/reference/python.md").read_text(), flags=re.DOTALL)
    assert len(blocks) >= 5
    names = {}
    for block in blocks:
        exec(block, names)
    assert len(names["events"]) > 100 and len(names["noise"]) > 0 and names["on"] > 0
