"""Interior-point methods over positive semi-definite blocks: one program of norms, or many of squares.

svec stacks the upper triangle of a symmetric matrix with off-diagonal entries times sqrt(2), so that
svec(A) . svec(B) = tr(A B). `solve_program` minimises a sum of norms, as in F_M of Eq. (19),

    minimise   sum_k |(R_k x - z_k, rest_k)| + c . x   over   x, svec of positive semi-definite blocks

or half the sum of their squares, with a barrier or without. It takes Mehrotra's predictor and corrector steps
along the direction of Nesterov and Todd (Todd, Toh and Tutuncu 1998), with two changes. The length of the
last step, not of the predicted one, determines the gap to aim at; with a barrier, each step is Newton's. The
norms are not treated as cones: away from zero they are smooth, and their tangent enters Newton's matrix. If
they change much from step to step, the residuals are weighted by the last norms instead (Weiszfeld), which
never overshoots.

`solve_batch` solves many similar least-squares problems with a trace term at once,

    minimise   |R_f x|^2 / 2 - g_f . x + l c . x   over   x, svec of positive semi-definite blocks

for every fold f of the readings and every weight l, by the same steps. Held-out errors distinguish weights to
a few per cent, so a hundredth of the cost is accurate enough, and no warm start is needed.

Its steps are taken in the scaled coordinates y of Nesterov and Todd, dx = K y with K = svec(G . G^T). There
Newton's matrix is 1 + S^T S with S = R K. Readings determine fewer directions than there are unknowns, so
Woodbury's identity solves it: y = u - S^T t, (1 + S S^T) t = S u. The step of the residuals is R dx = t.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.lapack import dpotrf, dpotrs

from testbench.errors import Array, Ids, Mask
from testbench.identify import cone

# --- One program of norms or squares ------------------------------------------------------------------------

MAX_ITERATIONS = 40  #: Most steps.
MIN_FIRST_GAP = 0.1
"""Least duality gap at the start, over the cost [1]."""
MIN_INITIAL_SIZE = 1e-3
"""Readings of the first x over the measured ones if the data fit best at x = 0 [1]."""
STOP_DISTANCE = 1e-11
"""Bound of the cost above its optimum at which the method ends, data of order one [1]."""
STOP_DISTANCE_OF_SQUARES = 1e-14
"""Bound of half the sum of squares above its optimum at which the method ends, data of order one [1]."""
ZERO_RESIDUAL = 1e-9
"""Norm of a residual below which it has no direction, so that no dual proves the optimum [1]."""
MIN_STEP_LENGTH = 1e-6
"""Length of a step, 1 for a full one, below which the method ends [1]."""
STALL_DISTANCE = 1e-7
"""Bound of the cost above its optimum below which a step that does not halve it is the last one."""
MAX_STEADY_CHANGE = 0.3  #: Relative change of the norms in a step below which their tangent is used [1].
MIN_TARGET_GAP_SHARE = 1e-6
"""Least ratio of the duality gap that a step aims at to the present one [1]."""
MIN_BOUNDARY_SHARE = 0.9
"""Least share of the distance to the boundary of the cone that a step takes [1]."""
SINGULAR_PIVOT = 3e-6
"""Least pivot of a matrix over its largest [1]: the root of the rounding of a Cholesky factorisation."""
TRACE_ROUNDING = 1e-12
"""Share of a trace by which an eigenvalue may be negative [1]."""
SMALLEST_DIVISOR = 1e-300  #: Number that replaces zero as a divisor.


@dataclass(frozen=True)
class BlockProgram:
    """Hold a program of norms or squares of residuals over positive semi-definite blocks, data of order one.

    The unknown x stacks the svec of all blocks. The K residuals are r_k = (R_k x - z_k, unexplained_k).
    """

    R: Array  #: Matrices R_k of the residuals, (K, rows, n).
    z: Array  #: Right-hand sides z_k of the residuals, (K, rows).
    unexplained: Array  #: Component of every residual that does not depend on x, (K,).
    linear_cost: Array  #: Cost c per unit of x, (n,).
    block_orders: tuple[int, ...]  #: Number of rows of every block.
    sum_of_squares: bool = False  #: Whether the cost has half the squares of the norms in place of the norms.
    barrier_weight: float = 0.0  #: Weight of the barrier -log det of every block.

    @cached_property
    def gram(self) -> Array:
        """Compute the Gram matrix R_k^T R_k of every residual R_k x - z_k, (K, n, n)."""
        return np.asarray(self.R.swapaxes(1, 2) @ self.R)

    def residual_weights(self, norms: Array) -> Array:
        """Compute the weight of every residual r_k in the gradient: 1 / |r_k|, or 1 for squares.

        Args:
            norms: Norms |r_k| of the residuals, (K,).

        Returns:
            Weights, (K,).
        """
        return np.ones_like(norms) if self.sum_of_squares else 1 / np.maximum(norms, SMALLEST_DIVISOR)

    def misfit(self, norms: Array) -> float:
        """Compute the misfit: the sum of the residuals' norms, or half the sum of their squares.

        Args:
            norms: Norms |r_k| of the residuals, (K,).

        Returns:
            The misfit [1].
        """
        return float((norms**2 / 2 if self.sum_of_squares else norms).sum())

    def cost(self, x: Array, norms: Array) -> float:
        """Compute the cost of x: misfit, linear term and barrier.

        Args:
            x: svec of all blocks, (n,).
            norms: Norms |r_k| of the residuals at x, (K,).

        Returns:
            The cost [1].
        """
        cost = self.misfit(norms) + float(x @ self.linear_cost)
        if self.barrier_weight:
            blocks = (cone.smat(x[at]) for at in cone.svec_indices_by_order(self.block_orders))
            cost -= self.barrier_weight * sum(float(np.linalg.slogdet(X)[1].sum()) for X in blocks)
        return cost

    def norms_and_gradients(self, x: Array) -> tuple[Array, Array]:
        """Compute the norm of every residual r_k at x, and the gradient of its term of the misfit.

        Args:
            x: svec of all blocks, (n,).

        Returns:
            Norms |r_k|, (K,), and gradients of the terms with respect to x, (K, n).
        """
        left = self.R @ x - self.z
        norms = np.sqrt((left**2).sum(axis=1) + self.unexplained**2)
        return norms, np.vecmat(left, self.R) * self.residual_weights(norms)[:, None]


@dataclass(frozen=True)
class Iterate:
    """Hold one iterate of the interior-point method: x, multipliers s of its blocks, norms and gradients."""

    x: Array  #: svec of the blocks, positive definite, (n,).
    multipliers: Array  #: svec of the multipliers s of the blocks, positive definite, (n,).
    norms: Array  #: Norms |r_k| of the residuals, (K,).
    gradients: Array  #: Gradients of the residuals' terms of the misfit, (K, n).
    dual_residual: Array  #: Gradient of misfit and linear cost minus the multipliers, (n,).
    step_length: float = 0.5  #: Length of the last step, 1 for a full one.
    #: Whether the norms change little from step to step, so that their tangent is accurate.
    norms_are_steady: bool = False

    def distance_from_optimum(self, program: BlockProgram) -> float:
        """Bound the distance of the cost from its optimum by the duality gap x . s plus |x| |gradient - s|.

        x are the unknowns of this iterate and s the multipliers of its blocks.

        With a barrier, the distance of the products X S from the barrier's weight replaces the gap.

        Args:
            program: The program to which x is an approximate solution.

        Returns:
            The bound [1].
        """
        gap = float(self.x @ self.multipliers)
        if program.barrier_weight:
            groups = cone.svec_indices_by_order(program.block_orders)
            products = (cone.smat(self.x[at]) @ cone.smat(self.multipliers[at]) for at in groups)
            gap = sum(
                float(np.linalg.norm(XS - program.barrier_weight * np.eye(len(XS[0])))) for XS in products
            )
        return gap + float(np.linalg.norm(self.x) * np.linalg.norm(self.dual_residual))


def least_squares_on_cone(M: Array, r: Array, block_orders: tuple[int, ...] = ()) -> tuple[Array, float]:
    """Minimise |M x - r|^2 / 2 over x, the svec of positive semi-definite blocks.

    Mathematics: `est-15`.

    Args:
        M: Matrix, (rows, n), of rank n.
        r: Right-hand side, (rows,).
        block_orders: Number of rows of every block; () for no constraint on x.

    Returns:
        x, (n,), and an upper bound of its cost above the least one: |x . s| + F H^-1 F / 2 for any s in the
        cone, with F the gradient minus s and H = M^T M. The bound is infinite where nothing is proven.
    """
    H, n = M.T @ M, M.shape[1]
    try:
        root = cho_factor(H, lower=True)
    except np.linalg.LinAlgError:
        return np.zeros(n), np.inf
    pivots = np.diag(root[0])
    if pivots.min() <= SINGULAR_PIVOT * pivots.max():
        return np.zeros(n), np.inf
    x, s = np.zeros(n), np.zeros(n)
    for _ in range(2):  # the second step removes the rounding of the first
        x -= cho_solve(root, M.T @ (M @ x - r))
    if not is_semidefinite(x, block_orders, 0.0):
        unit = max(float(np.linalg.norm(r)), SMALLEST_DIVISOR)
        R = np.asarray(np.linalg.qr(np.c_[M, r] / unit, mode="r"))[:n]
        iterate = solve_program(
            BlockProgram(
                R[None, :, :n], R[None, :, n], np.zeros(1), np.zeros(n), block_orders, sum_of_squares=True
            )
        )
        x, s = iterate.x, unit**2 * iterate.multipliers
        if not (
            is_semidefinite(x, block_orders, TRACE_ROUNDING)
            and is_semidefinite(s, block_orders, TRACE_ROUNDING)
        ):
            return x, np.inf
    F = M.T @ (M @ x - r) - s
    return x, float(abs(x @ s) + abs(F @ cho_solve(root, F)) / 2)


def is_semidefinite(x: Array, block_orders: tuple[int, ...], tolerance: float) -> bool:
    """Tell whether all blocks are positive semi-definite, up to a share of their traces.

    Args:
        x: svec of all blocks, (n,).
        block_orders: Number of rows of every block.
        tolerance: Share of a block's trace by which its eigenvalues may be negative [1].
    """
    if not np.isfinite(x).all():
        return False
    X = [cone.smat(x[at]) for at in cone.svec_indices_by_order(block_orders)]
    return all((np.linalg.eigvalsh(B)[:, 0] >= -tolerance * np.trace(B, axis1=1, axis2=2)).all() for B in X)


def solve_program(program: BlockProgram) -> Iterate:
    """Minimise a program of norms or squares by an interior-point method, as far as rounding allows.

    Mathematics: `est-11`.

    Args:
        program: The program.

    Returns:
        The best iterate; its distance from the optimum is for the caller to prove.
    """
    state = _initial_iterate(program)
    iterate, best = state, program.cost(state.x, state.norms)
    near, least = (
        (STOP_DISTANCE_OF_SQUARES, 0.0) if program.sum_of_squares else (STOP_DISTANCE, ZERO_RESIDUAL)
    )
    with np.errstate(all="ignore"):  # a step that is not finite is not taken
        for _ in range(MAX_ITERATIONS):
            before = state.distance_from_optimum(program)
            try:
                state = _step(program, state)
            except (np.linalg.LinAlgError, ValueError):  # a pair lost its last digits, or is not finite
                break
            cost = program.cost(state.x, state.norms)
            if cost <= best + near:  # near no residual at all rounding makes steps wild
                iterate, best = state, min(best, cost)
            left = state.distance_from_optimum(program)
            if not (left > near and state.norms.min() > least and state.step_length >= MIN_STEP_LENGTH):
                break
            if left < STALL_DISTANCE and left > before / 2:
                break
    return iterate


def _initial_iterate(program: BlockProgram) -> Iterate:
    """Start with equal blocks that fit the data best, and multipliers of the gradient's size."""
    identity = np.concatenate([cone.svec(np.eye(size)) for size in program.block_orders])
    moved = program.R @ identity
    square = max(float((moved**2).sum()), SMALLEST_DIVISOR)
    size = max(
        np.vdot(moved, program.z) / square, MIN_INITIAL_SIZE * float(np.linalg.norm(program.z)) / square**0.5
    )
    norms, pulls = program.norms_and_gradients(size * identity)
    gradient = pulls.sum(axis=0) + program.linear_cost
    matrices = (cone.smat(gradient[at]) for at in cone.svec_indices_by_order(program.block_orders))
    large = max(float(np.abs(np.linalg.eigvalsh(X)).max()) for X in matrices)
    s = max(MIN_FIRST_GAP * program.misfit(norms) / sum(program.block_orders) / size, large) * identity
    return Iterate(size * identity, s, norms, pulls, gradient - s)


