"""The file of a trial store, perhaps a stranger's: looked at before SQLite opens it, which would change it.

SQLite follows links, rolls back what a journal says, wherever it comes from, deletes a file that a journal
names, and computes views and triggers. So a file of another kind never reaches it.
"""

import contextlib
import os
import shutil
import sqlite3
import stat
from pathlib import Path

from testbench.errors import InputError
from testbench.output.scratch import remove, scratch_name, sync, writing

APPLICATION = 0x7462_7472  #: Says in a file's head that it is ours: "tbtr".
HEAD = 100  #: Size of it [byte].
MAGIC = b"SQLite format 3\0"
ROLLBACK = b"\1\1"  #: Written with a rollback journal; with another one SQLite would read other files.
JOURNAL = bytes.fromhex("d9d505f920a163d7")
"""A journal begins so while what it says is to be taken back, and ends so if it names a file of others."""
MARGIN = 2**20  #: By which a journal may be larger than twice its store [byte].
LONGEST = 2**24  #: Longest cell, the packed rows of a trial [byte].
TABLES = (
    "CREATE TABLE about (header TEXT)",
    "CREATE TABLE trials (seed INTEGER PRIMARY KEY, rows BLOB, sha256 BLOB)",
)
AWAY = "move it away to start afresh"
FAULTS = {
    "SQLITE_BUSY": "another run is writing it: wait for it or choose another folder",
    "SQLITE_FULL": "cannot be written: the disk is full",
    "SQLITE_IOERR": "cannot be written",
    "SQLITE_CANTOPEN": "cannot be written",
    "SQLITE_READONLY": "cannot be written",
}


def told(path: Path, err: Exception) -> InputError:
    """What a failure of SQLite, or of what is stored, means."""
    if words := _fault(err):
        return InputError(path, "", words)
    return InputError(path, "", f"expected a store of trials: {err}: it is damaged; {AWAY}")


def _fault(err: Exception) -> str:
    """What it means that SQLite cannot work; empty where it can, and what it reads is wrong."""
    name = getattr(err, "sqlite_errorname", "")
    return next((words for fault, words in FAULTS.items() if name.startswith(fault)), "")


def open_file(path: Path) -> sqlite3.Connection:
    """The database, locked; made where there is none.

    Raises:
        InputError: When something else stands there, which is left as it is; when another run writes it, or
            it cannot be written.
    """
    if not os.path.lexists(path):
        if os.path.lexists(journal_of(path)):  # SQLite would write what it says into a new store
            raise InputError(journal_of(path), "", f"is of no store of trials; {AWAY}")
        _make(path)
    _check_file(path)
    try:
        database = sqlite3.connect(path, timeout=0)
        try:
            _lock(database)
        except sqlite3.Error:
            database.close()
            raise
    except sqlite3.Error as err:
        raise told(path, err) from err
    try:
        _check_tables(path, database)
    except InputError:
        database.close()
        raise
    return database


def remove_file(path: Path) -> None:
    """Remove a store that is open, its journal first, which SQLite leaves after a full disk."""
    for file in (journal_of(path), path):
        file.unlink(missing_ok=True)


def journal_of(path: Path) -> Path:
    """Where SQLite keeps what a transaction has replaced."""
    return path.with_name(f"{path.name}-journal")


def _make(path: Path) -> None:
    """An empty store: there as a whole one, so that one without a head is none of ours."""
    part = path.with_name(scratch_name())
    try:
        with contextlib.closing(sqlite3.connect(part)) as database:
            database.execute("PRAGMA journal_mode=OFF")
            database.execute(f"PRAGMA application_id={APPLICATION}")
            for statement in (*TABLES, "INSERT INTO about VALUES ('{}')"):
                database.execute(statement)
            database.commit()
        with writing(path):
            sync(part)
            try:
                os.link(part, path)
            except FileExistsError:
                return  # another run was faster, and is told from us by its lock
            except OSError:  # a file system without hard links
                part.replace(path)
    except sqlite3.Error as err:
        raise told(path, err) from err
    finally:
        remove(part)


def _check_file(path: Path) -> None:
    """Refuse what is no store of ours, or has a journal that is none of it."""
    journal, hot = journal_of(path), False
    check_plain(path)
    if (names := path.lstat().st_nlink) > 1:
        raise InputError(path, "", f"has {names} names (hard links), expected one; {AWAY}")
    for other in ("-wal", "-shm"):
        if os.path.lexists(path.with_name(path.name + other)):
            raise InputError(path.with_name(path.name + other), "", f"is of no store of trials; {AWAY}")
    try:
        with path.open("rb") as file:
            head = file.read(HEAD)
        if os.path.lexists(journal):
            check_plain(journal)
            with journal.open("rb") as file:
                hot = file.read(len(JOURNAL)) == JOURNAL
                file.seek(max(0, journal.stat().st_size - len(JOURNAL)))
                if file.read() == JOURNAL:
                    raise InputError(journal, "", f"names another file, as that of no store does; {AWAY}")
    except OSError as err:
        raise InputError(path, "", f"cannot be read: {err.strerror}") from err
    ours = APPLICATION.to_bytes(4, "big")
    if head[:16] != MAGIC or head[18:20] != ROLLBACK or head[68:72] != ours or len(head) < HEAD:
        raise InputError(path, "", f"expected a store of trials of this version; {AWAY}")
    if hot:
        _try_journal(path)


def _try_journal(path: Path) -> None:
    """Refuse a journal that would leave no store of ours when SQLite writes what it says, tried on copies.

    It does not say of which file it is.
    """
    journal, part = journal_of(path), path.with_name(scratch_name()) / path.name
    fits = journal.stat().st_size <= 2 * path.stat().st_size + MARGIN
    try:
        with writing(path):
            part.parent.mkdir()
            for source, copy in ((path, part), (journal, journal_of(part))) if fits else ():
                shutil.copyfile(source, copy)
        if not fits or not _is_store(part):
            raise InputError(journal, "", f"is not the journal of {path.name}; {AWAY}")
    finally:
        remove(part.parent)


def _is_store(path: Path) -> bool:
    """Whether a file is a whole store when SQLite has taken back what its journal says."""
    try:
        with contextlib.closing(sqlite3.connect(path)) as database:
            _lock(database)
            _check_tables(path, database)
            return database.execute("PRAGMA integrity_check(1)").fetchall() == [("ok",)]
    except (sqlite3.Error, ValueError) as err:
        if _fault(err):
            raise told(path, err) from err
    except InputError:  # other tables
        pass
    return False


def check_plain(path: Path) -> None:
    """Refuse a link, a folder and a device."""
    if not stat.S_ISREG(path.lstat().st_mode):
        raise InputError(path, "", f"expected a file, got a link, a folder or a device; {AWAY}")


def _lock(database: sqlite3.Connection) -> None:
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LONGEST)
    for setting in ("trusted_schema=OFF", "cell_size_check=ON", "locking_mode=EXCLUSIVE"):
        database.execute(f"PRAGMA {setting}")
    with database:
        database.execute("BEGIN EXCLUSIVE")


def _check_tables(path: Path, database: sqlite3.Connection) -> None:
    try:
        found = {sql for (sql,) in database.execute("SELECT sql FROM sqlite_master LIMIT 9")}
    except (sqlite3.Error, ValueError) as err:
        raise told(path, err) from err
    if found != set(TABLES):
        raise InputError(path, "", f"expected a store of trials of this version: it has other tables; {AWAY}")
