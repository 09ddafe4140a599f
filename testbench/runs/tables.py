"""Tables of numbers and words in Parquet files that any program reads; a list of numbers may be a cell."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pyarrow as pa
from pyarrow import parquet

from testbench.errors import InputError, open_file

GROUP = 2**16  #: Rows of a row group.
MAX_BYTES = 10**9  #: Of a file [byte].
Cells = npt.NDArray[np.generic]


def write_table(path: Path, columns: Mapping[str, Cells | Sequence[str]]) -> None:
    """Write columns by name; of an array (rows, n) each cell is a list.

    Args:
        path: Path of the file.
        columns: Columns by name, of equal length.
    """
    cells = {name: list(own) if np.ndim(own) > 1 else own for name, own in columns.items()}
    _write(path, pa.table(cells))


def join_tables(parts: Sequence[Path], path: Path) -> None:
    """Write the rows of several tables one behind the other; the same rows give the same bytes.

    Args:
        parts: Files of the tables.
        path: File of the whole.
    """
    _write(path, pa.concat_tables(parquet.read_table(part, memory_map=True) for part in parts))


def _write(path: Path, table: pa.Table) -> None:
    parquet.write_table(table.combine_chunks(), path, compression="zstd", row_group_size=GROUP)


def read_table(path: Path, names: Sequence[str], **kept: str | None) -> dict[str, Cells]:
    """Read columns of a table by name.

    Args:
        path: A file of `write_table`.
        names: The columns that are wanted; there may be more.
        kept: By column the word of the rows that are wanted; None for all rows.

    Returns:
        The columns.

    Raises:
        InputError: When it is no Parquet file, or lacks a column.
    """
    with open_file(path, MAX_BYTES):
        pass  # a plain file
    words = [(name, "==", word) for name, word in kept.items() if word is not None]
    try:
        lacking = [name for name in (*names, *kept) if name not in parquet.read_schema(path).names]
        if lacking:
            raise InputError(path, f"column {lacking[0]}", "expected it, there is none")
        table = parquet.read_table(path, columns=list(names), filters=words or None)
        return {name: _array(table[name]) for name in names}
    except (OSError, ValueError, pa.ArrowException) as err:
        raise InputError(path, "", f"expected a table in Parquet: {err}") from err


def _array(column: pa.ChunkedArray) -> Cells:
    lists = pa.types.is_list(column.type)
    return np.array(column.to_pylist()) if lists else column.to_numpy()


def kinds(path: Path) -> dict[str, str]:
    """Name what each column of a table holds, in Arrow's words: int64, string, list<element: double>."""
    return {field.name: str(field.type) for field in parquet.read_schema(path)}
