"""Design criteria: information functions Phi of the information matrix M, each with a certificate.

Every criterion Phi is concave in M and positively homogeneous (Pukelsheim 1993, ch. 5), so that its
efficiency Phi(plan) / Phi(best) is between 0 and 1. A criterion has three methods. `phi(M)` is Phi.
`phi_with_candidate(M, rows)` is Phi with one more candidate, for every candidate, by updates of rank k.
`tangent(M)` is a plane above Phi, from which the equivalence theorem bounds all plans at once. M is (r, r),
and the whitened rows F of the candidates are (candidates, k, r).

D: det(M)^(1/r). A: r / tr(M^-1). E: least eigenvalue. I, and the test-pose criterion of Klimchik et al.
(Robotics and CIM 2014) and Wu et al. (2015): 1 / tr(W M^-1), where W averages the prediction rows' squares.
G: 1 / largest prediction variance. Formulas: Fedorov (1972), Pukelsheim (1993); for calibration poses Sun and
Hollerbach (ICRA 2008).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_triangular

from testbench.design.rows import DesignProblem, row_products, split_into_blocks
from testbench.errors import Array, BenchError

CRITERIA = ("D", "A", "E", "G", "I", "test")  #: Names of all criteria; absolute readings have no "test".
POWER_MEAN_EXPONENT = 24  #: Exponent of the power mean that replaces the largest cost of G and E [1].
MIN_UPDATE_ACCURACY = 1e-3
"""Share of the digits of K that updates of `CandidateGains` may leave [1]: N loses twice as many digits."""
MAX_INVERTED_INFORMATION = 1e5
"""Largest information of a reading over that of M, up to which gains are computed from M^-1 [1].

