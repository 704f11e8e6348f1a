"""The wheel: one py3-none wheel serves every Python, and works away from the checkout. The Blender extension as a zip:
complete, installed and run by Blender's own installer. One file, so that the wheel is built once."""

import json
import os
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pecs
import pytest
import tomllib

INSTALL_AND_RUN = """
import subprocess, sys
from pathlib import Path
sys.path.append(sys.argv[1])  # bpy and numpy, without the checkout that .pth files name
import bpy
assert bpy.ops.extensions.package_install_files(repo="user_default", filepath=sys.argv[2], enable_on_install=True) == {"FINISHED"}
from bl_ext.user_default.pecs_blender.cli import _parser, main
from bl_ext.user_default.pecs_blender.ui.settings import render_arguments
scene = bpy.context.scene
for lens in ("none", "pecs_lab_15mm"):  # what the panel asks for is what the command takes
    scene.pecs.lens = lens
    assert _parser().parse_args(["render", "-o", "s", *render_arguments(scene)]).lens == lens
code = main(["light", "--help"])
pecs = sys.modules["pecs"]
from bl_ext.user_default.pecs_blender.scene.cycles import empty_scene
empty_scene()  # Blender removes the wheels of extensions that its preferences do not list
print(len(pecs.bands("imx636", 4)), "bands")
if (Path(pecs.__file__).parent / "_lib/bin/pecs").exists():
    assert subprocess.check_output([pecs.program(), "--version"], text=True).split() == ["pecs", pecs.__version__]
print(pecs.__file__, file=sys.stderr)
sys.exit(code)
"""  # noqa: E501


@pytest.fixture(scope="module")
def wheel(root, tmp_path_factory):
    """The Python package as users install it; with the program where scripts/packaging/wheel_libraries.sh has run."""
    out = tmp_path_factory.mktemp("wheel")
    subprocess.run([sys.executable, root / "scripts/packaging/make_wheels.py", "--plain", "-o", out], check=True)
    (path,) = out.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def extension(root, wheel, tmp_path_factory):
    pytest.importorskip("auditwheel")
    out = tmp_path_factory.mktemp("extension")
    command = [sys.executable, root / "scripts/packaging/make_extension.py", "--wheel", wheel, "-o", out]
    subprocess.run(list(map(str, command)), check=True, capture_output=True)
    (path,) = out.glob("*.zip")
    return path


INSTALL = """
import sys
sys.path.append(sys.argv[1])
import bpy
for path in sys.argv[2:]:
    assert bpy.ops.extensions.package_install_files(repo="user_default", filepath=path) == {"FINISHED"}
"""


@pytest.fixture
def blender(extension, tmp_path):
    """Runs code in bpy, which has Blender's extension installer, with a user's folders in tmp_path and without this
    checkout."""
    bpy_folder = Path(pytest.importorskip("numpy").__file__).parents[1]
    if not (bpy_folder / "bpy").is_dir():
        pytest.skip("needs bpy")
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | {"BLENDER_USER_RESOURCES": str(tmp_path)}

    def run(code, *words):
        command = [sys.executable, "-S", "-P", "-c", code, str(bpy_folder), *map(str, words)]
        result = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert result.returncode == 0, result.stderr
        return result

    return run


def test_it_carries_its_libraries(root, extension):
    with zipfile.ZipFile(extension) as archive:
        names = archive.namelist()
        page = archive.read("manual/panel.html").decode()
        assert b"pecs fit" in archive.read("manual/fit_camera.html")
        manifest = tomllib.loads(archive.read("blender_manifest.toml").decode())
        (wheel,) = manifest["wheels"]
        with zipfile.ZipFile(archive.open(wheel.removeprefix("./"))) as inside:
            held = inside.namelist()
            listed = json.loads(inside.read(next(n for n in held if n.endswith("sboms/auditwheel.cdx.json"))))
            record = inside.read(next(n for n in held if n.endswith("/RECORD"))).decode()
    libraries = [n for n in held if n.startswith("pecs_sim.libs/lib")]
    assert "__init__.py" in names and "camera/stage.py" in names and not [n for n in names if n.endswith(".pyc")]
    pictures = (root / "docs/start/panel.md").read_text().count("![")
    assert page.count('src="data:image/png;base64,') == pictures > 0 and "href=" not in page
    assert manifest["version"] == (root / "VERSION").read_text().strip()
    assert any("OpenEXR" in n for n in libraries) and any("libtbb" in n for n in libraries)
    texts = {n.split("/")[-1].removesuffix(".txt") for n in held if "/licenses/third_party/" in n}
    assert {"libtbb12", "libeigen3-dev"} | {c["name"] for c in listed["components"]} - {"pecs_sim"} <= texts
    assert sorted(line.split(",")[0] for line in record.splitlines()) == sorted(held)


def test_blender_installs_and_runs_it(blender, extension, tmp_path):
    """libpecs comes from the extension's wheel."""
    result = blender(INSTALL_AND_RUN, extension)
    assert "4 bands" in result.stdout.splitlines()
    assert str(tmp_path) in result.stderr.splitlines()[-1]


