"""Weighted least squares, Eq. (14)-(15), by SVD of the reduced rows; never by an inverse."""

import math
from dataclasses import dataclass, replace

import numpy as np

from testbench.errors import Array
from testbench.identify import cone
from testbench.identify.conic import EXACT, clip, psd_entries, sensitivity_units
from testbench.identify.estimate import Estimate, make_estimate
from testbench.identify.observability import null_space
from testbench.identify.regression import RANK_TOLERANCE, Regression, check_symmetric, f_m
from testbench.model.structure import Structure


def minimum_norm(regression: Regression) -> Estimate:
    """Weighted least squares, Eq. (14)-(15); of minimum norm where the data leave directions free.

    Positions and rotations are weighted by the inverse of their sigma. The norm is that of the parameters in
    units in which each column of the observation matrix has length one.
    """
    # F_M weights a term by 1/sqrt(N); Eq. (14) sums squares over all equations alike.
    rows = np.vstack([np.sqrt(term.equations) * np.c_[term.R, term.z] for term in regression.terms])
    A, y, seen = rows[:, :-1], rows[:, -1], regression.columns > 0
    scale, pi = np.linalg.norm(A[:, seen], axis=0), np.zeros(regression.structure.n)
    pi[seen] = np.linalg.lstsq(A[:, seen] / scale, y, rcond=RANK_TOLERANCE)[0] / scale
    found = make_estimate(regression, pi, method="least squares", constraint="none")
    return replace(found, status="solved")


EQUAL = 1e-7
"""Share by which F_M may exceed that of least squares and count as equal: negative eigenvalues of the
solver's last digits are set to zero."""
PROVEN = 1e-8
"""Shift of all eigenvalues, where the data are of order one, that models of equal fit need if none is in the
cone; below it is what solvers leave."""
ROUNDING = 1e-12  #: Entry of a free direction of length one below which it is zero.
NONE = "no conservative model fits as well as least squares"
COMPLETED = "least squares, conservative of equal fit"  #: The method, where there is such a model.


@dataclass(frozen=True)
class Free:
    """What the data leave free: X = x + N w, entry by entry of the parameters."""

    unit: Array  #: pi = unit * X, (n,).
    x: Array  #: The solution of minimum norm, (n,).
    N: Array  #: Directions that no reading sees, orthonormal as matrices, (n, n - r).


def completed(regression: Regression) -> Estimate:
    """Least squares whose free directions make it conservative, nearest to the solution of minimum norm.

    Where what the data see allows no conservative model, it is the solution of minimum norm, and the status
    says so.

    Raises:
        BenchError: When the structure is not symmetric.
    """
    check_symmetric(regression.structure)
    plain = replace(minimum_norm(regression), constraint="free")
    if plain.conservative:
        return plain
    if regression.rank == regression.structure.n:
        return replace(plain, status=f"{NONE}: the data leave nothing free")
    free = free_directions(regression, plain.pi)
    shortest = cone.norm_below(0, np.eye(free.N.shape[1] + 1)[1:], np.zeros(free.N.shape[1]))
    found = cone.solve(_program(regression.structure, free, np.zeros(len(plain.pi)), (shortest,)))
    if found.status != "solved":
        why = NONE if least_shift(regression.structure, free) > PROVEN else found.failure
        return replace(plain, status=why, solver_seconds=found.seconds)
    pi = free.unit * clip(regression.structure, free.x + free.N @ found.x[1:])
    estimate = make_estimate(regression, pi, method=COMPLETED, constraint="free")
    allowed = EQUAL * plain.f_m + EXACT * f_m(regression, np.zeros(len(pi)))
    good = estimate.conservative and estimate.f_m <= plain.f_m + allowed
    if not good:
        estimate = replace(plain, status=f"{found.failure}, and its digits do not suffice")
    return replace(estimate, status="solved" if good else estimate.status, solver_seconds=found.seconds)


def free_directions(regression: Regression, pi: Array) -> Free:
    """The directions along which models fit as parameters do, (n,), in units of sensitivity."""
    s = regression.structure
    unit = sensitivity_units(regression, f_m(regression, np.zeros(s.n)) or 1.0)
    length = np.where(s.mirrored, math.sqrt(2), 1.0)  # an entry that stands at two places counts twice
    unseen = null_space(np.vstack([term.R for term in regression.terms]))
    N = np.linalg.qr((length / unit)[:, None] * unseen)[0]
    N[np.abs(N) < ROUNDING] = 0
    return Free(unit, pi / unit, N / length[:, None])


def least_shift(s: Structure, free: Free) -> float:
    """What no t >= -1 is below, of all w for which X_0 + N w + t 1 has positive semi-definite blocks."""
    one = np.where(s.a == s.b, 1.0, 0.0)
    first = np.eye(1, 1 + free.N.shape[1])
    return cone.solve(_program(s, free, one, (cone.Rows("nonnegative", -first, np.ones(1)),))).bound


def _program(s: Structure, free: Free, beside: Array, rows: tuple[cone.Rows, ...]) -> cone.Problem:
    """The least t with X_0 + N w + t beside in the cone, and what else; the unknowns are t, then w."""
    for block in s.blocks:
        entries, svec = psd_entries(s, block)
        A = -svec @ np.c_[beside, free.N][entries]
        rows += (cone.Rows("psd", A, svec @ free.x[entries]),)
    cost = np.r_[1.0, np.zeros(free.N.shape[1])]
    return cone.Problem(cost, (cone.free_block(0, len(cost)),), rows)
