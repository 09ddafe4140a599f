"""Weighted least squares, Eq. (14)-(15), by SVD of the reduced rows; never by an inverse."""

import numpy as np

from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify.estimate import Estimate, make_estimate
from testbench.identify.regression import RANK_TOLERANCE, Regression, reduce
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm


def least_squares(vjm: Vjm, structure: Structure, data: Dataset) -> Estimate:
    """Weighted least squares, Eq. (14)-(15); of minimum norm where the data leave directions free.

    Positions and rotations are weighted by the inverse of their sigma. The norm is that of the parameters in
    units in which each column of the observation matrix has length one.

    Args:
        vjm: The model.
        structure: The unknowns.
        data: The runs.

    Raises:
        BenchError: When the dataset is empty or names a marker that the arm lacks.
    """
    return minimum_norm(reduce(vjm, structure, data))


def minimum_norm(regression: Regression) -> Estimate:
    """Weighted least squares on a reduced dataset, as in `least_squares`."""
    advice: tuple[str, ...] = ()
    if regression.rank < regression.structure.n:
        advice = ("least squares filled the free directions with the solution of minimum norm",)
    pi = solve(regression)
    return make_estimate(regression, pi, method="least squares", status="solved", advice=advice)


def solve(regression: Regression) -> Array:
    """Parameters of least sum of squares over all terms, of minimum norm in scaled units, (n,)."""
    # F_M weights a term by 1/sqrt(N); Eq. (14) sums squares over all equations alike.
    rows = [np.sqrt(term.equations) * np.c_[term.R, term.z] for term in regression.terms]
    A, y = np.split(np.vstack(rows), [regression.structure.n], axis=1)
    seen = regression.columns > 0
    scale = np.linalg.norm(A[:, seen], axis=0)
    pi = np.zeros(regression.structure.n)
    pi[seen] = np.linalg.lstsq(A[:, seen] / scale, y[:, 0], rcond=RANK_TOLERANCE)[0] / scale
    return pi


def information_matrix(regression: Regression) -> Array:
    """Information matrix of Eq. (15), sum of A^T eta^T eta A, for reports; never inverted here.

    Returns:
        (n, n) in inverse squared units of pi.
    """
    return np.asarray(sum(t.equations / 3 * t.R.T @ t.R for t in regression.terms))
