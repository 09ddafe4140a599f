"""Reads a file as a whole and block by block, which must be the same bit by bit."""

from dataclasses import fields
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest

from testbench.arm.folder import Arm
from testbench.data import stream
from testbench.data.dataset import Dataset
from testbench.data.read_pairs import read_export
from testbench.data.spool import together
from testbench.errors import InputError

SIZE = 1500  #: Of a block: a few lines [byte].


def in_blocks(path: Path, arm: Arm, mapping: Path | None = None, size: int = SIZE) -> stream.Streamed:
    """However small the file is."""
    with patch.object(stream, "BLOCK", size):
        return stream.read_campaign(path, arm, mapping, least=0)


def whole(found: stream.Streamed) -> Dataset:
    """All runs as one dataset."""
    if found.every is None:
        return found.export.data
    return together([found.every.block(k)[1] for k in range(len(found.every))])


def read_both_ways(path: Path, arm: Arm, mapping: Path | None = None) -> tuple[Dataset, bool]:
    """The runs of a file, and whether it was read block by block."""
    try:
        expected = read_export(path, arm, mapping).data
    except InputError:
        with pytest.raises(InputError):
            in_blocks(path, arm, mapping)
        raise
    found = in_blocks(path, arm, mapping)
    check_equal(whole(found), expected)
    return expected, found.every is not None


def check_equal(found: Dataset, expected: Dataset) -> None:
    """Bit by bit."""
    for name in (field.name for field in fields(expected)):
        one, other = getattr(found, name), getattr(expected, name)
        if isinstance(other, np.ndarray):
            np.testing.assert_array_equal(one, other, err_msg=name)
        else:
            assert one == other, name
