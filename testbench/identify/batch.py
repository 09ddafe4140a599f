"""Least squares with a trace term over positive semi-definite blocks: many similar problems at once.

    minimise   |R_f x|^2 / 2 - g_f . x + l c . x   over   x, svec of positive semi-definite blocks

for every fold f of the readings and every weight l. The step is that of `interior`: Mehrotra's predictor and
corrector along the direction of Nesterov and Todd. Held-out errors distinguish weights at a precision of per
cents, so a hundredth of the cost is accurate enough, and so few steps need no warm start.

Steps are taken in the scaled coordinates y of Nesterov and Todd, dx = K y with K = svec(G . G^T). There
Newton's matrix is 1 + S^T S with S = R K. Readings determine fewer directions than there are unknowns, so
that Woodbury's identity solves it: y = u - S^T t, (1 + S S^T) t = S u. The step of the residuals is R dx = t.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotrs

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
    R: Array  #: (problems, rank, n).
    linear: Array  #: Gradient at x = 0, (problems, n).
    half: Array  #: Cost at x = 0, (problems,).
    x: Array  #: (problems, n).
    s: Array  #: Multipliers, (problems, n).
    gradient: Array  #: (problems, n).
    step: Array  #: Length of the last step, 1 for a full one, (problems,).

    def only(self, some: Mask) -> "_State":
        """Select some of the problems.

        Args:
            some: Which problems, (problems,).

        Returns:
            Their state.
        """
        return self if some.all() else _State(*(own[some] for own in vars(self).values()))


def solve(problems: Problems, weights: Array) -> tuple[Array, Array]:
    """Solve all folds with all weights.

    Args:
        problems: The folds.
        weights: Of the trace term, (weights,).

    Returns:
        x and its multipliers, (folds, weights, n) each, NaN where none was found.
    """
    groups, shape = cone.groups_of(problems.sizes), (len(problems.g), len(weights), len(problems.c))
    found = np.full((2, shape[0] * shape[1], shape[2]), np.nan)
    with np.errstate(all="ignore"):  # a problem that is not finite is given up
        state = _start(problems, weights, groups)
        for _ in range(STEPS):
            cost = np.vecdot(state.x, state.gradient + state.linear) / 2 + state.half
            missing = np.linalg.norm(state.gradient - state.s, axis=1)
            left = np.vecdot(state.x, state.s) + np.linalg.norm(state.x, axis=1) * missing
            done = left <= COST_TOLERANCE * cost
            found[:, state.at[done]] = state.x[done], state.s[done]
            state = state.only(~done)
            if not len(state.at):
                break
            try:
                state = _moved(state, _Newton.of(state.R, state.x, state.s, groups))
            except np.linalg.LinAlgError:
                sound = _definite(state.x, groups) & _definite(state.s, groups)
                if sound.all() or not sound.any():
                    break
                state = state.only(sound)
                continue
            state = state.only(np.asarray(np.isfinite(np.hstack([state.x, state.s])).all(axis=1)))
    x, s = found.reshape(2, *shape)
    return x, s


def freedom(problems: Problems, x: Array, s: Array) -> Array:
    """Compute effective numbers of parameters: traces of what maps readings to predictions.

    Args:
        problems: The folds.
        x: Solutions, (folds, weights, n).
        s: Their multipliers, (folds, weights, n).

    Returns:
        The numbers, (folds, weights); NaN where there is no solution.
    """
    some: Mask = np.asarray(np.isfinite(x).all(axis=2))
    fold, groups = np.nonzero(some)[0], cone.groups_of(problems.sizes)
    inner = _Newton.of(problems.R[fold], x[some], s[some], groups).inner
    found = np.full(some.shape, np.nan)
    found[some] = inner.shape[-1] - np.trace(np.linalg.inv(inner), axis1=1, axis2=2)
    return found


def _definite(x: Array, groups: list[Ids]) -> Mask:
    """Tell whether all blocks are positive definite, (problems,)."""
    least = [np.linalg.eigvalsh(cone.smat(x[:, at]))[..., 0].min(axis=1) for at in groups]
    return np.asarray(np.min(least, axis=0) > 0)


def _moved(state: _State, newton: "_Newton") -> _State:
    """Take one step: predicted to first order, then corrected to second order."""
    missing = state.gradient - state.s
    x, s, order = state.x, state.s, sum(one.d.shape[1] * one.d.shape[2] for one in newton.scalings)
    aim = np.maximum((1 - state.step) ** 2, MIN_AIM) * np.vecdot(x, s) / order
    scaled, wanted, sums = newton.scaled_back(missing), np.empty_like(x), []
    for scaling in newton.scalings:  # s is diag d there
        wanted[:, scaling.at] = cone.svec(scaling.d[..., None] * np.eye(scaling.d.shape[-1]))
    predicted, _ = newton.solve(-wanted - scaled)
    for scaling in newton.scalings:
        both = scaling.corrected(aim[:, None, None], cone.smat(predicted[:, scaling.at]))
        sums.append(np.nan_to_num(both))
        wanted[:, scaling.at] = cone.svec(sums[-1])
    y, moved = newton.solve(wanted - scaled)
    step = np.ones(len(x))
    for scaling, both in zip(newton.scalings, sums, strict=True):
        step = np.minimum(step, scaling.longest(np.nan_to_num(cone.smat(y[:, scaling.at])), both))
    step *= MIN_BOUNDARY_SHARE + (0.99 - MIN_BOUNDARY_SHARE) * step
    turned = step[:, None] * np.vecmat(moved, state.R)  # what the step changes of the gradient
    return replace(
        state,
        x=x + step[:, None] * newton.unscaled(y),
        s=s + step[:, None] * missing + turned,
        gradient=state.gradient + turned,
        step=step,
    )


def _start(problems: Problems, weights: Array, groups: list[Ids]) -> _State:
    """Start with equal blocks that fit the readings best, and multipliers of the gradient's size."""
    fold = np.repeat(np.arange(len(problems.g)), len(weights))
    linear = np.tile(weights, len(problems.g))[:, None] * problems.c - problems.g[fold]
    one = np.concatenate([cone.svec(np.eye(size)) for size in problems.sizes])
    moved = np.vecmat(problems.R @ one, problems.R)
    square = np.maximum(moved @ one, TINY)
    size = np.maximum(problems.g @ one / square, INITIAL_SIZE * np.sqrt(2 * problems.half / square))[fold]
    gradient = size[:, None] * moved[fold] + linear
    fit = size**2 * square[fold] / 2 - size * (problems.g @ one)[fold] + problems.half[fold]
    large = [np.abs(np.linalg.eigvalsh(cone.smat(gradient[:, at]))).max(axis=(1, 2)) for at in groups]
    s = np.maximum(FIRST * fit / sum(problems.sizes) / size, np.max(large, axis=0))
    return _State(
        at=np.arange(len(fold)),
        R=problems.R[fold],
        linear=linear,
        half=problems.half[fold],
        x=size[:, None] * one,
        s=s[:, None] * one,
        gradient=gradient,
        step=np.full(len(fold), 0.5),
    )


