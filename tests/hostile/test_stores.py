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
from spoil import Spoil, holds, instead, link, sparse

from testbench.trials.store import HEADER, MAGIC, record, records

RESUME = ("--workers", "1", "--resume")
STORE, WHOLE = "trials.log", "trials.parquet"
FULL = 30_000  #: Largest file that the disk takes [byte]: a store of some trials fits.


@pytest.fixture(scope="module")
def begun(attack, tmp_path_factory):
    """A run whose disk was full in mid-study, and the whole file that it should come to."""
    folder = tmp_path_factory.mktemp("begun")
    assert attack(folder, "trials", "left_alone", *RESUME).code == 0
    whole = (folder / "left_alone" / WHOLE).read_bytes()
    lab = folder / "lab"
    lab.mkdir()
    (lab / WHOLE).write_bytes(whole)
    stopped = attack(lab, "trials", "run", *RESUME, largest=FULL)
    assert stopped.code == 2, stopped
    assert re.fullmatch(r"error: run/trials\.log: .*; \d+ of 30 trials are stored, .*\n", stopped.err)
    return lab, whole


@pytest.fixture
def run(begun, tmp_path):
    return Path(shutil.copytree(begun[0], tmp_path / "lab")) / "run"


Stored = tuple[int, bytes, bytes]  #: Seed, checksum, rows.


def stored(change: Callable[..., list[Stored]]) -> Spoil:
    return lambda run: closed(run, change(*opened(run)))


def opened(run: Path) -> list[Stored]:
    with (run / STORE).open("rb") as file:
        file.seek(len(MAGIC))
        return [(seed, sha256, rows) for _, seed, sha256, rows in records(file)]


def closed(run: Path, own: list[Stored]) -> None:
    lines = (record(seed, rows, sha256) for seed, sha256, rows in own)
    (run / STORE).write_bytes(MAGIC + b"".join(lines))


def signed(text: bytes) -> Stored:
    return HEADER, hashlib.sha256(text).digest(), text


def at_store(spoil: Spoil) -> Spoil:
    return lambda run: spoil(run / STORE)


def header(change: Callable[[dict], object]) -> Spoil:
    def spoil(run: Path) -> None:
        head, *own = opened(run)
        change(about := json.loads(head[2]))
        closed(run, [signed(json.dumps(about).encode()), *own])

    return spoil


def packed(change: Callable[[bytes], bytes], seed: int | None = None) -> Spoil:
    """Other packed rows of the first trial under a right checksum, perhaps of another seed."""

    def spoil(run: Path) -> None:
        head, first, *own = opened(run)
        key = json.dumps(json.loads(head[2]), sort_keys=True)
        own, of = (own, first[0]) if seed is None else ([first, *own], seed)
        rows = change(first[2])
        closed(run, [head, (of, hashlib.sha256(f"{key}{of} ".encode() + rows).digest(), rows), *own])

    return spoil


def forged(change: Callable[[str], str]) -> Spoil:
    return packed(lambda rows: zlib.compress(change(zlib.decompress(rows).decode()).encode()))


def number(value: str) -> Spoil:
    return forged(lambda rows: re.sub(r'"rank":\[\d+', f'"rank":[{value}', rows))


def whole(change: Callable[[pa.Table], pa.Table]) -> Spoil:
    """A run that has ended, with another table."""

    def spoil(run: Path) -> None:
        (run / STORE).unlink()
        table = change(parquet.read_table(run.parent / WHOLE))
        parquet.write_table(table, run / WHOLE, write_page_checksum=True)

    return spoil


def rows(*numbers: int) -> Spoil:
    """Some rows of a run that has ended, in this order."""
    return whole(lambda table: table.take(pa.array(numbers)))


def instead_of_store(make: Spoil) -> Spoil:
    return lambda run: ((run / STORE).unlink(), make(run / WHOLE))


def flipped(place: int) -> Spoil:
    """A bit of a run that has ended."""

    def spoil(run: Path) -> None:
        data = bytearray((run.parent / WHOLE).read_bytes())
        data[place] ^= 1
        instead_of_store(holds(bytes(data)))(run)

    return spoil


def edited(run: Path) -> None:
    """One number of a run whose manifest has its checksum."""
    digests = {"sha256": {WHOLE: hashlib.sha256((run.parent / WHOLE).read_bytes()).hexdigest()}}
    said = {"command": "toy", "versions": {"testbench": "0"}}
    (run / "manifest.json").write_text(json.dumps(said | digests))
    whole(lambda table: table.set_column(1, table.field(1), [table[1].to_pylist()[::-1]]))(run)


def other_bytes(place: int, new: bytes) -> Spoil:
    def spoil(run: Path) -> None:
        old = (run / STORE).read_bytes()
        (run / STORE).write_bytes(old[:place] + new + old[place + len(new) :])

    return spoil


