"""Robust identification: Huber's loss on the length of every reading's residual; wild readings are rejected.

A reading is the deflection of one marker in one run, or the rotation of the tool in one run: three numbers
y_i in units of sqrt(2) sigma. Over the models x and one outlier o_i in R^3 a reading, a conic program finds

    min 1/2 sum_i |A_i x + o_i - y_i|^2 + DELTA sum_i |o_i| + 1/2 |B x - c|^2

with the rows B, c of the prior. Least over o_i that is Huber's loss of |A_i x - y_i|: half its square up to
DELTA, the tangent beyond. No reading pulls harder than DELTA, however wild it is.

The program finds the outliers: readings with a residual beyond REJECT, where o_i is not zero. The estimate is
the plain one from all other readings. Huber's own model was worse, as a wild reading goes on pulling: with a
fifth of the readings off by 1 mm it cost 20 to 25 % of RMS over the workspace, the rejection 2 to 5 %
(KR 500, MGCO68 and MGCO56 with a prior, median of 20 seeds). It was better only for errors as small as
0.3 mm, four standard deviations, of which the rejection sees half.

Three markers on a rigid tool have nine numbers for six: a run by itself notices an error of one marker within
their plane, not always whose it is, and none across the plane. Other runs and the prior tell the rest.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from testbench.data.dataset import Dataset, Mask
from testbench.errors import Array, BenchError
from testbench.identify import cone
from testbench.identify.estimate import TOOL, Constraint, Estimate, Rejected
from testbench.identify.metric import Belief, metric, precision_root
from testbench.identify.prior import Strength, cad_prior
from testbench.identify.regression import (
    RANK_TOLERANCE,
    ROUNDING,
    Regression,
    regression_of,
    term_of,
    triangle,
)
from testbench.identify.solve import solve
from testbench.identify.weighed import Readings, one_by_one
from testbench.model.vjm import Vjm

DELTA = 1.628
"""Length of a residual, in standard deviations, beyond which its reading pulls no harder.

Means of normal 3-vectors then keep 95 % of their efficiency: what 1.345 is for single numbers.
"""
REJECT = 4.033
"""Length beyond which a reading is rejected: the 99.9 % quantile of a standard normal 3-vector.

