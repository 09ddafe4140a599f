"""Sums of norms over positive semi-definite blocks: a dense interior-point method, many programs at once.

    minimise   sum_k |(R_k x - z_k, rest_k)| + c . x   over   x, svec of positive semi-definite blocks

Mehrotra's predictor and corrector along the direction of Nesterov and Todd (Todd, Toh and Tutuncu 1998), but
that the last step's length, not the predicted one, says how much smaller a gap to aim at. The norms are not
cones here: away from zero they are smooth, and their tangent enters Newton's matrix. Where they change much
from step to step the residuals are weighted by the last ones instead (Weiszfeld), which never overshoots.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.linalg import lapack

from testbench.errors import Array
from testbench.identify import cone
from testbench.identify.cone import Ids

Mask = npt.NDArray[np.bool_]

ITERATIONS = 40
CENTRED = 0.1  #: First gap, as a share of the objective.
SMALL = 1e-3  #: Size of the first x where the data want none above zero.
LEFT = 1e-11  #: Distance from the optimum at which it ends, in units where the data are of order one.
EXACT = 1e-9  #: Norm below which a residual has no direction to speak of: there is nothing to be proven.
STUCK = 1e-6  #: Step length below which it ends.
STALLED = 1e-7  #: Distance below which an iteration that gains less than half is the last.
STEADY = 0.3  #: Relative change of the norms below which their tangent is trusted.
LEAST = 1e-6  #: Least share of the gap that a step aims at.
BOLD, CAUTIOUS = 0.9, 0.6  #: Shares of the way to the boundary of a first try and of a second one.
ROOM = 10.0  #: Traces within which answers are proven: so often those found and one that explains all data.
ROUNDING = 1e-12  #: Share of a trace that an eigenvalue may lie below zero.
TINY = 1e-300


@dataclass(frozen=True)
class Term:
    """|(R x - z, rest)| of B programs."""

    R: Array  #: (B, rows, n), or (1, rows, n) where all share it.
    gram: Array  #: R^T R, (B, n, n) or (1, n, n).
    z: Array  #: (B, rows).
    rest: Array  #: What no x can change, (B,).

    def at(self, x: Array) -> tuple[Array, Array]:
        """The norm, (B,), and its gradient, (B, n)."""
        residual = (self.R @ x[..., None])[..., 0] - self.z
        norm = np.sqrt((residual**2).sum(axis=1) + self.rest**2)
        pull = (residual[:, None] @ self.R)[:, 0]
        return norm, np.asarray(pull / np.maximum(norm, TINY)[:, None])


@dataclass(frozen=True)
class Programs:
    """B programs of one shape."""

    terms: tuple[Term, ...]
    c: Array  #: (B, n).
    sizes: tuple[int, ...]  #: Orders of the blocks.

    def at(self, x: Array) -> tuple[Array, Array]:
        """Norms, (B, K), and their gradients, (B, K, n), at x, (B, n)."""
        norms, pulls = zip(*(term.at(x) for term in self.terms), strict=True)
        return np.stack(norms, axis=1), np.stack(pulls, axis=1)

    def take(self, which: Ids) -> "Programs":
        """Some of them."""

        def some(a: Array) -> Array:
            return a if len(a) == 1 < len(self.c) else a[which]

        terms = (Term(some(t.R), some(t.gram), some(t.z), some(t.rest)) for t in self.terms)
        return replace(self, terms=tuple(terms), c=self.c[which])


def least_norms(programs: Programs, enough: float) -> tuple[Array, Array]:
    """Minimise, twice where less is proven than asked.

    Returns:
        x, (B, n), and what its cost is at most above the least, (B,): infinite where nothing is proven. The
        cost f is convex, so that with S its gradient at x no model whose blocks have traces within t costs
        less than f(x) - <S, x> - sum max(0, -lambda_min S_i) t_i; nor less than 0.
    """
    x, gap = _tried(programs, BOLD)
    again = np.flatnonzero(np.isnan(gap) | (gap > enough))
    if len(again):
        second, better = _tried(programs.take(again), CAUTIOUS)
        less: Mask = np.asarray(better < gap[again])
        x[again[less]], gap[again[less]] = second[less], better[less]
    return x, gap


def _tried(programs: Programs, bold: float) -> tuple[Array, Array]:
    try:
        x = interior(programs, bold)
    except np.linalg.LinAlgError:  # of one of them
        each = [_tried(programs.take(np.array([k])), bold) for k in range(len(programs.c))]
        return np.concatenate([x for x, _ in each]), np.concatenate([gap for _, gap in each])
    inside: Mask = np.asarray(np.isfinite(x).all(axis=1))
    x = np.where(inside[:, None], x, 0.0)
    norms, pulls = programs.at(x)
    gradient = pulls.sum(axis=1) + programs.c
    gap = np.abs((x * gradient).sum(axis=1))
    for at in cone.groups_of(programs.sizes):
        X, S = cone.smat(x[:, at]), cone.smat(gradient[:, at])
        trace = np.trace(X, axis1=-2, axis2=-1)
        inside &= (np.linalg.eigvalsh(X)[..., 0] >= -ROUNDING * np.abs(trace)).all(axis=1)
        below = np.maximum(0, -np.linalg.eigvalsh(S)[..., 0])
        gap += (below * ROOM * (trace + X.shape[-1])).sum(axis=1)
    value = norms.sum(axis=1) + (x * programs.c).sum(axis=1)
    return x, np.where(inside, np.minimum(gap, value), np.inf)


@dataclass(frozen=True)
class State:
    """Some programs on their way."""

    x: Array  #: Coordinates of the blocks, positive definite, (B, n).
    s: Array  #: Those of their multipliers, positive definite, (B, n).
    cost: Array  #: (B,).
    norms: Array  #: (B, K).
    pulls: Array  #: Their gradients, (B, K, n).
    left: Array  #: Gap and what the gradient is not yet the multipliers, times the length of x, (B,).
    step: Array  #: How far the last step went, 1 for all the way, (B,).
    tangent: Array  #: One where the tangent of the norms is trusted, (B,).


def interior(programs: Programs, bold: float) -> Array:
    """Positive definite x as near the optimum as rounding allows, (B, n); how near, the caller asks.

    `bold` is the share of the way to the boundary that a step goes at least.
    """
    state, which = _start(programs), np.arange(len(programs.c))
    found, best = state.x.copy(), state.cost.copy()
    with np.errstate(all="ignore"):  # a step that is not finite is not taken
        for _ in range(ITERATIONS):
            before = state
            try:
                state, good = _iterate(programs, state, bold)
            except np.linalg.LinAlgError:  # a pair lost its last digits
                if len(which) > 1:
                    raise
                break
            kept = state.cost <= best[which] + LEFT  # near no residual at all rounding makes steps wild
            found[which[kept]], best[which] = state.x[kept], np.fmin(state.cost, best[which])
            stalled = (state.left < STALLED) & (state.left > before.left / 2) | (state.step < STUCK)
            going = good & (state.left > LEFT) & (state.norms.min(axis=1) > EXACT) & ~stalled
            if not going.any():
                break
            if not going.all():
                some = np.flatnonzero(going)
                programs, which = programs.take(some), which[some]
                state = State(**{name: value[some] for name, value in vars(state).items()})
    return found


def _start(programs: Programs) -> State:
    """All blocks alike, as large as fits the data best."""
    one = np.concatenate([cone.svec(np.eye(size)) for size in programs.sizes])
    moved = np.concatenate([np.broadcast_to(t.R @ one, t.z.shape) for t in programs.terms], axis=1)
    z = np.concatenate([t.z for t in programs.terms], axis=1)
    square = np.maximum((moved**2).sum(axis=1), TINY)
    size = np.maximum((moved * z).sum(axis=1) / square, SMALL * np.sqrt((z**2).sum(axis=1) / square))[:, None]
    norms, pulls = programs.at(size * one)
    gap, still = CENTRED * norms.sum(axis=1), np.zeros(len(z))
    s = (gap / sum(programs.sizes))[:, None] / size * one
    cost = norms.sum(axis=1) + programs.c @ one * size[:, 0]
    return State(size * one, s, cost, norms, pulls, left=gap, step=still + 0.5, tangent=still)


@dataclass(frozen=True)
class Scaling:
    """Nesterov and Todd's scaling of blocks of one order: G^-1 X G^-T = G^T S G = diag d."""

    at: Ids  #: Places of the blocks, (blocks, entries).
    inverse: Array  #: G^-1, (B, blocks, m, m).
    d: Array  #: (B, blocks, m).

    def primal(self, x: Array) -> Array:
        """G^-1 X G^-T."""
        return np.asarray(self.inverse @ cone.smat(x[:, self.at]) @ self.inverse.swapaxes(-1, -2))

    def corrected(self, aim: Array, X: Array, S: Array) -> Array:
        """Sum of the scaled steps that leads to products of this size, (B,), second order included."""
        d, half = self.d, X @ S
        product = (half + half.swapaxes(-1, -2)) / (d[..., :, None] + d[..., None, :])
        return np.asarray(_diagonal(aim[:, None, None] / d - d) - product)

    def longest(self, X: Array, S: Array) -> Array:
        """Longest step that keeps scaled steps X and S inside the cone, (B,)."""
        root = 1 / np.sqrt(self.d)
        steps = np.stack([X, S]) * (root[..., :, None] * root[..., None, :])
        least = np.linalg.eigvalsh(steps)[..., 0].min(axis=(0, 2))
        return np.asarray(1 / np.maximum(-least, TINY))