@dataclass(frozen=True)
class _Newton:
    """Solve (1 + S^T S) y = u in scaled coordinates, S = R K."""

    scalings: list[Scaling]  #: Of the blocks of each order.
    K: list[Array]  #: svec(Y) -> svec(G Y G^T) of their blocks, (problems, blocks, t, t) each.
    S: Array  #: (problems, rank, n).
    inner: Array  #: 1 + S S^T, (problems, rank, rank).

    @cached_property
    def roots(self) -> list[Array]:
        """Return Cholesky factors of `inner`, (rank, rank) each."""
        return [dpotrf(own, lower=1)[0] for own in self.inner]

    @classmethod
    def of(cls, R: Array, x: Array, s: Array, groups: list[Ids]) -> "_Newton":
        """Compute the matrices of a Newton step of many problems.

        Args:
            R: Rows of every problem, (problems, rows, n).
            x: Points in the cone, (problems, n).
            s: Points in the dual cone, (problems, n).
            groups: Places of the blocks of each order, (blocks, entries) per order.

        Returns:
            The matrices.
        """
        scalings = [Scaling.of(at, x, s) for at in groups]
        K, S = [cone.congruence(scaling.G) for scaling in scalings], np.empty_like(R)
        for scaling, own in zip(scalings, K, strict=True):
            if own.shape[-1] == 1:
                S[:, :, scaling.at[:, 0]] = R[:, :, scaling.at[:, 0]] * own[:, None, :, 0, 0]
                continue
            for k, places in enumerate(scaling.at):
                some = slice(places[0], places[-1] + 1)
                np.matmul(R[:, :, some], own[:, k], out=S[:, :, some])
        return cls(scalings, K, S, S @ S.swapaxes(1, 2) + np.eye(R.shape[1]))

    def scaled_back(self, v: Array) -> Array:
        """Scale gradients: svec(G^T V G) of svec(V), (problems, n)."""
        u = np.empty_like(v)
        for scaling, own in zip(self.scalings, self.K, strict=True):
            u[:, scaling.at] = np.vecmat(v[:, scaling.at], own)
        return u

    def unscaled(self, y: Array) -> Array:
        """Return steps of x from scaled ones: svec(G Y G^T) of svec(Y), (problems, n)."""
        x = np.empty_like(y)
        for scaling, own in zip(self.scalings, self.K, strict=True):
            x[:, scaling.at] = np.matvec(own, y[:, scaling.at])
        return x

    def solve(self, u: Array) -> tuple[Array, Array]:
        """Solve for scaled steps y, (problems, n), and steps of the residuals R dx, (problems, rank)."""
        right = np.matvec(self.S, u)
        t = np.array([dpotrs(L, own, lower=1)[0] for L, own in zip(self.roots, right, strict=True)])
        return u - np.vecmat(t, self.S), t
