"""The least and the greatest deflection over all conservative models that fit the data: conic programs.

The set. Let pi_LS be the unconstrained least-squares fit and A the rows of Eq. (13) divided by the standard
deviation of their readings. With linear truth A (pi_true - pi_LS) is the noise projected on the r directions
that the data see, and its squared length is chi squared with exactly r degrees of freedom. So
    S = {pi conservative: |A (pi - pi_LS)|^2 <= q_r},  q_r the quantile at the confidence,
holds the truth with exactly that probability, whatever the unseen directions are, and the bounds of ALL
functionals hold at once. chi^2(pi) <= q_e over all e equations covers as well, and is wider nearly always: it
leaves q_e - chi^2_LS, e - r less than q_e on average, and the spread of e terms instead of r (135 equations
of rank 49 at 95 %: 77 on average against 66).

What is unbounded. Compliance that no reading shows, D positive semi-definite with A D = 0, may grow without
end, and with it every entry that it shares a row with: |C_ij|^2 <= C_ii C_jj. A solver fails on such a
set, or stops anywhere. So growing rows are first cut out of the cone constraint, until none is left (facial
reduction); and x is kept within a length that no arm has: a bound that leans on it is infinite.
"""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import clarabel
import numpy as np
from joblib import cpu_count
from scipy import sparse, stats

from testbench.errors import Array, BenchError, check_array
from testbench.identify.conic import solver_settings
from testbench.identify.prior import Metric, whitened
from testbench.identify.regression import RANK_TOLERANCE, Regression

TOLERANCE = 1e-8
"""Feasibility and gap asked of the solver, of functionals of length one in the metric."""
VANISHES = 1e-6
"""Share of a functional below which it vanishes on a direction."""
FAR = 1e4
"""Length of x, in the prior's compliances, beyond which a model counts as infinitely far away."""
FAR_SHARE = 1e-3
"""Share of a bound that may be due to `FAR`; more, and it is no bound."""
GROWS = 0.5
"""Eigenvalue of the projector on growing rows, 0 or 1, from which a row grows."""
ACCEPTED = ("Solved", "AlmostSolved")


@dataclass(frozen=True)
class Face:
    """What is left of the cone constraint once growing compliance is cut out of it.

    Attributes:
        held: Rows of every block that cannot grow, in the metric, orthonormal, (size, k) a block.
        free: Directions of x that nothing holds, orthonormal, (n, f).
        basis: All others, (n, n - f).
    """

    held: tuple[Array, ...]
    free: Array
    basis: Array


@dataclass(frozen=True)
class FitSet:
    """All conservative models that fit the data at a confidence.

    Attributes:
        regression: The reduced dataset.
        metric: Units of every block; the ceiling is counted in its prior.
        confidence: Least probability that the truth is inside [1].
        ceiling: Every block is at most this often the prior's, C <= k P; None for no ceiling.
        rows: Of the r directions that the data see, in standard deviations, (r, n).
        centre: Those of the unconstrained least-squares fit, (r,).
        radius: Largest distance from it [standard deviations].
        nearest: Distance of the conservative model nearest to it; the set is empty where it is above radius.
        misfit: Probability that noise alone leaves the residual of least squares; small where the structure,
            sigma or linearity is wrong, and the set then proves little.
        face: What grows without end, whatever the functional.
    """

    regression: Regression
    metric: Metric
    confidence: float
    ceiling: float | None
    rows: Array
    centre: Array
    radius: float
    nearest: float
    misfit: float
    face: Face

    @property
    def empty(self) -> bool:
        """Whether no conservative model fits: the truth is one with a probability of 1 - confidence."""
        return self.nearest >= self.radius

    @property
    def name(self) -> str:
        """What the bounds are over, for reports."""
        ceiling = "" if self.ceiling is None else f" of at most {self.ceiling:g} times {self.metric.prior}"
        return f"conservative models{ceiling} that fit at {100 * self.confidence:g} %"


@dataclass(frozen=True)
class Bounds:
    """Least and greatest value of every functional over a set of models.

    Attributes:
        lower: (k,), -inf where nothing bounds it; NaN where the set is empty or the solver failed.
        upper: (k,), inf where nothing bounds it.
        gap: Distance of each from the value of a model that the solver found, (k, 2): bounds are the dual's.
        status: Of lower and upper: "solved"; "approached", as unseen compliance grows without end;
            "unbounded"; "empty"; or "not solved: ...".
        models: Parameters that reach them, (k, 2, n); NaN unless solved.
        name: What the bounds are over.
    """

    lower: Array
    upper: Array
    gap: Array
    status: tuple[tuple[str, str], ...]
    models: Array
    name: str


