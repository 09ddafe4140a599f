"""Stores that somebody spoiled, planted or forged, through the command line: refused, or resumed rightly.

What is refused stays byte by byte as it was; what is resumed ends as a run that was left alone, bit by bit.
"""

import contextlib
import hashlib
import json
import os
import re
import shutil
import sqlite3
import zlib
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pytest
from pyarrow import parquet

RESUME = ("--workers", "1", "--resume")
STORE, WHOLE = "trials.sqlite", "trials.parquet"
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
    assert re.fullmatch(r"error: run/trials\.sqlite: .*; \d+ of 30 trials are stored, .*\n", stopped.err)
    return lab, whole


@pytest.fixture
def run(begun, tmp_path):
    """A copy of the run."""
    return Path(shutil.copytree(begun[0], tmp_path / "lab")) / "run"


def sql(statements: str) -> Spoil:
    """What another program does to the store."""

    def spoil(run: Path) -> None:
        with contextlib.closing(sqlite3.connect(run / STORE)) as database:
            database.executescript(statements)
            database.commit()

    return spoil


def header(change: Callable[[dict], object]) -> Spoil:
    """Another header."""

    def spoil(run: Path) -> None:
        with contextlib.closing(sqlite3.connect(run / STORE)) as database:
            ((text,),) = database.execute("SELECT header FROM about").fetchall()
            change(about := json.loads(text))
            database.execute("UPDATE about SET header = ?", (json.dumps(about),))
            database.commit()

    return spoil


def forged(change: Callable[[str], str], seed: int | None = None) -> Spoil:
    """Other rows of the first trial under a right checksum, perhaps of another seed."""

    def spoil(run: Path) -> None:
        with contextlib.closing(sqlite3.connect(run / STORE)) as database:
            ((text,),) = database.execute("SELECT header FROM about").fetchall()
            first, rows = database.execute("SELECT seed, rows FROM trials ORDER BY seed").fetchone()
            own = first if seed is None else seed
            rows = zlib.compress(change(zlib.decompress(rows).decode()).encode())
            key = f"{json.dumps(json.loads(text), sort_keys=True)}{own} ".encode()
            insert = "INSERT OR REPLACE INTO trials VALUES (?, ?, ?)"
            database.execute(insert, (own, rows, hashlib.sha256(key + rows).digest()))
            database.commit()

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


def journal(statement: str, of: Path) -> bytes:
    """What SQLite would take back of a statement, had its process been killed; the file is left as it was."""
    with contextlib.closing(sqlite3.connect(of, isolation_level=None)) as database:
        database.execute("PRAGMA cache_size = 1")
        database.execute("BEGIN")
        database.execute(statement)
        kept = of.with_name(f"{of.name}-journal").read_bytes()
        database.execute("ROLLBACK")
    return kept


def alien_journal(run: Path) -> None:
    """One of another program's file, which SQLite would write into the store."""
    other = run.parent / "other.sqlite"
    with contextlib.closing(sqlite3.connect(other)) as database:
        database.executescript("CREATE TABLE mine (x); INSERT INTO mine VALUES (zeroblob(90000))")
    kept = journal("UPDATE mine SET x = zeroblob(80000)", other)
    other.unlink()
    (run / f"{STORE}-journal").write_bytes(kept)


def own_journal(run: Path) -> None:
    """A store that was killed while it wrote."""
    store, before = run / STORE, (run / STORE).read_bytes()
    with contextlib.closing(sqlite3.connect(store, isolation_level=None)) as database:
        database.execute("PRAGMA cache_size = 1")
        database.execute("BEGIN")
        database.execute("UPDATE trials SET rows = zeroblob(9000)")
        killed = store.read_bytes(), (run / f"{STORE}-journal").read_bytes()
        database.execute("ROLLBACK")
    assert killed[0] != before
    store.write_bytes(killed[0])
    (run / f"{STORE}-journal").write_bytes(killed[1])


def alone(run: Path) -> None:
    alien_journal(run)
    (run / STORE).unlink()


TABLES = "has other tables"
PLAIN = "expected a file, got a link, a folder or a device"
LINE: dict[str, tuple[Spoil, str]] = {
    "a virtual table": (sql("CREATE VIRTUAL TABLE v USING fts5(x)"), TABLES),
    "a view": (sql("CREATE VIEW v AS SELECT 1"), TABLES),
    "an index of an expression": (sql("CREATE INDEX i ON trials(abs(rows))"), TABLES),
    "a trigger": (sql("CREATE TRIGGER t AFTER INSERT ON trials BEGIN DELETE FROM trials; END"), TABLES),
    "swapped checksums": (
        sql("UPDATE trials SET sha256 = (SELECT sha256 FROM trials t WHERE t.seed = 11 - trials.seed)"),
        "seed 5: expected what was stored",
    ),
    "400,000 rows of another": (
        sql(
            "WITH RECURSIVE r(s) AS (SELECT 100 UNION ALL SELECT s + 1 FROM r WHERE s < 400000) "
            "INSERT INTO trials SELECT s, '[]', '0' FROM r"
        ),
        "seed 100: expected what was stored",
    ),
    "a long row": (sql("UPDATE trials SET rows = hex(zeroblob(9000000)) WHERE seed = 5"), "too big"),
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
    "a claim of 2^31 pages": (other_bytes(28, b"\x7f\xff\xff\xff"), "damaged"),
    "pages of 256 bytes": (other_bytes(16, b"\x01\x00"), "damaged"),
    "pages that lead back": (other_bytes(4096, bytes([5, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2])), "damaged"),
    "UTF-16": (other_bytes(56, b"\0\0\0\2"), "damaged"),
    "notes": (instead(STORE, lambda path: path.write_bytes(b"notes\n" * 999)), "of this version"),
    "a pipe": (instead(STORE, os.mkfifo), PLAIN),
    "a folder": (instead(STORE, Path.mkdir), PLAIN),
    "a link": (instead(STORE, lambda path: path.symlink_to("/etc/hostname")), PLAIN),
    "a log of another kind": (instead(f"{STORE}-wal", Path.touch), "is of no store"),
    "a link for a journal": (instead(f"{STORE}-journal", lambda path: path.symlink_to("/etc/passwd")), PLAIN),
    "another's journal": (alien_journal, "is not the journal of trials.sqlite"),
    "a journal alone": (alone, "is of no store"),
    "a sparse journal": (
        lambda run: (alien_journal(run), os.truncate(run / f"{STORE}-journal", 2**36)),
        "is not the journal of trials.sqlite",
    ),
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
    "killed while it wrote": own_journal,
    "seeds that nobody asked for": forged(lambda rows: rows, seed=2**63 - 1),
    "a journal of nothing": lambda run: (run / f"{STORE}-journal").write_bytes(bytes(9999)),
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
