"""Trials as records of a file that only grows: its header first, then rows of one trial after another.

A record is a seed, a length, a checksum and JSON by column, packed: a column repeats its name once and its
words often, so that a row takes a tenth of its own JSON. Numbers come back to the bit. What a kill or a full
disk cut short lies at the end of the file, and is as if it had never been written.
"""

import json
import os
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from testbench.errors import BenchError
from testbench.trials.rows import Table

MAGIC = b"testbench trials 5\n"  #: Begins a file.
HEAD = struct.Struct(">qI32s")  #: Seed, length of what follows [byte], SHA-256.
HEADER = -1  #: In place of a seed: what the trials are of.
LONGEST = 2**24  #: Longest record, and text in it [byte]: a few packed ones could be of any length.
NONE = bytes(HEAD.size)  #: What some file systems leave at the end of a file after a crash.


def record(seed: int, data: bytes, sha256: bytes) -> bytes:
    """As it stands in the file."""
    return HEAD.pack(seed, len(data), sha256) + data


def records(file: BinaryIO) -> Iterator[tuple[int, int, bytes, bytes]]:
    """Place, seed, checksum and data of every whole record from here on; ValueError for what is none."""
    place = file.tell()
    while len(head := file.read(HEAD.size)) == HEAD.size and head != NONE:
        seed, size, sha256 = HEAD.unpack(head)
        if size > LONGEST:
            raise ValueError(f"a record of {size} bytes")
        if len(data := file.read(size)) < size:
            return
        yield place, seed, sha256, data
        place += HEAD.size + size


def read_at(file: int, place: int) -> bytes:
    """Data of the record at a place."""
    _, size, _ = HEAD.unpack(os.pread(file, HEAD.size, place))
    return os.pread(file, size, place + HEAD.size)


def stored_seeds(path: Path) -> list[int]:
    """Seeds of the trials in a file, perhaps of a run under way."""
    with path.open("rb") as file:
        file.seek(len(MAGIC))
        return [seed for _, seed, _, _ in records(file) if seed != HEADER]


def pack(table: Table) -> bytes:
    """Rows of a trial as bytes; BenchError when they are too many."""
    text = json.dumps(table, separators=(",", ":")).encode()
    if len(text) > LONGEST:
        raise BenchError(f"rows: expected at most {LONGEST} bytes of a trial, got {len(text)}")
    return zlib.compress(text)


def unpack(data: bytes) -> Table:
    """Rows of a trial; ValueError or RecursionError where the bytes are of something else."""
    opened = zlib.decompressobj()
    try:
        text = opened.decompress(data, LONGEST)
    except zlib.error as err:
        raise ValueError(f"packed rows: {err}") from err
    if not opened.eof or opened.unused_data:
        raise ValueError(f"packed rows: expected at most {LONGEST} bytes and no more behind them")
    found = json.loads(text.decode())
    if not isinstance(found, dict) or not all(isinstance(cells, list) for cells in found.values()):
        raise ValueError("packed rows: expected columns")
    return found
