"""Least squares with a trace term over positive semi-definite blocks: many similar problems at once.

    minimise   |R_f x|^2 / 2 - g_f . x + l c . x   over   x, svec of positive semi-definite blocks

for every fold f of the readings and every weight l. The step is that of `interior`: Mehrotra's predictor and
corrector along the direction of Nesterov and Todd. Held-out errors distinguish weights at a precision of per
cents, so a hundredth of the cost is accurate enough, and so few steps need no warm start. Readings determine
fewer directions than there are unknowns: Newton's matrix R^T R + E, E of blocks, is inverted by Woodbury's
identity.
"""

from dataclasses import dataclass

import numpy as np

from testbench.errors import Array, Ids, Mask
from testbench.identify import cone
from testbench.identify.interior import INITIAL_SIZE, MIN_AIM, MIN_BOUNDARY_SHARE, TINY, Scaling

COST_TOLERANCE = 1e-2
"""Distance from the optimum at which a problem is solved, as a share of its cost [1]."""
STEPS = 30
"""Most steps."""
FIRST = 0.1
"""Duality gap at the start, as a share of the cost [1]."""


@dataclass(frozen=True)
class Problems:
    """Hold folds of readings, in units in which x and the readings are of order one."""

    R: Array  #: Root of the Gram matrix of every fold, (folds, rank, n).
    g: Array  #: (folds, n).
    half: Array  #: Half the squares of the readings, (folds,).
    c: Array  #: Cost per unit of x, (n,).
    sizes: tuple[int, ...]  #: Orders of the blocks.


@dataclass(frozen=True)
class _State:
    """Hold the problems that are not solved yet."""

    at: Ids  #: Their places among all problems, (problems,).
    x: Array  #: (problems, n).
    s: Array  #: Multipliers, (problems, n).
    step: Array  #: Length of the last step, 1 for a full one, (problems,).

    def only(self, some: Mask) -> "_State":
        """Select some of the problems.

        Args:
            some: Which problems, (problems,).

        Returns:
            Their state.
        """
        return _State(*(own[some] for own in vars(self).values()))


def solve(problems: Problems, weights: Array) -> tuple[Array, Array]:
    """Solve all folds with all weights.

    Args:
        problems: The folds.
        weights: Of the trace term, (weights,).

    Returns:
        x, (folds, weights, n), NaN where none was found; and the effective number of parameters, the trace
        of what maps readings to predictions, (folds, weights).
    """
    folds, many = len(problems.g), len(weights)
    fold, price = np.repeat(np.arange(folds), many), np.tile(weights, folds)[:, None] * problems.c
    groups = cone.groups_of(problems.sizes)
    found, freedom = np.full(price.shape, np.nan), np.full(len(price), np.nan)
    with np.errstate(all="ignore"):  # a problem that is not finite is given up
        state = _start(problems, fold, price, groups)
        for _ in range(STEPS):
            R, linear = problems.R[fold[state.at]], price[state.at] - problems.g[fold[state.at]]
            gradient = np.vecmat(np.matvec(R, state.x), R) + linear
            try:
                scalings = [Scaling.of(own, state.x, state.s) for own in groups]
                newton = _Newton.of(R, groups, scalings)
            except np.linalg.LinAlgError:
                sound = _definite(state.x, groups) & _definite(state.s, groups)
                if sound.all() or not sound.any():
                    break
                state = state.only(sound)
                continue
            cost = np.vecdot(state.x, gradient + linear) / 2 + problems.half[fold[state.at]]
            missing = gradient - state.s
            left = np.linalg.norm(state.x, axis=1) * np.linalg.norm(missing, axis=1)
            done = np.vecdot(state.x, state.s) + left <= COST_TOLERANCE * cost
            found[state.at[done]] = state.x[done]
            freedom[state.at[done]] = R.shape[1] - np.trace(newton.inner[done], axis1=1, axis2=2)
            try:
                state = _moved(state, missing, newton, scalings).only(~done)
            except np.linalg.LinAlgError:  # a step is not finite
                break
            state = state.only(np.asarray(np.isfinite(np.hstack([state.x, state.s])).all(axis=1)))
            if not len(state.at):
                break
    return found.reshape(folds, many, -1), freedom.reshape(folds, many)


def _definite(x: Array, groups: list[Ids]) -> Mask:
    """Tell whether all blocks are positive definite, (problems,)."""
    least = [np.linalg.eigvalsh(cone.smat(x[:, at]))[..., 0].min(axis=1) for at in groups]
    return np.asarray(np.min(least, axis=0) > 0)


