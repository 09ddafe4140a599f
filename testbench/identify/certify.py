"""Certificate of optimality for any conservative estimate.

F_M is a sum of norms |r_k| of affine residuals r_k = R_k pi - z_k. For vectors y_k of length at most one,
|r_k| >= y_k . r_k. So with S_i the gradient of sum y_k . r_k with respect to block i, and any trace term w
<W, C>, every conservative C whose blocks have a trace of at most t_i obeys

    F(C) + w <W, C> >= -sum y_k . z_k - sum max(0, -lambda_min(S_i + w W_i)) t_i.

With y_k = r_k / |r_k| of an estimate, S_i is the gradient of F_M there. It does not matter how the estimate
was found. The bound is used twice:

- with the trace term of GCO it bounds the program that is solved: the duality gap;
- without it it bounds F_M alone: the largest excess of F_M over its minimum is the cost of the trace term, in
  addition to the duality gap.
"""

import math

import numpy as np

from testbench.errors import Array, BenchError, check_array, check_type
from testbench.identify.estimate import Certificate, Dual, Estimate, Penalty
from testbench.identify.regression import Regression, f_m
from testbench.model.structure import Structure

TIE_BREAK = 1e-8
"""Weight of the trace in `paper_gco`, as a share of the largest sensitivity of F_M to a compliance [1].

The paper has no such term. It selects the least trace among models of equal fit. If the fit keeps improving
as an unobservable compliance grows, no such model exists; then this weight decides where the growth stops,
and the advice says so.
"""
LENGTH = 0.5
"""Length that turns a translation into a rotation in scaled units [m]: L / sqrt(3) of a link of 0.9 m."""

UNSEEN_SHARE = 1e-2
"""Sensitivity assumed of an axis that no reading observes, as a share of the largest sensitivity [1]."""

MAX_DUAL_LENGTH = 1 + 1e-9
"""Length up to which a dual vector counts as a unit vector; the excess is rounding [1]."""
EIGENVALUE_ROUNDING = 4 * np.finfo(float).eps
"""What rounding may take from an eigenvalue of S_i, as a share of the size of what S_i is summed from.

The bounds are exact up to it, and to 1e-12 of F_M at C = 0.
"""


def scaled_units(structure: Structure) -> Array:
    """Return units s in which traces and eigenvalues are taken: C = s X s^T.

    A translation counts as the rotation that causes it on an arm of `LENGTH`, so that X and its trace are in
    rad/(N m) whatever mixture of metres and radians C holds.

    Args:
        structure: The unknowns, which fix the order of the virtual joints.

    Returns:
        s of every virtual joint, (n_theta,): `LENGTH` [m/rad] for translations of links, 1 for all else.
    """
    index = np.arange(structure.n_theta)
    return np.where((index < 6 * structure.links) & (index % 6 < 3), LENGTH, 1.0)


def tie_break(regression: Regression) -> Penalty:
    """Make the trace term of the paper's GCO, so light that it only selects among models of equal fit.

    Args:
        regression: The reduced dataset.

    Returns:
        The term w <W, C>, w = `TIE_BREAK` times the largest sensitivity.
    """
    s, weight = regression.structure, TIE_BREAK * (regression.weight.max() or 1.0)
    return Penalty(float(weight), scaled_units(s) ** -2.0, s, np.eye(s.n))


def certify(estimate: Estimate, dual: Dual | None = None) -> Certificate:
    """Bound how far a conservative estimate is from the best one, by the dual bound of this module.

    Args:
        estimate: Any conservative estimate, from any method.
        dual: Vectors y_k that prove the bound, such as those of a better estimate; None for the unit
            residuals of the estimate itself, which prove much only near an optimum.

    Returns:
        Upper bounds of F_M, and of F_M + w <W, C>, above their least values [1]; both hold for traces within
        `default_trace_bounds`.

    Raises:
        BenchError: When the estimate is not conservative (the bound would prove nothing), or the dual has
            another shape, is not finite, or has a vector longer than one by more than rounding.
    """
    check_type(estimate, Estimate, "estimate")
    if not estimate.conservative:
        raise BenchError(
            f"certify: expected a conservative estimate, {estimate.method} has smallest eigenvalue "
            f"{estimate.min_eigenvalue:.3g}"
        )
    regression = estimate.regression
    dual = gradient_dual(regression, estimate.pi) if dual is None else _checked(regression, dual)
    if estimate.penalty is None or estimate.split is None:
        return lower_bound_certificate(regression, estimate.pi, dual, penalty=tie_break(regression))
    return lower_bound_certificate(
        estimate.penalty.lifted(regression), estimate.split, dual, penalty=estimate.penalty
    )


def _checked(regression: Regression, dual: Dual) -> Dual:
    """A dual from outside: refused unless its vectors are of length one at most but for rounding."""
    terms = len(regression.terms)
    y = check_array(dual.y, (terms, regression.structure.n), "dual.y")
    rest = check_array(dual.y_rest, (terms,), "dual.y_rest")
    longest = float(np.hypot(np.linalg.norm(y, axis=1), rest).max())
    if longest > MAX_DUAL_LENGTH:
        raise BenchError(f"dual: expected vectors of length 1 at most, got one of {longest:.9g}")
    return normalise_dual(y, rest)


