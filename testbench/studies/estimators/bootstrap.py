"""Parametric bootstrap: new readings from the fitted model, refitted."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from testbench.errors import Array, BenchError, check_array
from testbench.identify.conic import scale_program, sensitivity_units, solve_clarabel
from testbench.identify.estimate import Estimate
from testbench.identify.least_squares import complete_conservatively, minimum_norm
from testbench.identify.posterior import Intervals, check_confidence, linearise
from testbench.identify.regression import RANK_TOLERANCE, Regression, Term


def bootstrap(
    estimate: Estimate, functionals: Array, confidence: float, *, draws: int, rng: np.random.Generator
) -> Intervals:
    """Compute basic bootstrap intervals of functionals a . pi: errors of refits, turned round.

    A refit errs about the fit as the fit errs about the truth, so the truth lies at the prediction LESS such
    an error. Where the cone binds it pushes both errors the same way, and the basic interval takes the push
    back; a percentile interval would add it a second time. Order statistics k and draws + 1 - k with k =
    (draws + 1) (1 - confidence) / 2 make it exact for least squares; 39 draws are the least for 95 %. Where a
    functional is not seen the refits fill it as the fit, made without a prior, did, which proves nothing: the
    interval is infinite.

    Args:
        estimate: The estimate.
        functionals: Deflections asked for, (k, n).
        confidence: Probability of the interval [1].
        draws: Number of refits.
        rng: Source of randomness.

    Returns:
        The intervals.

    Raises:
        BenchError: When the confidence is outside (0, 1), there are too few draws for it, or a functional has
            another length.
    """
    check_confidence(confidence)
    a = check_array(functionals, (None, estimate.structure.n), "functionals [m per unit of pi]")
    tail = (1 - confidence) / 2
    k = int((draws + 1) * tail * (1 + 1e-12))
    if k < 1:
        least = math.ceil(1 / tail - 1e-9) - 1
        raise BenchError(f"draws: expected at least {least} for {100 * confidence:g} %, got {draws}")
    centre, linear = a @ estimate.pi, linearise(estimate)
    again = resampler(estimate.regression)
    refits = _refits([again(estimate.pi, rng) for _ in range(draws)], estimate)
    errors = refits @ a.T - centre
    errors.sort(axis=0)
    unseen = np.where(np.isinf(linear.deviations(a)), np.inf, 0.0)
    lower, upper = centre - errors[-k] - unseen, centre - errors[k - 1] + unseen
    return Intervals(centre, lower, upper, confidence, linear.on_boundary)


def _refits(regressions: Sequence[Regression], estimate: Estimate) -> Array:
    """Parameters, (datasets, n), of datasets that differ from an estimate's in their readings alone."""
    if estimate.penalty is not None:
        penalty = estimate.penalty
        lifted = [penalty.lifted(regression) for regression in regressions]
        return np.array([penalty.lift @ solve_clarabel(r, scale_program(r, penalty)).pi for r in lifted])
    fit = complete_conservatively if estimate.constraint == "free" else minimum_norm
    return np.array([fit(r).pi for r in regressions])


def resampler(regression: Regression) -> Callable[[Array, np.random.Generator], Regression]:
    """Draw reduced datasets, at parameters, (n,), in the same poses under the same loads.

    The rows are divided by sqrt(2) sigma sqrt(N): each orthonormal coordinate in the range of R has noise of
    deviation 1 / sqrt(N), and the rest is chi squared of all other equations over N.
    """
    unit = sensitivity_units(regression)
    spans = [_range(term.R * unit) for term in regression.terms]

    def draw(pi: Array, rng: np.random.Generator) -> Regression:
        terms = [_new_readings(term, pi, U, rng) for term, U in zip(regression.terms, spans, strict=True)]
        return replace(regression, terms=tuple(terms))

    return draw


def _new_readings(term: Term, pi: Array, U: Array, rng: np.random.Generator) -> Term:
    N, spare = term.equations / 3, term.equations - U.shape[1]
    z = term.R @ pi + U @ rng.standard_normal(U.shape[1]) / math.sqrt(N)
    return replace(term, z=z, unexplained=float(rng.chisquare(spare)) / N if spare else 0.0)


def _range(R: Array) -> Array:
    """Orthonormal basis of the columns, (n, r)."""
    U, s, _ = np.linalg.svd(R)
    return np.asarray(U[:, : int((s > RANK_TOLERANCE * s[0]).sum())])