def _moved(state: _State, missing: Array, newton: "_Newton", scalings: list[Scaling]) -> _State:
    """Take one step: predicted to first order, then corrected to second order."""
    x, s, order = state.x, state.s, sum(one.d.shape[1] * one.d.shape[2] for one in scalings)
    aim = np.maximum((1 - state.step) ** 2, MIN_AIM) * np.vecdot(x, s) / order
    predicted, w, sums = newton.solve(-s - missing), np.empty_like(x), []
    for (own, _), scaling in zip(newton.D, scalings, strict=True):
        sums.append(np.nan_to_num(scaling.corrected(aim[:, None, None], scaling.scaled(predicted))))
        w[:, own] = cone.svec(scaling.inverse.swapaxes(-1, -2) @ sums[-1] @ scaling.inverse)
    dx = newton.solve(w - missing)
    step = np.ones(len(x))
    for scaling, both in zip(scalings, sums, strict=True):
        step = np.minimum(step, scaling.longest(np.nan_to_num(scaling.scaled(dx)), both))
    step *= MIN_BOUNDARY_SHARE + (0.99 - MIN_BOUNDARY_SHARE) * step
    ds = missing + np.vecmat(np.matvec(newton.R, dx), newton.R)
    return _State(state.at, x + step[:, None] * dx, s + step[:, None] * ds, step)


def _start(problems: Problems, fold: Ids, price: Array, groups: list[Ids]) -> _State:
    """Start with equal blocks that fit the readings best, and multipliers of the gradient's size."""
    one = np.concatenate([cone.svec(np.eye(size)) for size in problems.sizes])
    moved = np.vecmat(problems.R @ one, problems.R)
    square = np.maximum(moved @ one, TINY)
    size = np.maximum(problems.g @ one / square, INITIAL_SIZE * np.sqrt(2 * problems.half / square))[fold]
    gradient = size[:, None] * moved[fold] - problems.g[fold] + price
    fit = size**2 * square[fold] / 2 - size * (problems.g @ one)[fold] + problems.half[fold]
    large = [np.abs(np.linalg.eigvalsh(cone.smat(gradient[:, at]))).max(axis=(1, 2)) for at in groups]
    s = np.maximum(FIRST * fit / sum(problems.sizes) / size, np.max(large, axis=0))
    return _State(np.arange(len(fold)), size[:, None] * one, s[:, None] * one, np.full(len(fold), 0.5))


@dataclass(frozen=True)
class _Newton:
    """Apply (R^T R + E)^-1 = D - D R^T (R D R^T + 1)^-1 R D, with D = E^-1 block by block."""

    R: Array  #: (problems, rank, n).
    RD: Array  #: (problems, rank, n).
    inner: Array  #: (R D R^T + 1)^-1, (problems, rank, rank).
    D: list[tuple[Ids, Array]]  #: Places of the blocks of one order, and their part of D.

    @classmethod
    def of(cls, R: Array, groups: list[Ids], scalings: list[Scaling]) -> "_Newton":
        """Compute the matrices of a Newton step of many problems.

        Args:
            R: Rows of every problem, (problems, rows, n).
            groups: Places of the blocks of each order, (blocks, entries) per order.
            scalings: Nesterov-Todd scalings of these blocks.

        Returns:
            The matrices.
        """
        D = [
            (at, cone.congruence(scaling.G @ scaling.G.swapaxes(-1, -2)))
            for at, scaling in zip(groups, scalings, strict=True)
        ]
        RD = np.empty_like(R)
        for at, own in D:
            for k, places in enumerate(at):
                RD[:, :, places] = R[:, :, places] @ own[:, k]
        inner: Array = np.asarray(np.linalg.inv(RD @ R.swapaxes(1, 2) + np.eye(R.shape[1])), dtype=float)
        return cls(R, RD, inner, D)

    def solve(self, v: Array) -> Array:
        """Solve for the step of every problem.

        Args:
            v: Right-hand sides, (problems, n).

        Returns:
            The steps, (problems, n).
        """
        u = np.empty_like(v)
        for at, own in self.D:
            u[:, at] = np.matvec(own, v[:, at])
        return np.asarray(u - np.vecmat(np.matvec(self.inner, np.matvec(self.R, u)), self.RD))
