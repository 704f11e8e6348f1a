# SPDX-License-Identifier: GPL-3.0-or-later
"""Open Image Denoise 2 (https://www.openimagedenoise.org), the library that Blender includes, through its C interface.

Cycles' own denoiser works on what one call renders: a part of a picture. This one filters whole pictures, which were
composed of parts. Guides are not filtered first: with 4 samples per pixel of scenes/street that takes 9.2 instead of
1.4 CPU s for 692 x 520 pixels, and lowers the RMS error of ln(photocurrent) from 0.202 to 0.200 only.
"""

from __future__ import annotations

import ctypes

import bpy
import numpy as np
from pecs._errors import ExitCode, PecsError
from pecs._platform import library_file, loaded_library

from .tiles import grown

_LIBRARY = library_file("OpenImageDenoise", "2")
_CPU, _FLOAT3 = 1, 3  # OIDN_DEVICE_TYPE_CPU, OIDN_FORMAT_FLOAT3
_FAST, _HIGH = 4, 6  # OIDN_QUALITY
_MEMORY_MB = 3000  # decides the tiles and so the last bits of the result: the same on every machine
GUIDES = ("Denoising Albedo", "Denoising Normal")  # passes of Cycles
CHANNELS = 3  # of each guide
# The filter draws traces of light where there is none: around objects before a black sky, and on surfaces in the dark,
# up to so much there (middle grey is 0.18).
DARK = 1e-3


def _library() -> ctypes.CDLL:
    """The copy that this process has loaded with Blender."""
    try:
        library = loaded_library(_LIBRARY)
    except OSError:
        raise PecsError(
            f"Blender {bpy.app.version_string} has no {_LIBRARY}: use blender.org's or `pip install bpy` "
            "(--no-denoise renders without it)",
            ExitCode.UNSUPPORTED,
        ) from None
    handle, text, size = ctypes.c_void_p, ctypes.c_char_p, ctypes.c_size_t
    signatures = {
        "oidnNewDevice": (handle, ctypes.c_int),
        "oidnSetDeviceInt": (None, handle, text, ctypes.c_int),
        "oidnSetDeviceBool": (None, handle, text, ctypes.c_bool),
        "oidnCommitDevice": (None, handle),
        "oidnReleaseDevice": (None, handle),
        "oidnGetDeviceError": (ctypes.c_int, handle, ctypes.POINTER(text)),
        "oidnNewFilter": (handle, handle, text),
        "oidnSetSharedFilterImage": (None, handle, text, handle, ctypes.c_int, size, size, size, size, size),
        "oidnSetFilterBool": (None, handle, text, ctypes.c_bool),
        "oidnSetFilterInt": (None, handle, text, ctypes.c_int),
        "oidnSetFilterFloat": (None, handle, text, ctypes.c_float),
        "oidnCommitFilter": (None, handle),
        "oidnExecuteFilter": (None, handle),
        "oidnReleaseFilter": (None, handle),
    }
    for name, (result, *arguments) in signatures.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


def is_available() -> bool:
    """Whether this Blender was built with Open Image Denoise."""
    try:
        return bool(_library())
    except PecsError:
        return False


class Denoiser:
    """threads: 0 for all cores; does not change the result."""

    def __init__(self, threads: int = 0):
        self._oidn = _library()
        self._device = self._oidn.oidnNewDevice(_CPU)
        self._oidn.oidnSetDeviceBool(self._device, b"setAffinity", False)
        if threads:
            self._oidn.oidnSetDeviceInt(self._device, b"numThreads", threads)
        self._oidn.oidnCommitDevice(self._device)

    def __del__(self):
        if hasattr(self, "_device"):
            self._oidn.oidnReleaseDevice(self._device)

    def __call__(self, light: np.ndarray, guides: np.ndarray, fast: bool = False) -> np.ndarray:
        """light: [bands, height, width], finite, of any unit. guides: [6, height, width], albedo and normal. fast:
        half the time, 6 % more error. Returns the denoised light."""
        albedo, normal = (_interleaved(part) for part in (guides[:CHANNELS], guides[CHANNELS:]))
        out = np.empty_like(light)
        for first in range(0, len(light), CHANNELS):
            bands = light[first : first + CHANNELS]
            lit = (bands > 0).any(axis=0)
            if not lit.any():
                out[first : first + CHANNELS] = 0
                continue
            color = _interleaved(bands[np.minimum(np.arange(CHANNELS), len(bands) - 1)])
            clean = np.empty_like(color)
            exposure = _exposure(bands)
            self._filter(exposure, _FAST if fast else _HIGH, color=color, albedo=albedo, normal=normal, output=clean)
            if not lit.all():
                nothing = ~guides.any(axis=0) | (~grown(lit) & (clean.max(axis=2) * exposure < DARK))
                clean[~lit & nothing] = 0
            out[first : first + CHANNELS] = clean.transpose(2, 0, 1)[: len(bands)]
        return out

    def _filter(self, exposure: float, quality: int, **images: np.ndarray) -> None:
        oidn, one = self._oidn, self._oidn.oidnNewFilter(self._device, b"RT")
        for name, image in images.items():
            height, width, _ = image.shape
            oidn.oidnSetSharedFilterImage(one, name.encode(), image.ctypes.data, _FLOAT3, width, height, 0, 0, 0)
        oidn.oidnSetFilterInt(one, b"maxMemoryMB", _MEMORY_MB)
        oidn.oidnSetFilterBool(one, b"hdr", True)
        oidn.oidnSetFilterFloat(one, b"inputScale", exposure)
        oidn.oidnSetFilterInt(one, b"quality", quality)
        oidn.oidnCommitFilter(one)
        oidn.oidnExecuteFilter(one)
        message = ctypes.c_char_p()
        failed = oidn.oidnGetDeviceError(self._device, ctypes.byref(message))
        oidn.oidnReleaseFilter(one)
        if failed:
            raise PecsError(f"Open Image Denoise: {(message.value or b'').decode()}", ExitCode.UNSUPPORTED)


def _interleaved(planes: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(planes.transpose(1, 2, 0), np.float32)


def _exposure(light: np.ndarray) -> float:
    """Factor that brings the geometric mean of the light, which is not 0 everywhere, to 0.18, middle grey."""
    return float(0.18 / np.exp(np.mean(np.log(light[light > 0]))))