Above it the rounding of M^-1 can exceed the gains in the weak directions; then use `gains_at_root`.
"""
MAX_EXACT_CANDIDATES = 32
"""Most candidates for which G and E are computed exactly; the power mean of their costs selects them."""


@dataclass(frozen=True)
class Tangent:
    """Hold a linear upper bound of a concave criterion: Phi(M') <= <Z, M'> = tr(Z M') for every M'.

    For D and the linear criteria it is the tangent plane of Phi at an information matrix M. For G and E it is
    that of a smooth function that is at least Phi everywhere.
    """

    Z: Array  #: Matrix of the bound, symmetric, (r, r).
    height: float  #: Phi(M); for G and E one over the power mean of the costs in place of their maximum.
    #: Second derivative along a matrix S, over <Z, S M^-1 S> / height: 1 for -log Phi of D, 2 for the cost
    #: tr(W M^-1) over its value of a linear criterion; 0 for G and E, which take no Newton step.
    curvature: float = 0.0


@dataclass(frozen=True)
class DeterminantCriterion:
    """Implement the D-criterion det(M)^(1/r), which measures the volume of the confidence ellipsoid."""

    def phi(self, M: Array) -> float:
        """Compute the D-criterion Phi(M) = det(M)^(1/r).

        Mathematics: `pose-4`.

        Args:
            M: Information matrix, (r, r) [1].

        Returns:
            Phi(M) [1]; 0 if M is not positive definite.
        """
        sign, size = np.linalg.slogdet(M)
        return float(np.exp(size / len(M))) if sign > 0 else 0.0

    def phi_with_candidate(self, M: Array, rows: Array) -> Array:
        """Compute Phi = det(M)^(1/r) with one more candidate: det(M + F^T F) = det(M) det(1 + F M^-1 F^T).

        Mathematics: `pose-7`.

        Args:
            M: Information matrix, (r, r) [1].
            rows: Whitened rows F of the candidates, (candidates, k, r).

        Returns:
            Phi(M + F^T F) of every candidate, (candidates,).
        """
        seen = row_products(rows, np.asarray(np.linalg.inv(M))) @ rows.swapaxes(1, 2)
        growth = np.linalg.slogdet(np.eye(rows.shape[1]) + seen)[1]
        return np.asarray(self.phi(M) * np.exp(growth / len(M)))

    def tangent(self, M: Array) -> Tangent:
        """Compute the tangent plane of Phi = det(M)^(1/r), Z = Phi(M) M^-1 / r.

        It bounds Phi by the inequality of arithmetic and geometric means.

        Mathematics: `pose-9`.

        Args:
            M: Information matrix, (r, r) [1].
        """
        value = self.phi(M)
        return Tangent(value * np.linalg.inv(M) / len(M), value, curvature=1.0)


@dataclass(frozen=True)
class LinearCriterion:
    """Implement the criteria 1 / tr(W M^-1), linear in M^-1: A, I and the test-pose criterion.

    For A, W is 1/r times the identity; for I it is `mean_square_weight` of the workspace, for the test-pose
    criterion that of the tasks.
    """

    W: Array  #: Weight, symmetric, positive semi-definite, (r, r).

    def phi(self, M: Array) -> float:
        """Compute Phi(M) = 1 / tr(W M^-1), with the weight W of this criterion.

        Mathematics: `pose-5`.

        Args:
            M: Information matrix, (r, r) [1].

        Returns:
            Phi(M), in the inverse unit of W.
        """
        return float(1 / np.trace(np.linalg.solve(M, self.W)))

    def phi_with_candidate(self, M: Array, rows: Array) -> Array:
        """Compute Phi = 1 / tr(W M^-1) with one more candidate, by Woodbury's formula.

        Mathematics: `pose-7`.

        Args:
            M: Information matrix, (r, r) [1].
            rows: Whitened rows F of the candidates, (candidates, k, r).

        Returns:
            Phi(M + F^T F) of every candidate, (candidates,).
        """
        return candidate_gains(M, rows, self.W).phi_with_candidate()

    def tangent(self, M: Array) -> Tangent:
        """Compute the tangent plane of Phi = 1 / tr(W M^-1), Z = M^-1 W M^-1 / tr(W M^-1)^2.

        It bounds Phi, because a concave and homogeneous function is at most <gradient, M'>.

        Mathematics: `pose-9`.

        Args:
            M: Information matrix, (r, r) [1].
        """
        return _tangent(M, self.W)


@dataclass(frozen=True)
class LargestCriterion:
    """Implement the minimax criteria G and E: one over the largest of k costs tr(W_i M^-1).

    Where a gradient is needed, the power mean of the costs with the exponent p = `POWER_MEAN_EXPONENT`
    replaces their maximum. Its gradient is that of a mean of the costs with weights proportional to
    cost^(p - 1). A weighted mean is at most the maximum, so that its tangent plane bounds this criterion too.
    """

    #: Function of information matrices, (..., r, r), to their costs, (..., k).
    costs: Callable[[Array], Array]
    #: Function of M, (r, r), and weights of the costs with sum one, (k,), to the W of their mean, (r, r).
    weight_matrix: Callable[[Array, Array], Array]

    def phi(self, M: Array) -> float:
        """Compute Phi(M), one over the largest of the costs tr(W_i M^-1).

        Mathematics: `pose-6`.

        Args:
            M: Information matrix, (r, r) [1].

        Returns:
            Phi(M), in the inverse unit of the costs.
        """
        return float(1 / self.costs(M).max())

    def phi_with_candidate(self, M: Array, rows: Array) -> Array:
        """Compute Phi with one more candidate, for the best `MAX_EXACT_CANDIDATES` by the mean of the costs.

        Args:
            M: Information matrix, (r, r) [1].
            rows: Whitened rows F of the candidates, (candidates, k, r).

        Returns:
            Phi(M + F^T F) of these candidates, and 0 for all others, (candidates,).
        """
        values = np.zeros(len(rows))
        first = np.arange(len(rows))
        if len(rows) > MAX_EXACT_CANDIDATES:
            gain = candidate_gains(M, rows, self._weighted(M, self.costs(M))).cost_reductions()
            first = np.argpartition(-gain, MAX_EXACT_CANDIDATES)[:MAX_EXACT_CANDIDATES]
        few = rows[first]
        # exact costs of the best ones; all others keep 0
        values[first] = 1 / self.costs(M + few.swapaxes(1, 2) @ few).max(axis=-1)
        return values

    def tangent(self, M: Array) -> Tangent:
        """Compute a plane above Phi: the tangent plane of one over the weighted mean of the costs.

        Its height at M is one over the power mean of the costs, so that it need not touch Phi there.

        Args:
            M: Information matrix, (r, r) [1].
        """
        costs = self.costs(M)
        most = costs.max()
        height = 1 / (most * np.mean((costs / most) ** POWER_MEAN_EXPONENT) ** (1 / POWER_MEAN_EXPONENT))
        return Tangent(_tangent(M, self._weighted(M, costs)).Z, float(height))

    def _weighted(self, M: Array, costs: Array) -> Array:
        share = (costs / costs.max()) ** (POWER_MEAN_EXPONENT - 1)
        return self.weight_matrix(M, share / share.sum())


Criterion = DeterminantCriterion | LinearCriterion | LargestCriterion  #: An information function.


def check_criterion(name: str, *, for_absolute_readings: bool = False) -> None:
    """Check that the name of a criterion is one of `CRITERIA`.

    Args:
        name: Name of the criterion.
        for_absolute_readings: Whether readings are absolute positions; these have no tasks, so "test" is
            refused too.

    Raises:
        BenchError: When the name is unknown.
    """
    known = CRITERIA[: len(CRITERIA) - for_absolute_readings]
    if name not in known:
        what = " of absolute readings" if for_absolute_readings else ""
        raise BenchError(f"no criterion {name!r}{what}; criteria are {', '.join(known)}")


def criterion_by_name(
    name: str, problem: DesignProblem, workspace_rows: Array, task_rows: Array | None = None
) -> Criterion:
    """Build a criterion from its name.

    Args:
        name: One of `CRITERIA`.
        problem: Candidates, for the r directions of x that they can observe.
        workspace_rows: Predictions in the workspace per unit of x, (poses, 3 m, n) [m]; I and G use them.
        task_rows: Predictions per unit of x at the tasks, (tasks, 3 m, n) [m]; "test" uses them, or the
            workspace without.

    Returns:
        The criterion on information matrices (r, r).
    """
    if name == "D":
        return DeterminantCriterion()
    if name == "A":
        return LinearCriterion(np.eye(problem.n_directions) / problem.n_directions)
    if name == "E":
        return criterion_e()
    wanted = (workspace_rows if task_rows is None or name != "test" else task_rows) @ problem.lift
    return criterion_g(wanted) if name == "G" else LinearCriterion(mean_square_weight(wanted))


def criterion_e() -> LargestCriterion:
    """Build the E-criterion, the least eigenvalue of the information matrix M."""

    def costs(M: Array) -> Array:
        return np.asarray(1 / np.linalg.eigvalsh(M))

    def weight_matrix(M: Array, share: Array) -> Array:
        """Compute W of a weighted mean of the costs: eigenvectors of M with the weights as eigenvalues.

        Args:
            M: Information matrix, (r, r) [1].
            share: Weight of every cost, (r,) [1].

        Returns:
            V diag(share) V^T, (r, r).
        """
        V = np.linalg.eigh(M)[1]
        return np.asarray((V * share) @ V.T)

    return LargestCriterion(costs, weight_matrix)


def criterion_g(rows: Array) -> LargestCriterion:
    """Build the G-criterion: one over the largest mean square prediction error of a pose [1/m^2].

    Args:
        rows: Predicted deflections of m targets per unit of the coordinates a, (poses, 3 m, r) [m].

    Returns:
        The criterion on information matrices (r, r).
    """
    every = gram_matrices(rows / math.sqrt(_targets_per_pose(rows)))

    def costs(M: Array) -> Array:
        I = np.linalg.inv(M)  # noqa: E741 - as in the books
        return np.asarray(I.reshape(*I.shape[:-2], -1) @ every.T)

    return LargestCriterion(costs, lambda M, share: (share @ every).reshape(M.shape))


def mean_square_weight(rows: Array) -> Array:
    """Compute the weight W with which tr(W M^-1) is the mean square prediction error of a target [m^2].

    M is the information matrix of a plan, (r, r).

    Mathematics: `pose-5`.

    Args:
        rows: Predicted deflections of m targets per unit of the unknowns, (poses, 3 m, r) [m].

    Returns:
        W, (r, r) [m^2].
    """
    A = rows.reshape(-1, rows.shape[-1])
    return np.asarray(A.T @ A / (len(rows) * _targets_per_pose(rows)))


def _targets_per_pose(rows: Array) -> float:
    """Count the targets of a pose: each has three rows."""
    return float(rows.shape[1] / 3)


def gram_matrices(rows: Array) -> Array:
    """Compute F^T F of the rows F of every candidate, (candidates, k, r), flattened to (candidates, r^2)."""
    return np.asarray((rows.swapaxes(1, 2) @ rows).reshape(len(rows), -1))


@dataclass(frozen=True)
class CandidateGains:
    """Hold how much each candidate would reduce the cost tr(W M^-1) of a plan with information matrix M.

    The reduction is tr(K^-1 N) with K = 1 + F I F^T and N = F I W I F^T, where I = M^-1 and F are the
    candidate's whitened rows. If M changes by a few rows, `update_gains` updates I, K and N.
    """

    rows: Array  #: Whitened rows F of every candidate, (candidates, k, r).
    W: Array  #: Weight of the linear criterion, (r, r).
    I: Array  # noqa: E741 - as in the books; the inverse of M, (r, r)
    K: Array  #: 1 + F I F^T of every candidate, (k, k, candidates).
    N: Array  #: F I W I F^T of every candidate, (k, k, candidates).
    #: Bound of the relative accuracy of K after updates, over that at first [1]; 1 without updates.
    accuracy: float = 1.0

    def phi_with_candidate(self) -> Array:
        """Compute Phi = 1 / tr(W M^-1) with one more candidate, for every candidate, (candidates,)."""
        return np.asarray(1 / ((self.I * self.W).sum() - self.cost_reductions()))

    def cost_reductions(self) -> Array:
        """Compute the reduction tr(K^-1 N) of tr(W M^-1) by one more candidate, for each, (candidates,).

        All candidates are eliminated together, row by row: LAPACK, one by one, takes three times as long.
        """
        K, N = self.K, self.N
        # symmetric elimination: pivot by pivot, each leaves a smaller K and N
        reduction = N[0, 0] / K[0, 0]
        while len(K) > 1:
            factor = K[1:, 0] / K[0, 0]
            mixed = factor[:, None] * (N[1:, 0] - factor * (N[0, 0] / 2))
            K, N = K[1:, 1:] - factor[:, None] * K[0, 1:], N[1:, 1:] - mixed - mixed.swapaxes(0, 1)
            reduction = reduction + N[0, 0] / K[0, 0]
        return np.asarray(reduction)

    def largest_information(self) -> float:
        """Return the largest diagonal entry of K: 1 plus the information of a reading over that of M [1]."""
        return float(np.einsum("iip->ip", self.K).max())


def candidate_gains(M: Array, rows: Array, W: Array) -> CandidateGains:
    """Compute how much each candidate would reduce tr(W M^-1), from M.

    Args:
        M: Information matrix, (r, r) [1].
        rows: Whitened rows F of every candidate, (candidates, k, r).
        W: Weight of the linear criterion, (r, r).
    """
    (_, k, r), I = rows.shape, np.asarray(np.linalg.inv(M))  # noqa: E741
    both = np.hstack([I, I @ W @ I])
    blocks = [
        row_products(block, both).reshape(len(block), 2 * k, r) @ block.swapaxes(1, 2)
        for block in split_into_blocks(rows)
    ]
    products = np.ascontiguousarray(np.concatenate(blocks).transpose(1, 2, 0))
    return CandidateGains(rows, W, I, np.eye(k)[:, :, None] + products[0::2], products[1::2])


def gains_at_root(root: Array, rows: Array, W: Array) -> CandidateGains:
    """Compute gains in the coordinates b = R a, in which the information M = R^T R is the identity.

    Whitened rows F become G = F R^-1, and the weight W becomes R^-T W R^-1. Every candidate's rows are turned
    by the eigenvectors of G G^T, which changes no gain: strong rows no longer hide weak ones. So gains stay
    accurate if a reading has far more information than M.

    Mathematics: `pose-7`.

    Args:
        root: Upper triangular root R of M = R^T R, (r, r).
        rows: Whitened rows F of every candidate, (candidates, k, r).
        W: Weight of the linear criterion, (r, r).

    Returns:
        Gains of all candidates at M; their rows and W are in the coordinates b.
    """
    G = solve_triangular(root, rows.reshape(-1, len(root)).T, trans="T").T.reshape(rows.shape)
    turned = np.linalg.eigh(G @ G.swapaxes(1, 2))[1].swapaxes(1, 2) @ G
    half = solve_triangular(root, W, trans="T")
    # the strongest row first: the elimination starts with it
    return candidate_gains(np.eye(len(root)), turned[:, ::-1], solve_triangular(root, half.T, trans="T"))


def update_gains(gains: CandidateGains, M: Array, changed_rows: Array, signs: Array) -> CandidateGains:
    """Update the gains of all candidates after M gained or lost rows, by Woodbury's formula.

    The gain of a candidate with whitened rows F is the reduction of tr(W M^-1), by I = M^-1, K = 1 + F I F^T
    and N = F I W I F^T. With the changed rows f, their signs D, U = I f^T, V = I W U and S = D + f U, the new
    inverse is I - U S^-1 U^T. So K and N change by products of F U and F V, which are as narrow as f. If
    updates would lose too many digits, all is computed from M.

    Mathematics: `pose-7`.

    Args:
        gains: Gains of all candidates before the change of M.
        M: Information matrix after the change, (r, r) [1].
        changed_rows: Whitened rows f that M gains or loses, (k, r).
        signs: 1 for a row that M gains, -1 for one that it loses, (k,).

    Returns:
        Gains of all candidates at M.
    """
    U = gains.I @ changed_rows.T
    S = np.diag(signs) + changed_rows @ U
    # M grows or shrinks along k directions by the eigenvalues of D S: differences lose that many digits
    change = np.linalg.eigvals(signs[:, None] * S).real
    accuracy = gains.accuracy * float(min(change.min(), 1 / max(change.max(), 1.0)))
    if not accuracy > MIN_UPDATE_ACCURACY:
        return candidate_gains(M, gains.rows, gains.W)
    # T = (F U)^T and R = (F V)^T of every candidate, (k of f, k of F, candidates), and X = S^-1 T
    products = row_products(gains.rows, np.hstack([U, gains.I @ (gains.W @ U)]))
    T, R = np.split(np.ascontiguousarray(products.transpose(2, 1, 0)), 2)
    X = np.tensordot(np.linalg.inv(S), T, 1)
    # K - T^T X, and N - half - half^T where half = X^T (R - U^T W U X / 2)
    half = np.einsum("lip,ljp->ijp", X, R - np.tensordot(U.T @ gains.W @ U / 2, X, 1))
    return replace(
        gains,
        I=gains.I - U @ np.linalg.solve(S, U.T),
        K=gains.K - np.einsum("lip,ljp->ijp", X, T),
        N=gains.N - half - half.swapaxes(0, 1),
        accuracy=accuracy,
    )


def _tangent(M: Array, W: Array) -> Tangent:
    I = np.linalg.inv(M)  # noqa: E741 - used thrice
    value = float(1 / (I * W).sum())
    return Tangent(value**2 * (I @ W @ I), value, curvature=2.0)
