"""PECS: a physically based event-camera simulator. Thin ctypes over one C library (python/c/include/pecs.h;
docs/reference/python.md)."""

from ._library import PecsError, PecsInputError, PecsNotFoundError, PecsOutputError, data_dir, version
from ._program import program
from ._sense import sense
from .chip import Chip, bands, models
from .events import EVENT_DTYPE, EventReader, Events, EventWriter, event_formats, read, write
from .lens import Camera, Lens
from .light import Light
from .metrics import compare, delays
from .motion import carry, carry_labels, event_labels
from .representations import event_histogram, time_surface, voxel_grid
from .sensor import Sensor, simulate
from .stack import StackReader, StackWriter

__version__ = version()
__all__ = [
    "Camera",
    "Chip",
    "EVENT_DTYPE",
    "EventReader",
    "EventWriter",
    "Events",
    "Lens",
    "Light",
    "PecsError",
    "PecsInputError",
    "PecsNotFoundError",
    "PecsOutputError",
    "Sensor",
    "StackReader",
    "StackWriter",
    "bands",
    "carry",
    "carry_labels",
    "compare",
    "data_dir",
    "delays",
    "event_formats",
    "event_histogram",
    "event_labels",
    "models",
    "program",
    "read",
    "sense",
    "simulate",
    "time_surface",
    "version",
    "voxel_grid",
    "write",
]
