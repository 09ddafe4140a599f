"""What a study's models are compared with, and the comparison: seed by seed, by true errors."""

from collections.abc import Sequence
from dataclasses import dataclass

from testbench.bench.campaign import Cell, Model
from testbench.bench.rows import JudgedRow
from testbench.identify import completed_least_squares
from testbench.model.structure import template56
from testbench.trials.spread import Number, middle, spread, wins

JOINTS = "Joints"  #: Key of `MODELS`: what most calibrations identify, the incumbent to beat.
EQUAL_FIT = "MLS56, PSD of equal fit"


@dataclass(frozen=True)
class Duel:
    """A model against another one, seed by seed, by true errors; alike are those a solver's digits apart."""

    ours: str
    theirs: str
    check: int  #: Seeds in which ours has the smaller error at the check poses.
    workspace: int  #: The same over the workspace.
    alike: int  #: Seeds in which the two err alike over the workspace.
    seeds: int  #: Of all.
    cone: bool  #: Whether they differ in nothing but the cone.
    ratio: Number  #: Our error over the workspace over theirs.


def equal_fit(cell: Cell) -> Model:
    """The model of MLS56 with its free directions used to be conservative."""
    return Model(EQUAL_FIT, template56(cell.arm, name="MLS56"), completed_least_squares)


def duel(ours: Sequence[JudgedRow], theirs: Sequence[JudgedRow]) -> Duel:
    """Two models in the same seeds."""
    (a, b), (at, bt) = (
        [[middle(getattr(row, where).rms_mm) for row in rows] for rows in (ours, theirs)]
        for where in ("workspace", "check_true")
    )
    ahead, one, other = wins(a, b), ours[0], theirs[0]
    same = (one.parameters, one.prior) == (other.parameters, other.prior)
    return Duel(
        ours=one.name,
        theirs=other.name,
        check=wins(at, bt),
        workspace=ahead,
        alike=len(a) - ahead - wins(b, a),
        seeds=len(a),
        cone=same and one.constraint != other.constraint,
        ratio=spread([x / y for x, y in zip(a, b, strict=True)]),
    )
