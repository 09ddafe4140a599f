"""Empirical Bayes for a linear model: sizes of unknowns, and noise of equations, learnt from the readings.

Of c unknowns some are drawn from N(m(h), d(h)^2), with one size d for all unknowns of a part. The others are
free, or held by equations that count as exact. With y_k = A_k x + noise of deviation s_k(h) for each kind k,
the hyperparameters h, all logarithms, maximise the evidence (MacKay 1992, The evidence framework):

    -log p(y, h) = sum_k (|y_k - A_k x|^2 / s_k^2 + 2 n_k log s_k) / 2
                   + sum_i ((x_i - m_i)^2 / d_i^2 + log d_i^2) / 2 + log det P / 2 - log p(h),

P = sum_k A_k^T A_k / s_k^2 + diag(d^-2), x the most probable unknowns, and P their precision. Only the Gram
matrices of the equations are needed.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.lapack import dpotri

from testbench.errors import Array, BenchError, Ids

EVIDENCE_TOLERANCE = 1e-4
"""Gain of the evidence below which a Newton step is the last one: the next step would gain its square."""
MAX_NEWTON_STEPS, MAX_HALVINGS = 100, 30  #: Steps, and times that one is halved.
STUDENT_SCALE, STUDENT_DOF = 0.4, 4.0
"""Scale and degrees of freedom of the Student distribution of log sizes: most are similar, a few differ."""
MIN_CURVATURE, MAX_STEP = 1e-3, 2.0
"""Least second derivative that a step uses, and the longest step."""


@dataclass(frozen=True)
class Hyperprior:
    """Hold the densities of linear functions z of the hyperparameters, one per row."""

    rows: Array  #: Of z, (k, m).
    middle: Array  #: h of z = 0 along the rows, (k,).
    #: -log p(z), each, and its first and second derivatives, (k,).
    density: Callable[[Array], tuple[Array, Array, Array]]


def normal_density(z: Array) -> tuple[Array, Array, Array]:
    """Compute -log of the standard normal density without its constant.

    Args:
        z: Standardised values, (...) [1].

    Returns:
        It and its first two derivatives, (...) each.
    """
    return z**2 / 2, z, np.ones_like(z)


def student_density(z: Array) -> tuple[Array, Array, Array]:
    """Compute -log of Student's density with `STUDENT_DOF`, without its constant.

    Args:
        z: Standardised values, (...) [1].

    Returns:
        It and its first two derivatives, (...) each.
    """
    over = STUDENT_DOF + z**2
    return (
        (STUDENT_DOF + 1) / 2 * np.log(over / STUDENT_DOF),
        (STUDENT_DOF + 1) * z / over,
        (STUDENT_DOF + 1) * (STUDENT_DOF - z**2) / over**2,
    )


@dataclass(frozen=True, eq=False)
class EvidenceModel:
    """Hold a linear model of c unknowns with m hyperparameters; the last are log s_k."""

    gram: Array  #: Gram matrices of [A | y] of every kind of equations, (kinds, c + 1, c + 1).
    counts: Array  #: Equations of every kind, (kinds,).
    known: Array  #: Gram matrix of the equations that count as exact, (c + 1, c + 1).
    drawn: Array  #: log d of every unknown per unit of h, zero for unknowns without a prior, (c, m).
    expected: Array  #: m_i over its scale, (c,).
    scale: Array  #: Logarithm of that scale per unit of h, (c, m).
    priors: tuple[Hyperprior, ...]  #: Of the hyperparameters.
    bounds: Array  #: Least and largest value of every hyperparameter, (2, m).


@dataclass(frozen=True)
class Normal:
    """Hold the solution of normal equations."""

    x: Array  #: Most likely unknowns, (c,).
    root: tuple[Array, bool]  #: Cholesky's, of the precision scaled to unit diagonal.
    size: Array  #: Roots of its diagonal before, (c,).

    @property
    def log_size(self) -> float:
        """Return the logarithm of the determinant of the precision."""
        return 2 * float(np.log(np.diag(self.root[0]) * self.size).sum())

    @property
    def covariance(self) -> Array:
        """Compute the covariance of all unknowns, (c, c)."""
        half = dpotri(self.root[0], lower=0)[0]
        inverse = np.where(np.tri(len(half), dtype=bool), half.T, half)
        return np.asarray(inverse / self.size / self.size[:, None])

    def variances(self, columns: Ids) -> Array:
        """Compute the variances of some unknowns.

        Args:
            columns: The unknowns, (k,).

        Returns:
            Variances, (k,).
        """
        some = np.eye(len(self.size))[:, columns]
        return np.asarray((some * cho_solve(self.root, some)).sum(axis=0) / self.size[columns] ** 2)


def normal(H: Array) -> Normal:
    """Solve for the most probable unknowns.

    Args:
        H: Gram matrix of the whitened [A | y], (c + 1, c + 1).

    Returns:
        The unknowns, (c,), with the factor of their precision.

    Raises:
        BenchError: If an unknown is undetermined: only frames and targets have no prior.
    """
    size = np.sqrt(np.diag(H)[:-1])
    try:
        root = cho_factor(H[:-1, :-1] / np.where(size > 0, size, np.nan) / size[:, None])
    except (np.linalg.LinAlgError, ValueError):  # not positive definite, or not finite
        raise BenchError(
            "calibration: the readings leave a frame or target open; expected more poses"
        ) from None
    return Normal(cho_solve(root, H[:-1, -1] / size) / size, root, size)


@dataclass(frozen=True)
class EvidencePosterior:
    """Hold the unknowns and the loss at given hyperparameters."""

    normal: Normal
    covariance: Array  #: V = P^-1, (c, c).
    deviation: Array  #: d, infinite for unknowns without a prior, (c,).
    mean: Array  #: m, (c,).
    residual_squares: Array  #: |y_k - A_k x|^2 / s_k^2, (kinds,).
    spent_equations: Array  #: Degrees of freedom that the unknowns use, by kind of equations, (kinds,).
    loss: float  #: -log p(y, h).
    gradient: Array  #: Of that, (m,).


def evidence_posterior(problem: EvidenceModel, h: Array) -> EvidencePosterior:
    """Compute the most probable unknowns and -log p(y, h) at given hyperparameters.

    Mathematics: `prior-8`.

    Args:
        problem: The linear model, c unknowns and m hyperparameters.
        h: Hyperparameters, logarithms, (m,) [1].

    Returns:
        Unknowns, covariance, loss and its gradient.

    Raises:
        BenchError: When the equations leave an unknown undetermined, or rounding leaves P no root.
    """
    kinds, D = len(problem.counts), problem.drawn
    d, s2 = np.where(D.any(axis=1), np.exp(D @ h), np.inf), np.exp(2 * h[-kinds:])
    mean = np.exp(problem.scale @ h) * problem.expected
    # Gram matrix of readings and prior, and the most probable unknowns.
    H = problem.known + sum(gram / own for gram, own in zip(problem.gram, s2, strict=True))
    H[:-1, -1] += mean / d**2
    H.flat[: -1 : len(H) + 1] += d**-2
    found = normal(H)
    V, v, off = found.covariance, np.r_[found.x, -1.0], (found.x - mean) / d
    left = problem.gram @ v @ v / s2
    spent = np.array([np.vdot(gram[:-1, :-1], V) for gram in problem.gram]) / s2
    # -log p, its derivative, and the hyperpriors.
    value = (left.sum() + off @ off + v @ problem.known @ v + found.log_size) / 2
    value += problem.counts @ h[-kinds:] + (D @ h).sum()
    g = D.T @ (D.any(axis=1) - off**2 - np.diag(V) / d**2) - problem.scale.T @ (mean * off / d)
    g[-kinds:] += problem.counts - left - spent
    for prior in problem.priors:
        of, slope, _ = prior.density(prior.rows @ h - prior.middle)
        value, g = value + of.sum(), g + prior.rows.T @ slope
    return EvidencePosterior(found, V, d, mean, left, spent, float(value), g)


def evidence_hessian(problem: EvidenceModel, h: Array, posterior: EvidencePosterior) -> tuple[Array, Array]:
    """Compute the second derivatives of the loss by the hyperparameters, with implicit differentiation.

    With w = d^-2 and U = -d^2 loss / dx dh it is dx/dh = V U. The loss at the best x bends by U^T V U less
    than at a fixed x; the determinant of P bends by tr(V P' V P') less than by its own P''.

    Mathematics: `prior-9`.

    Args:
        problem: The linear model.
        h: Hyperparameters, (m,) [1].
        posterior: The posterior there.

    Returns:
        Hessian, (m, m), and dx/dh, (c, m).
    """
    D, S, V, kinds = problem.drawn, problem.scale, posterior.covariance, len(posterior.residual_squares)
    w, off = posterior.deviation**-2, (posterior.normal.x - posterior.mean) / posterior.deviation
    a, K, s2 = off / posterior.deviation, np.eye(len(h))[-kinds:], np.exp(2 * h[-kinds:])
    # U: derivative of the gradient in x by h; J = V U is how x moves.
    pulls = (problem.gram @ np.r_[posterior.normal.x, -1.0])[:, :-1] / s2[:, None]
    U = 2 * a[:, None] * D + (w * posterior.mean)[:, None] * S + 2 * pulls.T @ K
    J = V @ U
    shares = _shares(problem, V, w, s2)
    N = w[:, None] * (np.array([(M * V).sum(axis=1) for M in shares]).T @ K)
    wD = w[:, None] * D
    # Second derivatives of the quadratic form and of log det P.
    traces = np.array([[np.vdot(M, other.T) for other in shares] for M in shares])
    mixed = D.T @ ((posterior.mean * a)[:, None] * S) - D.T @ N
    H = 2 * D.T @ ((off**2 + np.diag(V) * w)[:, None] * D) + 2 * (mixed + mixed.T) - U.T @ J
    H += S.T @ ((posterior.mean**2 * w - posterior.mean * a)[:, None] * S) - 2 * wD.T @ V**2 @ wD
    H += 2 * K.T @ (np.diag(posterior.residual_squares + posterior.spent_equations) - traces) @ K
    for prior in problem.priors:
        bend = prior.density(prior.rows @ h - prior.middle)[2]
        H += prior.rows.T @ (bend[:, None] * prior.rows)
    return H, J


def _shares(problem: EvidenceModel, V: Array, w: Array, s2: Array) -> list[Array]:
    """V A_k^T A_k / s_k^2 of every kind, (c, c); with V times all else in P they are one."""
    found = [V @ (gram[:-1, :-1] / own) for gram, own in zip(problem.gram[:-1], s2, strict=False)]
    last = np.eye(len(V)) - V * w - sum(found)
    on = np.flatnonzero(problem.known[:-1].any(axis=1))
    last[:, on] -= V[:, on] @ problem.known[np.ix_(on, on)]
    return [*found, last]


def maximise_evidence(problem: EvidenceModel, start: Array, held: int | None = None) -> Array:
    """Maximise the evidence over the hyperparameters by Newton's method with step halving.

    Mathematics: `prior-9`.

    Args:
        problem: The linear model.
        start: First hyperparameters, (m,) [1].
        held: Place of one that stays fixed; None for none.

    Returns:
        Hyperparameters of greatest evidence within the bounds, (m,) [1].
    """
    h, own, (low, high) = start, evidence_posterior(problem, start), problem.bounds
    for _ in range(MAX_NEWTON_STEPS):
        g = own.gradient
        # A hyperparameter at its bound is free only if the loss falls inwards.
        free = ~((h <= low) & (g > 0) | (h >= high) & (g < 0))
        if held is not None:
            free[held] = False
        values, Q = np.linalg.eigh(evidence_hessian(problem, h, own)[0][np.ix_(free, free)])
        # Newton's step with |eigenvalues|: it descends even where the loss is not convex.
        step = np.zeros_like(h)
        step[free] = -Q @ (Q.T @ g[free] / np.maximum(np.abs(values), MIN_CURVATURE))
        before, (h, own) = own.loss, _lower(problem, h, own, step)
        if before - own.loss < EVIDENCE_TOLERANCE:
            break
    return h


def _lower(
    problem: EvidenceModel, h: Array, own: EvidencePosterior, step: Array
) -> tuple[Array, EvidencePosterior]:
    """Where a step, or a part of it, lowers the loss; where it starts if none does."""
    step = step * min(1.0, MAX_STEP / np.abs(step).max(initial=MAX_STEP))
    for _ in range(MAX_HALVINGS):
        there = np.clip(h + step, *problem.bounds)
        try:
            found = evidence_posterior(problem, there)
        except BenchError:
            found = own
        if found.loss < own.loss:
            return there, found
        step = step / 2
    return h, own
