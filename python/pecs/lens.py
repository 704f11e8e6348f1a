"""Lenses: first-order data and the generated camera for Cycles. Keys and options: docs/reference/lens.md."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._c_types import DOUBLE, DOUBLES, FLOATS, INT, INT64, POINTER, TEXT
from ._library import Handle, function, json_function, options_bytes, path_bytes, take_text

if TYPE_CHECKING:
    from typing_extensions import Required, Unpack

_open = function("pecs_lens_open", POINTER, TEXT)
_close = function("pecs_lens_close", None, POINTER, error=False)
_info = json_function("pecs_lens_info", POINTER)
_pupil = json_function("pecs_lens_pupil", POINTER)
_draw = function("pecs_lens_draw", POINTER, POINTER, TEXT)
_camera = json_function("pecs_lens_camera", POINTER)

_bulk = (POINTER, TEXT, DOUBLES, INT64, DOUBLES, INT64)
_directions = function("pecs_lens_directions", INT64, *_bulk)
_pixels = function("pecs_lens_pixels", INT64, *_bulk)
_diffract = function("pecs_lens_diffract", INT, FLOATS, INT, INT, DOUBLE, DOUBLE, DOUBLE)


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
    channel_mode: str  # "mean": traced at the pass's mean wavelength; "mixed", "per_channel": at one band's per sample
    colour_shift_px: float  # RMS error of position of a band traced at the mean wavelength
    mixed_shift_px: float | None  # of the scene's colours with one band per sample for all channels
    acceptance: list[float]  # draws that get through: film centre, half way, corner
    missed_fraction: list[float]
    working_fnumber: list[float]  # per band, of the real axial cone behind the lens
    airy_radius_px: list[float]
    diffraction: bool  # whether to apply `diffract`: the Airy radius of a band exceeds half a pixel
    pixel_pitch_mm: float
    lens_name: str
    file: str
    sha256: str

    def diffract(self, pixels: NDArray[np.float32], band: int) -> None:
        """Blur the rendered image [height, width] (C-contiguous) of one band, a number in `bands_nm`, in place."""
        if pixels.ndim != 2 or pixels.dtype != "float32" or not pixels.flags["C_CONTIGUOUS"]:
            raise ValueError("pixels must be a C-contiguous float32 array [height, width]")
        height, width = pixels.shape
        _diffract(pixels, width, height, self.pixel_pitch_mm, self.bands_nm[band], self.working_fnumber[band])


class _Setting(TypedDict, total=False):
    focus_m: float | None  # from the entrance pupil; None is infinity
    stop_diameter_mm: float | None  # at most one of stop_diameter_mm and fnumber; None is wide open
    fnumber: float | None


class PupilOptions(_Setting, total=False):
    lambda_nm: float
    film_width_mm: float
    film_height_mm: float


class InfoOptions(PupilOptions, total=False):
    bands_nm: Sequence[float]
    field_rows: int


class DrawOptions(_Setting, total=False):
    film_width_mm: float
    film_height_mm: float
    bands_nm: Sequence[float]


class CameraOptions(_Setting, total=False):
    focus_bands_nm: Sequence[float] | None
    film_width_mm: float | None
    film_height_mm: float | None
    film_shift_x_mm: float
    film_shift_y_mm: float
    film_tilt_x_deg: float
    film_tilt_y_deg: float
    pixel_pitch_mm: float | None
    colour_tolerance_px: float | None
    band_shares: Sequence[float] | None
    share_spreads: Sequence[float] | None
    unit_m: float | None


class ImageOptions(_Setting, total=False):
    width: Required[int]
    height: Required[int]
    pixel_pitch_mm: float
    lambda_nm: float
    focus_bands_nm: Sequence[float] | None
    film_shift_mm: tuple[float, float]
    film_tilt_deg: tuple[float, float]


def _plain(options: Mapping[str, Any]) -> dict[str, Any]:
    """Options as JSON has them: NumPy's numbers and arrays as Python's."""
    return {key: value.tolist() if hasattr(value, "tolist") else value for key, value in options.items()}


def _image_json(options: Mapping[str, Any]) -> bytes:
    out = _plain(options)
    for key in ("film_shift_mm", "film_tilt_deg"):
        name, _, unit = key.rpartition("_")
        x, y = out.pop(key, (0, 0))
        out |= {f"{name}_x_{unit}": float(x), f"{name}_y_{unit}": float(y)}
    return options_bytes(out)


class Lens(Handle):
    """A lens prescription.

        with pecs.Lens("dgauss_50mm_tronnier") as lens:
            lens.info(focus_m=1.5, fnumber=4)["film_z_mm"]

    Methods share the options `focus_m` (from the entrance pupil; None: infinity), `stop_diameter_mm` and `fnumber`
    (at most one of both; None: wide open).

    Parameters
    ----------
    path : str or path
        Name of a shipped lens, or a file (docs/reference/lens.md).

    Raises
    ------
    PecsNotFoundError
        The lens is unknown.
    PecsInputError
        The file is wrong, an option is unknown or a value is out of range.
    """

    _free = staticmethod(_close)

    def __init__(self, path: str | PathLike[str]):
        super().__init__(_open(path_bytes(path)))

    def info(self, **options: Unpack[InfoOptions]) -> dict[str, Any]:
        """First-order data, film position and field of view.

        Parameters
        ----------
        focus_m, stop_diameter_mm, fnumber : float, optional
            As in `Lens`.
        lambda_nm : float
            Wavelength [nm]. Default 587.56.
        film_width_mm, film_height_mm : float
            Size of the film [mm]. Default 6.2208, 3.4992.
        bands_nm : sequence of float
            Wavelengths [nm] of the columns of lateral colour. Default: `lambda_nm`.
        field_rows : int
            Number of film radii from centre to corner. Default 5.

        Returns
        -------
        dict
            Names end with their unit; `field` lists illumination, distortion and colour along the film radius.
        """
        return self._answer(_info, options)

    def pupil(self, **options: Unpack[PupilOptions]) -> dict[str, Any]:
        """The exit pupil over the film radius: film radius, covering ellipse, exact area and irradiance per radiance.
        Options as in `info`."""
        return self._answer(_pupil, options)

    def draw(self, **options: Unpack[DrawOptions]) -> str:
        """Draw a section of the lens with rays, as SVG. Options as in `info`; `bands_nm` are the wavelengths [nm] of
        the rays."""
        return take_text(self._call(_draw, options_bytes(_plain(options))))

    def camera(self, *, bands_nm: Sequence[float], **options: Unpack[CameraOptions]) -> Camera:
        """The OSL camera of one pass.

        Parameters
        ----------
        bands_nm : sequence of float
            One to three wavelengths [nm]: red, green and blue of the pass.
        focus_m, stop_diameter_mm, fnumber : float, optional
            As in `Lens`.
        focus_bands_nm : sequence of float, optional
            All bands of the stack, for one common focus. Default: `bands_nm`.
        film_width_mm, film_height_mm : float, optional
            Size of the film [mm]. Default 6.2208, 3.4992.
        film_shift_x_mm, film_shift_y_mm : float
            Shift of the film's centre [mm], +x right, +y up, seen from behind. Default 0.
        film_tilt_x_deg, film_tilt_y_deg : float
            Tilt of the film [deg]. Default 0.
        pixel_pitch_mm : float, optional
            Distance of pixel centres [mm]. Default 0.00486.
        colour_tolerance_px : float, optional
            Largest error of position [pixels] with which the bands may share their rays. Default 0.1.
        band_shares : sequence of float, optional
            Shares of the bands in the signal of a sensor that adds them up, of sum 1. Rays may then be traced at the
            wavelength of one band, drawn by its share, for all bands. Default: bands are seen apart.
        share_spreads : sequence of float, optional
            RMS over the scene's colours of the difference from `band_shares`, of the sums of the shares up to each
            border between bands. Required with `band_shares`.
        unit_m : float, optional
            Metres per unit of the scene. Default 1.

        Returns
        -------
        Camera
            Shader source and calibration.
        """
        return Camera(**self._answer(_camera, {"bands_nm": np.asarray(bands_nm, float), **options}))

    def directions(self, pixels: ArrayLike, **options: Unpack[ImageOptions]) -> NDArray[np.float64]:
        """Chief rays of pixels.

        Axes: x right, y down, z forward, origin at the entrance pupil. Pixel (0, 0) has its centre at (0.5, 0.5).

        Parameters
        ----------
        pixels : array
            [..., 2], x and y [pixels].
        width, height : int
            Size of the image [pixels]; required.
        pixel_pitch_mm : float
            Distance of pixel centres [mm]. Default 0.00486.
        lambda_nm : float
            Wavelength [nm]. Default 550.
        focus_m, stop_diameter_mm, fnumber : float, optional
            As in `Lens`.
        focus_bands_nm : sequence of float, optional
            As in `camera`.
        film_shift_mm, film_tilt_deg : (float, float)
            x and y, as in `camera`. Default (0, 0).

        Returns
        -------
        float64 array
            [..., 3], unit vectors; NaN where no ray arrives.
        """
        return self._mapped(_directions, _image_json(options), pixels, 2, 3)

    def pixels(self, directions: ArrayLike, **options: Unpack[ImageOptions]) -> NDArray[np.float64]:
        """Pixels [..., 2] of directions [..., 3] of any length, the inverse of `directions` with its options; NaN
        outside the field of view."""
        return self._mapped(_pixels, _image_json(options), directions, 3, 2)

    def _answer(self, call: Any, options: Mapping[str, Any]) -> dict[str, Any]:
        answer: dict[str, Any] = self._call(call, _plain(options))
        return answer

    def _mapped(self, call: Any, setting: bytes, given: ArrayLike, size: int, result_size: int) -> NDArray[np.float64]:
        given = np.ascontiguousarray(given, np.float64)
        if given.ndim < 1 or given.shape[-1] != size:
            raise ValueError(f"got an array of shape {given.shape}, wanted [..., {size}]")
        result = np.empty((*given.shape[:-1], result_size))
        count = given.size // size
        self._call(call, setting, given, count, result, count)
        return result
