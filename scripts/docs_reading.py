#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Checks that docs/start/ and docs/concepts/ can be read by somebody who is new and whose first language is another.

For each page: Flesch reading ease of at least 45, no sentence above 35 words, and no undefined term: every word is
plain (scripts/plain_words.txt) or stands in the glossary (docs/reference/glossary.md, terms in bold). A new word needs
a decision: is it plain English, or a term to be defined? Names of files, options and code are left out.

scripts/docs_reading.py [PAGE...]
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
GLOSSARY = ROOT / "docs/reference/glossary.md"
PLAIN = ROOT / "scripts/plain_words.txt"
FOLDERS = ("start", "concepts")
LEAST_EASE, MOST_WORDS = 45, 35
WORD = re.compile(r"[A-Za-zÀ-ÿ]+(?:['’][a-z]+)?")


def sentences(markdown: str) -> list[str]:
    """The prose of a page, without headings, code, tables, pictures and comments; inline code is one word."""
    text = re.sub(r"<!--.*?-->|```.*?```|!\[[^\]]*\]\([^)]*\)", "", markdown, flags=re.DOTALL)
    paragraphs, lines = [], []
    for line in [*text.split("\n"), ""]:
        is_item = re.match(r"\s*(?:[-*]|\d+\.)\s+", line)
        if not line.strip() or is_item or re.match(r"#|\||    \S|!!!", line):
            paragraphs.append(" ".join(lines))
            lines = [line[is_item.end() :]] if is_item else []
        else:
            lines.append(line.strip())
    found = []
    for paragraph in filter(None, paragraphs):
        words = re.sub(r"`[^`]*`", "code", paragraph)
        words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", words).replace("*", "")
        found += [s for s in re.split(r"(?<=[.!?])\s+", words) if WORD.search(s)]
    return found


def words_of(sentence: str) -> list[str]:
    """Words and numbers; both count for the length."""
    return re.findall(r"[\w.,'’%°µ-]*\w[\w'’%°µ-]*", sentence)


def syllables(word: str) -> int:
    word = re.sub(r"[^a-z]", "", word.lower())
    if len(word) <= 3:
        return 1
    word = re.sub(r"(?:[^laeiouy]es|[^dt]ed|[^laeiouy]e)$", "x", word)  # silent ends
    return max(1, len(re.findall(r"[aeiouy]+", word)))


def reading_ease(found: list[str]) -> float:
    """Flesch 1948: 206.835 - 1.015 words/sentence - 84.6 syllables/word."""
    words = [word for sentence in found for word in words_of(sentence)]
    return 206.835 - 1.015 * len(words) / len(found) - 84.6 * sum(map(syllables, words)) / len(words)


def glossary_words() -> set[str]:
    """Of all terms in bold, and the forms that stand in brackets behind them."""
    heads = re.findall(r"^- (.+?): ", GLOSSARY.read_text(), re.MULTILINE)
    terms = re.findall(r"\*\*(.+?)\*\*", GLOSSARY.read_text()) + re.findall(r"\(([^)]*)\)", " ".join(heads))
    return {word.lower() for term in terms for word in WORD.findall(term)}


def plain_words() -> set[str]:
    lines = [line for line in PLAIN.read_text().splitlines() if not line.startswith("#")]
    return {word for line in lines for word in line.split()}


def bases(word: str):
    """The word, and what it may be a form of."""
    word = re.sub(r"['’]s?$", "", word.lower().replace("’", "'"))
    yield word
    for end, put in (
        ("s", ""),
        ("es", ""),
        ("ies", "y"),
        ("ed", ""),
        ("ed", "e"),
        ("d", ""),
        ("ing", ""),
        ("ing", "e"),
    ):
        if word.endswith(end):
            yield word.removesuffix(end) + put
    yield from (word.removesuffix(end) for end in ("er", "est", "ly") if word.endswith(end))


def unknown(found: list[str], known: set[str]) -> list[str]:
    words = {word for sentence in found for word in WORD.findall(sentence) if len(word) > 1}
    return sorted({word.lower() for word in words if not any(base in known for base in bases(word))})


def faults(page: Path, known: set[str]) -> list[str]:
    found = sentences(page.read_text())
    ease = reading_ease(found)
    lines = [f"reading ease: got {ease:.0f}, wanted at least {LEAST_EASE}"] if ease < LEAST_EASE else []
    for sentence in found:
        if len(words_of(sentence)) > MOST_WORDS:
            lines.append(f"got {len(words_of(sentence))} words, wanted at most {MOST_WORDS}: {sentence}")
    words = unknown(found, known)
    if words:
        lines.append(f"neither plain (scripts/plain_words.txt) nor in the glossary: {' '.join(words)}")
    return lines


def main():
    pages = [Path(name) for name in sys.argv[1:]] or sorted(
        page for folder in FOLDERS for page in (ROOT / "docs" / folder).glob("*.md")
    )
    plain, glossary = plain_words(), glossary_words()
    failed = False
    for page in pages:
        for line in faults(page, plain | glossary):
            failed = True
            print(f"{page}: {line}", file=sys.stderr)
        found = sentences(page.read_text())
        longest = max(len(words_of(sentence)) for sentence in found)
        print(f"{page.name}: {len(found)} sentences, reading ease {reading_ease(found):.0f}, longest {longest} words")
    sys.exit(failed)


if __name__ == "__main__":
    main()
