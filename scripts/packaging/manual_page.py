"""The manual's page inside the extension: docs/start/panel.md as one HTML file, which opens without a network."""

import base64
import re
from pathlib import Path

import markdown

PAGE = Path(__file__).resolve().parents[2] / "docs/start/panel.md"
STYLE = "body{max-width:50em;margin:2em auto;font:16px/1.5 sans-serif}img{max-width:100%}td{padding:.2em .6em}"


def html() -> str:
    """With its pictures inside; links to other pages, which the extension does not hold, are plain words."""
    body = markdown.markdown(PAGE.read_text(), extensions=["tables"], output_format="html")
    body = re.sub(r'<a href="(?!https?:)[^"]*">(.*?)</a>', r"\1", body, flags=re.DOTALL)
    body = re.sub(r'src="([^":]+)"', _inside, body)
    return f'<!doctype html><meta charset="utf-8"><title>PECS in Blender</title><style>{STYLE}</style>\n{body}\n'


def _inside(match: re.Match) -> str:
    data = base64.b64encode((PAGE.parent / match[1]).read_bytes()).decode()
    return f'src="data:image/png;base64,{data}"'