PLAIN, WHOLES = "expected a file, got a link, a folder or a device", "expected trials in Parquet"
LINE: dict[str, tuple[Spoil, str]] = {
    "swapped trials": (
        stored(lambda head, a, b, *own: [head, (a[0], *b[1:]), (b[0], *a[1:]), *own]),
        "seed 5: expected what was stored",
    ),
    "400,000 rows of another": (
        stored(lambda head, *_: [head, *((s, bytes(32), b"[]") for s in range(100, 400_000))]),
        "seed 100: expected what was stored",
    ),
    "no header": (stored(lambda _, *own: own), "it has no header"),
    "an edited header": (stored(lambda head, *own: [(*head[:2], head[2] + b" "), *own]), "it has no header"),
    "a deep header": (stored(lambda _, *own: [signed(b"[" * 100_000), *own]), "expected a store of trials"),
    "a header of another type": (stored(lambda _, *own: [signed(b"[]"), *own]), "no table of keys"),
    "a long row": (other_bytes(len(MAGIC) + 8, b"\x7f\xff\xff\xff"), "damaged"),
    "another format": (header(lambda h: h.update(format="testbench trials 2")), "format: the trials in this"),
    "another version": (header(lambda h: h["versions"].update(numpy="9")), "version of numpy"),
    "another study": (header(lambda h: h.update(scenario="\x1b[2J[red]")), "scenario: the trials in this"),
    "a name of 10 MB": (header(lambda h: h.update(scenario="x" * 10**7)), "scenario: the trials in this"),
    "keys that steer": (header(lambda h: h["settings"].update({"\x1b[2J\n": 1})), "this run has None"),
    "a word for a number": (number('"=cmd|x"'), "seed 5: rows: rank: expected int"),
    "5000 digits": (number("9" * 5000), "damaged"),
    "infinity": (number("Infinity"), "seed 5: rows: rank: expected int"),
    "half a character": (forged(lambda rows: rows.replace('"solve"', '"\\ud800"')), "expected str"),
    "no table": (forged(lambda _: "[]"), "expected columns"),
    "100 MB, packed": (forged(lambda _: "0" * 10**8), "expected at most"),
    "columns of other lengths": (forged(lambda rows: rows.replace("[", "[1,", 1)), "seed 5: rows"),
    "depth": (forged(lambda _: "[" * 10**6), "damaged"),
    "no text": (packed(lambda _: zlib.compress(b"\xff")), "expected a store of trials"),
    "not packed": (packed(zlib.decompress), "packed rows"),
    "cut": (packed(lambda rows: rows[:-1]), "packed rows"),
    "notes": (at_store(holds("notes\n" * 999)), "of this version"),
    "a pipe": (at_store(instead(os.mkfifo)), PLAIN),
    "a folder": (at_store(instead(Path.mkdir)), PLAIN),
    "a link": (at_store(link("/etc/hostname")), PLAIN),
    "two names": (lambda run: os.link(run / STORE, run.parent / "own"), "move it away"),
    "room of 64 GB": (at_store(instead(sparse(2**36))), "move it away"),
    "a link for a whole run": (instead_of_store(link("/dev/zero")), "expected a file"),
    "a whole run of noise": (instead_of_store(holds(b"PAR1" + bytes(999) + b"PAR1")), WHOLES),
    **{f"bit {place} of a whole run": (flipped(place), WHOLES) for place in (90, -1, -100)},
    "a whole run that goes back": (rows(9, 0), WHOLES),
    "a trial in two places": (rows(0, 9, 0), WHOLES),
    "200,000 rows of one trial": (rows(*[0] * 200_000), WHOLES),
    "a whole run of no seed": (
        whole(lambda table: table.set_column(0, "seed", pa.nulls(len(table), pa.int64()))),
        WHOLES,
    ),
    "an edited whole run": (edited, "trials.parquet: expected what its run left"),
}
RIGHT: dict[str, Spoil] = {
    "as it was left": lambda run: None,
    "killed while it wrote": lambda run: os.truncate(run / STORE, (run / STORE).stat().st_size - 5),
    "seeds that nobody asked for": packed(lambda rows: rows, seed=2**63 - 1),
    "a run that has ended": whole(lambda table: table),
    "room behind its end": at_store(sparse(2**36)),
}


@pytest.mark.parametrize("name", LINE)
def test_a_store_that_is_none_is_refused(attack, run, name):
    spoil, said = LINE[name]
    spoil(run)
    for words in (RESUME, RESUME[:2])[: 2 if said in (PLAIN, "move it away") else 1]:
        attack(run.parent, "trials", "run", *words).refused("run/trials.", said)


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


@pytest.mark.parametrize("value", [float("inf"), 1e308, None])
def test_numbers_that_no_trial_has_are_refused_by_the_report(attack, study, tmp_path, value):
    lab = Path(shutil.copytree(study, tmp_path / "lab"))
    table = parquet.read_table(lab / "run" / WHOLE)
    rows = [{k: value if isinstance(v, float) else v for k, v in row.items()} for row in table.to_pylist()]
    parquet.write_table(
        pa.Table.from_pylist(rows, table.schema), lab / "run" / WHOLE, write_page_checksum=True
    )
    again = attack(lab, "study", "single_link", "--quick", "--seeds", "1", *RESUME, "--out", "run", "--force")
    again.refused()
