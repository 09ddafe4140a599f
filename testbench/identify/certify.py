"""A proof of quality for any conservative estimate.

F_M is a sum of norms |r_k| of affine residuals r_k = R_k pi - z_k. For vectors y_k of length at most one,
|r_k| >= y_k . r_k; so with S_i the gradient of sum y_k . r_k with respect to block i, and any trace term
w <W, C>, every conservative C whose blocks have a trace of at most t_i obeys
    F(C) + w <W, C> >= -sum y_k . z_k - sum max(0, -lambda_min(S_i + w W_i)) t_i.
With y_k = r_k / |r_k| of an estimate, S_i is the gradient of F_M there. Nothing is asked of how the estimate
was found. The bound is used twice:
- with the trace term of GCO it bounds the program that is solved: the duality gap;
- without it it bounds F_M alone. What an optimum of the program is at most above the least F_M is what the
  trace term costs, beside the duality gap.
"""

import math

import numpy as np

from testbench.errors import Array, BenchError, check_array
from testbench.identify.estimate import Certificate, Dual, Estimate, Penalty
from testbench.identify.regression import Regression, f_m
from testbench.model.structure import Structure

TIE_BREAK = 1e-8
"""Weight of the trace in the paper's GCO, which has none: both as shares of what the data span.

It picks the least trace among models that fit alike. Where the fit goes on improving as unseen compliance
grows without end, there is no such model, and the weight decides where to stop: the advice says so.
"""
LENGTH = 0.5
"""Length that turns a translation into a rotation in scaled units [m]: L / sqrt(3) of a link of 0.9 m."""

UNSEEN_SHARE = 1e-2
"""Sensitivity that is assumed of an axis that no reading shows, as a share of the largest."""

LONGEST = 1 + 1e-9  #: Length of a dual vector up to which it is a unit vector but for rounding.
ROUNDING = 4 * np.finfo(float).eps
"""What rounding may take from an eigenvalue of S_i, as a share of the size of what S_i is summed from.

The bounds are exact up to it, and to 1e-12 of F_M at C = 0.
"""


def scaled_units(structure: Structure) -> Array:
    """Units s in which traces and eigenvalues are taken: C = s X s^T, (n_theta,).

    A translation counts as the rotation that causes it on an arm of `LENGTH`, so that X and its trace are in
    rad/(N m) whatever mixture of metres and radians C holds.
    """
    index = np.arange(structure.n_theta)
    return np.where((index < 6 * structure.links) & (index % 6 < 3), LENGTH, 1.0)


def tie_break(regression: Regression) -> Penalty:
    """Weigh the plain trace so lightly that it only chooses among models that fit alike."""
    s, weight = regression.structure, TIE_BREAK * (regression.weight.max() or 1.0)
    return Penalty(float(weight), scaled_units(s) ** -2.0, s, np.eye(s.n))


def certify(estimate: Estimate, dual: Dual | None = None) -> Certificate:
    """Bound how far a conservative estimate is from the best one.

    Args:
        estimate: Any conservative estimate, from any method.
        dual: Proof of the bound, such as that of a better estimate; None for the estimate's own gradients,
            which prove much only near an optimum.

    Returns:
        How far F_M is at most above its least value, the same of F_M and the trace term, and the traces
        within which that holds, `default_trace_bounds`.

    Raises:
        BenchError: When the estimate is not conservative (the bound would prove nothing), or the dual has
            another shape, is not finite, or has a vector longer than one by more than rounding.
    """
    if not estimate.conservative:
        raise BenchError(
            f"certify: expected a conservative estimate, {estimate.method} has smallest eigenvalue "
            f"{estimate.min_eigenvalue:.3g}"
        )
    regression = estimate.regression
    dual = gradient_dual(regression, estimate.pi) if dual is None else _checked(regression, dual)
    if estimate.penalty is None or estimate.split is None:
        return bound(regression, estimate.pi, dual, penalty=tie_break(regression))
    return bound(estimate.penalty.lifted(regression), estimate.split, dual, penalty=estimate.penalty)


def _checked(regression: Regression, dual: Dual) -> Dual:
    """A dual from outside: refused unless its vectors are of length one at most but for rounding."""
    terms = len(regression.terms)
    y = check_array(dual.y, (terms, regression.structure.n), "dual.y")
    rest = check_array(dual.y_rest, (terms,), "dual.y_rest")
    longest = float(np.hypot(np.linalg.norm(y, axis=1), rest).max())
    if longest > LONGEST:
        raise BenchError(f"dual: expected vectors of length 1 at most, got one of {longest:.9g}")
    return shortened(y, rest)


