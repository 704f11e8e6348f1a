"""Configuration files, whole files, errors and child processes, which all Python parts share."""

import os
import pickle
import signal
import subprocess
import sys
import time

import pytest
from pecs import PecsInputError, PecsNotFoundError, PecsOutputError
from pecs._config import Fields, parse_json, read_json
from pecs._errors import ExitCode, PecsError, bad_input, one_line
from pecs._files import whole, write_json
from pecs._platform import die_with_parent


def fields(text):
    return Fields(parse_json(text, "f.json"), "f.json")


def test_fields_return_what_the_file_has():
    top = fields('{"a": 1, "b": "x", "c": [1, 2.5], "d": {"e": true}, "f": [{}, {}], "g": null, "_": "comment"}')
    assert top.integer("a") == top.number("a") == 1 and top.text("b", choices=("x",)) == "x"
    assert top.numbers("c", count=2) == [1, 2.5] and top.table("d").flag("e") is True
    assert len(top.tables("f", least=2)) == 2 and top.array("c", -1).shape == (2,)
    assert top.optional(top.number, "g", low=0) is None and top.number("g", 7.0) == 7
    assert top.texts("h", ["y"]) == ["y"] and top.table("i", {}).keys() == []
    top.done()


@pytest.mark.parametrize(
    ("text", "read", "line"),
    [
        ('{"a": 1}', lambda o: o.done(), "f.json: a: got an unknown key"),
        ("{}", lambda o: o.text("a"), "f.json: a: got nothing, wanted text"),
        ('{"a": true}', lambda o: o.number("a"), "a: got true, wanted a finite number"),
        ('{"a": 1.5}', lambda o: o.integer("a"), "a: got 1.5, wanted a whole number >= 0"),
        ('{"a": 3}', lambda o: o.number("a", low=4, high=5), "a: got 3, wanted a number in [4, 5]"),
        ('{"a": "x"}', lambda o: o.text("a", choices=("y", "z")), 'a: got "x", wanted one of y, z'),
        ('{"a": {"b": [1, "2"]}}', lambda o: o.table("a").numbers("b"), 'a.b: got [1, "2"], wanted a list of numbers'),
        ('{"a": [1]}', lambda o: o.tables("a"), "a[0]: got 1, wanted an object"),
        ('{"a": []}', lambda o: o.tables("a", least=1), "a: got [], wanted a list of 1 or more objects"),
        ('{"a": [[1, 2]]}', lambda o: o.array("a", 2, 2), "a: got [[1, 2]], wanted 2 x 2 finite numbers"),
        ('{"a": [["1", "2"]]}', lambda o: o.array("a", 1, 2), 'a: got [["1", "2"]], wanted 1 x 2 finite numbers'),
        ('{"a": [true, 2]}', lambda o: o.array("a", 2), "a: got [true, 2], wanted 2 finite numbers"),
        ("[]", lambda o: o, "f.json: got [], wanted an object"),
        ('{"a": 1, "a": 2}', lambda o: o, "the key twice"),
        ('{"a": 1e999}', lambda o: o, "wanted finite numbers"),
        ('{"a": NaN}', lambda o: o, "wanted finite numbers"),
        ('{"a": %s}' % ("9" * 5000), lambda o: o, "wanted finite numbers"),
        ("[" * 100_000, lambda o: o, "too many levels"),
        ('{"a": "\\ud800"}', lambda o: o, "surrogate"),
        ("{", lambda o: o, "line 1 column 2"),
    ],
)
def test_wrong_content_is_one_line(text, read, line):
    with pytest.raises(PecsInputError) as error:
        read(fields(text))
    assert line in str(error.value) and "\n" not in str(error.value) and error.value.code == ExitCode.BAD_INPUT


def test_files(tmp_path):
    write_json(tmp_path / "new" / "a.json", {"b": [1]})
    assert read_json(tmp_path / "new" / "a.json") == {"b": [1]}
    with pytest.raises(ZeroDivisionError), whole(tmp_path / "a") as file:
        file.write(b"half")
        raise ZeroDivisionError
    assert [path.name for path in tmp_path.iterdir()] == ["new"]
    with pytest.raises(PecsOutputError, match="cannot be written"):
        write_json(tmp_path / "new" / "a.json" / "b.json", 1)
    with pytest.raises(PecsNotFoundError, match="no.json"):
        read_json(tmp_path / "no.json")
    with pytest.raises(PecsInputError, match="more than 3 bytes"):
        read_json(tmp_path / "new" / "a.json", max_bytes=3)


def test_errors():
    error = bad_input("f", "place", "x" * 99, "less")
    assert str(error) == f"f: place: got {'x' * 57}..., wanted less" and error.code == 4
    again = pickle.loads(pickle.dumps(PecsError("why", 6)))
    assert str(again) == "why" and again.code == 6 and PecsOutputError("x").code == 5
    assert one_line("a\nb\x7f") == "a\\x0ab\\x7f"


def test_a_child_ends_with_its_parent(tmp_path):
    """The parent is killed; the child gets SIGTERM and writes down that it did."""
    child = """import os, signal, sys, time
def end(*_):
    open(sys.argv[1] + "~", "w").write("ended")
    os.replace(sys.argv[1] + "~", sys.argv[1])
    sys.exit()
signal.signal(signal.SIGTERM, end)
print("ready", flush=True)
time.sleep(60)"""
    parent = f"""import subprocess, sys, time
from pecs._platform import die_with_parent
child = subprocess.Popen(die_with_parent([sys.executable, "-c", {child!r}, sys.argv[1]]), stdout=subprocess.PIPE)
child.stdout.readline()
print(child.pid, flush=True)
time.sleep(60)"""
    with subprocess.Popen([sys.executable, "-c", parent, tmp_path / "a"], stdout=subprocess.PIPE) as process:
        number = int(process.stdout.readline())
        os.kill(number, 0)
        process.send_signal(signal.SIGKILL)
    for _ in range(200):
        if (tmp_path / "a").exists():
            break
        time.sleep(0.05)
    assert (tmp_path / "a").read_text() == "ended"


def test_a_child_has_the_command_s_exit_code(tmp_path):
    assert subprocess.run(die_with_parent([sys.executable, "-c", "raise SystemExit(7)"])).returncode == 7
    missing = subprocess.run(die_with_parent([tmp_path / "no"]), capture_output=True, text=True)
    assert missing.returncode == 3 and missing.stderr == f"pecs: {tmp_path}/no: No such file or directory\n"
    orphan = die_with_parent([sys.executable, "-c", "open('x')"])
    orphan[3] = "1"  # the parent that it was started by
    assert subprocess.run(orphan).returncode == 128 + signal.SIGTERM


@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_a_library_that_does_not_return(sent, code):
    """Such as a network with an endless loop: Python's handlers do not run then."""
    command = """import hashlib, signal, sys
from pecs import _command
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where we run in the background
_command.GRACE_S = 0.5
def run(args):
    print("ready", flush=True)
    hashlib.pbkdf2_hmac("sha256", b"", b"", 10**{digits})
sys.exit(_command.answer(_command.Parser(prog="pecs test"), run, []))"""
    for digits, least_s in ((9, 0.5), (6, 0)):  # minutes; a second
        with subprocess.Popen(
            [sys.executable, "-c", command.format(digits=digits)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
        ) as process:
            process.stdout.readline()
            time.sleep(0.1)  # it is in the library now
            begin = time.monotonic()
            process.send_signal(sent)
            assert process.wait(60) == code
            assert least_s <= time.monotonic() - begin < 20 and process.stderr.read() == b""
