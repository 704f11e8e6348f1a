"""What `cmake --install` leaves: the program, its data, and a library that C finds and links."""

import os
import subprocess

import pecs
import pytest

BARE = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PECS_LIBRARY", "PECS_DATA")}


def run(*command, **options):
    return subprocess.run(list(map(str, command)), capture_output=True, text=True, env=BARE, **options)


def succeed(*command, **options):
    done = run(*command, **options)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def prefix(root, tmp_path_factory):
    build = next(b for b in (root / "build/release", root / "build/dev") if (b / "bin/pecs").is_file())
    prefix = tmp_path_factory.mktemp("prefix")
    succeed("cmake", "--install", build, "--prefix", prefix)
    return prefix


def test_the_program_finds_its_data(prefix, tmp_path):
    program = prefix / "bin" / "pecs"
    assert "EFL" in succeed(program, "lens", "info", "dgauss_50mm_tronnier", cwd=tmp_path)
    assert "wavelength" in succeed(program, "bands", "--chip", "imx636", "-n", 3, cwd=tmp_path).lower()


def test_the_library_has_its_names(prefix):
    (library,) = prefix.glob("lib*/libpecs.so")
    names = [library.name, os.readlink(library), os.readlink(library.parent / os.readlink(library))]
    assert names == ["libpecs.so", "libpecs.so.0", f"libpecs.so.{pecs.__version__}"]


@pytest.fixture(scope="module")
def example(root, prefix, tmp_path_factory):
    build = tmp_path_factory.mktemp("example")
    flags = [f"-DCMAKE_PREFIX_PATH={prefix}", "-DCMAKE_C_FLAGS=-Werror"]
    succeed("cmake", "-G", "Ninja", "-S", root / "examples" / "c", "-B", build, *flags)
    succeed("cmake", "--build", build)
    return build / "simulate_frames"


def test_the_example_in_c(example, tmp_path):
    said = succeed(example, "bar.raw", cwd=tmp_path)
    events = pecs.read(tmp_path / "bar.raw")
    assert said == f"{len(events)} events in bar.raw, by PECS {pecs.__version__}\n"
    assert len(events) > 10_000 and (events.width, events.height) == (320, 240)


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["a.raw", "nope"], 3, "none of"),
        (["none/a.raw"], 5, "cannot be written"),
        (["a.xyz"], 2, "a.xyz"),
        ([], 2, "usage"),
    ],
)
def test_its_wrong_uses(example, tmp_path, arguments, code, words):
    done = run(example, *arguments, cwd=tmp_path)
    assert done.returncode == code and words in done.stderr and done.stderr.count("\n") == 1


def test_pkg_config(prefix, root, tmp_path):
    (folder,) = prefix.glob("lib*/pkgconfig")
    flags = subprocess.run(
        ["pkg-config", "--cflags", "--libs", "pecs"],
        env=BARE | {"PKG_CONFIG_PATH": str(folder)},
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    succeed("cc", root / "examples/c/simulate_frames.c", "-o", tmp_path / "a", *flags, f"-Wl,-rpath,{folder.parent}")
    assert "events in" in succeed(tmp_path / "a", "bar.csv", cwd=tmp_path)