def _step(program: BlockProgram, state: Iterate) -> Iterate:
    """Take one step: predicted to first order, then corrected to second order.

    Newton's system is (hessian + E) dx = w - missing, E dx + ds = w.

    Raises:
        LinAlgError, ValueError: If the system has no solution.
    """
    x = state.x
    s = state.multipliers
    missing = state.dual_residual
    share = program.residual_weights(state.norms)
    # Hessian of the norms: Weiszfeld's majorant, minus the tangent term where the norms are steady.
    hessian = (
        np.tensordot(share, program.gram, 1)
        - state.norms_are_steady * (state.gradients.T * share) @ state.gradients
    )
    # E, the scaling of Nesterov and Todd, block by block.
    scalings = [
        NesterovToddScaling.of_pairs(at, x, s) for at in cone.svec_indices_by_order(program.block_orders)
    ]
    A = hessian.copy()
    for scaling in scalings:
        A[scaling.indices[:, :, None], scaling.indices[:, None]] += cone.congruence_map(
            scaling.inverse.swapaxes(1, 2) @ scaling.inverse
        )
    root = cho_factor(A, lower=True)
    w = np.empty_like(x)
    sums = []
    # Predictor: the affine step to the optimum; a barrier needs none.
    predicted = cho_solve(root, -s - missing) * (not program.barrier_weight)
    # Gap to aim at, from the length of the last step.
    aim = max(
        program.barrier_weight,
        max((1 - state.step_length) ** 2, MIN_TARGET_GAP_SHARE) * float(x @ s) / sum(program.block_orders),
    )
    for scaling in scalings:
        sums.append(scaling.corrected_step_sum(aim, scaling.scale_step(predicted)))
        w[scaling.indices] = cone.svec(scaling.inverse.swapaxes(1, 2) @ sums[-1] @ scaling.inverse)
    # Corrector: the step with the second-order term of the predicted one.
    dx = cho_solve(root, w - missing)
    # Stay inside the cone: a share MIN_BOUNDARY_SHARE to 0.99 of the way to its boundary.
    pairs = zip(scalings, sums, strict=True)
    step = min(1.0, *(float(scaling.longest_step(scaling.scale_step(dx), total)) for scaling, total in pairs))
    step *= MIN_BOUNDARY_SHARE + (0.99 - MIN_BOUNDARY_SHARE) * step
    x, s = x + step * dx, s + step * (missing + hessian @ dx)
    norms, pulls = program.norms_and_gradients(x)
    steady = not program.sum_of_squares and np.abs(norms * share - 1).max() < MAX_STEADY_CHANGE
    return Iterate(
        x, s, norms, pulls, pulls.sum(axis=0) + program.linear_cost - s, step, norms_are_steady=bool(steady)
    )


