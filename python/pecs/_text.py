"""Text of foreign files (names, descriptions) where it goes: one function for each target.

Readers refuse control characters in it (`is_plain`). What becomes part of a path is a `is_file_name`; what goes into a
table of Markdown is escaped by `markdown` there; the library escapes the text of pages (_pages.py).
"""

from __future__ import annotations

import re
import unicodedata

MOST_BYTES = 100  # of a name in a path; endings and numbers are added
_MARKDOWN = re.compile(r"([\\`*\[\]!|~&<>])")


def is_plain(text: str, lines: bool = False) -> bool:
    """Without control characters and separators of lines; `lines`: with line feeds and tabs."""
    return not any(
        unicodedata.category(c) in ("Cc", "Cs", "Zl", "Zp") and not (lines and c in "\n\t") for c in set(text)
    )


def is_file_name(text: str) -> bool:
    """A name that adds exactly one step to a path, on every file system."""
    return text not in ("", ".", "..") and "/" not in text and is_plain(text) and len(text.encode()) <= MOST_BYTES


def markdown(value: object) -> str:
    """Escaped, and in one line."""
    return _MARKDOWN.sub(r"\\\1", " ".join(str(value).split()))


def counted(number: int, thing: str) -> str:
    """A number of things, with the plural in s."""
    return f"{number} {thing}{'s' * (number != 1)}"
