#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""The pictures of examples/: what each script and notebook makes, and that of docs/start/first_events.md.

MUJOCO_GL=egl scripts/pictures/examples.py
"""

import importlib.util
import json
import runpy
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pecs
from figures import OFF, ON, ROOT, plt, save

EXAMPLES = ROOT / "examples"


def sheet(name: str, output: str, *options: str, to: Path = Path("picture.png")) -> None:
    """The events that a script writes, as `pecs view` draws them."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, EXAMPLES / name / f"{name}.py", output], cwd=folder, check=True)
        subprocess.run([pecs.program(), "view", output, "-o", "picture.png", *options], cwd=folder, check=True)
        shutil.copy(Path(folder, "picture.png"), EXAMPLES / name / to)


def models() -> None:
    """One row of each model's events over time."""
    events = runpy.run_path(EXAMPLES / "compare_models/compare_models.py")["simulate_all"]()
    del events["pecs, seed 1"]
    figure, axes = plt.subplots(1, len(events), figsize=(9, 2.4), sharey=True, layout="constrained")
    for axis, (name, found) in zip(axes, events.items(), strict=True):
        row = found[found["y"] == 120]
        axis.scatter(row["t"] / 1000, row["x"], c=np.where(row["p"] == 1, ON, OFF), s=1)
        axis.set(title=name, xlabel="time / ms", xlim=(0, 60), ylim=(20, 170))
    axes[0].set_ylabel("x / px")
    save(figure, EXAMPLES / "compare_models/picture.png", dpi=80)


def notebook(path: Path) -> None:
    """Its last figure."""
    plt.show = lambda: save(plt.gcf(), path.parent / "picture.png", dpi=80)
    names = {}
    for cell in json.loads(path.read_text())["cells"]:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)


def main() -> None:
    sheet("simulate_frames", "bar.raw", "--count", "2")
    sheet("simulate_frames", "bar.raw", to=ROOT / "docs/start/first_events.png")
    sheet("stream_frames", "stream.npz", "--count", "2")
    for name, module, output in (("mujoco_camera", "mujoco", "robot.raw"), ("pybullet_hand", "pybullet", "hand.raw")):
        if importlib.util.find_spec(module):
            sheet(name, output, "--count", "2")
    models()
    for path in sorted(EXAMPLES.glob("*/*.ipynb")):
        notebook(path)


if __name__ == "__main__":
    main()