@dataclass(frozen=True)
class NesterovToddScaling:
    """Hold the Nesterov-Todd scaling G of pairs of matrices X, S: G^-1 X G^-T = G^T S G = diag d.

    The pairs are the m x m blocks of a program, X, and their multipliers S; of many programs at once (...).
    """

    indices: Ids  #: Indices of the entries of every block in x, (blocks, entries).
    L: Array  #: Cholesky factor of X, (..., blocks, m, m).
    V: Array  #: Eigenvectors of L^T S L, (..., blocks, m, m).
    d: Array  #: Square roots of the eigenvalues of L^T S L, (..., blocks, m).

    @classmethod
    def of_pairs(cls, indices: Ids, x: Array, multipliers: Array) -> "NesterovToddScaling":
        """Compute the scaling G of blocks X and their multipliers S: G^-1 X G^-T = G^T S G = diag d.

        Mathematics: `est-10`.

        Args:
            indices: Indices of the entries of every block in x, (blocks, entries).
            x: svec of the blocks X, (..., n).
            multipliers: svec of the multipliers S, (..., n).

        Returns:
            The scaling of the blocks at `indices`.

        Raises:
            LinAlgError: If a block is not positive definite.
        """
        L: Array = np.asarray(np.linalg.cholesky(cone.smat(x[..., indices])))
        squares, V = np.linalg.eigh(L.swapaxes(-1, -2) @ cone.smat(multipliers[..., indices]) @ L)
        return cls(indices, L, V, np.sqrt(np.maximum(squares, SMALLEST_DIVISOR)))

    @cached_property
    def G(self) -> Array:
        """Compute the Nesterov-Todd scaling matrices G of all blocks, (..., blocks, m, m)."""
        return np.asarray(self.L @ self.V / np.sqrt(self.d)[..., None, :])

    @cached_property
    def inverse(self) -> Array:
        """Compute the inverses of the Nesterov-Todd scaling matrices G, (..., blocks, m, m)."""
        return np.asarray(np.sqrt(self.d)[..., None] * (self.V.swapaxes(-1, -2) @ np.linalg.inv(self.L)))

    def scale_step(self, step: Array) -> Array:
        """Scale a step of the blocks X: compute G^-1 dX G^-T with the scaling matrices G.

        Args:
            step: Step dx, svec of the blocks dX, (..., n).

        Returns:
            Scaled step, (..., blocks, m, m).
        """
        return np.asarray(self.inverse @ cone.smat(step[..., self.indices]) @ self.inverse.swapaxes(-1, -2))

    def corrected_step_sum(self, target_product: float | Array, scaled_step: Array) -> Array:
        """Compute the scaled step of the blocks X plus that of their multipliers S, for X S = target_product.

        The sum includes the second-order term of the predicted step (Mehrotra's corrector).

        Args:
            target_product: Factor of the identity to which the products X S should tend, (...).
            scaled_step: Predicted step of the blocks X, scaled, (..., blocks, m, m).

        Returns:
            Sum of the scaled steps, (..., blocks, m, m).
        """
        identity = np.eye(self.d.shape[-1])
        half = scaled_step @ (self.d[..., None] * identity + scaled_step)
        product = (half + half.swapaxes(-1, -2)) / (self.d[..., :, None] + self.d[..., None, :])
        return np.asarray((target_product / self.d - self.d)[..., None] * identity + product)

    def longest_step(self, scaled_step: Array, step_sum: Array) -> Array:
        """Compute the longest step that keeps the blocks and their multipliers positive semi-definite.

        Args:
            scaled_step: Step of the blocks, scaled, (..., blocks, m, m).
            step_sum: Sum of the scaled steps of blocks and multipliers, (..., blocks, m, m).

        Returns:
            Largest factor on both steps, (...) [1].
        """
        root = 1 / np.sqrt(self.d)
        steps = np.stack([scaled_step, step_sum - scaled_step]) * (root[..., :, None] * root[..., None, :])
        least = np.linalg.eigvalsh(steps)[..., 0].min(axis=(0, -1))
        return np.asarray(1 / np.maximum(-least, SMALLEST_DIVISOR))


