"""PECS: a physically based event-camera simulator. Thin ctypes over one C library (include/pecs.h)."""

from ._library import PecsError, data_dir, version
from .events import EVENT_DTYPE, EventReader, EventWriter, event_formats, read, write
from .lens import Camera, Lens
from .metrics import compare, delays
from .sensor import Sensor, bands, simulate
from .stack import StackReader, StackWriter

__version__ = version()
__all__ = [
    "Camera",
    "EVENT_DTYPE",
    "EventReader",
    "EventWriter",
    "Lens",
    "PecsError",
    "Sensor",
    "StackReader",
    "StackWriter",
    "bands",
    "compare",
    "data_dir",
    "delays",
    "event_formats",
    "read",
    "simulate",
    "version",
    "write",
]
