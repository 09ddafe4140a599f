"""A dense interior-point method for norms over positive semi-definite blocks, many programs at once.

Mehrotra's predictor and corrector along the direction of Nesterov and Todd (Todd, Toh and Tutuncu 1998), but
that the last step's length, not the predicted one, says how much smaller a gap to aim at. The norms are not
cones here: away from zero they are smooth, and their tangent enters Newton's matrix. Where they change much
from step to step the residuals are weighted by the last ones instead (Weiszfeld), which never overshoots.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from testbench.errors import Array
from testbench.identify.blocks import Blocks
from testbench.identify.linear import factorised
from testbench.identify.objective import TINY, Objective, Point
from testbench.identify.regression import Ids

Mask = npt.NDArray[np.bool_]

ITERATIONS = 40
CENTRED = 0.1  #: First gap, as a share of the objective.
SMALL = 1e-3  #: Size of the first x where the data want none above zero.
LEFT = 1e-11  #: Distance from the optimum at which it ends, in units where the data are of order one.
EXACT = 1e-9  #: Norm below which a residual has no direction to speak of: there is nothing to be proven.
STUCK = 1e-6  #: Step length below which it ends.
STALLED = 1e-7  #: Distance below which an iteration that gains less than half is the last.
STEADY = 0.3  #: Relative change of the norms below which their tangent is trusted.
FIRST = 0.5  #: Step length that the first step is thought to follow.
LEAST = 1e-6  #: Least share of the gap that a step aims at.


@dataclass(frozen=True)
class State:
    """Some of the programs, on their way."""

    objective: Objective
    programs: Ids  #: Which they are, (B,).
    x: Array  #: Coordinates of the blocks, positive definite, (B, n).
    s: Array  #: Those of their multipliers, positive definite, (B, n).
    point: Point  #: The objective at x.
    gap: Array  #: x . s, (B,).
    left: Array  #: The same and what the gradient is not yet the multipliers, times the length of x, (B,).
    step: Array  #: How far the last step went, 1 for all the way, (B,).
    tangent: Array  #: One where the tangent of the norms is trusted, (B,).
    going: Mask  #: Which are not at their end, (B,).

    def rest(self) -> "State":
        """Those that are not at their end."""
        which = np.flatnonzero(self.going)
        if len(which) == len(self.going):
            return self
        parts = {k: v[which] for k, v in vars(self).items() if k not in ("objective", "point")}
        return State(objective=self.objective.take(which), point=self.point.take(which), **parts)


def interior(objective: Objective, blocks: Blocks, bold: float) -> Array:
    """Minimise over positive semi-definite blocks as far as rounding lets it; how far, the caller asks.

    `bold` is the share of the way to the boundary that a step goes at least.

    Returns:
        Coordinates of the blocks, positive definite, (B, n).
    """
    state = _start(objective, blocks)
    x = state.x.copy()
    with np.errstate(all="ignore"):  # a step that is not finite is not taken
        for _ in range(ITERATIONS):
            state = _iterate(state.rest(), blocks, bold)
            x[state.programs] = state.x
            if not state.going.any():
                break
    return x


def _start(objective: Objective, blocks: Blocks) -> State:
    """All blocks alike, as large as fits the data best."""
    one, B = blocks.one, len(objective.z)
    moved, z = objective.R @ one, objective.z
    square = np.maximum((moved**2).sum(axis=1), TINY)
    size = np.maximum((moved * z).sum(axis=1) / square, SMALL * np.sqrt((z**2).sum(axis=1) / square))[:, None]
    x = size * one
    point = objective.at(x)
    gap = CENTRED * point.norms.sum(axis=1)
    s = (gap / blocks.degree)[:, None] / size * one
    return State(
        objective, np.arange(B), x, s, point, gap, gap, np.full(B, FIRST), np.zeros(B), np.ones(B, dtype=bool)
    )


def _iterate(state: State, blocks: Blocks, bold: float) -> State:
    """One step of all: predicted, for terms of second order, then corrected."""
    x, s = state.x, state.s
    scaling = _scaling(blocks, x, s)
    newton = Newton(state, scaling)
    X = scaling.primal(newton.primal(-s))
    aim = np.maximum((1 - state.step) ** 2, LEAST) * state.gap / blocks.degree
    W = scaling.corrected(aim, X, scaling.diagonal(-scaling.d) - X)
    dx = newton.primal(scaling.back(W))
    ds = newton.dual(dx)
    X = scaling.primal(dx)
    step = _longest(scaling, X, W - X)
    step = np.minimum(1, (bold + (0.99 - bold) * step) * step)
    good = newton.factors.good & np.isfinite(step)
    dx, ds = (np.where(good[:, None], step[:, None] * d, 0.0) for d in (dx, ds))
    return _judged(replace(state, x=x + dx, s=s + ds, step=step, going=good), state)


def _judged(state: State, before: State) -> State:
    """What there is to say of a state after a step."""
    gap, point = (state.x * state.s).sum(axis=1), state.objective.at(state.x)
    size = np.linalg.norm(state.x, axis=1)
    left = gap + size * np.linalg.norm(point.gradient - state.s, axis=1)
    change = np.abs(point.norms / np.maximum(before.point.norms, TINY) - 1).max(axis=1)
    stalled = (left < STALLED) & (left > before.left / 2) | (state.step < STUCK)
    going = state.going & (left > LEFT) & (point.norms.min(axis=1) > EXACT) & ~stalled
    tangent = np.where(change < STEADY, 1.0, 0.0)
    return replace(state, point=point, gap=gap, left=left, tangent=tangent, going=going)


@dataclass(frozen=True)
class Scaling:
    """Nesterov and Todd's scaling of some pairs: G^-1 X G^-T = G^T S G = diag d."""

    blocks: Blocks
    inverse: Array  #: G^-1, (B, bins, most, most).
    d: Array  #: Ones in the padding, (B, bins, most).

    def primal(self, x: Array) -> Array:
        """G^-1 X G^-T."""
        return np.asarray(self.inverse @ self.blocks.matrices(x) @ self.inverse.swapaxes(-1, -2))

    def back(self, W: Array) -> Array:
        """Coordinates of G^-T W G^-1."""
        return self.blocks.vector(self.inverse.swapaxes(-1, -2) @ W @ self.inverse)

    def diagonal(self, values: Array) -> Array:
        """Diagonal matrices of values, (B, bins, most)."""
        found = np.zeros_like(self.inverse)
        i = np.arange(values.shape[-1])
        found[..., i, i] = values
        return found

    def corrected(self, aim: Array, X: Array, S: Array) -> Array:
        """Sum of the scaled steps that leads to products of this size, (B,), second order included."""
        d, half = self.d, X @ S
        product = (half + half.swapaxes(-1, -2)) / (d[..., :, None] + d[..., None, :])
        return self.diagonal(aim[:, None, None] / d - d) - product


