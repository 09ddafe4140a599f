"""Stores that somebody spoiled, planted or forged, through the command line: refused, or resumed rightly.

What is refused stays byte by byte as it was; what is resumed ends as a run that was left alone, bit by bit.
"""

import hashlib
import json
import os
import re
import shutil
import zlib
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pytest
from pyarrow import parquet

from testbench.trials.store import HEADER, MAGIC, record, records

RESUME = ("--workers", "1", "--resume")
STORE, WHOLE = "trials.log", "trials.parquet"
FULL = 30_000  #: Largest file that the disk takes [byte]: a store of some trials fits.
Spoil = Callable[[Path], object]


@pytest.fixture(scope="module")
def begun(attack, tmp_path_factory):
    """A run whose disk was full in mid-study, and the whole file that it should come to."""
    folder = tmp_path_factory.mktemp("begun")
    assert attack(folder, "trials", "left_alone", *RESUME).code == 0
    whole = (folder / "left_alone" / WHOLE).read_bytes()
    lab = folder / "lab"
    lab.mkdir()
    stopped = attack(lab, "trials", "run", *RESUME, largest=FULL)
    assert stopped.code == 2, stopped
    assert re.fullmatch(r"error: run/trials\.log: .*; \d+ of 30 trials are stored, .*\n", stopped.err)
    return lab, whole


@pytest.fixture
def run(begun, tmp_path):
    """A copy of the run."""
    return Path(shutil.copytree(begun[0], tmp_path / "lab")) / "run"


def trials(change: Callable[[list[tuple[int, bytes, bytes]]], list[tuple[int, bytes, bytes]]]) -> Spoil:
    """Other trials behind the header: seed, checksum, rows."""

    def spoil(run: Path) -> None:
        head, *own = opened(run)
        closed(run, [head, *change(own)])

    return spoil


def opened(run: Path) -> list[tuple[int, bytes, bytes]]:
    with (run / STORE).open("rb") as file:
        file.seek(len(MAGIC))
        return [(seed, sha256, rows) for _, seed, sha256, rows in records(file)]


def closed(run: Path, own: list[tuple[int, bytes, bytes]]) -> None:
    lines = (record(seed, rows, sha256) for seed, sha256, rows in own)
    (run / STORE).write_bytes(MAGIC + b"".join(lines))


def header(change: Callable[[dict], object]) -> Spoil:
    """Another header."""

    def spoil(run: Path) -> None:
        (_, _, text), *own = opened(run)
        change(about := json.loads(text))
        text = json.dumps(about).encode()
        closed(run, [(HEADER, hashlib.sha256(text).digest(), text), *own])

    return spoil


def forged(change: Callable[[str], str], seed: int | None = None) -> Spoil:
    """Other rows of the first trial under a right checksum, perhaps of another seed."""

    def spoil(run: Path) -> None:
        head, (first, sha256, rows), *own = opened(run)
        key = json.dumps(json.loads(head[2]), sort_keys=True)
        seed_, more = (first, []) if seed is None else (seed, [(first, sha256, rows)])
        rows = zlib.compress(change(zlib.decompress(rows).decode()).encode())
        sha256 = hashlib.sha256(f"{key}{seed_} ".encode() + rows).digest()
        closed(run, [head, (seed_, sha256, rows), *more, *own])

    return spoil


def number(value: str) -> Spoil:
    """Another value of a number of the first trial."""
    return forged(lambda rows: re.sub(r'"rank":\[\d+', f'"rank":[{value}', rows))


def instead(name: str, make: Spoil) -> Spoil:
    """Something else at a place of the run's folder."""

    def spoil(run: Path) -> None:
        (run / name).unlink(missing_ok=True)
        make(run / name)

    return spoil


def other_bytes(place: int, new: bytes) -> Spoil:
    """Other bytes in the store's file."""

    def spoil(run: Path) -> None:
        old = (run / STORE).read_bytes()
        (run / STORE).write_bytes(old[:place] + new + old[place + len(new) :])

    return spoil