# --- Least squares with a trace term: many similar problems at once -----------------------------------------

BATCH_GAP_TOLERANCE = 1e-2
"""Bound of the cost above its optimum, over the cost, at which a problem of a batch is solved [1]."""
MAX_BATCH_STEPS = 30  #: Most steps.


@dataclass(frozen=True)
class BatchedProblems:
    """Hold least-squares problems A x = y, one per fold of a cross-validation, data of order one.

    The unknown x stacks the svec of positive semi-definite blocks.
    """

    R: Array  #: Root of the Gram matrix of every fold, A^T A = R^T R, (folds, rank, n).
    g: Array  #: A^T y of every fold, (folds, n).
    half_squares: Array  #: Half the sum of squares of the readings y of every fold, (folds,).
    trace_cost: Array  #: Trace term per unit of x, (n,).
    block_orders: tuple[int, ...]  #: Number of rows of every block.


@dataclass(frozen=True)
class _State:
    """Hold the problems that are not solved yet."""

    at: Ids  #: Their places among all problems, (problems,).
    R: Array  #: Root of the Gram matrix, (problems, rank, n).
    linear: Array  #: Gradient at x = 0, (problems, n).
    half_squares: Array  #: Cost at x = 0, (problems,).
    x: Array  #: svec of the blocks, (problems, n).
    s: Array  #: Multipliers, (problems, n).
    gradient: Array  #: Gradient of the cost, (problems, n).
    step: Array  #: Length of the last step, 1 for a full one, (problems,).

    def select(self, mask: Mask) -> "_State":
        """Return the state of some of the problems only.

        Args:
            mask: True for each problem to keep, (problems,).
        """
        return self if mask.all() else _State(*(values[mask] for values in vars(self).values()))


