"""Data sets of events with ground truth: reading them, training with them, and writing them in others' formats
(docs/reference/dataset_formats.md)."""

from typing import TYPE_CHECKING

from .._lazy import attributes

if TYPE_CHECKING:
    from . import writers
    from .event_file import EventFile
    from .sequence import IMU_DTYPE, Camera, Frame, Sequence, sequences
    from .truth import BOX_DTYPE, Truth
    from .windows import WINDOW_DTYPE, Windows, collate

__all__ = [
    "BOX_DTYPE", "Camera", "EventFile", "Frame", "IMU_DTYPE", "Sequence", "Truth", "WINDOW_DTYPE", "Windows", "collate",
    "sequences", "writers",
]  # fmt: skip
_MODULES = {
    "event_file": "EventFile",
    "sequence": "Camera Frame IMU_DTYPE Sequence sequences",
    "truth": "BOX_DTYPE Truth",
    "windows": "WINDOW_DTYPE Windows collate",
    "writers": "",
}
__getattr__, __dir__ = attributes(__name__, _MODULES)