def fit_set(
    regression: Regression, metric: Metric, confidence: float, *, ceiling: float | None = None
) -> FitSet:
    """The conservative models that fit a dataset.

    Args:
        regression: The reduced dataset.
        metric: The structure in the metric of a prior; without a ceiling it only gives the units.
        confidence: Least probability that the truth is inside, such as 0.95.
        ceiling: Times the prior that no block exceeds, such as 10: then every bound is finite.

    Raises:
        BenchError: When the confidence is outside (0, 1), the ceiling is not above 0, or the metric is of
            another structure.
    """
    check_confidence(confidence)
    check_metric(regression, metric)
    if ceiling is not None and not 0 < ceiling < math.inf:
        raise BenchError(f"ceiling: expected a finite number above 0, got {ceiling}")
    A, y = whitened(regression, metric)
    U, s, Vt = np.linalg.svd(A, full_matrices=False)
    r = int((s > RANK_TOLERANCE * s[0]).sum()) if s[0] > 0 else 0
    rows, centre = s[:r, None] * Vt[:r], U[:, :r].T @ y
    residual = y @ y - centre @ centre + sum(t.rest * t.equations / 3 for t in regression.terms)
    spare = regression.equations - r
    sizes = metric.sizes
    face = _whole(sizes) if ceiling is not None else _face(rows, sizes)
    return FitSet(
        regression=regression,
        metric=metric,
        confidence=confidence,
        ceiling=ceiling,
        rows=rows,
        centre=centre,
        radius=math.sqrt(stats.chi2.ppf(confidence, r)) if r else 0.0,
        nearest=_nearest(rows, centre, sizes, face, ceiling) if r else -1.0,
        misfit=float(stats.chi2.sf(residual, spare)) if spare > 0 else 1.0,
        face=face,
    )


def bounds(models: FitSet, functionals: Array, *, workers: int | None = 1) -> Bounds:
    """Least and greatest value of linear functionals of pi, such as deflections.

    Args:
        models: The set.
        functionals: Rows a of a . pi, (k, n), such as `uncertainty.deflection_rows`.
        workers: Threads (Clarabel works without Python's lock); None for one a core.

    Raises:
        BenchError: When a functional has another length or is not finite, or workers is below 1.
    """
    n = models.metric.structure.n
    functionals = check_array(functionals, (None, n), "functionals [m per unit of pi]")
    if workers is not None and workers < 1:
        raise BenchError(f"workers: expected at least 1, got {workers}")
    k = len(functionals)
    parts = np.array_split(functionals @ models.metric.L, max(1, min(k, workers or cpu_count())))
    with ThreadPoolExecutor(len(parts)) as threads:
        found = [pair for part in threads.map(partial(_sides, models), parts) for pair in part]
    value, gap = np.empty((k, 2)), np.empty((k, 2))
    reached = np.full((k, 2, n), np.nan)
    for i, pair in enumerate(found):
        for side, (bound, slack, x, _) in enumerate(pair):
            value[i, side], gap[i, side] = (-1, 1)[side] * bound, slack
            if x is not None:
                reached[i, side] = models.metric.L @ x
    status = tuple((lower[3], upper[3]) for lower, upper in found)
    return Bounds(value[:, 0], value[:, 1], gap, status, reached, models.name)


def _sides(models: FitSet, functionals: Array) -> list[tuple["Side", "Side"]]:
    """Greatest -a . x and a . x of some functionals of x."""
    programs = [] if models.empty else _programs(models)
    return [(_greatest(programs, -a), _greatest(programs, a)) for a in functionals]


Side = tuple[float, float, Array | None, str]
"""A bound, its gap, the x that reaches it, its status."""


def _greatest(programs: list["_Program"], a: Array) -> Side:
    """Greatest a . x by the first program in which it is finite."""
    size = float(np.linalg.norm(a))
    found: Side = (math.nan, math.nan, None, "empty")
    for program in programs:
        bound, gap, x, status = program.greatest(a / size if size else a)
        found = (size * bound if size else 0.0, size * gap, x, status)
        if status in ("solved", "approached"):
            break
    return found


def _programs(models: FitSet) -> list["_Program"]:
    """One without growing rows, then the whole one: a functional may be bounded on one side alone."""
    whole = _whole(models.metric.sizes)
    cut = any(W.shape[1] < n for W, n in zip(models.face.held, models.metric.sizes, strict=True))
    faces = [(models.face, "approached"), (whole, "solved")] if cut else [(whole, "solved")]
    return [_Program(models, face, name) for face, name in faces]


