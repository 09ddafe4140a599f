"""Which single mistake in the loads, or between the two readings, would make the deflections fit the prior.

The model is linear with a prior that learns from the readings (`hierarchy`): y ~ N(A s e, S). A mistake b
adds Z b to what is expected; Z is the difference of the residuals where it changes all runs.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from testbench.data.dataset import Dataset, read_by
from testbench.errors import Array, Mask
from testbench.identify.absolute.unknowns import compliances
from testbench.identify.diagnosis.finding import Finding, test
from testbench.identify.evidence import greatest, posterior
from testbench.identify.fold import reduce
from testbench.identify.hierarchy import evidence
from testbench.identify.metric import Metric
from testbench.identify.registered import station, unloaded
from testbench.identify.rows import jacobian, straight, whiten
from testbench.identify.weighed import Readings, each_reading, one_by_one
from testbench.model.joint_errors import JointErrors
from testbench.model.load import Load
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm, marker_points, tool_pose

PLAY, STIFFER = 6e-5, 200.0
"""Half width of a joint's play or friction [rad, m], and the share by which it turns less, a radian [1/rad].

Typical sizes, as of `plant.TYPICAL`, and a little more."""
FORCE, POINT, SHIFT, FACTOR = 0.1, 0.1, 1e-3, 0.3
"""Sizes that are expected of a constant force over the largest, of a load point's error [m], of a tracker's
move [m, rad] and of a wrong load [1]."""
BUMP = 3e-3  #: The same of a target that was touched, or of a reading of another one [m].
LEAST_OF_LEVEL = 3  #: Runs of a load below which it is no level.
SAME = 0.02  #: Share by which loads of one level may differ.


@dataclass(frozen=True)
class Learnt:
    """The learnt model of a dataset, reading by reading."""

    vjm: Vjm
    metric: Metric
    data: Dataset
    read: Readings  #: Its readings one by one.
    loss: float  #: Minus the logarithm of its evidence.
    pi: Array  #: Expected parameters after the readings, (n,).
    #: The inverse of the readings' covariance is I / misfit^2 - shared shared^T, (k, r): readings share few
    #: unknowns, so that nothing is as large as the readings squared.
    shared: Array
    surprise: Array  #: That inverse times readings minus what is expected before them, (k,) [1].
    h: Array  #: Hyperparameters.

    @property
    def misfit(self) -> float:
        """How much more than their noise the readings scatter [1]."""
        return float(np.exp(self.h[-1]))


def learnt(vjm: Vjm, metric: Metric, data: Dataset, h: Array | None = None) -> Learnt:
    """Learn the prior from a dataset, or take hyperparameters of others; its readings against it."""
    structure = metric.structure
    seen = evidence(reduce(vjm, structure, data), metric, alike=True)
    h = greatest(seen.problem, seen.start) if h is None else h
    read = one_by_one(vjm, structure, data)
    G = read.A.reshape(-1, structure.n) @ seen.metric.L
    s, kappa = seen.scale(h), np.exp(h[-1])
    width = np.exp(seen.problem.drawn @ h)
    residual = read.y.ravel() - G @ (s * seen.metric.expected)
    half = G * width
    expected = np.concatenate([residual, np.zeros(len(width))])
    x = np.linalg.lstsq(np.vstack([half, kappa * np.eye(len(width))]), expected)[0]
    pi = seen.metric.L @ (s * seen.metric.expected + width * x)
    if vjm.arm.joints:
        half = np.hstack([half, allowed(vjm, data, structure, pi)])
    U, size, _ = np.linalg.svd(half, full_matrices=False)
    shared = U * (size / np.hypot(size, kappa) / kappa)
    surprise = residual / kappa**2 - shared @ (shared.T @ residual)
    least = posterior(seen.problem, h).loss
    return Learnt(vjm, seen.metric, data, read, least, pi, shared, surprise, h)


def allowed(vjm: Vjm, data: Dataset, structure: Structure, pi: Array) -> Array:
    """What joints of sound arms do beyond springs, (rows, 2 n) [standard deviations]: play, and stiffening.

    Args:
        vjm: The model.
        data: The runs.
        structure: The compliances.
        pi: Of them those about which, (n,).
    """
    told, first = straight(vjm, data.q, [Load(data.wrench, data.point)]), 6 * len(vjm.arm.links)
    turn = np.diag(structure.matrix(pi))[first:, None] * told.u[first:]
    told = replace(told, phi=np.stack([PLAY * np.sign(turn), STIFFER * turn * np.abs(turn)], axis=1))
    own = replace(compliances(vjm, structure), errors=JointErrors(play=True, stiffening=True))
    points, read = marker_points(vjm, data.markers), data.sigma_rotation is not None
    A = jacobian(own, told, points, turned=read)[:, :, own.columns("errors")]
    return each_reading(A, whiten(A, data, np.arange(data.runs))).reshape(-1, A.shape[2])


def of_all(own: Learnt) -> Iterator[Finding]:
    """Every mistake of all runs, of a station or of a level, whose size enters linearly."""
    start = _left(own, own.data)
    for found, unit, undone in _of_all(own.data):
        Z = np.column_stack([start - _left(own, data) for data in undone])
        yield _tested(own, found, unit, Z)


def of_runs(own: Learnt) -> Iterator[Finding]:
    """Every mistake of a single run or reading whose size enters linearly."""
    read = own.read
    expected, size = (read.A @ own.pi).ravel(), BUMP / np.repeat(read.unit, 3)
    for r, name in enumerate(map(str, own.data.run)):
        first, end = np.searchsorted(read.run, [r, r + 1])
        if first == end:
            continue
        every = slice(3 * first, 3 * end)
        yield _tested(own, Finding("run_load", (name,)), FACTOR, FACTOR * expected[every, None], every)
        yield _tested(own, Finding("run", (name,)), BUMP, np.diag(size[every]), every)
        for k in range(first, end):
            one, target = slice(3 * k, 3 * k + 3), read.marker[k]
            label = (own.data.markers[target],) if target >= 0 else ()
            yield _tested(own, Finding("reading", (name, *label)), BUMP, np.diag(size[one]), one)


def _left(own: Learnt, data: Dataset) -> Array:
    """Readings minus predictions of a changed dataset, (k,)."""
    read = one_by_one(own.vjm, own.metric.structure, data)
    return np.asarray((read.y - read.A @ own.pi).ravel())


def _tested(own: Learnt, found: Finding, unit: float, Z: Array, rows: slice = slice(None)) -> Finding:
    """A mistake that adds Z b, (rows, z) [standard deviations a unit], to what is expected of some rows."""
    shared = own.shared[rows].T @ Z
    tested = test(Z.T @ own.surprise[rows], Z.T @ Z / own.misfit**2 - shared.T @ shared)
    return replace(found, size=unit * tested.b, nats=float(tested.nats))


def _of_all(data: Dataset) -> Iterator[tuple[Finding, float, list[Dataset]]]:
    """Mistakes of all runs, of a station or of a level: the unit of their size, data with one unit undone."""
    axes, y, w = np.eye(3), data.after, data.wrench
    size = FORCE * float(np.linalg.norm(w[:, :3], axis=1).max())
    if size > 0:
        yield (
            Finding("force_offset"),
            size,
            [replace(data, wrench=w + np.r_[size * e, 0, 0, 0]) for e in axes],
        )
    yield Finding("load_point"), POINT, [replace(data, point=data.point + POINT * e) for e in axes]
    moves = [*axes, *(np.cross(e, y - y[data.seen].mean(axis=0)) for e in axes)]
    for name in (station(one.frame) for one in unloaded(data)):
        own = SHIFT * read_by(data, name)[:, None, None]
        where = () if data.station is None else (str(name),)
        yield Finding("tracker_moved", where), SHIFT, [replace(data, after=y - own * move) for move in moves]
    groups = levels(data)
    for mask in groups if len(groups) > 1 else ():
        load = np.linalg.norm(w[mask, :3], axis=1).mean()
        heavier = replace(data, wrench=w * (1 + FACTOR * mask)[:, None])
        yield Finding("level", beside={"force": float(load)}), FACTOR, [heavier]


def levels(data: Dataset) -> list[Mask]:
    """Runs of one size of force each, sizes that occur often enough; none where a load is of no such size."""
    force = np.linalg.norm(data.wrench[:, :3], axis=1)
    found: list[Mask] = []
    left = np.ones(len(force), dtype=bool)
    while left.any():
        own = left & (np.abs(force - force[left].max()) <= SAME * force.max())
        found.append(own)
        left &= ~own
    often = all(own.sum() >= LEAST_OF_LEVEL for own in found)
    return found if often and force.min() > 0 else []


def other_loads(vjm: Vjm, data: Dataset) -> Iterator[tuple[str, tuple[str, ...], Dataset]]:
    """Mistakes of all loads that have no size: kind, what the loads are in truth, the data without it."""
    w, rotation = data.wrench.reshape(-1, 2, 3), tool_pose(vjm, data.q)[1]
    turned = np.einsum("rxy,rky->rkx", rotation, w)
    yield "force_axes", ("tool",), replace(data, wrench=turned.reshape(-1, 6))
    for order in list(permutations(range(3)))[1:]:
        for sign, said in ((1, "+"), (-1, "-")):
            axes = "".join("xyz"[k] for k in order)
            yield "force_axes", (axes, said), replace(data, wrench=sign * w[:, :, list(order)].reshape(-1, 6))
    groups = levels(data)
    sizes = [np.linalg.norm(data.wrench[own, :3], axis=1).mean() for own in groups]
    shifted = [np.roll(sizes, -k) for k in range(1, len(sizes))]
    for place, values in enumerate([*shifted, np.array(sizes[::-1])] if len(groups) > 1 else ()):
        factor = np.ones(data.runs)
        for own, size, value in zip(groups, sizes, values, strict=True):
            factor[own] = value / size
        named = ("reversed",) if place == len(shifted) else ()
        yield "levels", named, replace(data, wrench=data.wrench * factor[:, None])
