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


def write(name: str, about: str, columns: str, rows) -> None:
    path = FOLDER / f"{name}.csv"
    path.parent.mkdir(exist_ok=True)
    lines = [f"# {about}, {AS_TABULATED}", columns] + [",".join(f"{v:.6g}" for v in row) for row in rows]
    path.write_text("\n".join(lines) + "\n")


def rows(distribution, step_nm=None):
    values = distribution.values if distribution.values.ndim > 1 else distribution.values[:, None]
    return [
        (nm, *v) for nm, v in zip(distribution.wavelengths, values, strict=True) if not step_nm or nm % step_nm == 0
    ]


def main() -> None:
    for name, (key, about) in ILLUMINANTS.items():
        write(
            name,
            f"{about}: relative spectral power, {CIE_15}",
            "wavelength_nm,value",
            rows(colour.SDS_ILLUMINANTS[key], 5),
        )
    photopic = colour.SDS_LEFS["CIE 1924 Photopic Standard Observer"]
    write(
        "photopic",
        "CIE 1924 photopic luminous efficiency V(lambda), CIE 018:2019",
        "wavelength_nm,value",
        [row for row in rows(photopic, 5) if 380 <= row[0] <= 780],
    )
    for patch, distribution in colour.SDS_COLOURCHECKERS["ISO 17321-1"].items():
        write(
            f"colorchecker/{patch.split('(')[0].strip().replace(' ', '_').replace('.', 'p')}",
            f"ColorChecker Classic, patch '{patch}': reflectance, ISO 17321-1:2012 Table D.1",
            "wavelength_nm,value",
            rows(distribution),
        )
    write(
        "basis/srgb",
        "Reflectances of the sRGB primaries: Mallett & Yuksel, Spectral Primary Decomposition for Rendering with sRGB "
        "Reflectance, EGSR 2019",
        "wavelength_nm,red,green,blue",
        rows(colour.recovery.MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019),
    )
    write(
        "basis/daylight",
        f"Daylight components S0, S1, S2, {CIE_15}",
        "wavelength_nm,s0,s1,s2",
        daylight_rows(),
    )
    cmfs = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    write(
        "basis/cie1931",
        "CIE 1931 2 degree colour matching functions, CIE 018:2019",
        "wavelength_nm,x,y,z",
        [row for row in rows(cmfs, 5) if 380 <= row[0] <= 780],
    )


def daylight_rows():
    parts = [colour.colorimetry.SDS_BASIS_FUNCTIONS_CIE_ILLUMINANT_D_SERIES[key] for key in ("S0", "S1", "S2")]
    return [(nm, *(part[nm] for part in parts)) for nm in parts[0].wavelengths]


if __name__ == "__main__":
    main()