class _Program:
    """max a . x over the set, set up once: only the cost changes from functional to functional."""

    def __init__(self, models: FitSet, face: Face, name: str) -> None:
        self.face, self.name = face, name
        m = face.basis.shape[1]
        r = len(models.rows)
        A = [np.vstack([np.zeros(m), -np.eye(m)])]
        b = [np.r_[FAR, np.zeros(m)]]
        cones: list[object] = [clarabel.SecondOrderConeT(m + 1)]
        if r:
            A.append(np.vstack([np.zeros(m), -models.rows @ face.basis / models.radius]))
            b.append(np.r_[1.0, -models.centre / models.radius])
            cones.append(clarabel.SecondOrderConeT(r + 1))
        _hold(face.held, models.metric.sizes, face.basis, models.ceiling, A, b, cones)
        settings = _settings()
        settings.presolve_enable = False  # or the cost could not be changed
        self.solver = clarabel.DefaultSolver(
            sparse.csc_matrix((m, m)),
            np.zeros(m),
            sparse.csc_matrix(np.vstack(A)),
            np.concatenate(b),
            cones,
            settings,
        )

    def greatest(self, a: Array) -> Side:
        """Upper bound of a . x for a of length one, by the dual."""
        if np.linalg.norm(self.face.free.T @ a) > VANISHES:
            return math.inf, math.nan, None, "unbounded"
        self.solver.update(q=-self.face.basis.T @ a)
        solution = self.solver.solve()
        if str(solution.status) not in ACCEPTED:
            return math.nan, math.nan, None, f"not solved: Clarabel says {solution.status}"
        bound, x = -solution.obj_val_dual, self.face.basis @ np.array(solution.x)
        if FAR * solution.z[0] > FAR_SHARE * max(1.0, abs(bound)):
            return math.inf, math.nan, None, "unbounded"
        return bound, bound - a @ x, x if self.name == "solved" else None, self.name


def _settings() -> clarabel.DefaultSettings:
    settings = solver_settings()
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = TOLERANCE
    return settings


def _hold(
    held: tuple[Array, ...],
    sizes: tuple[int, ...],
    basis: Array,
    ceiling: float | None,
    A: list[Array],
    b: list[Array],
    cones: list[object],
) -> None:
    """Every held part of every block positive semi-definite, and under the ceiling: rows for Clarabel."""
    first = 0
    for W, n in zip(held, sizes, strict=True):
        last = first + n * (n + 1) // 2
        k = W.shape[1]
        if k:
            rows = compression(W) @ basis[first:last]
            A.append(-rows)
            b.append(np.zeros(len(rows)))
            cones.append(clarabel.PSDTriangleConeT(k))
            if ceiling is not None:
                A.append(rows)
                b.append(ceiling * _svec(np.eye(k)))
                cones.append(clarabel.PSDTriangleConeT(k))
        first = last


def _nearest(rows: Array, centre: Array, sizes: tuple[int, ...], face: Face, ceiling: float | None) -> float:
    """Least distance of a conservative model from the centre."""
    m = face.basis.shape[1]
    unit = max(1.0, float(np.linalg.norm(centre)))
    ball = np.zeros((len(rows) + 1, m + 1))
    ball[0, 0] = -1
    ball[1:, 1:] = -rows @ face.basis / unit
    A, b = [ball], [np.r_[0.0, -centre / unit]]
    cones: list[object] = [clarabel.SecondOrderConeT(len(ball))]
    _hold(face.held, sizes, np.hstack([np.zeros((len(face.basis), 1)), face.basis]), ceiling, A, b, cones)
    cost = np.r_[1.0, np.zeros(m)]
    return float(unit * _solve(cost, A, b, cones)[0])


def _solve(cost: Array, A: list[Array], b: list[Array], cones: list[object]) -> Array:
    """Least cost . v; raises nothing: a solver that stalls has found what it found."""
    m = len(cost)
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix((m, m)),
        cost,
        sparse.csc_matrix(np.vstack(A)),
        np.concatenate(b),
        cones,
        _settings(),
    )
    return np.array(solver.solve().x)


