"""Tables 2 and 3 of the paper on a scene where they can mean something: how many wavelengths, placed how, give the
events of 61 bands? A ColorChecker on the rotating disk, and the same disk in grey; the same light, 400-700 nm for all.

One dense stack (5 nm) per scene is rendered by Cycles; radiance over the lamp is smooth, so single wavelengths are read
off it as Cycles would render them. Means over bands are rendered. No noise, so what differs is the wavelengths.

    .venv/bin/python scripts/studies/ablation.py out/ablation

Writes ablation.json, ablation.md and ablation.png (matplotlib).
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pecs
from pecs_blender.spectral.spectra import load
from pecs_lab.measure import by_pixel, command
from pecs_lab.report import cell, table

ROOT = Path(__file__).resolve().parents[2]
COUNTS = (1, 3, 4, 6, 7, 9, 11, 12, 16, 31)
MEANS = (1, 3, 6, 12)  # bands
PLACEMENTS = {"uniform": COUNTS, "gauss": COUNTS, "means": MEANS}
LIGHT = (10, 30, 60, 80, 100, 120, 140, 160)  # C of Table 3, in % of the light
LO_NM, HI_NM = 400.0, 700.0
WIDTH, FRAMES, FPS, LAMP, PHOTOCURRENT_A = 64, 40, 2000.0, "led_b3", 1e-11
WITHIN_US = (1, 2, 3, 5, 7, 10, 15, 20, 30, 50, 70, 100, 150, 200, 300, 500, 700, 1000, 2000, 5000, 10000)


def response(nm):
    """lambda * QE of imx636, up to a factor."""
    with pecs.Chip("imx636") as chip:
        return np.array(chip.amperes_per_unit([{"lambda_nm": at, "weight_nm": 1.0} for at in nm]))


def bands(placement: str, n: int, lamp) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths and weights [nm]."""
    pairs = np.stack([lamp.lambda_nm, lamp.value], axis=1)
    chosen = pecs.bands(n=n, placement=placement, illuminant=pairs, min_nm=LO_NM, max_nm=HI_NM)
    return tuple(np.array([b[key] for b in chosen]) for key in ("lambda_nm", "weight_nm"))


def render(folder: Path, grey: int, placement: str, count: int) -> None:
    command = [sys.executable, "-m", "pecs_blender", "render", ROOT / "scenes/colorchecker_disk", "-o", folder]
    command += ["--lens", "none", "--focal", 25, "--placement", placement, "--bands", count, "--min-wavelength", LO_NM]
    command += ["--max-wavelength", HI_NM, "--width", WIDTH, "--samples", 4, "--fps", FPS]
    command += ["--frames", FRAMES, "--set", f"grey={grey}", "--set", f"lamp_spectrum={LAMP}"]
    subprocess.run(list(map(str, command)), check=True)


