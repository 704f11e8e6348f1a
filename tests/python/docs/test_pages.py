"""The pages as a reader uses them: their commands and their Python run from top to bottom, options and files that they
name exist, links lead somewhere.

A block that is not run says why in a comment before it: `<!-- not run: REASON -->`. `<!-- run with: OPTIONS -->` adds
options to the renders of a block, so that they take seconds. A block of JSON, TOML or Python with a title is a
file. A text block with the title "printed" lists lines that the block before it prints."""

import io
import json
import os
import re
import subprocess
import sys
from contextlib import redirect_stdout
from functools import cache

import pytest
from pecs._arguments import latest
from support import ROOT, in_bpy, load_script
from support.labels import Rectangle, write_truth
from support.printed import PRINTED, assert_printed
from support.small_stacks import write

BLOCK = re.compile(
    r"(?:<!-- (not run|run with): ([^>]+) -->\n)? *```(sh|python|json|toml)([^\n]*)\n(.*?)```", re.DOTALL
)
RENDER = re.compile(r"^((?:(?:python -m )?pecs_blender render|pecs run) (?:[^\n\\]|\\\n)*)", re.MULTILINE)
RUN_ELSEWHERE = {"docs/reference/trajectories.md"}  # datasets/test_trajectories.py, which also reads its tables
FOLDERS = ("apps blender_addon calibration common docs examples lens_data python scenes scripts sensor tests").split()


