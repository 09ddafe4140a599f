"""Weighted least squares, Eq. (14)-(15), from the reduced rows, never by inverting the information matrix.

`minimum_norm` is the plain solution. `complete_conservatively` uses what the data leave unobservable to make
it conservative.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from testbench.errors import Array
from testbench.identify import cone
from testbench.identify.conic import EXACT_FIT, clip_eigenvalues, psd_entries, sensitivity_units
from testbench.identify.estimate import Estimate, make_estimate
from testbench.identify.observability import null_space
from testbench.identify.regression import RANK_TOLERANCE, Regression, check_symmetric, f_m
from testbench.model.structure import Structure


def minimum_norm(regression: Regression) -> Estimate:
    """Solve weighted least squares, Eq. (14)-(15), with minimum norm along unobservable directions.

    Positions and rotations are weighted by 1 / (sqrt(2) sigma). The norm is that of pi in units in which each
    column of the observation matrix has length one.

    Mathematics: `est-1`.

    Args:
        regression: The reduced dataset.

    Returns:
        The estimate; it need not be conservative.
    """
    # F_M weights a term by 1/sqrt(N); Eq. (14) sums squares over all equations equally.
    rows = np.vstack([np.sqrt(term.equations) * np.c_[term.R, term.z] for term in regression.terms])
    A, y, seen = rows[:, :-1], rows[:, -1], regression.columns > 0
    scale, pi = np.linalg.norm(A[:, seen], axis=0), np.zeros(regression.structure.n)
    # SVD of the scaled columns; singular values below RANK_TOLERANCE are structural zeros.
    pi[seen] = np.linalg.lstsq(A[:, seen] / scale, y, rcond=RANK_TOLERANCE)[0] / scale
    estimate = make_estimate(regression, pi, method="least squares", constraint="none")
    return replace(estimate, status="solved")


EQUAL_FIT = 1e-7
"""Relative excess of F_M over least squares that still counts as an equal fit [1].

The model's negative eigenvalues, the solver's last digits, are set to zero, which changes F_M a little.
"""
PROVEN_DISTANCE = 1e-8
"""Shift of all eigenvalues, in units where the data are of order one, that proves that no model of equal fit
is conservative [1]; smaller ones are the solver's rounding."""
ZERO_ENTRY = 1e-12
"""Entry of an unobservable direction of length one below which it counts as zero [1]."""
NO_CONSERVATIVE_FIT = "no conservative model fits as well as least squares"
COMPLETED_METHOD = "least squares, conservative of equal fit"
"""Method name of an estimate for which a conservative model of equal fit exists."""


@dataclass(frozen=True)
class EqualFits:
    """Hold all parameters that fit as well as least squares: X = x + N w, with any w."""

    unit: Array  #: pi = unit * X, (n,) [m/N, rad/(N m), rad/N].
    x: Array  #: The solution of minimum norm, (n,) [1].
    N: Array  #: Unobservable directions, orthonormal as matrices, (n, n - r) [1].


def complete_conservatively(regression: Regression) -> Estimate:
    """Solve least squares, then choose its unobservable directions so that the model is conservative.

    It minimises |w| subject to X_0 + N w positive semi-definite in every block. If no w does that, it returns
    the solution of minimum norm, and the status says so.

    Mathematics: `est-2`.

    Args:
        regression: The reduced dataset.

    Returns:
        The estimate; its status is "solved" only if it is conservative and fits as well as least squares.

    Raises:
        BenchError: When the structure is not symmetric.
    """
    check_symmetric(regression.structure)
    plain = replace(minimum_norm(regression), constraint="free")
    if plain.conservative:
        return plain
    if regression.rank == regression.structure.n:
        return replace(plain, status=f"{NO_CONSERVATIVE_FIT}: the data leave nothing free")
    # Second-order cone: the shortest w; PSD cones: every block of X_0 + N w.
    free = free_directions(regression, plain.pi)
    shortest = cone.norm_below(0, np.eye(free.N.shape[1] + 1)[1:], np.zeros(free.N.shape[1]))
    solution = cone.solve(_program(regression.structure, free, np.zeros(len(plain.pi)), (shortest,)))
    if solution.status != "solved":
        why = (
            NO_CONSERVATIVE_FIT
            if least_shift(regression.structure, free) > PROVEN_DISTANCE
            else solution.failure
        )
        return replace(plain, status=why, solver_seconds=solution.seconds)
    # Remove the solver's last digits, then check that the fit did not change by more than rounding.
    pi = free.unit * clip_eigenvalues(regression.structure, free.x + free.N @ solution.x[1:])
    estimate = make_estimate(regression, pi, method=COMPLETED_METHOD, constraint="free")
    allowed = EQUAL_FIT * plain.f_m + EXACT_FIT * f_m(regression, np.zeros(len(pi)))
    good = estimate.conservative and estimate.f_m <= plain.f_m + allowed
    if not good:
        estimate = replace(plain, status=f"{solution.failure}, and its digits do not suffice")
    return replace(estimate, status="solved" if good else estimate.status, solver_seconds=solution.seconds)


def free_directions(regression: Regression, pi: Array) -> EqualFits:
    """Compute the directions along which F_M does not change, in units of sensitivity.

    Args:
        regression: The reduced dataset.
        pi: Parameters of least squares, (n,) [m/N, rad/(N m), rad/N].

    Returns:
        The affine set X_0 + N w of equal fit.
    """
    s = regression.structure
    unit = sensitivity_units(regression, f_m(regression, np.zeros(s.n)) or 1.0)
    length = np.where(s.mirrored, math.sqrt(2), 1.0)  # an entry that stands at two places counts twice
    unseen = null_space(np.vstack([term.R for term in regression.terms]))
    N = np.linalg.qr((length / unit)[:, None] * unseen)[0]
    N[np.abs(N) < ZERO_ENTRY] = 0
    return EqualFits(unit, pi / unit, N / length[:, None])


def least_shift(s: Structure, free: EqualFits) -> float:
    """Compute a lower bound of the least t >= -1 for which some X_0 + N w + t 1 is positive semi-definite.

    Args:
        s: The unknowns.
        free: The affine set of equal fit.

    Returns:
        The bound, in units where the data are of order one [1]; above 0 no conservative model fits equally.
    """
    one = np.where(s.a == s.b, 1.0, 0.0)
    first = np.eye(1, 1 + free.N.shape[1])
    return cone.solve(_program(s, free, one, (cone.Rows("nonnegative", -first, np.ones(1)),))).bound


def _program(s: Structure, free: EqualFits, beside: Array, rows: tuple[cone.Rows, ...]) -> cone.ConeProgram:
    """Make the program min t over (t, w) with X_0 + N w + t B in the cone, B the argument `beside`."""
    for block in s.blocks:
        entries, svec = psd_entries(s, block)
        A = -svec @ np.c_[beside, free.N][entries]
        rows += (cone.Rows("psd", A, svec @ free.x[entries]),)
    cost = np.r_[1.0, np.zeros(free.N.shape[1])]
    return cone.ConeProgram(cost, (cone.free_block(0, len(cost)),), rows)