def test_a_new_build_of_the_same_version_replaces_the_old_one(root, blender, extension, tmp_path, monkeypatch):
    """Blender keeps a wheel of the version that is there; so each build has its own. The later ones are small."""
    monkeypatch.syspath_prepend(root / "scripts/packaging")
    from make_extension import extension as zip_of
    from wheels import files_of, write_wheel

    with zipfile.ZipFile(extension) as archive:
        (name,) = (n for n in archive.namelist() if n.startswith("wheels/"))
        files = files_of(Path(archive.extract(name, tmp_path)))
    files = {n: file for n, file in files.items() if ".dist-info/" in n or n == "pecs/__init__.py"}
    again = tmp_path / name
    write_wheel(files | {"pecs/new.txt": (b"a newer build", 0o644)}, again, 10**9)
    blender(INSTALL, extension, zip_of(again, tmp_path))
    (package,) = tmp_path.glob("extensions/.local/lib/python3*/site-packages/pecs")
    assert (package / "new.txt").read_text() == "a newer build"
    assert len(list(package.parent.glob("pecs_sim-*.dist-info"))) == 1
    for tag, platform in (("win_amd64", "windows-x64"), ("macosx_11_0_arm64", "macos-arm64")):
        of_another = tmp_path / f"{'-'.join(again.name.split('-')[:2])}-py3-none-{tag}.whl"
        write_wheel(files_of(again), of_another, 10**9)
        with zipfile.ZipFile(zip_of(of_another, tmp_path)) as archive:
            assert f'platforms = ["{platform}"]' in archive.read("blender_manifest.toml").decode()
        assert archive.filename.endswith(f"-{platform}.zip")


def test_tag_and_contents(wheel):
    assert "-py3-none-linux_" in wheel.name
    names = zipfile.ZipFile(wheel).namelist()
    assert [n for n in names if "libpecs" in n] == ["pecs/_lib/libpecs.so"]  # a zip has no links
    data = "pecs/_lib/share/pecs"
    weights = ("pecs/learning/network.onnx",)
    for name in (
        *weights,
        "pecs/py.typed",
        f"{data}/sensor/chips/imx636.json",
        f"{data}/sensor/presets/v2e_noisy.json",
        f"{data}/lens_data/lenses/pecs_lab_15mm.json",
    ):
        assert name in names
    assert not [n for n in names if n.startswith(("tests/", "include/", "share/"))]


def test_works_away_from_the_checkout(root, wheel, tmp_path):
    venv.create(tmp_path / "v", with_pip=True, system_site_packages=False)
    python = tmp_path / "v" / "bin" / "python"
    subprocess.run([python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", wheel], check=True)
    code = "import pecs; print(pecs.__version__, pecs.__file__); assert len(pecs.bands(n=6)) == 6"
    bare = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PECS_LIBRARY", "PECS_PROGRAM")}
    result = subprocess.run([python, "-c", code], cwd=tmp_path, env=bare, check=True, capture_output=True, text=True)
    version, where = result.stdout.split()
    assert version == wheel.name.split("-")[1]
    assert str(tmp_path) in where
    libraries = bare | {
        "LD_LIBRARY_PATH": str(root / "build" / "wheel-libraries" / "lib")
    }  # auditwheel puts them inside
    for command in ([tmp_path / "v/bin/pecs"], [python, "-m", "pecs"]):
        answer = subprocess.run([*command, "bands", "-n", "6"], env=libraries, capture_output=True, text=True)
        assert answer.returncode == 0 and "nm" in answer.stdout, answer.stderr
    for command, code, words in (("demo", 0, "usage: pecs demo"), ("dataset", 6, "the package scipy is missing; run ")):
        command = [tmp_path / "v/bin/pecs", command, "--help"]
        answer = subprocess.run(command, env=libraries, capture_output=True, text=True)
        assert answer.returncode == code and words in answer.stdout + answer.stderr, answer.stderr


def test_program(root, monkeypatch):
    monkeypatch.delenv("PECS_PROGRAM", raising=False)
    answer = subprocess.run([pecs.program(), "--version"], capture_output=True, text=True, check=True)
    assert answer.stdout.split() == ["pecs", pecs.__version__]
    monkeypatch.setenv("PECS_PROGRAM", __file__)
    assert str(pecs.program()) == __file__
    monkeypatch.setenv("PECS_PROGRAM", "/elsewhere/pecs")
    with pytest.raises(pecs.PecsNotFoundError, match="PECS_PROGRAM: /elsewhere/pecs: no such file"):
        pecs.program()
    for named, words in ("/elsewhere/pecs", "no such file"), (__file__, f"{__file__}: Permission denied"):
        monkeypatch.setenv("PECS_PROGRAM", named)
        answer = subprocess.run([sys.executable, "-m", "pecs", "--version"], capture_output=True, text=True)
        assert (answer.returncode, words in answer.stderr) == (3, True), answer
