"""What a study's models are compared with, and the comparison: seed by seed, by true errors."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeVar

from testbench.bench.campaign import Cell
from testbench.bench.models import Model
from testbench.bench.rows import JudgedRow
from testbench.identify import Constraint, completed_least_squares
from testbench.model.structure import template56
from testbench.trials.duel import Duel
from testbench.trials.gain import Gain, gained
from testbench.trials.spread import middle, spread, wins

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


def gain(by_name: Mapping[str, Sequence[JudgedRow]], ours: str, theirs: str) -> Gain | None:
    """Two models over the workspace, against the truth; None where one is not there, or both are one."""
    if ours == theirs or not {ours, theirs} <= by_name.keys():
        return None
    a, b = ([middle(row.workspace.rms_mm) for row in by_name[name]] for name in (ours, theirs))
    return gained(ours, theirs, a, b)


def duels(by_name: Mapping[str, Sequence[JudgedRow]], pairs: Iterable[tuple[str, str]]) -> list[Duel]:
    """Duels of those pairs that are there, each once; none in a single seed."""
    found = [
        duel(by_name[a], by_name[b]) for a, b in dict.fromkeys(pairs) if a != b and {a, b} <= by_name.keys()
    ]
    return [d for d in found if d.seeds > 1]


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