def solve_batch(problems: BatchedProblems, trace_weights: Array) -> tuple[Array, Array]:
    """Minimise |R_f x|^2 / 2 - g_f . x + weight c . x for every fold f and every weight of the trace term.

    R_f and g_f are root and right-hand side of the fold's normal equations, and c . x is the trace.

    Args:
        problems: One least-squares problem per fold.
        trace_weights: Weights of the trace term, (weights,) [1].

    Returns:
        Solutions x and multipliers of their blocks, (folds, weights, n) each; NaN where none was found.
    """
    groups, shape = (
        cone.svec_indices_by_order(problems.block_orders),
        (len(problems.g), len(trace_weights), len(problems.trace_cost)),
    )
    solutions = np.full((2, shape[0] * shape[1], shape[2]), np.nan)
    with np.errstate(all="ignore"):  # a problem that is not finite is given up
        state = _start_problems(problems, trace_weights, groups)
        for _ in range(MAX_BATCH_STEPS):
            cost = np.vecdot(state.x, state.gradient + state.linear) / 2 + state.half_squares
            missing = np.linalg.norm(state.gradient - state.s, axis=1)
            left = np.vecdot(state.x, state.s) + np.linalg.norm(state.x, axis=1) * missing
            done = left <= BATCH_GAP_TOLERANCE * cost
            solutions[:, state.at[done]] = state.x[done], state.s[done]
            state = state.select(~done)
            if not len(state.at):
                break
            try:
                state = _batch_step(state, _Newton.of_problems(state.R, state.x, state.s, groups))
            except np.linalg.LinAlgError:
                sound = _definite(state.x, groups) & _definite(state.s, groups)
                if sound.all() or not sound.any():
                    break
                state = state.select(sound)
                continue
            state = state.select(np.asarray(np.isfinite(np.hstack([state.x, state.s])).all(axis=1)))
    x, s = solutions.reshape(2, *shape)
    return x, s


