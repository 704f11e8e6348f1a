#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Checks that every link inside a built site leads to a file that is there, and to a place in it that is there. Links
to other sites are not followed: the check needs no network.

scripts/docs/links.py SITE
"""

import sys
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class Links(HTMLParser):
    def __init__(self):
        super().__init__()
        self.links, self.ids = [], set()

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        self.links += [attrs[key] for key in ("href", "src") if attrs.get(key)]
        self.ids |= {attrs[key] for key in ("id", "name") if attrs.get(key)}


@cache
def read(path: Path) -> Links:
    links = Links()
    links.feed(path.read_text(encoding="utf-8"))
    return links


def broken(site: Path):
    """(page, link) of each link that leads nowhere."""
    for page in sorted(site.rglob("*.html")):
        for link in read(page).links:
            url = urlsplit(link)
            if url.scheme or url.netloc:
                continue
            base = site if url.path.startswith("/") else page.parent
            target = (base / unquote(url.path).lstrip("/")).resolve() if url.path else page
            target = target / "index.html" if target.is_dir() else target
            fragment = unquote(url.fragment)
            if not target.is_file() or (fragment and target.suffix == ".html" and fragment not in read(target).ids):
                yield page.relative_to(site), link


def main():
    site = Path(sys.argv[1]).resolve()
    pages = len(list(site.rglob("*.html")))
    if not pages:
        sys.exit(f"links.py: {site}: got no pages, wanted a built site")
    found = list(broken(site))
    for page, link in found:
        print(f"{page}: {link}", file=sys.stderr)
    print(f"{pages} pages, {len(found)} links that lead nowhere")
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