def _scaling(blocks: Blocks, x: Array, s: Array) -> Scaling:
    X, S = blocks.matrices(x) + blocks.padding, blocks.matrices(s) + blocks.padding
    L = np.linalg.cholesky(X)
    squares, V = np.linalg.eigh(L.swapaxes(-1, -2) @ S @ L)
    d = np.sqrt(np.maximum(squares, TINY))
    return Scaling(blocks, np.sqrt(d)[..., None] * (V.swapaxes(-1, -2) @ np.linalg.inv(L)), d)


class Newton:
    """Newton's system of some programs: (hessian + E) dx = w - (gradient - s), E dx + ds = w."""

    def __init__(self, state: State, scaling: Scaling) -> None:
        """Factorise it."""
        self.missing = state.point.gradient - state.s
        self.hessian = state.objective.hessian(state.point, state.tangent)
        W = scaling.inverse.swapaxes(-1, -2) @ scaling.inverse
        A = self.hessian.matrix()
        scaling.blocks.add(A, scaling.blocks.congruence(W))
        self.factors = factorised(A, self.hessian.along)

    def primal(self, w: Array) -> Array:
        """Step dx, (B, n)."""
        return self.factors.solve(w - self.missing)

    def dual(self, dx: Array) -> Array:
        """Step ds that goes with it, (B, n)."""
        return self.missing + self.hessian.times(dx)


def _longest(scaling: Scaling, X: Array, S: Array) -> Array:
    """Longest step up to 1 that keeps scaled steps X and S inside the cone, (B,)."""
    root = 1 / np.sqrt(scaling.d)
    steps = np.stack([X, S]) * (root[..., :, None] * root[..., None, :])
    least = np.linalg.eigvalsh(steps)[..., 0].min(axis=(0, 2))
    return np.asarray(np.minimum(1.0, 1 / np.maximum(-least, TINY)))
