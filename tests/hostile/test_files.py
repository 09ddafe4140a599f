"""Files of readings as nobody means them: refused in one line, in little time and memory."""

import gzip
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from spoil import Spoil, holds, instead, link, sparse
from workbooks import packed, parts

from testbench.data.stream import LEAST

MANY = LEAST + 1000  #: Bytes of a file that is read block by block.


def _after(file: Path, rest: bytes) -> None:
    file.write_bytes(file.read_bytes() + rest)


def _one_run(file: Path) -> None:
    head, row = file.read_bytes().splitlines()[:2]
    file.write_bytes(head + b"\n" + (row + b"\n") * (MANY // len(row)))


def _apart(file: Path) -> None:
    """Rows of a run that stand apart, in a file too large to be held."""
    head, *rows = file.read_bytes().splitlines()
    file.write_bytes(b"\n".join([head, *rows, *rows[:2], b"\n" * 301_000_000]))


def _book(**changed: Callable[[], str]) -> Callable[[Path], None]:
    """A workbook with another first sheet, or other shared texts."""

    def make(file: Path) -> None:
        part = {"sheet": "xl/worksheets/sheet1.xml", "words": "xl/sharedStrings.xml"}
        own = {part[name]: made() for name, made in changed.items()}
        file.write_bytes(packed(parts({"A": [["run"], [1.0]]}) | own))

    return make


def _many_parts(file: Path) -> None:
    file.write_bytes(packed({f"{k}": "" for k in range(10_001)}))


CELL = '<c t="s"><v>0</v></c>'

HOSTILE: dict[str, tuple[Spoil, str]] = {
    "empty": (holds(b""), "empty"),
    "separators": (holds(b";;, |\t\n" * (MANY // 7)), "empty"),
    "newlines_behind": (lambda f: _after(f, b"\n" * MANY + b"x"), "field"),
    "a_long_line": (holds(b"x" * MANY), "letters"),
    "a_long_line_behind": (lambda f: _after(f, b"x" * MANY), "letters"),
    "short_lines": (holds(b"1\n" * 1_001_000), "lines"),
    "zeros_behind": (lambda f: _after(f, bytes(MANY)), "zero byte"),
    "quotes": (lambda f: _after(f, b'"' + b"a\n" * (MANY // 2)), "quotes"),
    "quotes_in_pairs": (lambda f: _after(f, b'a"' * (MANY // 2)), "letters"),
    "comments": (holds(b"# run\n" * 10_000), "row"),
    "gzip": (holds(gzip.compress(bytes(MANY))), "gzip"),
    "workbook": (holds(b"PK\x03\x04" + bytes(100)), "workbook"),
    "noise": (holds(os.urandom(MANY)), "data.csv"),
    "pipe": (instead(os.mkfifo), "expected a file"),
    "folder": (instead(Path.mkdir), "expected a file"),
    "cells": (_book(sheet=lambda: f"<w>{'<row><c><v>1</v></c></row>' * 2_000_000}</w>"), "elements"),
    "blanks_of_a_workbook": (_book(sheet=lambda: f"<w>{'<!---->' * 50_000_000}</w>"), "element"),
    "wide_rows_of_a_workbook": (
        _book(sheet=lambda: "<w>{}</w>".format('<row><c r="XFD1"><v>1</v></c></row>' * 50_000)),
        "letters",
    ),
    "a_wide_row": (_book(sheet=lambda: f'<w><row r="99999">{"<c><v>1</v></c>" * 16_000}</row></w>'), "cells"),
    "one_text_in_all_cells": (
        _book(
            words=lambda: f"<s><si><t>{'a' * 9_000_000}</t></si></s>",
            sheet=lambda: f"<w>{f'<row>{CELL}</row>' * 100_000}</w>",
        ),
        "letters",
    ),
    "depth_of_a_workbook": (_book(sheet=lambda: "<w>" * 1_000_000), "elements in one another"),
    "entities_of_a_workbook": (
        _book(sheet=lambda: '<!DOCTYPE w [<!ENTITY a SYSTEM "file:///etc/passwd">]><w>&a;</w>'),
        "document types",
    ),
    "parts_of_a_workbook": (_many_parts, "parts"),
    "zero_device": (link("/dev/zero"), "expected a file"),
    "its_own_link": (link("data.csv"), "cannot be read"),
    "five_gigabytes_of_nothing": (lambda f: (f.write_bytes(b""), sparse(5 * 10**9)(f)), "zero byte"),
    "five_gigabytes_behind": (sparse(5 * 10**9), "zero byte"),
    "a_terabyte": (sparse(10**12), "bytes"),
    "one_run": (_one_run, "run"),
    "rows_apart": (_apart, "together"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_file_of_readings_is_refused(attack, lab, name):
    spoil, said = HOSTILE[name]
    spoil(lab / "data.csv")
    attack(lab, "identify", "arm", "data.csv", "--out", "out").refused("data.csv", said)