def _whole(sizes: tuple[int, ...]) -> Face:
    """The cone constraint as it is."""
    n = sum(k * (k + 1) // 2 for k in sizes)
    return Face(tuple(map(np.eye, sizes)), np.zeros((n, 0)), np.eye(n))


def _face(rows: Array, sizes: tuple[int, ...]) -> Face:
    """Cut growing rows out of the cone until no unseen direction is positive semi-definite in the rest."""
    N = _null(rows)
    held = tuple(map(np.eye, sizes))
    while N.shape[1] and any(W.shape[1] for W in held):
        grown = _growing(N, held, sizes)
        if not any(G.shape[1] < W.shape[1] for G, W in zip(grown, held, strict=True)):
            break
        held = grown
    return _lineality(N, held, sizes)


def _lineality(N: Array, held: tuple[Array, ...], sizes: tuple[int, ...]) -> Face:
    """Directions that neither the data see nor the held parts of the cone constrain, and all others."""
    free = N @ _null(_held_parts(held, sizes, N))
    Q = np.linalg.qr(free, mode="complete")[0] if free.shape[1] else np.eye(len(free))
    return Face(held, free, Q[:, free.shape[1] :])


def _growing(N: Array, held: tuple[Array, ...], sizes: tuple[int, ...]) -> tuple[Array, ...]:
    """What is held once more: without the rows in which an unseen direction is positive semi-definite.

    max sum tr E over 0 <= E <= 1, E <= D, D = N y: D may be as long as it likes, so E is the projector on
    the rows that can grow.
    """
    K = _held_parts(held, sizes, N)
    K = K @ _complement(_null(K))  # without what touches nothing held
    f, e = K.shape[1], len(K)
    A = [np.vstack([np.zeros(f + e), np.eye(f, f + e)])]
    b = [np.r_[FAR, np.zeros(f)]]
    cones: list[object] = [clarabel.SecondOrderConeT(f + 1)]
    trace, first = np.zeros(e), 0
    for W in held:
        k = W.shape[1]
        part = slice(first, first + k * (k + 1) // 2)
        first = part.stop
        if k:
            pick = np.eye(e)[part]
            trace[part] = _svec(np.eye(k))
            none = np.zeros((len(pick), f))
            A += [np.hstack([-K[part], pick]), np.hstack([none, -pick]), np.hstack([none, pick])]
            b += [np.zeros(len(pick)), np.zeros(len(pick)), trace[part]]
            cones += [clarabel.PSDTriangleConeT(k)] * 3
    E = _solve(np.r_[np.zeros(f), -trace], A, b, cones)[f:]
    kept, first = [], 0
    for W in held:
        k = W.shape[1]
        last = first + k * (k + 1) // 2
        values, Q = np.linalg.eigh(_smat(E[first:last], k)) if k else (np.zeros(0), np.zeros((0, 0)))
        kept.append(W @ Q[:, values < GROWS])
        first = last
    return tuple(kept)


def _held_parts(held: tuple[Array, ...], sizes: tuple[int, ...], directions: Array) -> Array:
    """Held part of every block of each direction, as one column, (entries, k)."""
    parts, first = [np.zeros((0, directions.shape[1]))], 0
    for W, n in zip(held, sizes, strict=True):
        last = first + n * (n + 1) // 2
        parts.append(compression(W) @ directions[first:last])
        first = last
    return np.vstack(parts)


def _null(A: Array) -> Array:
    """Orthonormal basis of the null space, (n, f)."""
    if not A.size:
        return np.eye(A.shape[1])
    _, s, Vt = np.linalg.svd(A)
    return np.asarray(Vt[int((s > RANK_TOLERANCE * s[0]).sum()) if s[0] > 0 else 0 :].T)


def _complement(N: Array) -> Array:
    """Orthonormal basis of what is orthogonal to orthonormal columns."""
    return np.asarray(np.linalg.qr(N, mode="complete")[0][:, N.shape[1] :]) if N.shape[1] else np.eye(len(N))


def compression(W: Array) -> Array:
    """The map from x of a block to that of W^T X W, (k (k + 1) / 2, n (n + 1) / 2)."""
    n = len(W)
    X = _smat(np.eye(n * (n + 1) // 2), n)
    return _svec(W.T @ X @ W).T


def _svec(X: Array) -> Array:
    """Upper triangle by column, off-diagonals times sqrt 2."""
    column, row = np.tril_indices(X.shape[-1])
    return np.asarray(X[..., row, column] * np.where(row == column, 1, math.sqrt(2)))


def _smat(x: Array, n: int) -> Array:
    """The symmetric matrices of such triangles."""
    column, row = np.tril_indices(n)
    X = np.zeros((*x.shape[:-1], n, n))
    X[..., row, column] = X[..., column, row] = x * np.where(row == column, 1, math.sqrt(0.5))
    return X


def check_confidence(confidence: float) -> None:
    """Refuse what is no confidence.

    Raises:
        BenchError: When it is not between 0 and 1.
    """
    if not 0 < confidence < 1:
        raise BenchError(f"confidence: expected a number between 0 and 1, got {confidence}")


def check_metric(regression: Regression, metric: Metric) -> None:
    """Refuse the metric of another structure.

    Raises:
        BenchError: When its parameters are not those of the regression.
    """
    ours, theirs = regression.structure, metric.structure
    same = ours.n == theirs.n and (ours.a == theirs.a).all() and (ours.b == theirs.b).all()
    if not same:
        raise BenchError(f"metric: expected one of {ours.name}, {ours.n} unknowns, got {theirs.name}")