At 99 % every third campaign of 45 sound readings would lose one, and gain nothing for it.
"""
WEAK = 10.0  #: Relative uncertainty of the CAD compliances while outliers of GCO without a prior are sought.
NO_OUTLIERS = "sigma too small, or wrong structure, load, unit or frame"


@dataclass(frozen=True)
class Huber:
    """Optimum of the program."""

    x: Array  #: Model, (n,).
    length: Array  #: Length of every reading's residual, (readings,) [1].
    status: str  #: "solved", or what went wrong.
    seconds: float  #: Time inside the solver.


def without_outliers(
    vjm: Vjm, data: Dataset, regression: Regression, constraint: Constraint, belief: Belief | None
) -> Estimate:
    """The plain estimate from the readings that Huber's loss does not reject; for GCO of whole blocks.

    F_M, its floor and the rank are of the readings that are left.

    Raises:
        BenchError: When the dataset is too large, or too few readings are left.
    """
    readings = one_by_one(vjm, regression.structure, data)
    found = search(vjm, readings, regression, constraint, belief)
    keep = found.length <= REJECT
    _check_left(keep, regression.rank)
    if not keep.all():
        regression = _accepted(regression, readings, keep)
    plain = solve(regression, constraint, belief)
    return replace(
        plain,
        method=f"{plain.method}, Huber loss",
        status=plain.status if found.status == "solved" else f"{found.status} (search for outliers)",
        solver_seconds=plain.solver_seconds + found.seconds,
        rejected=_rejected(data, readings, keep, plain.pi),
        lost=tuple(data.run[np.setdiff1d(readings.run, readings.run[keep])].tolist()),
    )


def search(
    vjm: Vjm, readings: Readings, regression: Regression, constraint: Constraint, belief: Belief | None
) -> Huber:
    """The program that finds the outliers.

    For GCO without a prior the compliances of the arm's folder, known to a factor of WEAK, keep its numbers
    of order one.
    """
    if constraint != "psd" and belief is None:
        A = _column_space(readings.A)
        return huber(A, readings.y, np.zeros((1, A.shape[2])), np.zeros(1))
    if belief is None:
        belief = Belief(metric(cad_prior(vjm.arm), vjm, regression.structure), Strength(WEAK))
    units = belief.metric
    B, c = precision_root(units, belief.strength)
    return huber(readings.A @ units.L, readings.y, B, c, units.sizes if constraint == "psd" else ())


def huber(A: Array, y: Array, B: Array, c: Array, sizes: tuple[int, ...] = ()) -> Huber:
    """Minimise sum_i h(|A_i x - y_i|) + 1/2 |B x - c|^2, h Huber's loss, as a conic program.

    Its variables are x, what noise explains of every reading, e_i, and bounds t_i >= |y_i - A_i x - e_i|. A
    is (readings, 3, n), y (readings, 3) [1], B (any, n) and c (any,) are those of the prior. `sizes` are
    those of the blocks of x, each the svec of a matrix that must be positive semi-definite; none for least
    squares.
    """
    N, _, n = A.shape
    rows = np.zeros((N, 4, n))
    rows[:, 1:] = A
    one = np.eye(4)
    e, bound = sparse.kron(sparse.eye(N), one[:, 1:]), sparse.kron(sparse.eye(N), -one[:, :1])
    M = sparse.csc_matrix(sparse.hstack([sparse.csc_matrix(rows.reshape(4 * N, n)), e, bound]))
    x_blocks = cone.psd_blocks(0, sizes) if sizes else (cone.free_block(0, n),)
    solution = cone.solve(
        cone.Problem(
            cost=np.r_[-B.T @ c, np.zeros(3 * N), np.full(N, DELTA)],
            blocks=(*x_blocks, cone.free_block(n, 4 * N)),
            rows=(cone.Rows("second order", M, np.c_[np.zeros(N), y].ravel(), each=4),),
            quadratic=sparse.csc_matrix(
                sparse.block_diag([np.triu(B.T @ B), sparse.eye(3 * N), sparse.csc_matrix((N, N))])
            ),
        )
    )
    x = solution.x[:n]
    return Huber(x, np.linalg.norm(y - A @ x, axis=1), solution.status, solution.seconds)


def _column_space(A: Array) -> Array:
    """Orthonormal columns that span the rows of all readings, (readings, 3, rank); zeros for rank 0."""
    rows = A.reshape(-1, A.shape[2])
    norm = np.linalg.norm(rows, axis=0)
    seen = norm > ROUNDING * norm.max()
    if not seen.any():
        return A[..., :1]
    U, s, _ = np.linalg.svd(rows[:, seen] / norm[seen], full_matrices=False)
    return np.asarray(U[:, s > RANK_TOLERANCE * s[0]].reshape(*A.shape[:2], -1))


def _check_left(keep: Mask, rank: int) -> None:
    """Refuse a search that left no reading, or fewer equations than directions that all readings see."""
    left = int(keep.sum())
    if not left or 3 * left < rank:
        raise BenchError(
            f"{len(keep) - left} of {len(keep)} readings rejected, beyond {REJECT} standard deviations; "
            f"{3 * left} equations left for {rank} directions: {NO_OUTLIERS}"
        )


def _accepted(regression: Regression, readings: Readings, keep: Mask) -> Regression:
    """The regression of these readings alone; a term that lost all of its own is left out."""
    terms = []
    for kind in (readings.marker >= 0, readings.marker < 0):
        some = keep & kind
        if some.any():
            rows = np.concatenate([readings.A[some], readings.y[some, :, None]], axis=2)
            T = triangle(rows.reshape(-1, rows.shape[2])) / np.sqrt(some.sum())
            terms.append(term_of(T, 0.0, 3 * int(some.sum())))
    return regression_of(regression.structure, tuple(terms))


def _rejected(data: Dataset, readings: Readings, keep: Mask, pi: Array) -> tuple[Rejected, ...]:
    """The readings left out, with their distance from the estimate that does without them."""
    length = np.linalg.norm(readings.y - readings.A @ pi, axis=1)
    names = (*data.markers, TOOL)
    return tuple(
        Rejected(
            run=int(data.run[readings.run[i]]),
            marker=names[readings.marker[i]],
            residual=float(length[i] * readings.unit[i]),
            sigmas=float(length[i]),
        )
        for i in np.flatnonzero(~keep)
    )
