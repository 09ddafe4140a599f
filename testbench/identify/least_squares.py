"""Weighted least squares, Eq. (14)-(15), by SVD of the reduced rows; never by an inverse."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from testbench.errors import Array
from testbench.identify.estimate import Estimate, make_estimate
from testbench.identify.regression import RANK_TOLERANCE, Regression


def minimum_norm(regression: Regression) -> Estimate:
    """Weighted least squares, Eq. (14)-(15); of minimum norm where the data leave directions free.

    Positions and rotations are weighted by the inverse of their sigma. The norm is that of the parameters in
    units in which each column of the observation matrix has length one.
    """
    advice: tuple[str, ...] = ()
    if regression.rank < regression.structure.n:
        advice = ("least squares filled the free directions with the solution of minimum norm",)
    pi = solve(regression)
    found = make_estimate(regression, pi, method="least squares", constraint="none", advice=advice)
    return replace(found, status="solved")


def solve(regression: Regression) -> Array:
    """Parameters of least sum of squares over all terms, of minimum norm in scaled units, (n,)."""
    return np.asarray(solve_all([regression])[0])


def solve_all(regressions: Sequence[Regression]) -> Array:
    """The same of datasets that differ in their readings alone, (datasets, n)."""
    # F_M weights a term by 1/sqrt(N); Eq. (14) sums squares over all equations alike.
    one = regressions[0]
    weights = [np.sqrt(term.equations) for term in one.terms]
    A = np.vstack([w * term.R for w, term in zip(weights, one.terms, strict=True)])
    y = [
        np.concatenate([w * term.z for w, term in zip(weights, own.terms, strict=True)])
        for own in regressions
    ]
    seen = one.columns > 0
    scale = np.linalg.norm(A[:, seen], axis=0)
    pi = np.zeros((len(y), one.structure.n))
    pi[:, seen] = np.linalg.lstsq(A[:, seen] / scale, np.transpose(y), rcond=RANK_TOLERANCE)[0].T / scale
    return pi
