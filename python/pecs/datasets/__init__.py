"""Data sets of events with ground truth: reading them (docs/dataset_formats.md says into which formats they go)."""

from .event_file import EventFile
from .sequence import Camera, Frame, Sequence, sequences
from .truth import Truth

__all__ = ["Camera", "EventFile", "Frame", "Sequence", "Truth", "sequences"]
