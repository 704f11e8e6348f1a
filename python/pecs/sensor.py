"""The sensor: which bands to render for a chip."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike, fspath

from ._library import json_function

_bands = json_function("pecs_bands")


def bands(
    chip: str | PathLike[str] = "imx636",
    n: int = 6,
    placement: str = "gauss",
    illuminant: Sequence[tuple[float, float]] | None = None,
    min_nm: float | None = None,
    max_nm: float | None = None,
) -> list[dict[str, float]]:
    """Wavelengths and quadrature weights: [{"lambda_nm": .., "weight_nm": ..}, ...], rising.

    `illuminant`: (lambda_nm, power) pairs, linear in between; the bands then integrate reflectances under it.
    """
    return _bands(
        {
            "chip": fspath(chip),
            "n": n,
            "placement": placement,
            "illuminant": None if illuminant is None else [[float(x), float(p)] for x, p in illuminant],
            "min_nm": min_nm,
            "max_nm": max_nm,
        }
    )["bands"]
