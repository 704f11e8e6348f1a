"""Writes lens_data/spectra from colour-science's data: `.venv/bin/python scripts/packaging/make_spectra.py`.
(BSD-3-Clause, see lens_data/spectra/LICENSE.colour; the numbers of CIE publications are facts.)"""

import warnings
from pathlib import Path

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import colour

FOLDER = Path(__file__).resolve().parents[2] / "lens_data" / "spectra"
AS_TABULATED = "as tabulated in colour-science 0.4"
CIE_15 = "CIE 15:2018"

ILLUMINANTS = {
    "a": ("A", "CIE standard illuminant A (tungsten, 2856 K)"),
    "d50": ("D50", "CIE illuminant D50 (horizon daylight, 5003 K)"),
    "d65": ("D65", "CIE standard illuminant D65 (noon daylight, 6504 K)"),
    "e": ("E", "CIE illuminant E (equal energy)"),
    "fl2": ("FL2", "CIE illuminant FL2 (F2, cool white fluorescent, 4230 K)"),
    "fl11": ("FL11", "CIE illuminant FL11 (F11, three-band fluorescent, 4000 K)"),
    "led_b1": ("LED-B1", "CIE illuminant LED-B1 (phosphor-converted white LED, 2733 K)"),
    "led_b2": ("LED-B2", "CIE illuminant LED-B2 (phosphor-converted white LED, 2998 K)"),
    "led_b3": ("LED-B3", "CIE illuminant LED-B3 (phosphor-converted white LED, 4103 K)"),
    "led_b4": ("LED-B4", "CIE illuminant LED-B4 (phosphor-converted white LED, 5109 K)"),
    "led_b5": ("LED-B5", "CIE illuminant LED-B5 (phosphor-converted white LED, 6598 K)"),
}


def write(name: str, about: str, rows, columns: str = "value") -> None:
    path = FOLDER / f"{name}.csv"
    path.parent.mkdir(exist_ok=True)
    lines = [f"# {about}, {AS_TABULATED}", f"wavelength_nm,{columns}"]
    path.write_text("\n".join([*lines, *(",".join(f"{v:.6g}" for v in row) for row in rows)]) + "\n")


def rows(distribution, step_nm=None, visible=False):
    """visible: only 380 to 780 nm."""
    values = distribution.values if distribution.values.ndim > 1 else distribution.values[:, None]
    every = [(nm, *v) for nm, v in zip(distribution.wavelengths, values, strict=True)]
    kept = [row for row in every if not step_nm or row[0] % step_nm == 0]
    return [row for row in kept if not visible or 380 <= row[0] <= 780]


def main() -> None:
    for name, (key, about) in ILLUMINANTS.items():
        write(name, f"{about}: relative spectral power, {CIE_15}", rows(colour.SDS_ILLUMINANTS[key], 5))
    photopic = rows(colour.SDS_LEFS["CIE 1924 Photopic Standard Observer"], 5, visible=True)
    write("photopic", "CIE 1924 photopic luminous efficiency V(lambda), CIE 018:2019", photopic)
    for patch, distribution in colour.SDS_COLOURCHECKERS["ISO 17321-1"].items():
        name = patch.split("(")[0].strip().replace(" ", "_").replace(".", "p")
        about = f"ColorChecker Classic, patch '{patch}': reflectance, ISO 17321-1:2012 Table D.1"
        write(f"colorchecker/{name}", about, rows(distribution))
    about = (
        "Reflectances of the sRGB primaries: Mallett & Yuksel, Spectral Primary Decomposition for Rendering with sRGB "
    )
    about += "Reflectance, EGSR 2019"
    write("basis/srgb", about, rows(colour.recovery.MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019), "red,green,blue")
    parts = [colour.colorimetry.SDS_BASIS_FUNCTIONS_CIE_ILLUMINANT_D_SERIES[key] for key in ("S0", "S1", "S2")]
    daylight = [(nm, *(part[nm] for part in parts)) for nm in parts[0].wavelengths]
    write("basis/daylight", f"Daylight components S0, S1, S2, {CIE_15}", daylight, "s0,s1,s2")
    cmfs = rows(colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"], 5, visible=True)
    write("basis/cie1931", "CIE 1931 2 degree colour matching functions, CIE 018:2019", cmfs, "x,y,z")


if __name__ == "__main__":
    main()
