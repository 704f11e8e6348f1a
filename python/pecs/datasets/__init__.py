"""Data sets of events with ground truth: reading them, and writing them in the formats of others
(docs/dataset_formats.md)."""

from . import writers
from .event_file import EventFile
from .sequence import IMU_DTYPE, Camera, Frame, Sequence, sequences
from .truth import BOX_DTYPE, Truth

__all__ = ["BOX_DTYPE", "Camera", "EventFile", "Frame", "IMU_DTYPE", "Sequence", "Truth", "sequences", "writers"]
