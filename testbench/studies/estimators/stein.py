"""Other ways to fill what data do not see, in the metric of a prior: least trace, and a log determinant.

The log-determinant prior is Stein's divergence from what was expected.
D(X, s) = tr(X) / s - log det(X / s) - n is zero at X = s and grows without bound as X becomes singular:
every compliance stays positive definite. Near X = s it is |X / s - 1|^2 / 2, so that D / u^2 is the Gaussian
penalty of relative uncertainty u there. The log determinant is its own barrier, so that Newton's method with
an exact line search minimises chi^2 / 2 + D / u^2, of several datasets at once.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify import cone
from testbench.identify.conic import EXACT, norms_below, optimum
from testbench.identify.crossval import Fold, divided, folds
from testbench.identify.estimate import Estimate, make_estimate
from testbench.identify.fold import reduce_parts
from testbench.identify.metric import Belief, Case, Metric, whitened
from testbench.identify.prior import Strength
from testbench.identify.regression import Ids, Regression, f_m
from testbench.identify.solve import answer
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm

UNCERTAINTIES = (0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.3, 2.0)
"""Relative uncertainties of a prior that cross-validation tries [1]."""
SLACK = 1e-2  #: Share by which F_M may exceed its optimum while the trace is made least.
DECREMENT = 1e-6  #: Newton decrement at which the step, still taken, is the last: what is left is its square.
MAX_STEPS = 60
LONGEST = 4.0  #: Of a step, in Newton's own.
HALVINGS = 30  #: Of the interval in which a line search looks for its step.

Regularised = Callable[[Sequence[Case]], Array]
"""Parameters of many datasets with priors, (datasets, n)."""


def gco_stein(regression: Regression, metric: Metric, strength: Strength) -> Estimate:
    """GCO with the log-determinant prior; the common scale is that of the Gaussian fit."""
    case = Case(regression, Belief(metric, strength))
    pi, left = _minima([case])
    estimate = make_estimate(
        regression,
        pi[0],
        method="GCO with log-det prior",
        constraint="psd",
    )
    status = "solved" if left[0] <= DECREMENT else f"not solved: {MAX_STEPS} Newton steps were not enough"
    return replace(estimate, belief=case.belief, status=status)


def stein_parameters(cases: Sequence[Case]) -> Array:
    """The parameters that `gco_stein` finds, of many datasets in one metric, (cases, n)."""
    return _minima(cases)[0]


def _minima(cases: Sequence[Case]) -> tuple[Array, Array]:
    """Parameters, (cases, n), and the Newton decrement there, (cases,)."""
    metric = cases[0].belief.metric
    gaussian = np.linalg.solve(metric.L, np.transpose([answer("psd", case).pi for case in cases]))
    scale = np.maximum(1e-6, metric.expected @ gaussian / (metric.expected @ metric.expected))
    squares = {}
    for case in cases:  # many strengths, few datasets
        if id(case.regression) not in squares:
            A, y = whitened(case.regression, metric)
            squares[id(case.regression)] = A.T @ A, A.T @ y
    H, h = (np.array(part) for part in zip(*(squares[id(c.regression)] for c in cases), strict=True))
    unit = scale * np.array([case.belief.strength.uncertainty for case in cases]) ** 2
    x, left = least_divergence((scale * unit)[:, None, None] * H, unit[:, None] * h, metric.sizes)
    return scale[:, None] * x @ metric.L.T, left


def least_divergence(H: Array, h: Array, sizes: tuple[int, ...]) -> tuple[Array, Array]:
    """Least x^T H x / 2 - h^T x + tr X - log det X over positive definite X, x its svec, block by block.

    Args:
        H: Of several problems, (problems, n, n).
        h: (problems, n).
        sizes: Of the blocks, in the order of x.

    Returns:
        x, (problems, n), and the Newton decrement there, (problems,).
    """
    ends = np.cumsum([*map(cone.triangle, sizes)])
    places = [np.arange(end - cone.triangle(n), end) for n, end in zip(sizes, ends, strict=True)]
    groups = [np.array([at for at in places if len(at) == k]) for k in {len(at) for at in places}]
    e = np.concatenate([cone.svec(np.eye(n)) for n in sizes])
    x, left = np.tile(e, (len(h), 1)), np.full(len(h), np.inf)
    for _ in range(MAX_STEPS):  # groups: places in x of the entries of blocks of one size, (blocks, entries)
        moving = np.flatnonzero(left > DECREMENT)
        if not len(moving):
            break
        own = H[moving]
        slope = (own @ x[moving, :, None])[..., 0] + e - h[moving]
        g, K = _barrier(x[moving], groups)
        step = -np.linalg.solve(own + K, (slope + g)[..., None])[..., 0]
        left[moving] = np.sqrt(np.maximum(0, -((slope + g) * step).sum(axis=1)))
        curve = (step * (own @ step[..., None])[..., 0]).sum(axis=1)
        x[moving] += _length((slope * step).sum(axis=1), curve, _stretch(x[moving], step, groups)) * step
    return x, left


def _barrier(x: Array, groups: Sequence[Ids]) -> tuple[Array, Array]:
    """Gradient, (problems, n), and second derivative, (problems, n, n), of -log det X."""
    g, K = np.zeros_like(x), np.zeros((*x.shape, x.shape[1]))
    for at in groups:
        inverse = np.asarray(np.linalg.inv(cone.smat(x[:, at])))
        g[:, at] = -cone.svec(inverse)
        row, column = cone.upper(inverse.shape[-1])
        unit = np.where(row == column, math.sqrt(0.5), 1.0)
        rows, columns = inverse[..., row, :], inverse[..., column, :]
        pairs = rows[..., row] * columns[..., column] + rows[..., column] * columns[..., row]
        K[:, at[:, :, None], at[:, None]] = unit[:, None] * unit * pairs
    return g, K


def _stretch(x: Array, step: Array, groups: Sequence[Ids]) -> Array:
    """Eigenvalues of the step relative to X, (problems, rows of all blocks)."""
    found = []
    for at in groups:
        inverse = np.linalg.inv(np.linalg.cholesky(cone.smat(x[:, at])))
        found.append(np.linalg.eigvalsh(inverse @ cone.smat(step[:, at]) @ inverse.swapaxes(-1, -2)))
    return np.concatenate([values.reshape(len(x), -1) for values in found], axis=1)


def _length(slope: Array, curve: Array, stretch: Array) -> Array:
    """The t of least slope t + curve t^2 / 2 - sum log(1 + t stretch), by bisection, (problems, 1)."""
    low = np.zeros(len(slope))
    high = np.minimum(LONGEST, 0.99 / np.maximum(1e-9, -stretch.min(axis=1)))
    for _ in range(HALVINGS):
        t = (low + high) / 2
        rising = slope + curve * t > (stretch / (1 + t[:, None] * stretch)).sum(axis=1)
        low, high = np.where(rising, low, t), np.where(rising, t, high)
    return low[:, None]


def gco_least_trace(regression: Regression, metric: Metric) -> Estimate:
    """GCO without a prior: of the models that fit as well as the best, the one of least trace of X.

    The prior's compliances are a metric here and nothing more: the trace counts every compliance in units of
    what was expected. As well means an F_M within `SLACK` of the optimum, which itself may only be approached
    as unseen compliance grows without end.
    """
    best = optimum(regression).f_m
    n, count = metric.structure.n, len(regression.terms)
    allowed = (1 + SLACK) * max(best, EXACT * f_m(regression, np.zeros(n)))
    total = cone.Rows("nonnegative", np.r_[np.ones(count), np.zeros(n)][None], np.array([1.0]))
    parts = [(term.R @ metric.L, term.z, math.sqrt(term.rest)) for term in regression.terms]
    norms = norms_below(*(np.array(part) / allowed for part in zip(*parts, strict=True)))
    solution = cone.solve(
        cone.Problem(
            cost=np.r_[np.zeros(count), metric.expected],
            blocks=(cone.free_block(0, count), *cone.psd_blocks(count, metric.sizes)),
            rows=(total, *norms),
        )
    )
    estimate = make_estimate(
        regression,
        metric.L @ metric.project(solution.x[count:]),
        method="GCO, least trace in the metric",
        constraint="psd",
        advice=(
            f"free directions: least trace in the metric of {metric.prior}, F_M within {100 * SLACK:g} %",
        ),
    )
    return replace(estimate, status=solution.status, solver_seconds=solution.seconds)


def every_fold(vjm: Vjm, structure: Structure, data: Dataset) -> list[Fold]:
    """The folds of the runs with a reading."""
    [parts] = reduce_parts(vjm, [structure], data, divided(data))
    return folds(parts)


def choose_strength(held: Sequence[Fold], metric: Metric, fits: Regularised) -> Strength:
    """The uncertainty of a prior that predicts poses held out best, its scale left to the data."""
    tried = [Strength(u) for u in UNCERTAINTIES]
    found = fits([Case(fold.fitted, Belief(metric, strength)) for strength in tried for fold in held])
    errors = [f_m(fold.held_out, pi) for fold, pi in zip(list(held) * len(tried), found, strict=True)]
    return tried[int(np.argmin(np.reshape(errors, (len(tried), len(held))).mean(axis=1)))]