def dense(folder: Path, grey: int) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths, and radiance over lamp power [T, 61, H, W]."""
    render(folder, grey, "uniform", 61)
    with pecs.StackReader(folder) as stack:
        nm = np.array([b["lambda_nm"] for b in stack.info["bands"]])
        frames = np.array([stack.read_frame(i) for i in range(FRAMES)])
    return nm, frames / load(LAMP)(nm)[None, :, None, None]


def photocurrent(nm, frames, placement, n, lamp):
    """[T, H, W]: what the sensor sees with these bands; gain removed (mean 1)."""
    at, weight = bands(placement, n, lamp)
    factor = np.zeros(len(nm))
    for wavelength, w in zip(at, weight, strict=True):  # linear in between
        unit = np.array([np.interp(wavelength, nm, row) for row in np.eye(len(nm))])
        factor += w * response([wavelength])[0] * lamp(wavelength) * unit
    light = np.einsum("k,tkyx->tyx", factor, frames)
    return (light / light.mean()).astype(np.float32)


def of_means(folder: Path, grey: int, n: int) -> np.ndarray:
    """[T, H, W]: of a render with n bands, gain removed."""
    render(folder, grey, "means", n)
    with pecs.Chip("imx636") as chip:
        light = chip.photocurrent(folder, fnumber=8.0)
    return light / light.mean()


def events(light):
    t_us = np.arange(len(light)) * 1e6 / FPS
    return pecs.simulate(light, t_us, chip="imx636", noise=False, photocurrent_a=PHOTOCURRENT_A)


def score(reference, light, truth) -> dict:
    found = events(light)
    h, w = light.shape[1:]
    if len(found) == 0:
        return {"events": 0}
    d = pecs.compare(reference, found, width=w, height=h, origin="zero", split_half=False)
    delays = delay_us(reference, found, w)
    return {
        "log_rms_percent": 100 * float(np.std(np.log(light) - np.log(truth))),
        "events": len(found),
        "chamfer": d["chamfer"],
        "gaussian": d["gaussian"],
        "paired_percent": 100 * len(delays) / len(reference),
        "delay_us_median": float(np.median(np.abs(delays))) if len(delays) else None,
        "delay_us_p95": float(np.percentile(np.abs(delays), 95)) if len(delays) else None,
        # of the reference's events, those with a partner within WITHIN_US
        "within_percent": [100 * float((np.abs(delays) <= us).sum()) / len(reference) for us in WITHIN_US],
    }


def delay_us(a, b, width) -> np.ndarray:
    """Time differences of the i-th events of each pixel and polarity, where both streams have as many."""

    (ka, ta), (kb, tb) = by_pixel(a, width), by_pixel(b, width)
    count_a, count_b = (np.bincount(k, minlength=max(ka.max(), kb.max()) + 1) for k in (ka, kb))
    same = count_a == count_b
    return tb[same[kb]] - ta[same[ka]]


def main(output: Path) -> None:
    spectrum = load(LAMP)
    output.mkdir(parents=True, exist_ok=True)
    result = {"lamp": LAMP, "width": WIDTH, "frames": FRAMES, "fps": FPS, "bands": [], "light": []}
    for scene, grey in (("colour", 0), ("grey", 1)):
        nm, rendered = dense(output / f"stack_{scene}", grey)
        truth = photocurrent(nm, rendered, "gauss", 61, spectrum)
        reference = events(truth)
        for placement, counts in PLACEMENTS.items():
            for n in counts:
                if placement == "means":
                    light = of_means(output / f"means_{scene}_{n}", grey, n)
                else:
                    light = photocurrent(nm, rendered, placement, n, spectrum)
                row = {"scene": scene, "placement": placement, "n": n, **score(reference, light, truth)}
                result["bands"].append(row)
        if scene == "colour":
            result["light"] = [{"c": c, **score(reference, truth * np.float32(c / 100), truth)} for c in LIGHT]
    (output / "ablation.json").write_text(json.dumps(result, indent=1))
    (output / "ablation.md").write_text(page(result))
    plot(result, output / "ablation.png")
    print(output / "ablation.md")


def plot(result, path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    plt.rcParams |= {"font.size": 8, "axes.grid": True, "grid.alpha": 0.3}
    figure, axes = plt.subplots(2, 3, figsize=(10, 5.6), layout="constrained")
    rows = {(r["scene"], r["placement"], r["n"]): r for r in result["bands"]}
    for axis, key, label in zip(
        axes[0],
        ("log_rms_percent", "chamfer", "delay_us_p95"),
        ("RMS of ln photocurrent, %", "Chamfer distance", "95 % of |delay| below, µs"),
        strict=True,
    ):
        for scene, style in (("colour", "-"), ("grey", ":")):
            for placement, colour in (("uniform", "C0"), ("gauss", "C2"), ("means", "C1")):
                counts = PLACEMENTS[placement]
                ys = [max(rows[scene, placement, n].get(key) or 0, 1e-3) for n in counts]
                label_line = placement if scene == "colour" else None
                axis.loglog(counts, ys, style, marker=".", color=colour, label=label_line)
        axis.set(xlabel="bands N", ylabel=label, xticks=(1, 3, 6, 12, 31), xticklabels=(1, 3, 6, 12, 31))
        axis.minorticks_off()
    axes[0, 0].legend(title="solid: colour, dotted: grey", loc=(0.02, 0.36), fontsize=6)
    for axis, placement in ((axes[1, 0], "gauss"), (axes[1, 1], "means")):
        for n in PLACEMENTS[placement]:
            colour = plt.get_cmap("viridis")(COUNTS.index(n) / len(COUNTS))
            axis.semilogx(WITHIN_US, rows["colour", placement, n]["within_percent"], color=colour, label=n)
        axis.set(xlabel="|delay|, µs", ylabel="events with a partner within, %", title=f"{placement}, colour")
    axes[1, 0].legend(title="N", ncols=2, fontsize=7)
    axes[1, 2].plot([r["c"] for r in result["light"]], [r["chamfer"] for r in result["light"]], ".-")
    axes[1, 2].set(xlabel="light (Table 3's C), %", ylabel="Chamfer distance")
    figure.savefig(path, dpi=110)


def page(result) -> str:
    keys = ("log_rms_percent", "events", "chamfer", "gaussian", "paired_percent", "delay_us_median", "delay_us_p95")
    bands = [[r["scene"], r["placement"], r["n"], *(cell(r.get(k)) for k in keys)] for r in result["bands"]]
    light = [[r["c"], *(cell(r.get(k)) for k in keys)] for r in result["light"]]
    return (
        f"# Wavelengths and light: events against 61 bands\n{table(('scene', 'placement', 'N', *keys), bands)}\n\n"
        f"## Light level (Table 3's C, in %)\n{table(('C', *keys), light)}\n"
    )


if __name__ == "__main__":
    command(main)