def pages():
    found = subprocess.run(["git", "ls-files", "*.md"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return sorted(name for name in found.split() if (ROOT / name).is_file())


def text_of(page):
    return (ROOT / page).read_text()


def blocks(page):
    """(mark, reason or options, language, title, text) of each block that could run."""
    return [match.groups() for match in BLOCK.finditer(text_of(page))]


def stack_and_truth(folder):
    write(folder / "stack")
    write_truth(folder / "truth", Rectangle(), 1, light=False)


def my_blend(folder):
    code = "import bpy; from pecs_lab import blend as b; b.start(); b.lamp(energy=2000)\n"
    code += "ball = b.ball(b.material('grey', ('ShaderNodeBsdfDiffuse', {'Color': b.GREY}))[0])\n"
    code += (
        "for frame, x in ((1, -0.5), (2, 0.5)): ball.location.x = x; ball.keyframe_insert('location', frame=frame)\n"
    )
    code += f"bpy.ops.wm.save_as_mainfile(filepath='{folder}/my.blend')"
    in_bpy(code)


INPUTS = {
    "docs/reference/python.md": stack_and_truth,
    "docs/start/own_blend.md": my_blend,
    "docs/howto/add_pixel_model.md": lambda folder: write(folder / "stack"),
}  # what a page takes as given


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    """A folder that looks like the checkout, to write into; the program and Python as a reader has them."""
    for entry in ROOT.iterdir():
        if entry.name not in ("out", ".git", ".pytest_cache"):
            (tmp_path / entry.name).symlink_to(entry)
    (tmp_path / "out").mkdir()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{ROOT}/build/release/bin:{os.path.dirname(sys.executable)}:{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}/python:{ROOT}/blender_addon")
    return tmp_path


def run_shell(text, options):
    """The output of the command."""
    added = lambda match: " ".join(latest(f"{match[1]} {options}".replace("\\\n", " ").split()))  # noqa: E731
    command = RENDER.sub(added, text) if options else text
    done = subprocess.run(["bash", "-euo", "pipefail", "-c", command], capture_output=True, text=True)
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout + done.stderr


@pytest.mark.parametrize("page", [p for p in pages() if blocks(p) and p not in RUN_ELSEWHERE])
def test_what_a_page_says_runs(page, workplace):
    found = [block for block in blocks(page) if block[0] != "not run"]
    if not found:
        pytest.skip("; ".join(sorted({why for _, why, *_ in blocks(page)})))
    INPUTS.get(page, lambda folder: None)(workplace)
    names, printed = {}, dict(PRINTED.findall(text_of(page)))
    assert len(printed) == text_of(page).count('title="printed"'), f"{page}: printed text without a block before it"
    for mark, options, language, title, text in found:
        if file := re.search(r'title="([\w.]+)"', title):
            (workplace / file[1]).write_text(text)
        if language == "python":
            with redirect_stdout(io.StringIO()) as output:
                exec(text, names)
            prints = output.getvalue()
        elif language == "sh":
            prints = run_shell(text, options if mark else "")
        if text in printed:
            assert_printed(printed[text], prints)
    if page == "docs/reference/python.md":
        assert len(names["events"]) > 100 and len(names["noise"]) > 0 and names["on"] > 0


def test_rendered_frames_fit_on_the_chips_of_later_commands():
    """At the sizes as printed: `run with` renders smaller ones."""
    checked = 0
    for page in pages():
        sizes = {}
        for _, _, language, _, text in blocks(page):
            for line in re.sub(r"\\\n\s*", " ", text).splitlines() if language == "sh" else ():
                size = re.search(r"--width (\d+) --height (\d+)", line)
                named = re.search(r"--chip (\w+)", line)
                chip = ROOT / f"sensor/chips/{named[1] if named else ''}.json"
                name = re.search(r"-o (\S+)\.(?:raw|stack)\b", line)
                if size and name:
                    sizes[f"{name[1]}.stack"] = int(size[1]), int(size[2])
                used = re.match(r"pecs sense (\S+)", line)
                size = sizes.get(used[1] if used else f"{name[1]}.stack" if name else "")
                if size and chip.is_file():
                    values = json.loads(chip.read_text())["values"]
                    limits = [values[key]["value"] for key in ("width", "height")]  # 0: no limit
                    assert all(n <= limit or not limit for n, limit in zip(size, limits, strict=True)), (
                        f"{page}: {line}"
                    )
                    checked += 1
    assert checked >= 4


def test_every_block_that_is_not_run_says_why():
    for page in pages():
        for mark, why, language, _, text in blocks(page):
            if language not in ("json", "toml"):
                assert mark != "not run" or len(why.split()) > 4, f"{page}: {text}"
            assert mark != "run with" or RENDER.search(text), f"{page}: no render to add options to"
        assert len(re.findall("<!-- (?:not run|run with)", text_of(page))) == sum(bool(b[0]) for b in blocks(page)), (
            page
        )


@cache
def helps():
    """Command -> its --help."""
    script = load_script(ROOT / "scripts/docs/commands.py")
    return dict(script.all_commands())


def written_commands(page):
    """Command lines in indented blocks, shell blocks and inline code."""
    text = re.sub(r"\\\n\s*", " ", text_of(page))
    shell = re.findall(r"```(?:sh|text)\n(.*?)```", text, re.DOTALL)
    indented = [re.sub(r"\n +(?=\[)", " ", part) for part in re.findall(r"(?:^    .*\n)+", text, re.MULTILINE)]
    inline = [code.replace("\n", " ") for code in re.findall(r"(?<!`)`([^`]+)`(?!`)", text)]
    for line in "\n".join([*shell, *indented, *inline]).split("\n"):
        line = re.sub(
            r"^(?:\.venv/bin/)?python (?:-m pecs_blender|scripts/tools/)",
            lambda m: m[0].split("/bin/")[-1],
            line.strip(),
        )
        line = re.sub(r"^build/release/bin/pecs", "pecs", line)
        if re.match(r"pecs |python -m pecs_blender |(?:python )?scripts/tools/\w+\.py", line):
            yield line.removeprefix("python ") if "scripts/tools/" in line[:14] else line


def test_options_that_pages_name_exist():
    """For commands that are shown and not only for those that run: synopses too."""
    seen = 0
    for page in pages():
        if page == "CHANGELOG.md":  # past commands
            continue
        for line in written_commands(page):
            command = max((name for name in helps() if f"{line} ".startswith(f"{name} ")), key=len, default=None)
            assert command, f"{page}: {line}: no such command"
            for option in re.findall(r"(?<![\w-])--[a-z][\w-]*", line.split(" -- ")[0]):
                seen += 1
                assert re.search(rf"{re.escape(option)}(?![\w-])", helps()[command]), (
                    f"{page}: {command} has no {option}"
                )
    assert seen > 100


def test_files_that_pages_name_exist():
    for page in pages():
        if page == "CHANGELOG.md":
            continue
        for code in re.findall(r"(?<!`)`([^`\n]+)`(?!`)", text_of(page)):
            for name in re.findall(rf"^(?:{'|'.join(FOLDERS)})/[\w./-]+", code):
                if not re.search(r"[A-Z]{4,}|\*|…", code):  # a place to be filled in
                    beside = (ROOT / page).parent / name
                    assert (ROOT / name).exists() or beside.exists(), f"{page}: {code}"


def slugs(page):
    """Anchors of a page's headings, as the site and code hosts make them; and its own."""
    text = re.sub(r"```.*?```", "", text_of(page), flags=re.DOTALL)
    heads = [
        re.sub(r"[`*]|\[([^\]]*)\]\([^)]*\)", r"\1", head) for head in re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    ]
    return {re.sub(r"[\s-]+", "-", re.sub(r"[^\w\s-]", "", head).strip().lower()) for head in heads}


def test_links_lead_somewhere():
    count = 0
    for page in pages():
        text = re.sub(r"```.*?```|`[^`\n]*`", "", text_of(page), flags=re.DOTALL)
        for target, anchor in re.findall(r"\]\(([^)#\s]*)#?([^)\s]*)\)", text):
            if re.match(r"[a-z]+:", target) or target.startswith(
                "c/"
            ):  # Doxygen's pages are there when the site is built
                continue
            path = ((ROOT / page).parent / target).resolve() if target else ROOT / page
            assert path.exists(), f"{page}: {target}"
            if anchor:
                assert anchor in slugs(path.relative_to(ROOT).as_posix()), f"{page}: {target}#{anchor}"
            count += 1
    assert count > 100


def test_every_page_is_in_the_navigation():
    """And every entry is a page."""
    entries = set(re.findall(r"[\w/.]+\.md", (ROOT / "mkdocs.yml").read_text().split("\nnav:")[1]))
    elsewhere = {entry for entry in entries if entry.startswith("repo/")}  # pages and notebooks of examples
    assert all((ROOT / entry[5:].removesuffix(".md" * entry.endswith(".ipynb.md"))).is_file() for entry in elsewhere)
    entries -= elsewhere
    entries.remove("reference/commands.md")  # scripts/docs.sh writes it
    there = [page.removeprefix("docs/") for page in pages() if page.startswith("docs/")]
    assert sorted(entries) == there


def test_scripts_that_pages_call_find_their_python(tmp_path):
    """That of this tree, whatever `python3` is and wherever one stands."""
    called = {
        name
        for page in pages()
        for name in re.findall(r"(?:^ *|`)(scripts/tools/\w+\.py) \S", text_of(page), re.MULTILINE)
    }
    scripts = (ROOT / "scripts").glob("*/*.py")
    scripts = [path for path in scripts if path.read_text().startswith("#!") or f"scripts/tools/{path.name}" in called]
    assert called and len(scripts) > 10
    for path in scripts:
        assert ".venv/bin/python" in path.read_text().split("\n")[0] and os.access(path, os.X_OK), path
    bare = {"PATH": "/usr/bin:/bin"}
    for name in called:
        done = subprocess.run([ROOT / name, "--help"], cwd=tmp_path, env=bare, capture_output=True, text=True)
        assert done.returncode == 0 and done.stdout.startswith("usage: "), (name, done.stderr)


def test_all_files_name_one_version():
    done = subprocess.run([ROOT / "scripts/release.sh", "--versions"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
