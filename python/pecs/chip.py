"""Chips, the photocurrent that light makes on them, and the pixel models (docs/reference/: sensor.md, models.md)."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from os import PathLike, fspath
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np
from numpy.typing import NDArray

from ._c_types import FLOATS, INT64, POINTER, TEXT
from ._library import Handle, function, json_function, path_bytes, take_json
from .stack import StackReader

if TYPE_CHECKING:
    from typing_extensions import Unpack

_models = function("pecs_models", POINTER)
_presets = function("pecs_presets", POINTER)
_bands = json_function("pecs_bands")
_open = function("pecs_chip_open", POINTER, TEXT, TEXT)
_info = function("pecs_chip_info", POINTER, POINTER)
_amperes = json_function("pecs_chip_amperes_per_unit", POINTER)
_photocurrent = function("pecs_chip_photocurrent", INT64, POINTER, POINTER, TEXT, INT64, FLOATS, INT64)
_close = function("pecs_chip_close", None, POINTER, error=False)


def models() -> list[dict[str, Any]]:
    """The pixel models: [{"name", "source", "takes_light", "tells_causes", "parameters": [{"key", "unit", "value",
    "min", "max", "meaning"}, ...]}, ...]. The parameters of `pecs` are the chip's; `tells_causes`: `labels` work."""
    answer: list[dict[str, Any]] = take_json(_models())
    return answer


def presets() -> list[dict[str, Any]]:
    """Published settings of other simulators, for the option `preset` of `Sensor`, `simulate` and `sense`: [{"name",
    "description", "source", "model", "set": {key: value} of the chip, "param": {key: value} of the model}, ...]."""
    answer: list[dict[str, Any]] = take_json(_presets())
    return answer


class ScaleOptions(TypedDict, total=False):
    """From light to photocurrent: options of `Chip.amperes_per_unit`, `Chip.photocurrent` and `Light`."""

    fnumber: float | None  # of the lens, for radiance
    gain: float | None  # A per sum of lambda_nm QE L weight_nm, for relative light
    photocurrent_a: float | None  # of light 1 in all bands, for relative light; 1e-12 if neither is given


class Chip(Handle):
    """A chip profile, by name or path, with `overrides` of its values (in the profile's unit and range).

        chip = pecs.Chip("imx636", overrides={"contrast_threshold_on": 0.25})
        chip.pixel_pitch_m, chip.width                 # every value of the profile is an attribute
        current_a = chip.photocurrent("stack", 0)      # [height, width]

    `info` also has units, ranges, description and the relative quantum efficiency. Raises PecsNotFoundError for an
    unknown name, PecsInputError for a wrong profile, key or value.
    """

    _free = staticmethod(_close)

    def __init__(self, name: str | PathLike[str] = "imx636", *, overrides: Mapping[str, float] | None = None):
        self.name = fspath(name)
        self.overrides = {key: float(value) for key, value in (overrides or {}).items()}
        super().__init__(_open(path_bytes(self.name), json.dumps(self.overrides).encode()))
        self.info: dict[str, Any] = take_json(self._call(_info))

    def __getattr__(self, key: str) -> Any:
        entry = self.__dict__.get("info", {}).get("values", {}).get(key)
        if entry is None:
            raise AttributeError(f"{type(self).__name__} has no {key}")
        return int(entry["value"]) if entry["unit"] == "px" else entry["value"]

    def __repr__(self) -> str:
        return f"pecs.Chip({self.name!r}, overrides={self.overrides!r})"

    def amperes_per_unit(
        self,
        bands: Sequence[Mapping[str, float]],
        quantity: str = "irradiance",
        **scale: Unpack[ScaleOptions],
    ) -> list[float]:
        """Photocurrent [A] of a pixel per unit of each band's value.

        `bands`: [{"lambda_nm", "weight_nm"}, ...] as of `pecs.bands` or a stack. `quantity`: "irradiance" [W m^-2
        nm^-1 on the film], "radiance" [W m^-2 sr^-1 nm^-1, through a lens of `fnumber`] or "relative": then `gain` is
        A per sum of lambda_nm QE L weight_nm, or `photocurrent_a` the current of light 1 in all bands (1 pA if
        neither).
        """
        pairs = [{key: float(band[key]) for key in ("lambda_nm", "weight_nm")} for band in bands]
        options = {"bands": pairs, "quantity": quantity, **scale}
        amperes: list[float] = self._call(_amperes, options)["amperes_per_unit"]
        return amperes

    def photocurrent(
        self,
        stack: str | PathLike[str] | StackReader,
        frames: int | Sequence[int] | None = None,
        *,
        fps: float | None = None,
        **scale: Unpack[ScaleOptions],
    ) -> NDArray[np.float32]:
        """The photocurrent of a stack's frames [A]: [height, width] of one, [frames, height, width] of several or,
        with None, of all. Without dark current. Negative light gives 0, what is not finite gives NaN.

        Options as of `amperes_per_unit`; `fps`: for a folder without stack.json.
        """
        if not isinstance(stack, StackReader):
            with StackReader(stack, fps) as reader:
                return self.photocurrent(reader, frames, **scale)
        options = json.dumps(scale).encode()
        wanted = range(stack.info["frames"]) if frames is None else np.atleast_1d(np.asarray(frames, np.int64))
        out = np.empty((len(wanted), stack.info["height"], stack.info["width"]), np.float32)
        for plane, frame in zip(out, wanted, strict=True):
            with self._use() as handle, stack._use() as reader_handle:
                _photocurrent(handle, reader_handle, options, int(frame), plane, plane.size)
        return out[0] if isinstance(frames, (int, np.integer)) else out


def chip_options(chip: str | PathLike[str] | Chip, overrides: Mapping[str, float] | None = None) -> dict[str, Any]:
    """The chip as the library's options name it."""
    own = chip.overrides if isinstance(chip, Chip) else {}
    name = chip.name if isinstance(chip, Chip) else fspath(chip)
    return {"chip": name, "set": own | {key: float(value) for key, value in (overrides or {}).items()}}


def bands(
    chip: str | PathLike[str] | Chip = "imx636",
    n: int = 6,
    placement: str = "gauss",
    illuminant: str | Sequence[tuple[float, float]] | None = None,
    min_nm: float | None = None,
    max_nm: float | None = None,
) -> list[dict[str, float]]:
    """Wavelengths and quadrature weights: [{"lambda_nm": .., "weight_nm": ..}, ...], rising.

        pecs.bands("imx636", n=3)[0]["lambda_nm"]

    `placement`: "gauss" (quadrature) or "uniform". `illuminant`: a name of
    lens_data/spectra, a .csv file, "blackbody:T", "daylight:T", or (lambda_nm, power) pairs, linear in between; the
    bands then integrate reflectances under it.
    """
    pairs: Any = illuminant
    if illuminant is not None and not isinstance(illuminant, str):
        pairs = [[float(x), float(p)] for x, p in illuminant]
    options = {"chip": chip_options(chip)["chip"], "n": n, "placement": placement, "illuminant": pairs}
    chosen: list[dict[str, float]] = _bands({**options, "min_nm": min_nm, "max_nm": max_nm})["bands"]
    return chosen