def shortened(y: Array, rest: Array) -> Dual:
    """The dual of these vectors, (terms, n) and (terms,), those longer than one scaled to it."""
    length = np.maximum(1.0, np.hypot(np.linalg.norm(y, axis=1), rest))
    return Dual(y / length[:, None], rest / length)


def gradient_dual(regression: Regression, pi: Array) -> Dual:
    """The unit residuals of a parameter vector: their S_i are the gradient of F_M there."""
    y, rest = [], []
    for term in regression.terms:
        residual = np.r_[term.R @ pi - term.z, math.sqrt(term.rest)]
        norm = np.linalg.norm(residual)
        residual = residual / norm if norm > 0 else residual
        y.append(residual[:-1])
        rest.append(residual[-1])
    return Dual(np.array(y), np.array(rest))


def bound(
    regression: Regression, pi: Array, dual: Dual, trace_bounds: Array | None = None, *, penalty: Penalty
) -> Certificate:
    """How far a conservative pi, (n,), is at most above the lower bounds of a dual, none longer than one.

    Regression and pi are of the penalty's own structure. `trace_bounds` are t_i, of the trace of each block
    in scaled units, (blocks,) [rad/(N m)]; None for `default_trace_bounds`.
    """
    s, t = regression.structure, trace_bounds
    t = default_trace_bounds(regression, pi) if t is None else t
    g = np.zeros(s.n)
    constant = 0.0
    for term, y, rest in zip(regression.terms, dual.y, dual.y_rest, strict=True):
        g += term.R.T @ y
        constant += rest * math.sqrt(term.rest) - y @ term.z
    cost, free = f_m(regression, pi), np.zeros(s.n)

    def over(cost: float, price: Array) -> float:
        least = constant - float(np.maximum(0, -_smallest(regression, g, price)) @ t)
        return max(0.0, cost - max(0.0, least))  # the cost is a sum of norms and traces

    return Certificate(
        duality_gap=over(cost + float(penalty.price @ pi), penalty.price),
        f_m_excess_bound=over(cost, free),
        trace_bounds=t,
        dual=dual,
    )


def _smallest(regression: Regression, g: Array, price: Array) -> Array:
    """Smallest eigenvalue of every S_i + w W_i in scaled units, less its rounding, (blocks,).

    `g` is the gradient of S_i, `price` that of the trace term, (n,) each.
    """
    s, unit = regression.structure, scaled_units(regression.structure)
    scale = np.outer(unit, unit)
    S, size = s.gradient(g + price) * scale, s.gradient(regression.columns + np.abs(price)) * scale
    smallest = np.empty(len(s.blocks))
    for group in s.groups:
        lost = ROUNDING * np.linalg.norm(size[group.index], axis=(1, 2))
        smallest[group.at] = np.linalg.eigvalsh(S[group.index])[:, 0] - lost
    return smallest


def default_trace_bounds(regression: Regression, pi: Array) -> Array:
    """Traces within which every axis may be soft enough to explain the data by itself, (blocks,) [rad/(N m)].

    An axis d is allowed c_d = 2 F_M(0) / |R e_d|, with R e_d the weighted readings that a unit of C_dd causes
    in all terms; a block the sum of what its axes are. By the triangle inequality a model with C_dd = c
    and nothing else has F_M >= sum_k (c |R_k e_d| - |z_k|) >= c |R e_d| - F_M(0): softer than c_d, it fits
    worse than a rigid arm. So it is for every axis that a reading shows, however little.

    That is proven of one axis at a time. Of models with several it is assumed: compliances whose readings
    cancel may be softer and fit. An axis that no reading shows has no bound from data: it is assumed to be
    allowed what one of `UNSEEN_SHARE` of the largest sensitivity is. A block is allowed twice the trace of pi
    if that is more.
    """
    s = regression.structure
    used = s.block_of >= 0
    unit = scaled_units(s)[used] ** 2
    sensitivity = regression.weight[used] * unit
    sensitivity[sensitivity == 0] = UNSEEN_SHARE * (sensitivity.max() or 1.0)
    allowed = 2 * f_m(regression, np.zeros(s.n)) / sensitivity
    own = 2 * np.diag(s.matrix(pi))[used] / unit
    return np.maximum(*(np.bincount(s.block_of[used], weights=trace) for trace in (allowed, own)))


def total_trace(structure: Structure, pi: Array) -> float:
    """Trace of C_theta in scaled units [rad/(N m)]."""
    diagonal = structure.a == structure.b
    return float((pi[diagonal] / scaled_units(structure)[structure.a[diagonal]] ** 2).sum())
