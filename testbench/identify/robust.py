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

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import clarabel
import numpy as np
import numpy.typing as npt
from scipy import sparse

from testbench.data.dataset import Dataset, Mask
from testbench.errors import Array, BenchError
from testbench.identify import prior
from testbench.identify.conic import optimum, solver_settings
from testbench.identify.estimate import Estimate
from testbench.identify.least_squares import minimum_norm
from testbench.identify.prior import Metric
from testbench.identify.regression import (
    RANK_TOLERANCE,
    ROUNDING,
    Regression,
    Term,
    marker_points,
    reduce,
    regression_of,
)
from testbench.identify.regularised import Strength, gco_with, least_squares_with, precision_root, status_of
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm, observation

DELTA = 1.628
"""Length of a residual, in standard deviations, beyond which its reading pulls no harder.

Means of normal 3-vectors then keep 95 % of their efficiency: what 1.345 is for single numbers.
"""
REJECT = 4.033
"""Length beyond which a reading is rejected: the 99.9 % quantile of a standard normal 3-vector.

At 99 % every third campaign of 45 sound readings would lose one, and gain nothing for it.
"""
MOST_REJECTED = 1 / 3
"""Share of rejected readings beyond which the advice doubts that they are outliers."""
WEAK = 10.0
"""Relative uncertainty of the CAD compliances while outliers of GCO without a prior are sought."""
MOST_READINGS = 5000
"""Most readings that fit into one program: about ten seconds and some hundred megabytes for 153 unknowns."""
NO_OUTLIERS = "sigma too small, or wrong structure, load, unit or frame"
TOOL = "orientation"
"""Stands in for the marker where the tool's orientation was read."""


@dataclass(frozen=True)
class Rejected:
    """A reading that the estimate does without.

    Attributes:
        run: Identifier of its run.
        marker: Name of its marker, or `TOOL`.
        residual: Distance of the reading from the estimate's prediction [m, or rad for an orientation]; the
            estimate is not the model that rejected it, so a few are below REJECT.
        sigmas: The same in standard deviations of a deflection, sqrt(2) sigma [1].
    """

    run: int
    marker: str
    residual: float
    sigmas: float


@dataclass(frozen=True)
class RobustFit:
    """An estimate and the readings that it does without.

    Attributes:
        estimate: From all other readings: F_M, its floor and the rank are of those.
        rejected: In the order of the dataset.
    """

    estimate: Estimate
    rejected: tuple[Rejected, ...]


@dataclass(frozen=True)
class Readings:
    """Rows of Eq. (13), reading by reading, in standard deviations.

    Attributes:
        A: Observation matrices, (readings, 3, n).
        y: Measured, (readings, 3) [1].
        unit: Standard deviation of each, sqrt(2) sigma where all axes are alike, (readings,) [m, rad].
        run: Index of its run in the dataset, (readings,).
        marker: Index of its marker, -1 for the orientation, (readings,).
    """

    A: Array
    y: Array
    unit: Array
    run: npt.NDArray[np.int_]
    marker: npt.NDArray[np.int_]


@dataclass(frozen=True)
class Huber:
    """Optimum of the program.

    Attributes:
        x: Model, (n,).
        length: Length of every reading's residual, (readings,) [1].
        status: "solved", or what went wrong.
        seconds: Time inside the solver.
    """

    x: Array
    length: Array
    status: str
    seconds: float


def gco_robust(
    vjm: Vjm,
    structure: Structure,
    data: Dataset,
    *,
    metric: Metric | None = None,
    strength: Strength | None = None,
) -> RobustFit:
    """GCO from the readings that Huber's loss does not reject.

    Without a prior the compliances of the arm's folder, known to a factor of WEAK, keep the numbers of the
    program that finds the outliers of order one; the estimate itself is that of `gco`.

    Args:
        vjm: The model.
        structure: The unknowns, every block with all its entries.
        data: The runs.
        metric: The structure in the metric of a prior; None for no prior.
        strength: How firmly that is believed.

    Raises:
        BenchError: When the dataset is empty, too large or names a marker that the arm lacks, only one of
            metric and strength is given or it is of another structure, or too few readings are left.
    """
    _check_prior(structure, metric, strength)
    regression, readings = reduce(vjm, structure, data), weigh(vjm, structure, data)
    units = metric or prior.metric(prior.cad_prior(vjm.arm), vjm, structure)
    B, c = precision_root(units, strength or Strength(WEAK))
    found = huber(readings.A @ units.L, readings.y, B, c, units.sizes)

    def refit(regression: Regression) -> Estimate:
        if metric is None or strength is None:
            return optimum(regression)
        return gco_with(regression, metric, strength)

    return _without_outliers(data, regression, readings, found, refit)


