"""Reads a file as a whole and block by block, which must be the same bit by bit."""

from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest

from testbench.arm.folder import Arm
from testbench.data import read_series as read_series_module
from testbench.data import stream, table
from testbench.data.dataset import Dataset
from testbench.data.read_pairs import Export, read_export
from testbench.data.read_series import SeriesExport, _gathered, read_series
from testbench.data.series import Series
from testbench.data.spool import together
from testbench.errors import InputError

SIZE = 1500  #: Of a block: a few lines [byte].


def in_blocks(path: Path, arm: Arm, mapping: Path | None = None, size: int = SIZE) -> Export:
    """However small the file is."""
    with patch.multiple(stream, BLOCK=size, LEAST=0):
        return read_export(path, arm, mapping)


def whole(found: Export) -> Dataset:
    """All runs as one dataset."""
    if found.every is None:
        return found.data
    return together([found.every.block(k)[1] for k in range(len(found.every))])


def read_both_ways(path: Path, arm: Arm, mapping: Path | None = None) -> tuple[Dataset, bool]:
    """The runs of a file, and whether it was read block by block."""
    try:
        with patch.object(table, "TOGETHER", 200):
            expected = read_export(path, arm, mapping).data
    except InputError:
        with pytest.raises(InputError):
            in_blocks(path, arm, mapping)
        raise
    found = in_blocks(path, arm, mapping)
    check_equal(whole(found), expected)
    return expected, found.every is not None


def series_both_ways(path: Path, arm: Arm) -> tuple[SeriesExport, bool]:
    """The absolute readings of a file, and whether they were read block by block."""
    expected, gathered = read_series(path, arm), list[bool]()

    def gather(exports: Iterator[SeriesExport]) -> SeriesExport:
        found = _gathered(exports)
        gathered.append(True)
        return found

    with patch.multiple(stream, BLOCK=SIZE, LEAST=0), patch.object(read_series_module, "_gathered", gather):
        found = read_series(path, arm)
    assert found.notes == expected.notes
    for one, other in zip(found.series, expected.series, strict=True):
        check_equal(one, other)
    return expected, bool(gathered)


def check_equal(found: Dataset | Series, expected: Dataset | Series) -> None:
    """Bit by bit."""
    for name in (field.name for field in fields(expected)):
        one, other = getattr(found, name), getattr(expected, name)
        if isinstance(other, np.ndarray):
            np.testing.assert_array_equal(one, other, err_msg=name)
        else:
            assert one == other, name
