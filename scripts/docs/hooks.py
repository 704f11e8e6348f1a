"""Hooks of mkdocs.yml. The site holds the pages of docs/, what those link to elsewhere in the repository
(under repo/, notebooks as pages, other files that are not Markdown as listings) and what scripts/docs.sh generates into
out/docs."""

import json
import posixpath
import re
from pathlib import Path

from mkdocs.structure.files import File

ROOT = Path(__file__).resolve().parents[2]
GENERATED = ROOT / "out/docs"
LINK = re.compile(r"(\]\()([^)#\s]+)((?:#[^)\s]*)?\))")
PICTURES = (".png", ".svg", ".jpg")


def prose(text):
    """The parts of a page that are no code, and those that are, in turn."""
    return re.split(r"(```.*?```|`[^`\n]*`)", text, flags=re.DOTALL)


def repository_path(source, link):
    """The path in the repository that a relative link of a page means, or None. A folder means its README."""
    if re.match(r"[a-z][a-z+.-]*:|/", link):
        return None
    path = posixpath.normpath(posixpath.join(posixpath.dirname(source), link))
    return f"{path}/README.md" if (ROOT / path).is_dir() else path


def site_path(path):
    """The site's address of a file of the repository."""
    if path.startswith("docs/"):
        return path.removeprefix("docs/")
    return f"repo/{path}" if path.endswith((".md", *PICTURES)) else f"repo/{path}.md"


def linked(start):
    """Files outside docs/ that pages link to, and so on."""
    found, queue = set(), list(start)
    while queue:
        page = queue.pop()
        for part in prose((ROOT / page).read_text(encoding="utf-8"))[::2]:
            for _, link, _ in LINK.findall(part):
                path = repository_path(page, link)
                if path is None or path in found or path.startswith("docs/") or not (ROOT / path).is_file():
                    continue
                found.add(path)
                if path.endswith(".md"):
                    queue.append(path)
    return found


def notebook(path):
    """Its text and its code; picture.png of its folder is what it draws."""
    cells = json.loads((ROOT / path).read_text(encoding="utf-8"))["cells"]
    text = [(cell["cell_type"], "".join(cell["source"])) for cell in cells]
    parts = [source if kind == "markdown" else f"```python\n{source}\n```" for kind, source in text]
    return "\n\n".join([*parts, "![What the notebook draws](picture.png)"]) + "\n"


def listing(path):
    if path.endswith(".ipynb"):
        return notebook(path)
    language = {".c": "c", ".h": "c", ".py": "python", ".toml": "toml", ".json": "json", ".sh": "bash"}
    text = (ROOT / path).read_text(encoding="utf-8")
    return f"# {path}\n\n````{language.get(Path(path).suffix, 'text')}\n{text}\n````\n"


def on_files(files, config):
    pages = [f"docs/{file.src_uri}" for file in files if file.src_uri.endswith(".md")]
    for path in sorted(linked(pages)):
        whole = path.endswith((".md", *PICTURES))
        given = {"abs_src_path": str(ROOT / path)} if whole else {"content": listing(path)}
        files.append(File.generated(config, site_path(path), **given))
    for path in sorted(GENERATED.rglob("*")):
        if path.is_file() and path.suffix != ".log":
            name = path.relative_to(GENERATED).as_posix()
            files.append(File.generated(config, f"reference/{name}", abs_src_path=str(path)))
    return files


def on_page_markdown(markdown, page, config, files):
    uri = page.file.src_uri
    source = uri.removeprefix("repo/") if uri.startswith("repo/") else f"docs/{uri}"
    base = posixpath.dirname(uri)

    def moved(match):
        path = repository_path(source, match[2])
        if path is None:
            return match[0]
        return f"{match[1]}{posixpath.relpath(site_path(path), base or '.')}{match[3]}"

    parts = prose(markdown)
    parts[::2] = [LINK.sub(moved, part) for part in parts[::2]]
    return "".join(parts)