def effective_parameters(problems: BatchedProblems, x: Array, multipliers: Array) -> Array:
    """Compute the effective number of parameters of each solution of a batch.

    It is the trace of the derivative of the predicted readings with respect to the measured ones.

    Args:
        problems: One least-squares problem per fold.
        x: Solutions, (folds, weights, n); NaN where there is none.
        multipliers: Multipliers of the blocks of x, (folds, weights, n).

    Returns:
        Effective numbers of parameters, (folds, weights) [1]; NaN where there is no solution.
    """
    solved: Mask = np.asarray(np.isfinite(x).all(axis=2))
    fold, groups = np.nonzero(solved)[0], cone.svec_indices_by_order(problems.block_orders)
    inner = _Newton.of_problems(problems.R[fold], x[solved], multipliers[solved], groups).inner
    numbers = np.full(solved.shape, np.nan)
    numbers[solved] = inner.shape[-1] - np.trace(np.linalg.inv(inner), axis1=1, axis2=2)
    return numbers


def _definite(x: Array, groups: list[Ids]) -> Mask:
    """Tell whether all blocks are positive definite, (problems,)."""
    least = [np.linalg.eigvalsh(cone.smat(x[:, at]))[..., 0].min(axis=1) for at in groups]
    return np.asarray(np.min(least, axis=0) > 0)


