"""What a writer wrote, and what it left out."""

from __future__ import annotations

from typing import Any


class Report:
    """`count` adds up numbers of a sequence; `leave_out` is said once for each reason."""

    def __init__(self) -> None:
        self.sequences: dict[str, dict[str, Any]] = {}
        self.left_out: dict[tuple[str, str], list[str]] = {}
        self.more: dict[str, Any] = {}

    def count(self, sequence: str, **numbers: int) -> None:
        counts = self.sequences.setdefault(sequence, {})
        for key, number in numbers.items():
            counts[key] = counts.get(key, 0) + int(number)

    def leave_out(self, what: str, why: str, sequence: str = "") -> None:
        names = self.left_out.setdefault((what, why), [])
        if sequence and sequence not in names:
            names.append(sequence)

    def as_dict(self) -> dict[str, Any]:
        left = [
            {"what": what, "why": why} | ({"sequences": names} if names else {})
            for (what, why), names in self.left_out.items()
        ]
        return {"sequences": self.sequences, "left_out": left, **self.more}