def least_squares_robust(
    vjm: Vjm,
    structure: Structure,
    data: Dataset,
    *,
    metric: Metric | None = None,
    strength: Strength | None = None,
) -> RobustFit:
    """Weighted least squares from the readings that Huber's loss does not reject.

    Args:
        vjm: The model.
        structure: The unknowns.
        data: The runs.
        metric: The structure in the metric of a prior; None for no prior.
        strength: How firmly that is believed.

    Raises:
        BenchError: As `gco_robust`.
    """
    _check_prior(structure, metric, strength)
    regression, readings = reduce(vjm, structure, data), weigh(vjm, structure, data)
    if metric is None or strength is None:
        A = _column_space(readings.A)
        found = huber(A, readings.y, np.zeros((1, A.shape[2])), np.zeros(1))
    else:
        found = huber(readings.A @ metric.L, readings.y, *precision_root(metric, strength))

    def refit(regression: Regression) -> Estimate:
        if metric is not None and strength is not None:
            return least_squares_with(regression, metric, strength)
        return minimum_norm(regression)

    return _without_outliers(data, regression, readings, found, refit)


def weigh(vjm: Vjm, structure: Structure, data: Dataset) -> Readings:
    """A dataset reading by reading, none folded into another; `reduce` has checked it.

    Raises:
        BenchError: When there are more readings than MOST_READINGS.
    """
    points = marker_points(vjm, data.markers)
    args = vjm, structure, data.q, data.wrench, data.point
    turned = data.sigma_rotation is not None
    each = len(points) + turned
    if data.runs * each > MOST_READINGS:
        raise BenchError(f"robust fit: expected at most {MOST_READINGS} readings, got {data.runs * each}")
    root = _roots(data)
    A, y = root @ observation(*args, targets=points), (root @ data.deflection[..., None])[..., 0]
    unit, marker = np.linalg.det(root) ** (-1 / 3), np.arange(each)
    seen = data.seen
    if data.sigma_rotation is not None:
        turn = math.sqrt(2) * data.sigma_rotation
        A = np.concatenate([A, observation(*args, targets=points[:1], rotation=True) / turn], axis=1)
        y = np.concatenate([y, data.rotation[:, None] / turn], axis=1)
        unit = np.c_[unit, np.full(data.runs, turn)]
        seen, marker[-1] = np.c_[seen, np.ones(data.runs, dtype=bool)], -1
    used = seen.ravel()
    return Readings(
        A=A.reshape(-1, 3, structure.n)[used],
        y=y.reshape(-1, 3)[used],
        unit=unit.ravel()[used],
        run=np.repeat(np.arange(data.runs), each)[used],
        marker=np.tile(marker, data.runs)[used],
    )


def _roots(data: Dataset) -> Array:
    """Roots of the inverse covariance of every deflection, (runs, m, 3, 3) [1/m]; one where it was lost."""
    if data.precision is None:
        one = np.eye(3) / (math.sqrt(2) * data.sigma)
        return np.broadcast_to(one, (data.runs, len(data.markers), 3, 3))
    safe = np.where(data.seen[..., None, None], data.precision, np.eye(3))
    return np.asarray(np.linalg.cholesky(safe).swapaxes(2, 3))


def huber(A: Array, y: Array, B: Array, c: Array, sizes: tuple[int, ...] = ()) -> Huber:
    """Minimise sum_i h(|A_i x - y_i|) + 1/2 |B x - c|^2, h Huber's loss, as a conic program.

    Its variables are x, what noise explains of every reading, e_i, and bounds t_i >= |y_i - A_i x - e_i|.

    Args:
        A: Rows of every reading, (readings, 3, n).
        y: Measured, (readings, 3) [1].
        B: Rows of the prior, (any, n).
        c: What it expects of them, (any,).
        sizes: Sizes of the blocks of x, upper triangles by column with off-diagonals times sqrt 2, that must
            be positive semi-definite; none for least squares.
    """
    N, _, n = A.shape
    P = sparse.block_diag([np.triu(B.T @ B), sparse.eye(3 * N), sparse.csc_matrix((N, N))], format="csc")
    rows = np.zeros((N, 4, n))
    rows[:, 1:] = A
    one = np.eye(4)
    e, bound = sparse.kron(sparse.eye(N), one[:, 1:]), sparse.kron(sparse.eye(N), -one[:, :1])
    M = sparse.hstack([sparse.csc_matrix(rows.reshape(4 * N, n)), e, bound])
    b = np.c_[np.zeros(N), y].ravel()
    cones: list[object] = [clarabel.SecondOrderConeT(4)] * N
    if sizes:
        M = sparse.vstack([M, -sparse.eye(n, n + 4 * N)])
        b = np.r_[b, np.zeros(n)]
        cones += map(clarabel.PSDTriangleConeT, sizes)
    cost = np.r_[-B.T @ c, np.zeros(3 * N), np.full(N, DELTA)]
    solver = clarabel.DefaultSolver(P, cost, sparse.csc_matrix(M), b, cones, solver_settings())
    solution = solver.solve()
    x = np.array(solution.x)[:n]
    return Huber(x, np.linalg.norm(y - A @ x, axis=1), status_of(solution), solution.solve_time)


