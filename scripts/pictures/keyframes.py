#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""docs/studies/keyframes.svg: recall, precision and CPU time of uniform steps and keyframes.

.venv/bin/python scripts/bench/motion.py -o out/motion > out/motion.json
.venv/bin/python scripts/pictures/keyframes.py out/motion.json
"""

import json
import sys
from pathlib import Path

from figures import GREY, INK, OFF, ON, ROOT, plt, save

COLOURS = {"uniform": OFF, "adaptive": ON}
LABELS = {"uniform": "uniform steps, 8 samples", "adaptive": "keyframes, 32 samples"}


def main(report: Path) -> None:
    scenes = json.loads(report.read_text())["scenes"]
    fig, panels = plt.subplots(1, 3, figsize=(8, 2.7), layout="constrained", sharey=True, width_ratios=(1, 1, 0.8))
    for axes, key in zip(panels, ("recall", "precision", "cpu_s"), strict=True):
        axes.spines[["top", "right"]].set_visible(False)
        for row, found in enumerate(scenes.values()):
            values = {variant: found[variant][key] for variant in COLOURS}
            axes.plot(list(values.values()), [row, row], color=GREY, lw=1.5, zorder=1)
            for variant, value in values.items():
                axes.plot(value, row, "o", ms=5, color=COLOURS[variant], label=None if row else LABELS[variant])
            if key in found["ceiling"]:
                axes.plot(found["ceiling"][key], row, "|", ms=10, mew=1.5, color=INK, label=None if row else "ceiling")
        axes.grid(axis="x", alpha=0.3)
    panels[0].set(yticks=range(len(scenes)), yticklabels=scenes, xlim=(0.4, 1), xlabel="recall")
    panels[0].invert_yaxis()
    panels[1].set(xlim=(0.4, 1), xlabel="precision")
    panels[2].set(xlim=(0, None), xlabel="CPU time, s")
    fig.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    save(fig, ROOT / "docs/studies/keyframes.svg")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
