"""Files of readings as nobody means them: refused in one line, in little time and memory."""

import gzip
import os
from pathlib import Path

import pytest
from spoil import Spoil, holds, instead, link, sparse

from testbench.files import text
from testbench.files.robot import meshes, robot
from testbench.runs import manifest, store

MANY = 16_000_000  #: Bytes of a large file.


def _after(file: Path, rest: bytes) -> None:
    file.write_bytes(file.read_bytes() + rest)


HOSTILE: dict[str, tuple[Spoil, str]] = {
    "empty": (holds(b""), "empty"),
    "separators": (holds(b";;, |\t\n" * (MANY // 7)), "lines"),
    "newlines_behind": (lambda f: _after(f, b"\n" * MANY + b"x"), "lines"),
    "a_long_line": (holds(b"x" * MANY), "letters"),
    "a_long_line_behind": (lambda f: _after(f, b"x" * MANY), "letters"),
    "short_lines": (holds(b"1\n" * 2_001_000), "lines"),
    "zeros_behind": (lambda f: _after(f, bytes(MANY)), "zero byte"),
    "quotes": (lambda f: _after(f, b'"' + b"a\n" * (MANY // 20)), "a quote is never closed"),
    "quotes_in_pairs": (lambda f: _after(f, b'a"' * (MANY // 2)), "letters"),
    "comments": (holds(b"# run\n" * 10_000), "row"),
    "gzip": (holds(gzip.compress(bytes(MANY))), "gzip"),
    "workbook": (holds(b"PK\x03\x04" + bytes(100)), "workbook"),
    "noise": (holds(os.urandom(MANY)), "data.csv"),
    "pipe": (instead(os.mkfifo), "expected a file"),
    "folder": (instead(Path.mkdir), "expected a file"),
    "zero_device": (link("/dev/zero"), "expected a file"),
    "its_own_link": (link("data.csv"), "cannot be read"),
    "a_terabyte": (sparse(10**12), "bytes"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_file_of_readings_is_refused(attack, lab, name):
    spoil, said = HOSTILE[name]
    spoil(lab / "data.csv")
    attack(lab, "identify", "arm", "data.csv", "--out", "out").refused("data.csv", said)


def test_the_security_page_states_the_limits_of_the_readers():
    page = (Path(__file__).parents[2] / "SECURITY.md").read_text(encoding="utf-8")
    said = [
        f"a table {text.MAX_BYTES // 10**6} MB and {text.MAX_LINES // 10**6} million lines",
        f"a workbook {text.MAX_UNPACKED // 10**6} MB when unpacked",
        f"a robot file {robot.MAX_BYTES // 10**6} MB and {robot.MOST_OF['joint']} joints",
        f"a mesh {meshes.MAX_BYTES // 10**6} MB",
        f"the arrays of a model {manifest.MAX_ROOT // 10**6} MB",
        f"trials {store.MAX_UNPACKED // 10**9} GB when unpacked",
    ]
    assert ", ".join(said) in " ".join(page.split())
