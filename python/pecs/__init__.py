"""PECS: a physically based event-camera simulator. Thin ctypes over one C library (include/pecs.h)."""

from ._library import PecsError, version
from .sensor import bands

__version__ = version()
__all__ = ["PecsError", "bands", "version"]
