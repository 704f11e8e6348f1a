"""PECS: a physically based event-camera simulator. Python binding of the C library (docs/reference/python.md).

`import pecs` loads neither NumPy nor libpecs: a name loads its module, and the first call into the library loads it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ._lazy import attributes

if TYPE_CHECKING:
    from ._errors import PecsError, PecsInputError, PecsNotFoundError, PecsOutputError
    from ._library import data_dir, version
    from ._program import program
    from ._sense import sense
    from .chip import Chip, bands, models, presets
    from .events import EVENT_DTYPE, EventReader, Events, EventWriter, event_formats, read, write
    from .lens import Camera, Lens
    from .light import Light
    from .metrics import compare, delays
    from .motion import CarriedLight, Carrier, carry, carry_labels, event_labels
    from .representations import event_histogram, event_picture, time_surface, voxel_grid
    from .sensor import Sensor, simulate
    from .spectra import glass, spectrum
    from .stack import StackReader, StackWriter

_MODULES = {
    "_errors": "PecsError PecsInputError PecsNotFoundError PecsOutputError",
    "_library": "data_dir version",
    "_program": "program",
    "_sense": "sense",
    "chip": "Chip bands models presets",
    "events": "EVENT_DTYPE EventReader Events EventWriter event_formats read write",
    "lens": "Camera Lens",
    "light": "Light",
    "metrics": "compare delays",
    "motion": "CarriedLight Carrier carry carry_labels event_labels",
    "representations": "event_histogram event_picture time_surface voxel_grid",
    "sensor": "Sensor simulate",
    "spectra": "glass spectrum",
    "stack": "StackReader StackWriter",
}
__all__ = [
    "Camera", "CarriedLight", "Carrier", "Chip", "EVENT_DTYPE", "EventReader", "EventWriter", "Events", "Lens", "Light",
    "PecsError", "PecsInputError", "PecsNotFoundError", "PecsOutputError", "Sensor", "StackReader", "StackWriter",
    "bands", "carry", "carry_labels", "compare", "data_dir", "delays", "event_formats", "event_histogram",
    "event_labels", "event_picture", "glass", "models", "presets", "program", "read", "sense", "simulate", "spectrum",
    "time_surface", "version", "voxel_grid", "write",
]  # fmt: skip


_find, _names = attributes(__name__, _MODULES)


def __getattr__(name: str) -> Any:
    return _find("version")() if name == "__version__" else _find(name)


def __dir__() -> list[str]:
    return sorted({*_names(), "__version__"})