def _batch_step(state: _State, newton: "_Newton") -> _State:
    """Take one step: predicted to first order, then corrected to second order."""
    missing = state.gradient - state.s
    x, s = state.x, state.s
    order = sum(scaling.d.shape[1] * scaling.d.shape[2] for scaling in newton.scalings)
    aim = np.maximum((1 - state.step) ** 2, MIN_TARGET_GAP_SHARE) * np.vecdot(x, s) / order
    scaled = newton.scale_gradient(missing)
    wanted = np.empty_like(x)
    sums = []
    for scaling in newton.scalings:  # s is diag d there
        wanted[:, scaling.indices] = cone.svec(scaling.d[..., None] * np.eye(scaling.d.shape[-1]))
    predicted, _ = newton.solve(-wanted - scaled)
    for scaling in newton.scalings:
        total = scaling.corrected_step_sum(aim[:, None, None], cone.smat(predicted[:, scaling.indices]))
        sums.append(np.nan_to_num(total))
        wanted[:, scaling.indices] = cone.svec(sums[-1])
    y, moved = newton.solve(wanted - scaled)
    step = np.ones(len(x))
    for scaling, total in zip(newton.scalings, sums, strict=True):
        step = np.minimum(step, scaling.longest_step(np.nan_to_num(cone.smat(y[:, scaling.indices])), total))
    step *= MIN_BOUNDARY_SHARE + (0.99 - MIN_BOUNDARY_SHARE) * step
    turned = step[:, None] * np.vecmat(moved, state.R)  # what the step changes of the gradient
    return replace(
        state,
        x=x + step[:, None] * newton.unscale_step(y),
        s=s + step[:, None] * missing + turned,
        gradient=state.gradient + turned,
        step=step,
    )


def _start_problems(problems: BatchedProblems, weights: Array, groups: list[Ids]) -> _State:
    """Start with equal blocks that fit the readings best, and multipliers of the gradient's size."""
    fold = np.repeat(np.arange(len(problems.g)), len(weights))
    linear = np.tile(weights, len(problems.g))[:, None] * problems.trace_cost - problems.g[fold]
    identity = np.concatenate([cone.svec(np.eye(size)) for size in problems.block_orders])
    moved = np.vecmat(problems.R @ identity, problems.R)
    square = np.maximum(moved @ identity, SMALLEST_DIVISOR)
    size = np.maximum(
        problems.g @ identity / square, MIN_INITIAL_SIZE * np.sqrt(2 * problems.half_squares / square)
    )[fold]
    gradient = size[:, None] * moved[fold] + linear
    fit = size**2 * square[fold] / 2 - size * (problems.g @ identity)[fold] + problems.half_squares[fold]
    large = [np.abs(np.linalg.eigvalsh(cone.smat(gradient[:, at]))).max(axis=(1, 2)) for at in groups]
    s = np.maximum(MIN_FIRST_GAP * fit / sum(problems.block_orders) / size, np.max(large, axis=0))
    return _State(
        at=np.arange(len(fold)),
        R=problems.R[fold],
        linear=linear,
        half_squares=problems.half_squares[fold],
        x=size[:, None] * identity,
        s=s[:, None] * identity,
        gradient=gradient,
        step=np.full(len(fold), 0.5),
    )


