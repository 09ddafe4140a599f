"""A proof of quality for any conservative estimate.

F_M is a sum of norms |r_k| of affine residuals r_k = R_k pi - z_k. For unit vectors y_k, |r_k| >= y_k . r_k;
so with S_i the gradient of sum y_k . r_k with respect to block i, every conservative C* whose blocks have a
trace of at most t_i obeys
    F(C*) >= -sum y_k . z_k - sum max(0, -lambda_min S_i) t_i.
With y_k = r_k / |r_k| of an estimate, S_i is the gradient of F_M there, and the bound reads
    F - F* <= sum <S_i, C_i> + sum max(0, -lambda_min S_i) t_i.
Nothing is asked of how the estimate was found.
"""

import math

import numpy as np

from testbench.errors import Array, BenchError, check_array
from testbench.identify.estimate import Certificate, Dual, Estimate
from testbench.identify.regression import Regression, f_m
from testbench.model.structure import Structure

LENGTH = 0.5
"""Length that turns a translation into a rotation in scaled units [m]: L / sqrt(3) of a link of 0.9 m."""

SENSITIVITY_SHARE = 1e-2
"""Least sensitivity of an axis in the default trace bounds, as a share of the largest."""


def scaled_units(structure: Structure) -> Array:
    """Units s in which traces and eigenvalues are taken: C = s X s^T, (n_theta,).

    A translation counts as the rotation that causes it on an arm of `LENGTH`, so that X and its trace are in
    rad/(N m) whatever mixture of metres and radians C holds.
    """
    index = np.arange(structure.n_theta)
    links = (structure.n_theta + 1) // 7  # six virtual joints each, and one joint less than links
    return np.where((index < 6 * links) & (index % 6 < 3), LENGTH, 1.0)


def certify(
    estimate: Estimate, trace_bounds: Array | None = None, *, dual: Dual | None = None
) -> Certificate:
    """Bound the optimality gap of a conservative estimate.

    Args:
        estimate: Any conservative estimate, from any method.
        trace_bounds: t_i, bound of the trace of each block in scaled units, (blocks,) [rad/(N m)]; None for
            `default_trace_bounds`.
        dual: Proof of the bound, such as that of a better estimate; None for the estimate's own gradients,
            which prove much only near an optimum.

    Returns:
        How far F_M is at most above its least value, and the traces within which that holds.

    Raises:
        BenchError: When the estimate is not conservative (the bound would prove nothing), or a trace bound
            is negative, not finite or missing.
    """
    if not estimate.conservative:
        raise BenchError(
            f"certify: expected a conservative estimate, {estimate.method} has smallest eigenvalue "
            f"{estimate.min_eigenvalue:.3g}"
        )
    regression = estimate.regression
    dual = gradient_dual(regression, estimate.pi) if dual is None else dual
    return bound_gap(regression, estimate.pi, dual, trace_bounds)


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


def bound_gap(
    regression: Regression,
    pi: Array,
    dual: Dual,
    trace_bounds: Array | None = None,
    *,
    trace_weight: float = 0.0,
) -> Certificate:
    """Gap between the cost of a conservative pi, (n,), and the lower bound of a dual vector from anywhere.

    The cost is F_M + trace_weight * total trace [N m/rad]; the weight adds itself to every eigenvalue of S_i.
    """
    s = regression.structure
    unit = scaled_units(s)
    if trace_bounds is None:
        t = default_trace_bounds(regression, pi)
    else:
        t = check_array(trace_bounds, (len(s.blocks),), "trace_bounds [rad/(N m)]")
        if (t < 0).any():
            raise BenchError(f"trace_bounds [rad/(N m)]: expected none below 0, got {t.min():g}")
    g = np.zeros(s.n)
    constant = 0.0
    for term, y, rest in zip(regression.terms, dual.y, dual.y_rest, strict=True):
        g += term.R.T @ y
        constant += rest * math.sqrt(term.rest) - y @ term.z
    S = s.gradient(g) * np.outer(unit, unit)
    smallest = np.full(len(s.blocks), trace_weight)
    for group in s.groups:
        smallest[group.at] += np.linalg.eigvalsh(S[group.index])[:, 0]
    lower = max(0.0, constant - float(np.maximum(0, -smallest) @ t))  # the cost is a sum of norms
    cost = f_m(regression, pi) + trace_weight * total_trace(s, pi)
    return Certificate(max(0.0, cost - lower), t, smallest, dual)


def default_trace_bounds(regression: Regression, pi: Array) -> Array:
    """Bounds in scaled units that no arm near the data exceeds, whatever the estimate, (blocks,) [rad/(N m)].

    Every axis is allowed a compliance that explains all the data by itself, an axis that the data hardly load
    that of one a hundredth as sensitive as the most sensitive; and twice the estimate's own, if that is more.
    """
    s, weight = regression.structure, regression.weight
    unit = scaled_units(s) ** 2
    sensitivity = np.maximum(weight, SENSITIVITY_SHARE * (weight.max() or 1.0))
    allowed = f_m(regression, np.zeros(s.n)) / sensitivity / unit
    own = 2 * np.diag(s.matrix(pi)) / unit
    used = s.block_of >= 0
    each = [np.bincount(s.block_of[used], weights=trace[used]) for trace in (allowed, own)]
    return np.maximum(*each)


def total_trace(structure: Structure, pi: Array) -> float:
    """Trace of C_theta in scaled units [rad/(N m)]."""
    diagonal = structure.a == structure.b
    return float((pi[diagonal] / scaled_units(structure)[structure.a[diagonal]] ** 2).sum())
