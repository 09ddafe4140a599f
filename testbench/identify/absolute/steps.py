"""A step in the middle of a series: which row it is at, and how much it explains.

From row k on a step b of up to six numbers is added to the model, in tool axes for the targets and in base
axes for the tracker. Beside it stands all that the model may still lack: geometry, low periodic errors of the
joints and compliances, each with its prior. What these explain as well is no step:

    gain_k = g_k^T M_k^-1 g_k,   g_k = Z_k^T (1 - P) e,   M_k = Z_k^T (1 - P) Z_k

with e the residuals, Z_k the columns of the step and 1 - P what takes the others out.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular

from testbench.data.series import Series, select_rows
from testbench.errors import Array
from testbench.identify.absolute.choose import GEOMETRY
from testbench.identify.absolute.evidence import LOOSE, Choice, Learnt, choice, prior, usual
from testbench.identify.absolute.noise import Noise, lengths, plan_of, roots
from testbench.identify.absolute.rows import rows_of
from testbench.identify.absolute.state import State
from testbench.identify.absolute.unknowns import unknowns_of
from testbench.identify.metric import Metric
from testbench.identify.robust_loss import READINGS
from testbench.model.joint_errors import JointErrors
from testbench.model.structure import Ids

ORDERS = 8  #: Periodic errors beside a step: those that the poses of a part of a series may share.
LACKING = 3.0  #: Size of errors beside a step, over the usual one: what part of them is left is not known.
BATCH = 3_000_000  #: Numbers of the equations that are in memory at a time.
STEP = 1.0  #: Standard deviation of a step before any reading [m, rad]: it may be of any size.
FREE = 6
"""Independent equations of a pose at most: its targets and loads share what the model leaves open there."""
ALIKE = 10.0  #: Difference of gains below which two steps explain the readings alike.

What = Literal["target", "tracker"]


@dataclass(frozen=True)
class Linear:
    """Where readings are linear, and what the model may lack."""

    own: Choice  #: What may be lacking.
    prior: Array  #: Its precision, compliances in the metric, (c, c).
    state: State  #: The arm.
    noise: Noise  #: How readings scatter about it.


def lacking(
    state: State, series: tuple[Series, ...], noise: Noise, elastic: Metric, orders: int = ORDERS
) -> Linear:
    """Residuals of series, and what else may explain them.

    Args:
        state: The arm without joint errors.
        series: The readings.
        noise: How they scatter.
        elastic: Prior of all compliances that there may be.
        orders: Highest order of periodic errors that there may be.
    """
    errors = JointErrors(tuple(range(1, orders + 1)))
    state = replace(state, errors=errors, n=np.zeros((state.vjm.arm.n_joints, errors.size)))
    unknowns = unknowns_of(state.vjm, series, errors, elastic.structure)
    own, size = choice(unknowns, GEOMETRY | {"harmonics"}, elastic), usual(unknowns, len(noise.factor))
    P, _ = prior(own, Learnt(LACKING * size.deviation, size.factor), LOOSE)
    return Linear(own, P, state, noise)


@dataclass(frozen=True)
class _Sums:
    """Whitened sums over rows: A is what may be lacking, Z both steps, e the residuals."""

    AA: Array  #: Over all rows, (c + 1, c + 1), e last.
    ZA: Array  #: Over the rows behind every step, (steps, z, c + 1), e last.
    ZZ: Array  #: (steps, z, z).
    count: int  #: Equations that were read.


def _sums(at: Linear, series: Series, steps: Ids) -> _Sums:
    edges = np.r_[0, steps, series.rows]
    cells, AA = [], 0.0
    for part in _batches(at, series, edges):
        A, Z = _equations(at, select_rows(series, np.arange(edges[part[0]], edges[part[-1] + 1])))
        AA = AA + np.einsum("ar,br->ab", A, A, optimize=True)
        each = A.shape[1] // (edges[part[-1] + 1] - edges[part[0]])
        for a, b in zip(edges[part] - edges[part[0]], edges[part + 1] - edges[part[0]], strict=True):
            own = slice(each * a, each * b)
            cells.append(Z[:, own] @ np.vstack([A[:, own], Z[:, own]]).T)
    count = 3 * int(series.seen.sum() + series.turned.sum())
    behind = np.cumsum(np.array(cells)[:0:-1], axis=0)[::-1]
    c = len(at.own.columns) + 1
    return _Sums(np.asarray(AA), behind[:, :, :c], behind[:, :, c:], count)


def _batches(at: Linear, series: Series, edges: Ids) -> Iterator[Ids]:
    """Places of cells that are in memory together."""
    numbers = 3 * series.rows * (len(series.markers) + 1) * at.own.unknowns.size
    parts = np.array_split(np.arange(len(edges) - 1), min(len(edges) - 1, 1 + numbers // BATCH))
    yield from parts


def _equations(at: Linear, series: Series) -> tuple[Array, Array]:
    """Whitened [A e], (c + 1, equations), and Z, (z, equations); those of a row follow one another."""
    own, rows = at.own, rows_of(at.own.unknowns, at.state, series)
    alone = replace(series, pose=np.arange(series.rows))
    W, _ = roots(alone, at.noise, plan_of(alone), at.state.frame(series).rotation)
    pull = READINGS.pull(lengths(np.einsum("srxy,syr->sxr", W, rows.left)))
    W = W * np.sqrt(pull)[..., None, None]
    names = own.unknowns.columns
    mount = rows.A[:, :, names(f"mount {series.target}")]
    A = np.concatenate([rows.A[:, :, own.columns], rows.left[:, :, None]], axis=2)
    Z = np.concatenate([_rigid(at, series, mount), rows.A[:, :, names(f"frame {series.frame}")]], axis=2)
    both = np.einsum("srxy,sycr->crsx", W, np.concatenate([A, Z], axis=2))
    if own.elastic is not None:
        e = slice(own.rigid, len(own.columns))
        both[e] = np.tensordot(own.elastic.L.T, both[e], 1)
    lines = both.reshape(len(both), -1)
    return lines[: A.shape[2]], lines[A.shape[2] :]


def _rigid(at: Linear, series: Series, mount: Array) -> Array:
    """Columns of a rigid step of the targets, (s, 3, 3 or 6, runs), from those of the mount."""
    points = at.state.mount(series).points
    T = np.zeros((mount.shape[2], 6))
    for k, point in enumerate(points):
        T[3 * k : 3 * k + 3] = np.column_stack([np.eye(3), np.cross(np.eye(3), point).T])
    T[3 * len(points) :, 3:] = np.eye(3)[: max(0, len(T) - 3 * len(points))]
    return np.asarray(np.einsum("sxcr,cz->sxzr", mount, T[:, : 3 if len(T) == 3 else 6]))


@dataclass(frozen=True)
class Step:
    """The step of greatest gain."""

    place: int  #: First row behind it.
    what: What  #: What moved.
    alike: bool  #: Whether the other explains the readings as well.
    b: Array  #: How far it moved and turned, (3 or 6,) [m, rad].
    gain: float  #: Sum of squares that it takes away, over the variance of what is left [1].
    share: float  #: Share of the sum of squares that it takes away [1].
    free: float  #: Independent equations that nothing spends.


def best(
    at: Linear, series: Series, steps: Ids, others: tuple[Series, ...] = (), *, turns: bool = True
) -> Step:
    """The step of greatest gain.

    Args:
        at: What else the model may lack.
        series: The readings, in order of time.
        steps: First rows behind the steps that are tried, rising, (steps,).
        others: Series without a step that tell of the arm as well.
        turns: Whether a step may turn what moves.
    """
    sums, c = _sums(at, series, steps), len(at.own.columns)
    for one in others:
        more = _sums(at, one, np.array([], dtype=int))
        sums = replace(sums, AA=sums.AA + more.AA, count=sums.count + more.count)
    H = sums.AA[:c, :c] + at.prior
    size = np.sqrt(np.diag(H))
    L = cholesky(H / size / size[:, None], lower=True)
    spent = c - float(np.trace(cho_solve((L, True), at.prior / size / size[:, None])))
    e = solve_triangular(L, sums.AA[:c, c] / size, lower=True)
    K = solve_triangular(L, (sums.ZA[:, :, :c] / size).reshape(-1, c).T, lower=True)
    K = K.T.reshape(*sums.ZA.shape[:2], c)
    g, M = sums.ZA[:, :, c] - K @ e, sums.ZZ - K @ K.swapaxes(1, 2)
    z = g.shape[1] - 6
    target, tracker = (
        _gains(g[:, own], M[:, own, own])
        for own in (slice(z if turns else 3), slice(z, None if turns else z + 3))
    )
    what: What = "target" if target[0].max() > tracker[0].max() else "tracker"
    (gain, b), other = (target, tracker) if what == "target" else (tracker, target)
    k, before = int(gain.argmax()), float(sums.AA[c, c] - e @ e)
    s2 = max(before - gain[k], 1e-300) / max(sums.count - spent, 1.0)
    alike = bool(gain[k] - other[0][max(0, k - 2) : k + 3].max() < ALIKE * s2)
    shared = max(1.0, sums.count / (FREE * sum(len(np.unique(one.pose)) for one in (series, *others))))
    free = max(sums.count - spent, 1.0) / shared
    return Step(int(steps[k]), what, alike, b[k], float(gain[k] / s2 / shared), float(gain[k] / before), free)


def _gains(g: Array, M: Array) -> tuple[Array, Array]:
    """Gain of every step, (steps,), and the step itself, (steps, z)."""
    b: Array = np.asarray(np.linalg.solve(M + np.eye(g.shape[1]) / STEP**2, g[..., None])[..., 0])
    return np.asarray((b * g).sum(axis=1)), b


def moves(at: Linear, series: Series, step: Step) -> float:
    """How far a step moved the targets where they were read, root mean square [m]."""
    rows, columns = rows_of(at.own.unknowns, at.state, series), at.own.unknowns.columns
    Z = rows.A[:, :, columns(f"frame {series.frame}")]
    if step.what == "target":
        Z = _rigid(at, series, rows.A[:, :, columns(f"mount {series.target}")])
    d = np.einsum("sxcr,c->sxr", Z[:, :, : len(step.b)], step.b)[: len(series.markers)]
    return float(np.sqrt((d**2).sum() / max(1, series.seen.sum())))
