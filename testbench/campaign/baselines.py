"""What a study's models are compared with."""

from collections.abc import Sequence
from typing import Any, TypeVar

from testbench.campaign.campaign import Cell
from testbench.campaign.models import Model
from testbench.identify import Constraint, completed_least_squares
from testbench.model.structure import template56

T = TypeVar("T")

JOINTS = "Joints"  #: Key of `MODELS`: what most calibrations identify, the incumbent to beat.
EQUAL_FIT = "MLS56, PSD of equal fit"


def equal_fit(cell: Cell) -> Model:
    """The model of MLS56 with its free directions used to be conservative."""
    return Model(EQUAL_FIT, template56(cell.arm, name="MLS56"), completed_least_squares)


def is_least_squares(structure: str, constraint: Constraint, *, prior: bool) -> bool:
    """Whether it is least squares of links without a prior, what GCO is compared with."""
    return structure != JOINTS and constraint == "none" and not prior


def distinct(rows: Sequence[T]) -> list[T]:
    """The models without a completion that exists in no seed: that is least squares once more."""
    every: Sequence[Any] = rows
    return [row for row in every if row.constraint != "free" or row.conservative is not False]