def _check_prior(structure: Structure, metric: Metric | None, strength: Strength | None) -> None:
    if (metric is None) != (strength is None):
        raise BenchError("robust fit: expected the metric of a prior and its strength together, or none")
    if metric is None:
        return
    own = metric.structure
    if not (np.array_equal(own.a, structure.a) and np.array_equal(own.b, structure.b)):
        raise BenchError(f"metric: expected one of {structure.name}, got one of {own.name}")


def _column_space(A: Array) -> Array:
    """Orthonormal columns that span the rows of all readings, (readings, 3, rank); zeros for rank 0."""
    rows = A.reshape(-1, A.shape[2])
    norm = np.linalg.norm(rows, axis=0)
    seen = norm > ROUNDING * norm.max()
    if not seen.any():
        return A[..., :1]
    U, s, _ = np.linalg.svd(rows[:, seen] / norm[seen], full_matrices=False)
    return np.asarray(U[:, s > RANK_TOLERANCE * s[0]].reshape(*A.shape[:2], -1))


def _without_outliers(
    data: Dataset,
    regression: Regression,
    readings: Readings,
    found: Huber,
    refit: Callable[[Regression], Estimate],
) -> RobustFit:
    """The estimate from the readings that Huber's model does not reject.

    Raises:
        BenchError: When no reading is left, or fewer equations than directions that all readings see.
    """
    keep = found.length <= REJECT
    left = int(keep.sum())
    if not left or 3 * left < regression.rank:
        raise BenchError(
            f"{len(keep) - left} of {len(keep)} readings rejected, beyond {REJECT} standard deviations; "
            f"{3 * left} equations left for {regression.rank} directions: {NO_OUTLIERS}"
        )
    if not keep.all():
        regression = _accepted(regression, readings, keep)
    plain = refit(regression)
    length = np.linalg.norm(readings.y - readings.A @ plain.pi, axis=1)
    names = (*data.markers, TOOL)
    rejected = tuple(
        Rejected(
            run=int(data.run[readings.run[i]]),
            marker=names[readings.marker[i]],
            residual=float(length[i] * readings.unit[i]),
            sigmas=float(length[i]),
        )
        for i in np.flatnonzero(~keep)
    )
    estimate = replace(
        plain,
        method=f"{plain.method}, Huber loss",
        status=plain.status if found.status == "solved" else f"{found.status} (search for outliers)",
        solver_seconds=plain.solver_seconds + found.seconds,
        advice=(*plain.advice, *_advice(data, readings, keep)),
    )
    return RobustFit(estimate, rejected)


def _accepted(regression: Regression, readings: Readings, keep: Mask) -> Regression:
    """The regression of these readings alone; a term that lost all of its own is left out."""
    kinds = readings.marker >= 0, readings.marker < 0
    terms = tuple(_term(readings, keep & kind) for kind in kinds if (keep & kind).any())
    return regression_of(regression.structure, terms)


def _term(readings: Readings, keep: Mask) -> Term:
    """Triangular factor of some readings' rows over sqrt(N), as in F_M, Eq. (19)."""
    rows = np.concatenate([readings.A[keep], readings.y[keep, :, None]], axis=2) / math.sqrt(keep.sum())
    n = rows.shape[2] - 1
    T = np.zeros((n + 1, n + 1))
    R = np.linalg.qr(rows.reshape(-1, n + 1), mode="r")
    T[: len(R)] = R
    return Term(R=T[:n, :n], z=T[:n, n], rest=float(T[n, n] ** 2), equations=3 * int(keep.sum()))


def _advice(data: Dataset, readings: Readings, keep: Mask) -> tuple[str, ...]:
    """What was rejected, and whether that can still be outliers."""
    bad = int((~keep).sum())
    if not bad:
        return ()
    said = [f"{bad} of {len(keep)} readings rejected, beyond {REJECT} standard deviations"]
    lost = data.run[np.setdiff1d(readings.run, readings.run[keep])]
    if len(lost):
        runs = ", ".join(map(str, lost))
        said.append(f"no reading is left of run {runs}: look at the load, the pose and the frame there")
    if bad > MOST_REJECTED * len(keep):
        said.append(f"too many to be outliers: {NO_OUTLIERS}")
    return tuple(said)
