"""Readings boiled down to triangular factors of their weighted equations, in parts for cross-validation.

Memory does not grow with the rows.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from testbench.data.series import Series, select_rows
from testbench.errors import Array
from testbench.identify.absolute.noise import POSITIONS, Noise, combine, kinds_of, plan_of, roots
from testbench.identify.absolute.rows import rows_of
from testbench.identify.absolute.state import State
from testbench.identify.absolute.unknowns import Unknowns
from testbench.identify.fold import Folded
from testbench.model.structure import Ids

BATCH = 3_000_000  #: Numbers of the equations that are in memory at a time.


@dataclass(frozen=True)
class Part:
    """The equations of one block of one series."""

    series: int  #: Place of the series.
    gram: Array  #: Sums of squares of [A | y] of every kind of equations, (kinds, size + 1, size + 1).
    counts: Array  #: Scalar equations of every kind, (kinds,).


@dataclass(frozen=True)
class Reduced:
    """All equations."""

    kinds: tuple[int, ...]  #: Kinds of equations that there are, as places of `KINDS`.
    parts: tuple[Part, ...]  #: In blocks.
    factors: Mapping[int, Array]  #: Triangular factor of [A | y] of every kind, (size + 1, size + 1).

    @cached_property
    def gram(self) -> Array:
        """Of all parts."""
        return total(self.parts)

    @property
    def positions(self) -> npt.NDArray[np.bool_]:
        """Which kinds are positions, (kinds,)."""
        return np.isin(self.kinds, POSITIONS)

    @property
    def counts(self) -> Array:
        """Of all parts."""
        return np.asarray(sum(part.counts for part in self.parts))


@dataclass(frozen=True)
class Weighting:
    """How much the readings of one series count."""

    pull: Array  #: Of every reading, robust, (s, rows) [1].
    block: Ids  #: Block of joint space of every row, the same for all rows of a pose, (rows,).


@dataclass(frozen=True)
class Point:
    """Where equations are linear, and how they are weighted."""

    unknowns: Unknowns
    state: State
    noise: Noise


def reduce(at: Point, series: Sequence[Series], weighting: Sequence[Weighting]) -> Reduced:
    """Fold all rows into triangular factors, those of every series and block by themselves first."""
    kinds, parts, whole = kinds_of(series), [], Folded(at.unknowns.size + 1)
    for place, (one, own) in enumerate(zip(series, weighting, strict=True)):
        for block in np.unique(own.block):
            part = _folded(at, one, own, np.flatnonzero(own.block == block))
            factors = [part.factor(kind, [0]) for kind in kinds]
            counts = np.array([part.sums[kind, 0][0] for kind in kinds])
            parts.append(Part(place, np.array([T.T @ T for T in factors]), counts))
            whole.join(part)
    return Reduced(kinds, tuple(parts), {kind: whole.factor(kind, [0]) for kind in kinds})


def _folded(at: Point, series: Series, own: Weighting, rows: Ids) -> Folded:
    """The equations of some rows."""
    found = Folded(at.unknowns.size + 1)
    targets = len(series.markers) + (series.rotation is not None)
    for some in batches(series.pose[rows], max(16, BATCH // (3 * targets * at.unknowns.size))):
        for kind, lines in equations(at, select_rows(series, rows[some]), own.pull[:, rows[some]]):
            found.sums[kind, 0] += lines.shape[1], 0
            found.add(kind, 0, lines)
    return found


def total(parts: Sequence[Part]) -> Array:
    """Sums of squares of several parts, (kinds, size + 1, size + 1)."""
    found = np.zeros_like(parts[0].gram)
    for part in parts:
        found += part.gram
    return found


def equations(at: Point, series: Series, pull: Array) -> Iterator[tuple[int, Array]]:
    """Whitened equations of every kind, (size + 1, equations): unknowns, then what they should tell."""
    rows, plan = rows_of(at.unknowns, at.state, series), plan_of(series)
    y = rows.left + np.einsum("sxcr,c->sxr", rows.A, at.unknowns.current(at.state))
    A = combine(plan, np.concatenate([rows.A, y[:, :, None]], axis=2))
    W, kinds = roots(series, at.noise, plan, at.state.frame(series).rotation)
    held = pull.copy()
    for group in plan.groups:
        held[:, group] = held[:, group].min(axis=2, keepdims=True)
    W = W * np.sqrt(held)[..., None, None]
    isotropic = series.precision is None
    A = A * W[:, None, None, :, 0, 0] if isotropic else np.einsum("srxy,sycr->sxcr", W, A)
    read = np.concatenate([series.seen.T, series.turned[None]])[: len(kinds)]
    lines = A.transpose(2, 1, 0, 3)
    for kind in np.unique(kinds):
        own = (kinds == kind) & read
        if own.any():
            yield int(kind), np.ascontiguousarray(lines[:, :, own].reshape(at.unknowns.size + 1, -1))


def batches(pose: Ids, size: int) -> Iterator[Ids]:
    """Places of rows in batches of about a size; the rows of a pose are never parted."""
    order = np.argsort(pose, kind="stable")
    first = np.flatnonzero(np.r_[True, np.diff(pose[order]) != 0])
    starts = [0]
    for place in first:
        if place - starts[-1] >= size:
            starts.append(int(place))
    for a, b in zip(starts, [*starts[1:], len(order)], strict=True):
        yield order[a:b]
