"""A trial's rows as bytes: JSON by column, packed.

A column repeats its name once and its words often, so that a row takes a tenth of its own JSON. Numbers come
back to the bit: JSON has as many digits as they need.
"""

import json
import zlib

from testbench.errors import BenchError
from testbench.trials.rows import Table

LONGEST = 2**24  #: Longest text of a trial [byte]: a few packed ones could be of any length.


def pack(table: Table) -> bytes:
    """Rows of a trial as bytes; BenchError when they are too many."""
    text = json.dumps(table, separators=(",", ":")).encode()
    if len(text) > LONGEST:
        raise BenchError(f"rows: expected at most {LONGEST} bytes of a trial, got {len(text)}")
    return zlib.compress(text)


def unpack(data: object) -> Table:
    """Rows of a trial; ValueError or RecursionError where the bytes are of something else."""
    if not isinstance(data, bytes):
        raise ValueError(f"expected bytes, got {type(data).__name__}")
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