@dataclass(frozen=True)
class _Newton:
    """Hold the matrices of Newton's equations (1 + S^T S) y = u in scaled coordinates, with S = R K."""

    scalings: list[NesterovToddScaling]  #: Scalings G of the blocks of each order.
    #: Maps K of svec(Y) to svec(G Y G^T) for the blocks of each order, (problems, blocks, t, t) each.
    K: list[Array]
    S: Array  #: R K of every problem, (problems, rank, n).
    inner: Array  #: 1 + S S^T of every problem, (problems, rank, rank).

    @cached_property
    def roots(self) -> list[Array]:
        """Compute the Cholesky factor of every problem's matrix `inner`, 1 + S S^T, (rank, rank) each."""
        return [dpotrf(matrix, lower=1)[0] for matrix in self.inner]

    @classmethod
    def of_problems(cls, R: Array, x: Array, multipliers: Array, groups: list[Ids]) -> "_Newton":
        """Compute the matrices of a Newton step of many problems.

        Args:
            R: Root of the Gram matrix of every problem, (problems, rank, n).
            x: svec of positive definite blocks, (problems, n).
            multipliers: svec of the multipliers of the blocks, positive definite, (problems, n).
            groups: For each order of blocks the indices of their entries in x, (blocks, entries) each.
        """
        scalings = [NesterovToddScaling.of_pairs(at, x, multipliers) for at in groups]
        K, S = [cone.congruence_map(scaling.G) for scaling in scalings], np.empty_like(R)
        for scaling, maps in zip(scalings, K, strict=True):
            if maps.shape[-1] == 1:
                S[:, :, scaling.indices[:, 0]] = R[:, :, scaling.indices[:, 0]] * maps[:, None, :, 0, 0]
                continue
            for k, places in enumerate(scaling.indices):
                columns = slice(places[0], places[-1] + 1)
                np.matmul(R[:, :, columns], maps[:, k], out=S[:, :, columns])
        return cls(scalings, K, S, S @ S.swapaxes(1, 2) + np.eye(R.shape[1]))

    def scale_gradient(self, gradient: Array) -> Array:
        """Scale gradients V: compute svec(G^T V G) from svec(V), with the scaling matrices G.

        Args:
            gradient: Gradients svec(V) with respect to x, (problems, n).

        Returns:
            Scaled gradients, (problems, n).
        """
        scaled = np.empty_like(gradient)
        for scaling, maps in zip(self.scalings, self.K, strict=True):
            scaled[:, scaling.indices] = np.vecmat(gradient[:, scaling.indices], maps)
        return scaled

    def unscale_step(self, scaled_step: Array) -> Array:
        """Convert scaled steps Y to steps of x: compute svec(G Y G^T), with the scaling matrices G.

        Args:
            scaled_step: Scaled steps svec(Y), (problems, n).

        Returns:
            Steps of x, (problems, n).
        """
        step = np.empty_like(scaled_step)
        for scaling, maps in zip(self.scalings, self.K, strict=True):
            step[:, scaling.indices] = np.matvec(maps, scaled_step[:, scaling.indices])
        return step

    def solve(self, right_side: Array) -> tuple[Array, Array]:
        """Solve Newton's equations (1 + S^T S) y = u of all problems.

        S is the matrix of each problem's residuals R x in scaled coordinates.

        Args:
            right_side: Right-hand sides u in scaled coordinates, (problems, n).

        Returns:
            Scaled steps y, (problems, n), and steps of the residuals R dx, (problems, rank).
        """
        products = np.matvec(self.S, right_side)
        t = np.array([dpotrs(L, row, lower=1)[0] for L, row in zip(self.roots, products, strict=True)])
        return right_side - np.vecmat(t, self.S), t
