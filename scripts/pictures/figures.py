"""Shared by the scripts that draw the documentation's figures: backend, colours, saving without dates."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

ROOT = Path(__file__).resolve().parents[2]
ON, OFF, INK, GREY = "#0072b2", "#d55e00", "#1b1f24", "#8a9199"  # ON and OFF as in pecs view
plt.rcParams.update(
    {"font.size": 9, "legend.frameon": False, "legend.fontsize": 8, "svg.hashsalt": "pecs", "svg.fonttype": "path"}
)


def figure(width=7.0, height=2.6):
    fig, axes = plt.subplots(figsize=(width, height), layout="constrained")
    axes.spines[["top", "right"]].set_visible(False)
    return fig, axes


def save(fig, path: Path, dpi=110) -> None:
    """The same figure is the same bytes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    fig.savefig(path, dpi=dpi, metadata={"Date": None} if path.suffix == ".svg" else {"Software": None})
    plt.close(fig)