def normalise_dual(y: Array, rest: Array) -> Dual:
    """Scale dual vectors that are longer than one to length one.

    Args:
        y: Their components against the rows of every term's R, (terms, n) [1].
        rest: Their components against the unexplained residual, (terms,) [1].

    Returns:
        The dual, every vector of length one at most.
    """
    length = np.maximum(1.0, np.hypot(np.linalg.norm(y, axis=1), rest))
    return Dual(y / length[:, None], rest / length)


def gradient_dual(regression: Regression, pi: Array) -> Dual:
    """Compute the unit residuals y_k = r_k / |r_k| of parameters; their S_i are the gradient of F_M there.

    Mathematics: `est-13`.

    Args:
        regression: The reduced dataset.
        pi: Parameters, (n,) [m/N, rad/(N m), rad/N].

    Returns:
        The dual, one vector per term of F_M; zero where the residual is zero.
    """
    y, rest = [], []
    for term in regression.terms:
        residual = np.r_[term.R @ pi - term.z, math.sqrt(term.unexplained)]
        norm = np.linalg.norm(residual)
        residual = residual / norm if norm > 0 else residual
        y.append(residual[:-1])
        rest.append(residual[-1])
    return Dual(np.array(y), np.array(rest))


def lower_bound_certificate(
    regression: Regression, pi: Array, dual: Dual, trace_bounds: Array | None = None, *, penalty: Penalty
) -> Certificate:
    """Bound F_M(pi), and F_M(pi) + w <W, C>, above their least values by a dual.

    Mathematics: `est-12`.

    Args:
        regression: The reduced dataset, by the parameters of the penalty's own structure.
        pi: Parameters of a conservative model in that structure, (n,) [m/N, rad/(N m), rad/N].
        dual: Vectors y_k, none longer than one.
        trace_bounds: Bound t_i of every block's trace in scaled units, (blocks,) [rad/(N m)]; None for
            `default_trace_bounds`.
        penalty: The trace term w <W, C>.

    Returns:
        The certificate, all costs in units of F_M [1].
    """
    s, t = regression.structure, trace_bounds
    t = default_trace_bounds(regression, pi) if t is None else t
    # Lagrangian of the dual: gradient sum R_k^T y_k and constant sum (rest_k |rest| - y_k . z_k).
    g = np.zeros(s.n)
    constant = 0.0
    for term, y, rest in zip(regression.terms, dual.y, dual.y_rest, strict=True):
        g += term.R.T @ y
        constant += rest * math.sqrt(term.unexplained) - y @ term.z
    cost, free = f_m(regression, pi), np.zeros(s.n)

    def over(cost: float, price: Array) -> float:
        # A negative eigenvalue of S_i can lower the cost by at most -lambda_min t_i.
        """Bound how far a cost lies above the least.

        Args:
            cost: The cost.
            price: Gradient of the trace term that it includes, (n,).

        Returns:
            The bound, 0 or more.
        """
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
        # The eigenvalue is lowered by what rounding may have added: the bound stays rigorous.
        lost = EIGENVALUE_ROUNDING * np.linalg.norm(size[group.index], axis=(1, 2))
        smallest[group.at] = np.linalg.eigvalsh(S[group.index])[:, 0] - lost
    return smallest


def default_trace_bounds(regression: Regression, pi: Array) -> Array:
    """Compute the traces within which a certificate holds: what the data can bound axis by axis.

    An axis d is allowed c_d = 2 F_M(0) / |R e_d|, with R e_d the weighted readings that a unit of C_dd causes
    in all terms; a block is allowed the sum over its axes. By the triangle inequality a model with C_dd = c
    and nothing else has F_M >= sum_k (c |R_k e_d| - |z_k|) >= c |R e_d| - F_M(0): with c above c_d it fits
    worse than a rigid arm. This holds for every axis that a reading observes, however little.

    It is proven for one axis at a time and assumed for several: compliances whose deflections cancel may be
    larger and still fit. An axis that no reading observes is treated as if its sensitivity were
    `UNSEEN_SHARE` of the largest. A block is allowed twice the trace of pi if that is more.

    Mathematics: `est-14`.

    Args:
        regression: The reduced dataset.
        pi: Parameters of the model that is certified, (n,) [m/N, rad/(N m), rad/N].

    Returns:
        Bound t_i of every block's trace in scaled units, (blocks,) [rad/(N m)].
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
    """Compute the trace of C_theta in scaled units.

    Args:
        structure: The unknowns.
        pi: Parameters, (n,) [m/N, rad/(N m), rad/N].

    Returns:
        tr(s^-1 C_theta s^-1) [rad/(N m)], with s of `scaled_units`.
    """
    diagonal = structure.a == structure.b
    return float((pi[diagonal] / scaled_units(structure)[structure.a[diagonal]] ** 2).sum())
