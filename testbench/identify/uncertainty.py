"""How sure an estimate is: standard deviations and intervals of parameters and of predicted deflections.

Linearised: the covariance (M^T M)^+ of weighted least squares, Eq. (14)-(15), M the rows of the data over
their standard deviation and, with a prior, those of the prior below them. A direction that M does not see has
an infinite standard deviation. Parametric bootstrap: new readings from the fitted model, refitted.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from testbench.errors import Array, BenchError, check_array
from testbench.identify.bounds import check_confidence, check_metric
from testbench.identify.conic import UNSEEN_WEIGHT
from testbench.identify.estimate import Estimate
from testbench.identify.prior import Metric
from testbench.identify.regression import RANK_TOLERANCE, Regression, Term
from testbench.identify.regularised import Strength, precision_root
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm, observation

UNSEEN = 1e-8
"""Share of a functional outside the seen directions from which it is unseen: rounding is 1e-11."""
BINDS = 0.1
"""Distance from the optimum without a cone that counts as moved by it [standard deviations]."""
ONLY_LINEARISED = (
    "the optimum is on the boundary of the cone: linearised intervals are not exact, prefer the bootstrap or "
    "set-based bounds"
)

Refit = Callable[[Regression], Array]
"""Parameters of a reduced dataset: what the bootstrap repeats."""


@dataclass(frozen=True)
class Linearised:
    """A normal distribution around an estimate.

    Attributes:
        pi: Its centre, (n,).
        root: Covariance of pi is root^T root along the seen directions, (r, n).
        unseen: Rows whose product with a functional is zero where it is seen, (f, n).
        scale: Of each parameter, for what counts as zero, (n,).
        pull: Distance between the estimate and the optimum without a cone [standard deviations].
        on_boundary: Whether the cone holds the estimate: then intervals are not exact.
        advice: Sentences for a person.
    """

    pi: Array
    root: Array
    unseen: Array
    scale: Array
    pull: float
    on_boundary: bool
    advice: tuple[str, ...]


@dataclass(frozen=True)
class Intervals:
    """Intervals of linear functionals of pi, such as deflections.

    Attributes:
        centre: By the estimate, (k,).
        lower: (k,), -inf where the data see nothing.
        upper: (k,), inf where the data see nothing.
        confidence: Of each interval by itself [1].
        method: How they were found.
    """

    centre: Array
    lower: Array
    upper: Array
    confidence: float
    method: str


def deflection_rows(
    vjm: Vjm,
    structure: Structure,
    q: Array,
    wrench: Array,
    point: Array,
    *,
    targets: Array,
    direction: Array | None = None,
) -> Array:
    """Predicted deflections as linear functionals of pi, Eq. (12).

    Args:
        vjm: The model.
        structure: The unknowns.
        q: Actuated joint angles, (runs, n) [rad].
        wrench: Force and moment, world axes, (runs, 6) [N, N m].
        point: Where it acts, in the tool's frame, (runs, 3) [m].
        targets: Points that move, in the tool's frame, (m, 3) [m].
        direction: World direction whose component is asked, (3,); None for x, y and z.

    Returns:
        Run by run and target by target, (runs m 3, n) or, with a direction, (runs m, n).

    Raises:
        BenchError: When an argument has the wrong shape or is not finite, or the direction is zero.
    """
    rows = observation(vjm, structure, q, wrench, point, targets=targets)
    if direction is None:
        return rows.reshape(-1, structure.n)
    direction = check_array(direction, (3,), "direction")
    length = np.linalg.norm(direction)
    if length == 0:
        raise BenchError("direction: expected one that is not zero")
    return np.asarray(np.einsum("x,rmxn->rmn", direction / length, rows)).reshape(-1, structure.n)


def linearise(
    estimate: Estimate, metric: Metric | None = None, strength: Strength | None = None
) -> Linearised:
    """The distribution of an estimate's parameters, by its information matrix.

    Args:
        estimate: Of any method.
        metric: The structure in the metric of a prior; with a strength this prior counts as data.
        strength: How firmly the prior is believed; None for no prior.

    Raises:
        BenchError: When the metric is of another structure, or a strength comes without one.
    """
    regression = estimate.regression
    if metric is not None:
        check_metric(regression, metric)
    elif strength is not None:
        raise BenchError("linearise: expected a metric with the strength of a prior, got none")
    L = np.diag(_units(regression)) if metric is None else metric.L
    x = np.linalg.solve(L, estimate.pi)
    blocks = [math.sqrt(t.equations / 3) * t.R @ L for t in regression.terms]
    residuals = [
        B @ x - math.sqrt(t.equations / 3) * t.z for B, t in zip(blocks, regression.terms, strict=True)
    ]
    if metric is not None and strength is not None:
        B, c = precision_root(metric, strength)
        blocks, residuals = [*blocks, B], [*residuals, B @ x - c]
    _, s, Vt = np.linalg.svd(np.linalg.qr(np.vstack(blocks), mode="r"))
    r = int((s > RANK_TOLERANCE * s[0]).sum()) if s[0] > 0 else 0
    back = Vt[:r] / s[:r, None]
    gradients = [B.T @ e for B, e in zip(blocks, residuals, strict=True)]
    pull = float(np.linalg.norm(back @ sum(gradients)))
    if strength is None and len(gradients) > 1:  # F_M weights its terms by their residuals
        terms = zip(gradients, residuals, regression.terms, strict=True)
        tilted = [g / (math.sqrt((e @ e) / t.equations + t.rest / 3) or 1.0) for g, e, t in terms]
        pull = min(pull, float(np.linalg.norm(back @ sum(tilted))))
    bound = estimate.conservative and pull > BINDS
    missing = estimate.structure.n - r
    advice: tuple[str, ...] = (ONLY_LINEARISED,) if bound else ()
    if missing:
        advice += (f"{missing} directions are not seen: parameters and deflections along them are unknown",)
    return Linearised(
        pi=estimate.pi,
        root=back @ L.T,
        unseen=Vt[r:] @ L.T,
        scale=np.linalg.norm(L, axis=1),
        pull=pull,
        on_boundary=bound,
        advice=advice,
    )


def deviations(linearised: Linearised, functionals: Array) -> Array:
    """Standard deviations of linear functionals of pi, infinite where they are not seen.

    Args:
        linearised: The distribution.
        functionals: Rows a of a . pi, (k, n); the unit matrix for the parameters themselves.

    Returns:
        (k,).

    Raises:
        BenchError: When a functional has another length or is not finite.
    """
    a = _check(functionals, len(linearised.pi))
    seen = np.linalg.norm(a @ linearised.root.T, axis=1)
    size = np.linalg.norm(a * linearised.scale, axis=1)
    unseen = np.linalg.norm(a @ linearised.unseen.T, axis=1) > UNSEEN * size
    return np.where(unseen, np.inf, seen)


def intervals(linearised: Linearised, functionals: Array, confidence: float) -> Intervals:
    """Linearised intervals: normal quantiles around the estimate.

    Args:
        linearised: The distribution.
        functionals: Rows a of a . pi, (k, n).
        confidence: Of each interval, such as 0.95.

    Raises:
        BenchError: When the confidence is outside (0, 1) or a functional has another length.
    """
    check_confidence(confidence)
    half = float(stats.norm.ppf((1 + confidence) / 2)) * deviations(linearised, functionals)
    centre = functionals @ linearised.pi
    return Intervals(centre, centre - half, centre + half, confidence, "linearised")


def bootstrap(
    estimate: Estimate,
    refit: Refit,
    functionals: Array,
    confidence: float,
    *,
    draws: int,
    rng: np.random.Generator,
) -> Intervals:
    """Basic bootstrap intervals: errors of refits around the fitted prediction, turned round.

    A refit errs about the fit as the fit errs about the truth, so the truth lies at the prediction LESS such
    an error. Where the cone binds it pushes both errors the same way, and the basic interval takes the push
    back; a percentile interval would add it a second time. Order statistics k and draws + 1 - k with
    k = (draws + 1) (1 - confidence) / 2 make it exact for least squares. Where a functional is not seen the
    refits fill it as the fit did, which proves nothing: the interval is infinite.

    Args:
        estimate: The fit; by the data alone, without a prior.
        refit: The same method on a reduced dataset, such as `least_squares.solve`.
        functionals: Rows a of a . pi, (k, n).
        confidence: Of each interval, such as 0.95.
        draws: Datasets; 39 is the least for 95 %.
        rng: Source of their noise.

    Raises:
        BenchError: When the confidence is outside (0, 1), there are too few draws for it, or a functional has
            another length.
    """
    check_confidence(confidence)
    a = _check(functionals, estimate.structure.n)
    tail = (1 - confidence) / 2
    k = int((draws + 1) * tail * (1 + 1e-12))
    if k < 1:
        least = math.ceil(1 / tail - 1e-9) - 1
        raise BenchError(f"draws: expected at least {least} for {100 * confidence:g} %, got {draws}")
    centre = a @ estimate.pi
    again = resampler(estimate.regression)
    errors = np.array([a @ refit(again(estimate.pi, rng)) - centre for _ in range(draws)])
    errors.sort(axis=0)
    unseen = np.where(np.isinf(deviations(linearise(estimate), a)), np.inf, 0.0)
    lower, upper = centre - errors[-k] - unseen, centre - errors[k - 1] + unseen
    return Intervals(centre, lower, upper, confidence, "bootstrap")


def resampler(regression: Regression) -> Callable[[Array, np.random.Generator], Regression]:
    """Reduced datasets of new readings in the same poses under the same loads.

    The rows are divided by sqrt(2) sigma sqrt(N): each orthonormal coordinate in the range of R has noise of
    deviation 1 / sqrt(N), and the rest is chi squared of all other equations over N.

    Args:
        regression: Poses, loads, sigmas.

    Returns:
        A function from parameters, (n,), and a source of noise to a dataset.
    """
    unit = _units(regression)
    spans = [_range(term.R * unit) for term in regression.terms]

    def draw(pi: Array, rng: np.random.Generator) -> Regression:
        terms = [_new_readings(term, pi, U, rng) for term, U in zip(regression.terms, spans, strict=True)]
        return replace(regression, terms=tuple(terms))

    return draw


def _new_readings(term: Term, pi: Array, U: Array, rng: np.random.Generator) -> Term:
    N, spare = term.equations / 3, term.equations - U.shape[1]
    z = term.R @ pi + U @ rng.standard_normal(U.shape[1]) / math.sqrt(N)
    return replace(term, z=z, rest=float(rng.chisquare(spare)) / N if spare else 0.0)


def _range(R: Array) -> Array:
    """Orthonormal basis of the columns, (n, r)."""
    U, s, _ = np.linalg.svd(R)
    return np.asarray(U[:, : int((s > RANK_TOLERANCE * s[0]).sum())])


def _units(regression: Regression) -> Array:
    """Units of pi in which its parameters move the readings alike, (n,)."""
    s, weight = regression.structure, regression.weight
    d = 1 / np.sqrt(np.maximum(weight, UNSEEN_WEIGHT * (weight.max() or 1.0)))
    return np.asarray(d[s.a] * d[s.b])


def _check(functionals: Array, n: int) -> Array:
    return check_array(functionals, (None, n), "functionals [m per unit of pi]")
