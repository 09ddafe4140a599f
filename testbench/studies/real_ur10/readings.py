"""The public readings, and which of them train a model and judge it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.absolute import FRAME_POSES, read_all
from testbench.bench.campaign import Cell, build_cell
from testbench.data.dataset import Ids
from testbench.data.series import Series, select_rows
from testbench.identify.absolute.choose import blocks_of

ARM = "ur10"
FILES = {"A": "series_A_every_8th.csv", "C": "series_C.csv"}
"""Of the arm's folder, by the name that their authors gave the series."""
THIN = 6  #: Every so many rows are read with --quick.


@dataclass(frozen=True)
class Readings:
    """The arm and its series."""

    cell: Cell
    series: tuple[Series, ...]  #: A and C.


@dataclass(frozen=True)
class Judged:
    """Readings that judge a model."""

    series: Series
    frame_poses: int | None  #: Rows that tell its frame and target anew; None for those of the training.


@dataclass(frozen=True)
class Split:
    """Readings that train, and others that judge."""

    name: str
    words: str  #: What it is.
    train: tuple[Series, ...]
    judged: tuple[Judged, ...]


def read(thin: int) -> Readings:
    """Every `thin`-th row of both series, called A and C."""
    folder = find_arm(ARM)
    cell = build_cell(folder)
    series, _ = read_all([folder / "readings" / name for name in FILES.values()], cell.arm, None, None)
    some = [select_rows(one, np.arange(0, one.rows, thin)) for one in series]
    return Readings(cell, tuple(replace(one, name=name) for name, one in zip(FILES, some, strict=True)))


SPLITS = {
    "blocks": "trained on half of the blocks of joint space of both series, judged on the others",
    "A to C": "trained on A, judged on C, its frame and target by 50 of its poses",
    "C to A": "trained on C, judged on A, its frame and target by 50 of its poses",
    "blocks, realigned": "as blocks, frames and targets of the others by 50 of their poses",
    "both": "trained on both series, judged on nothing",
}


def split(name: str, series: Sequence[Series]) -> Split:
    """A split of A and C."""
    a, c = series
    if name == "A to C":
        return Split(name, SPLITS[name], (a,), (Judged(c, FRAME_POSES),))
    if name == "C to A":
        return Split(name, SPLITS[name], (c,), (Judged(a, FRAME_POSES),))
    if name == "both":
        return Split(name, SPLITS[name], (a, c), ())
    blocks = zip(series, blocks_of(series), strict=True)
    train, rest = zip(*(_halves(one, own) for one, own in blocks), strict=True)
    poses = FRAME_POSES if name.endswith("realigned") else None
    return Split(name, SPLITS[name], train, tuple(Judged(one, poses) for one in rest))


def _halves(series: Series, block: Ids) -> tuple[Series, Series]:
    """Rows of blocks of even and of odd number."""
    return select_rows(series, block % 2 == 0), select_rows(series, block % 2 == 1)
