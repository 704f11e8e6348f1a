"""Lenses: first-order data and the generated camera for Cycles. Keys and options: docs/lens.md."""

from __future__ import annotations

import ctypes
import json
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np

from ._library import function, json_function, take_text

_open = function("pecs_lens_open", ctypes.c_void_p, ctypes.c_char_p)
_close = function("pecs_lens_close", None, ctypes.c_void_p, error=False)
_info = json_function("pecs_lens_info", ctypes.c_void_p)
_pupil = json_function("pecs_lens_pupil", ctypes.c_void_p)
_draw = function("pecs_lens_draw", ctypes.c_void_p, ctypes.c_void_p, ctypes.c_char_p)
_camera = json_function("pecs_lens_camera", ctypes.c_void_p)

_doubles = ctypes.POINTER(ctypes.c_double)
_bulk = (ctypes.c_void_p, ctypes.c_char_p, _doubles, ctypes.c_int64, _doubles, ctypes.c_int64)
_directions = function("pecs_lens_directions", ctypes.c_int64, *_bulk)
_pixels = function("pecs_lens_pixels", ctypes.c_int64, *_bulk)
_diffract = function(
    "pecs_lens_diffract",
    ctypes.c_int,
    ctypes.POINTER(ctypes.c_float),
    ctypes.c_int,
    ctypes.c_int,
    ctypes.c_double,
    ctypes.c_double,
    ctypes.c_double,
)


@dataclass(frozen=True)
class Camera:
    """One OSL camera, for one pass of up to three bands (red, green, blue).

    Film irradiance [W m^-2 nm^-1] of band k = rendered value of channel k times e0[k], for a scene whose radiance is in
    W m^-2 sr^-1 nm^-1. The camera object's origin is the centre of the entrance pupil; focus_m counts from there.
    """

    osl: str
    shader_name: str
    bands_nm: list[float]
    e0: list[float]
    film_z_mm: float
    film_width_mm: float
    film_height_mm: float
    film_shift_x_mm: float
    film_shift_y_mm: float
    film_tilt_x_deg: float
    film_tilt_y_deg: float
    focus_m: float | None
    rms_spot_um: float
    stop_diameter_mm: float
    fnumber: float
    efl_mm: float
    entrance_pupil_z_mm: float
    channel_mode: (
        str  # "mean": all channels traced at the pass's mean wavelength; "per_channel": one channel per sample
    )
    colour_shift_px: float  # how far the bands' pictures lie from that of the mean wavelength
    acceptance: list[float]  # draws that get through: film centre, half way, corner
    missed_fraction: list[float]
    working_fnumber: list[float]  # per band, of the real axial cone behind the lens
    airy_radius_px: list[float]
    diffraction: bool  # whether to apply `diffract`: the Airy radius of a band exceeds half a pixel
    pixel_pitch_mm: float
    lens_name: str
    file: str
    sha256: str

    def diffract(self, pixels: Any, band: int) -> None:
        """Blurs one band's rendered picture in place; pixels: C-contiguous float32 array [height, width]."""
        if pixels.ndim != 2 or pixels.dtype != "float32" or not pixels.flags["C_CONTIGUOUS"]:
            raise ValueError("pixels must be a C-contiguous float32 array [height, width]")
        pointer = pixels.ctypes.data_as(ctypes.POINTER(ctypes.c_float))
        height, width = pixels.shape
        _diffract(pointer, width, height, self.pixel_pitch_mm, self.bands_nm[band], self.working_fnumber[band])


def _image_setting(arguments: dict[str, Any]) -> bytes:
    setting = {k: v for k, v in arguments.items() if k not in ("self", "pixels", "directions") and v is not None}
    setting["film_shift_x_mm"], setting["film_shift_y_mm"] = setting.pop("film_shift_mm")
    setting["film_tilt_x_deg"], setting["film_tilt_y_deg"] = setting.pop("film_tilt_deg")
    return json.dumps(setting).encode()


def _mapped(call: Any, handle: Any, setting: bytes, given: Any, size: int, result_size: int) -> np.ndarray:
    given = np.ascontiguousarray(given, np.float64)
    if given.ndim < 1 or given.shape[-1] != size:
        raise ValueError(f"got an array of shape {given.shape}, wanted [..., {size}]")
    result = np.empty((*given.shape[:-1], result_size))
    count = given.size // size
    call(handle, setting, given.ctypes.data_as(_doubles), count, result.ctypes.data_as(_doubles), count)
    return result


class Lens:
    """A prescription, by path or by the name of one of lens_data/lenses."""

    def __init__(self, path: str | PathLike[str]):
        self._handle = None
        self._handle = _open(str(path).encode())

    def info(self, **options: Any) -> dict[str, Any]:
        """lambda_nm, focus_m, stop_diameter_mm or fnumber, film_width_mm, film_height_mm."""
        return _info(self._handle, options)

    def pupil(self, **options: Any) -> dict[str, Any]:
        """The pupil over the film radius; options as for info."""
        return _pupil(self._handle, options)

    def draw(self, **options: Any) -> str:
        """The lens in section with its rays, as SVG text; options as for info."""
        return take_text(_draw(self._handle, json.dumps(options).encode()))

    def camera(self, **options: Any) -> Camera:
        """bands_nm, focus_bands_nm, focus_m, stop_diameter_mm or fnumber, film_width_mm, film_height_mm,
        film_shift_x_mm, film_shift_y_mm, film_tilt_x_deg, film_tilt_y_deg, pixel_pitch_mm, colour_tolerance_px,
        unit_m."""
        return Camera(**_camera(self._handle, options))

    def directions(
        self,
        pixels: Any,
        *,
        width: int,
        height: int,
        pixel_pitch_mm: float = 0.00486,
        lambda_nm: float = 550,
        focus_m: float | None = None,
        focus_bands_nm: Sequence[float] | None = None,
        stop_diameter_mm: float | None = None,
        fnumber: float | None = None,
        film_shift_mm: tuple[float, float] = (0, 0),
        film_tilt_deg: tuple[float, float] = (0, 0),
    ) -> np.ndarray:
        """Unit vectors [..., 3] of the chief rays of pixels [..., 2]; NaN where none arrives.

        Camera axes: x right, y down, z forward, origin at the entrance pupil. Pixel (0, 0) has its centre at
        (0.5, 0.5).
        """
        setting = _image_setting(locals())
        return _mapped(_directions, self._handle, setting, pixels, 2, 3)

    def pixels(
        self,
        directions: Any,
        *,
        width: int,
        height: int,
        pixel_pitch_mm: float = 0.00486,
        lambda_nm: float = 550,
        focus_m: float | None = None,
        focus_bands_nm: Sequence[float] | None = None,
        stop_diameter_mm: float | None = None,
        fnumber: float | None = None,
        film_shift_mm: tuple[float, float] = (0, 0),
        film_tilt_deg: tuple[float, float] = (0, 0),
    ) -> np.ndarray:
        """Pixels [..., 2] of directions [..., 3] of any length, the inverse of `directions`; NaN where the lens sees
        nothing."""
        setting = _image_setting(locals())
        return _mapped(_pixels, self._handle, setting, directions, 3, 2)

    def close(self) -> None:
        if self._handle:
            _close(self._handle)
            self._handle = None

    def __enter__(self) -> Lens:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __del__(self) -> None:
        self.close()