def _scaling(at: Ids, x: Array, s: Array) -> Scaling:
    L = np.linalg.cholesky(cone.smat(x[:, at]))
    squares, V = np.linalg.eigh(L.swapaxes(-1, -2) @ cone.smat(s[:, at]) @ L)
    d = np.sqrt(np.maximum(squares, TINY))
    return Scaling(at, np.sqrt(d)[..., None] * (V.swapaxes(-1, -2) @ np.linalg.inv(L)), d)


def _diagonal(values: Array) -> Array:
    return np.asarray(values[..., None] * np.eye(values.shape[-1]))


def _iterate(programs: Programs, state: State, bold: float) -> tuple[State, Mask]:
    """One step of all, predicted for terms of second order, then corrected; and which could be taken.

    Newton's system is (hessian + E) dx = w - (gradient - s), E dx + ds = w.
    """
    x, s = state.x, state.s
    missing = state.pulls.sum(axis=1) + programs.c - s
    hessian = _hessian(programs, state)
    scalings = [_scaling(at, x, s) for at in cone.groups_of(programs.sizes)]
    A = hessian.copy()
    for scaling in scalings:
        W = scaling.inverse.swapaxes(-1, -2) @ scaling.inverse
        A[:, scaling.at[:, :, None], scaling.at[:, None]] += cone.congruence(W)
    factors = [lapack.dpotrf(one.T, lower=1, clean=0, overwrite_a=1) for one in A]
    good: Mask = np.array([info == 0 for _, info in factors])

    def primal(w: Array) -> Array:
        pairs = zip(factors, w - missing, strict=True)
        return np.array([lapack.dpotrs(L, right, lower=1)[0] for (L, _), right in pairs])

    predicted, w, sums = primal(-s), np.empty_like(x), []
    aim = np.maximum((1 - state.step) ** 2, LEAST) * (x * s).sum(axis=1) / sum(programs.sizes)
    for own in scalings:
        X = own.primal(predicted)
        sums.append(own.corrected(aim, X, _diagonal(-own.d) - X))
        w[:, own.at] = cone.svec(own.inverse.swapaxes(-1, -2) @ sums[-1] @ own.inverse)
    dx = primal(w)
    ds = missing + (hessian @ dx[..., None])[..., 0]
    step = np.ones(len(x))
    for own, both in zip(scalings, sums, strict=True):
        X = own.primal(dx)
        step = np.minimum(step, own.longest(X, both - X))
    step = np.minimum(1, (bold + (0.99 - bold) * step) * step)
    good &= np.isfinite(step)
    dx, ds = (np.where(good[:, None], step[:, None] * d, 0.0) for d in (dx, ds))
    return _judged(programs, state, x + dx, s + ds, step), good


def _hessian(programs: Programs, state: State) -> Array:
    """Second derivative of the norms, (B, n, n); without that of one along itself where not trusted."""
    found = np.zeros((*programs.c.shape, programs.c.shape[1]))
    for term, norm, pull in zip(programs.terms, state.norms.T, state.pulls.swapaxes(0, 1), strict=True):
        share = 1 / np.maximum(norm, TINY)
        found += share[:, None, None] * term.gram
        found -= (state.tangent * share)[:, None, None] * (pull[:, :, None] * pull[:, None])
    return found


def _judged(programs: Programs, before: State, x: Array, s: Array, step: Array) -> State:
    """What there is to say of a state after a step."""
    norms, pulls = programs.at(x)
    missing = pulls.sum(axis=1) + programs.c - s
    left = (x * s).sum(axis=1) + np.linalg.norm(x, axis=1) * np.linalg.norm(missing, axis=1)
    change = np.abs(norms / np.maximum(before.norms, TINY) - 1).max(axis=1)
    cost = norms.sum(axis=1) + (x * programs.c).sum(axis=1)
    return State(x, s, cost, norms, pulls, left, step, tangent=np.where(change < STEADY, 1.0, 0.0))
