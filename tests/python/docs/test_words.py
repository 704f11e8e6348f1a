"""Preferred terms, in pages, comments, messages and names alike."""

import re
import subprocess

from support import ROOT

PREFERRED = {  # regular expression: what to write instead
    r"rising times|times (that )?(rise|fall)|falling times": "increasing (decreasing) timestamps",
    r"but for": "except",
    r"anew": "again, re-",
    r"nobody|somebody|no one": "name who, or use the passive",
    r"without a word|for ever": "silently, indefinitely",
    r"what is no|that is no": "which is not",
}
SUFFIXES = ("cmake", "cpp", "h", "md", "py", "sh", "toml", "txt", "yml")
OWN_WORDS = ("CHANGELOG.md", "tests/python/docs/test_words.py", "tests/python/support/outside/")


def test_preferred_terms():
    patterns = [f"*.{suffix}" for suffix in SUFFIXES]
    names = subprocess.run(["git", "ls-files", *patterns], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    found = []
    for name in names.splitlines():
        if name.startswith(OWN_WORDS):
            continue
        for number, line in enumerate((ROOT / name).read_text().splitlines(), 1):
            for word, preferred in PREFERRED.items():
                if match := re.search(rf"\b(?:{word})\b", line, re.IGNORECASE):
                    found.append(f"{name}:{number}: {match[0]}: write: {preferred}")
    assert not found, "\n".join(found)