PLAIN = "expected a file, got a link, a folder or a device"
LINE: dict[str, tuple[Spoil, str]] = {
    "swapped checksums": (
        trials(lambda own: [(own[0][0], own[1][1], own[0][2]), *own[1:]]),
        "seed 5: expected what was stored",
    ),
    "400,000 rows of another": (
        trials(lambda own: [(s, bytes(32), b"[]") for s in range(100, 400_000)]),
        "seed 100: expected what was stored",
    ),
    "a long row": (other_bytes(len(MAGIC) + 8, b"\x7f\xff\xff\xff"), "damaged"),
    "another format": (header(lambda h: h.update(format="testbench trials 2")), "format: the trials in this"),
    "another version": (header(lambda h: h["versions"].update(numpy="9")), "version of numpy"),
    "another study": (header(lambda h: h.update(scenario="\x1b[2J[red]")), "scenario: the trials in this"),
    "a name of 10 MB": (header(lambda h: h.update(scenario="x" * 10**7)), "scenario: the trials in this"),
    "keys that steer": (header(lambda h: h["settings"].update({"\x1b[2J\n": 1})), "this run has None"),
    "a word for a number": (number('"=cmd|x"'), "seed 5: rows: rank: expected int"),
    "a truth value": (number("true"), "seed 5: rows: rank: expected int"),
    "5000 digits": (number("9" * 5000), "damaged"),
    "an integer of 65 bits": (number(str(2**64)), "seed 5: rows: rank: expected int"),
    "infinity": (number("Infinity"), "seed 5: rows: rank: expected int"),
    "half a character": (forged(lambda rows: rows.replace('"solve"', '"\\ud800"')), "expected str"),
    "no table": (forged(lambda _: "[]"), "expected columns"),
    "100 MB, packed": (forged(lambda _: "0" * 10**8), "expected at most"),
    "columns of other lengths": (forged(lambda rows: rows.replace("[", "[1,", 1)), "seed 5: rows"),
    "depth": (forged(lambda _: "[" * 10**6), "damaged"),
    "notes": (instead(STORE, lambda path: path.write_bytes(b"notes\n" * 999)), "of this version"),
    "a pipe": (instead(STORE, os.mkfifo), PLAIN),
    "a folder": (instead(STORE, Path.mkdir), PLAIN),
    "a link": (instead(STORE, lambda path: path.symlink_to("/etc/hostname")), PLAIN),
    "a link for a whole run": (
        lambda run: ((run / STORE).unlink(), (run / WHOLE).symlink_to("/dev/zero")),
        "expected a file",
    ),
    "a whole run of noise": (
        lambda run: ((run / STORE).unlink(), (run / WHOLE).write_bytes(b"PAR1" + bytes(999) + b"PAR1")),
        "expected trials in Parquet",
    ),
}
RIGHT: dict[str, Spoil] = {
    "as it was left": lambda run: None,
    "killed while it wrote": lambda run: os.truncate(run / STORE, (run / STORE).stat().st_size - 5),
    "seeds that nobody asked for": forged(lambda rows: rows, seed=2**63 - 1),
    "room behind its end": lambda run: os.truncate(run / STORE, 2**36),
}


@pytest.mark.parametrize("name", LINE)
def test_a_store_that_is_none_is_refused(attack, run, name):
    spoil, said = LINE[name]
    spoil(run)
    attack(run.parent, "trials", "run", *RESUME).refused("run/trials.", said)


@pytest.mark.parametrize("name", RIGHT)
def test_a_store_that_is_sound_is_resumed_bit_by_bit(attack, begun, run, name):
    RIGHT[name](run)
    assert attack(run.parent, "trials", "run", *RESUME).code == 0
    assert (run / WHOLE).read_bytes() == begun[1]
    assert [path.name for path in run.iterdir()] == [WHOLE]


@pytest.fixture(scope="module")
def study(attack, tmp_path_factory):
    """A small study that has come to its end, without the manifest that has its checksums."""
    lab = tmp_path_factory.mktemp("study") / "lab"
    lab.mkdir()
    done = attack(lab, "study", "single_link", "--quick", "--seeds", "1", *RESUME, "--out", "run")
    assert done.code == 0, done
    (lab / "run" / "manifest.json").unlink()
    return lab


@pytest.mark.parametrize("value", [float("inf"), float("nan"), 1e308, None])
def test_numbers_that_no_trial_has_are_refused_by_the_report(attack, study, tmp_path, value):
    lab = Path(shutil.copytree(study, tmp_path / "lab"))
    table = parquet.read_table(lab / "run" / WHOLE)
    rows = [{k: value if isinstance(v, float) else v for k, v in row.items()} for row in table.to_pylist()]
    parquet.write_table(
        pa.Table.from_pylist(rows, table.schema), lab / "run" / WHOLE, write_page_checksum=True
    )
    again = attack(lab, "study", "single_link", "--quick", "--seeds", "1", *RESUME, "--out", "run", "--force")
    again.refused()
