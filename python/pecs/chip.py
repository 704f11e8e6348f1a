"""Chips, the photocurrent that light makes on them, and the pixel models (docs/reference/: sensor.md, models.md)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from os import PathLike, fspath
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np
from numpy.typing import NDArray

from ._c_types import FLOATS, INT64, POINTER, TEXT
from ._errors import bad_input
from ._library import Handle, function, json_function, options_bytes, path_bytes, take_json
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
    """List the pixel models.

    Each has `name`, `source`, `takes_light` (False: it takes grey values), `tells_causes` (True: the option `labels`
    works), and `parameters`: a list of `key`, `unit`, `value` (default), `min`, `max`, `meaning`. The parameters of
    `pecs` are the values of the chip.
    """
    answer: list[dict[str, Any]] = take_json(_models())
    return answer


def presets() -> list[dict[str, Any]]:
    """List published settings of other simulators, for the option `preset` of `Sensor`, `simulate` and `sense`.

    Each has `name`, `description`, `source`, `model`, `set` (values of the chip) and `param` (parameters of the model).
    """
    answer: list[dict[str, Any]] = take_json(_presets())
    return answer


class ScaleOptions(TypedDict, total=False):
    """Options of `Chip.amperes_per_unit`, `Chip.photocurrent` and `Light`, from light to photocurrent."""

    fnumber: float | None  # of the lens, for radiance
    gain: float | None  # A per sum of lambda_nm QE L weight_nm, for relative light
    photocurrent_a: float | None  # of light 1 in all bands, for relative light; 1e-12 if neither is given


class Chip(Handle):
    """A chip profile. Every value of the profile is an attribute, such as `chip.width` and `chip.pixel_pitch_m`.

        chip = pecs.Chip("imx636", overrides={"contrast_threshold_on": 0.25})
        current_a = chip.photocurrent("stack", 0)      # [height, width]

    Parameters
    ----------
    name : str or path
        Name of a shipped profile (`pecs chips`) or a .json file. Default "imx636".
    overrides : dict of str to float, optional
        Values of the chip, by key, in the profile's unit and range.

    Attributes
    ----------
    info : dict
        Values with units, ranges and sources, description, relative quantum efficiency.

    Raises
    ------
    PecsNotFoundError
        The name is unknown.
    PecsInputError
        The profile, a key or a value is wrong.
    """

    _free = staticmethod(_close)

    def __init__(self, name: str | PathLike[str] = "imx636", *, overrides: Mapping[str, float] | None = None):
        self.name = fspath(name)
        self.overrides = numbers_by_name("overrides", overrides)
        super().__init__(_open(path_bytes(self.name), options_bytes(self.overrides)))
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
        """Photocurrent of a pixel per unit of each band's value.

        Parameters
        ----------
        bands : sequence of dict
            `lambda_nm` and `weight_nm` of each band, as `pecs.bands` or a stack lists them.
        quantity : str
            "irradiance" (default; W m^-2 nm^-1 on the film), "radiance" (W m^-2 sr^-1 nm^-1) or "relative".
        fnumber : float, optional
            Of the lens; required for radiance.
        gain : float, optional
            A per sum of lambda_nm QE L weight_nm, for relative light.
        photocurrent_a : float, optional
            Photocurrent [A] of light 1 in all bands, for relative light. Default 1e-12.

        Returns
        -------
        list of float
            [A] per unit, one per band.
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
        """Photocurrent [A] of a stack's frames (default: all) without dark current: [height, width] of one frame,
        [frames, height, width] of several. Negative light gives 0; light that is not finite gives NaN.

        fps: frame rate [Hz] of a folder without stack.json. fnumber, gain and photocurrent_a as in `amperes_per_unit`.
        """
        some = None if frames is None else np.atleast_1d(np.asarray(frames))
        if some is not None and some.size and some.dtype.kind not in "iu":
            raise ValueError(f"frames: got {some.dtype}, wanted integers")
        if not isinstance(stack, StackReader):
            with StackReader(stack, fps) as reader:
                return self.photocurrent(reader, frames, **scale)
        if fps is not None:
            raise ValueError("fps: got one with a StackReader, wanted it there")
        options = options_bytes(scale)
        wanted = range(stack.info["frames"]) if some is None else some
        out = np.empty((len(wanted), stack.info["height"], stack.info["width"]), np.float32)
        for plane, frame in zip(out, wanted, strict=True):
            with self._use() as handle, stack._use() as reader_handle:
                _photocurrent(handle, reader_handle, options, int(frame), plane, plane.size)
        return out[0] if isinstance(frames, (int, np.integer)) else out


def numbers_by_name(key: str, values: Any) -> dict[str, float]:
    """An option that maps names to numbers. Raises PecsInputError."""
    if values is None:
        return {}
    try:
        found = {name: float(value) for name, value in values.items()}
    except (AttributeError, TypeError, ValueError):
        raise bad_input(key, "", values, "numbers by name, such as {'diff_on': 35}") from None
    if wrong := next((name for name, value in found.items() if not math.isfinite(value)), None):
        raise bad_input(f"{key}.{wrong}", "", repr(found[wrong]), "a finite number")
    return found


def chip_options(chip: str | PathLike[str] | Chip, overrides: Mapping[str, float] | None = None) -> dict[str, Any]:
    """The chip as the library's options name it."""
    own = chip.overrides if isinstance(chip, Chip) else {}
    name = chip.name if isinstance(chip, Chip) else fspath(chip)
    return {"chip": name, "set": own | numbers_by_name("overrides", overrides)}


def bands(
    chip: str | PathLike[str] | Chip = "imx636",
    n: int = 6,
    placement: str = "gauss",
    illuminant: str | Sequence[tuple[float, float]] | None = None,
    min_nm: float | None = None,
    max_nm: float | None = None,
) -> list[dict[str, float]]:
    """Choose wavelengths and quadrature weights for a chip.

        pecs.bands("imx636", n=3)[0]["lambda_nm"]

    Parameters
    ----------
    chip : str, path or Chip
        The chip. Default "imx636".
    n : int
        Number of bands. Default 6.
    placement : str
        "gauss" (default; quadrature) or "uniform".
    illuminant : str or sequence of (float, float), optional
        A name of lens_data/spectra, a .csv file, "blackbody:T", "daylight:T" (T in K), or pairs of wavelength [nm] and
        power, linear in between. The bands then integrate reflectances under it. Default: equal power.
    min_nm, max_nm : float, optional
        Range of wavelengths [nm]. Default: where the response of chip and illuminant begins and ends.

    Returns
    -------
    list of dict
        `lambda_nm` and `weight_nm` of each band, with increasing wavelength.
    """
    pairs: Any = illuminant
    if illuminant is not None and not isinstance(illuminant, str):
        pairs = [[float(x), float(p)] for x, p in illuminant]
    options = {"chip": chip_options(chip)["chip"], "n": n, "placement": placement, "illuminant": pairs}
    chosen: list[dict[str, float]] = _bands({**options, "min_nm": min_nm, "max_nm": max_nm})["bands"]
    return chosen
