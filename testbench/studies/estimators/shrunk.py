"""Least squares that are held down without a cone: ridge regression, and eigenvalues clipped afterwards."""

from dataclasses import replace

import numpy as np

from testbench.data.dataset import Dataset
from testbench.identify import Estimate, least_squares, make_estimate, reduce
from testbench.identify.cone import psd_part
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm

UNSEEN = 1e-9  #: Length of a column over the longest one below which no reading sees it.
RIDGES = np.geomspace(1e-9, 1, 60)  #: Tried, over the largest eigenvalue.


def ridge(vjm: Vjm, structure: Structure, data: Dataset) -> Estimate:
    """Identify by ridge regression in columns of length one, its size by generalised cross-validation.

    Golub, Heath, Wahba 1979, "Generalized cross-validation as a method for choosing a good ridge parameter".

    Args:
        vjm: Kinematics of the arm.
        structure: The unknowns.
        data: Measured runs.

    Returns:
        The estimate.
    """
    regression = reduce(vjm, structure, data)
    A, y = regression.rows
    scale = np.linalg.norm(A, axis=0)
    scale[scale < UNSEEN * scale.max()] = np.inf  # what no reading sees is zero
    U, s, Vt = np.linalg.svd(A / scale, full_matrices=False)
    z = U.T @ y
    rest = y @ y - z @ z + sum(term.equations / 3 * term.unexplained for term in regression.terms)

    def score(size: float) -> float:
        left = size / (s**2 + size)
        return float(((left * z) @ (left * z) + rest) / (regression.equations - (1 - left).sum()) ** 2)

    size = min(RIDGES * s[0] ** 2, key=score)
    pi = Vt.T @ (s / (s**2 + size) * z) / scale
    return replace(make_estimate(regression, pi, method="ridge", constraint="ridge"), status="solved")


def clipped(vjm: Vjm, structure: Structure, data: Dataset) -> Estimate:
    """Identify by least squares, negative eigenvalues of every block set to zero afterwards.

    Args:
        vjm: Kinematics of the arm.
        structure: The unknowns.
        data: Measured runs.

    Returns:
        The estimate.
    """
    plain = least_squares(vjm, structure, data)
    C = plain.C_theta.copy()
    for block in structure.blocks:
        C[np.ix_(block, block)] = psd_part(C[np.ix_(block, block)])
    pi, regression = structure.entries(C), plain.regression
    return replace(
        make_estimate(regression, pi, method="clipped least squares", constraint="clipped"), status="solved"
    )
