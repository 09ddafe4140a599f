"""Which single mistake in the loads, or between the two readings, would make the deflections fit the prior.

The model is linear with a prior that learns from the readings (`hierarchy`): y ~ N(A s e, S). A mistake b
adds Z b to what is expected, Z by differences of the residual under changed data where it changes all runs.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise, permutations

import numpy as np

from testbench.data.dataset import Dataset, Mask, read_by
from testbench.errors import Array
from testbench.identify.diagnosis.finding import Tested, test
from testbench.identify.evidence import greatest, posterior
from testbench.identify.fold import reduce
from testbench.identify.hierarchy import evidence
from testbench.identify.metric import Metric
from testbench.identify.registered import station, unloaded
from testbench.identify.weighed import Readings, marker_points, one_by_one, white
from testbench.model.vjm import Vjm, chain, generalised_load, tool_pose, translation_rows

Change = Callable[[Dataset, Array], Dataset]
"""A dataset with a mistake of a size undone, (z,)."""
PLAY, STIFFER = 6e-5, 200.0
"""Half width of a joint's play or friction [rad, m], and the share by which it turns less, a radian [1/rad].

Typical sizes, as of `plant.TYPICAL`, and a little more."""
STEP = 1e-3  #: Of a mistake, for derivatives: mistakes enter almost linearly [1].
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


def learnt(vjm: Vjm, metric: Metric, data: Dataset) -> Learnt:
    """Learn the prior from a dataset; its readings against it."""
    structure = metric.structure
    seen = evidence(reduce(vjm, structure, data), metric)
    h = greatest(seen.problem, seen.start)
    read = one_by_one(vjm, structure, data)
    G = read.A.reshape(-1, structure.n) @ seen.metric.L
    s, kappa = np.exp(h[: seen.blocks])[seen.block], np.exp(h[-1])
    width = s * np.exp(np.where(seen.metric.couplings, h[-2], h[-3]))
    residual = read.y.ravel() - G @ (s * seen.metric.expected)
    half = G * width
    expected = np.concatenate([residual, np.zeros(len(width))])
    x = np.linalg.lstsq(np.vstack([half, kappa * np.eye(len(width))]), expected)[0]
    pi = seen.metric.L @ (s * seen.metric.expected + width * x)
    if vjm.arm.joints:
        half = np.hstack([half, allowed(vjm, data, structure.matrix(pi))])
    U, size, _ = np.linalg.svd(half, full_matrices=False)
    shared = U * (size / np.hypot(size, kappa) / kappa)
    surprise = residual / kappa**2 - shared @ (shared.T @ residual)
    least = posterior(seen.problem, h).loss
    return Learnt(vjm, seen.metric, data, read, least, pi, shared, surprise, h)


def allowed(vjm: Vjm, data: Dataset, C: Array) -> Array:
    """What joints of sound arms do beyond springs, (rows, 2 n) [standard deviations]: play, and stiffening.

    Args:
        vjm: The model.
        data: The runs.
        C: Compliance about which, (n_theta, n_theta).
    """
    where, first = chain(vjm, data.q), 6 * len(vjm.arm.links)
    own = np.diag(C)[first:, None] * generalised_load(where, data.wrench, data.point)[first:]
    moved = translation_rows(where, marker_points(vjm, data.markers))[:, first:]
    moved = moved.reshape(-1, 3, *moved.shape[1:])  # marker, axis, joint, run
    columns = []
    for k, turn in enumerate(own):
        for size in (PLAY * np.sign(turn), STIFFER * turn * np.abs(turn)):
            turned = (where.J_theta[3:, first + k] * size).T
            columns.append(white(data, (moved[:, :, k] * size).transpose(2, 0, 1), turned))
    return np.array(columns).reshape(len(columns), -1).T


@dataclass(frozen=True)
class Hypothesis:
    """A mistake, and how much likelier it makes the readings."""

    kind: str
    where: tuple[str, ...]  #: Run, target, station or level [N].
    tested: Tested
    unit: float  #: Of its size, SI.
    undo: Change | None = None  #: Undoes it in all runs; None for a mistake of single runs.

    @property
    def size(self) -> Array:
        """How large it looks, SI."""
        return self.unit * self.tested.b


def hypotheses(own: Learnt) -> Iterator[Hypothesis]:
    """Every mistake whose size enters linearly."""
    start = _left(own, own.data)
    for kind, where, z, unit, undo in _of_all(own.data):
        ends = (_left(own, undo(own.data, STEP * e)) for e in np.eye(z))
        Z = np.column_stack([(start - end) / STEP for end in ends])
        yield Hypothesis(kind, where, _tested(own, Z), unit, undo)
    yield from _single(own)


def _left(own: Learnt, data: Dataset) -> Array:
    """Readings minus predictions of a changed dataset, (k,)."""
    read = one_by_one(own.vjm, own.metric.structure, data)
    return np.asarray((read.y - read.A @ own.pi).ravel())


def _tested(own: Learnt, Z: Array, rows: slice = slice(None)) -> Tested:
    """A mistake that adds Z b, (rows, z) [standard deviations], to what is expected of some rows."""
    shared = own.shared[rows].T @ Z
    return test(Z.T @ own.surprise[rows], Z.T @ Z / own.misfit**2 - shared.T @ shared)


def _of_all(data: Dataset) -> Iterator[tuple[str, tuple[str, ...], int, float, Change]]:
    """Mistakes of all runs, of a station or of a level: kind, where, numbers, unit, and what undoes them."""
    force, centre = (
        float(np.linalg.norm(data.wrench[:, :3], axis=1).max()),
        data.after[data.seen].mean(axis=0),
    )
    if force > 0:
        size = FORCE * force
        yield "force_offset", (), 3, size, lambda d, b: pushed(d, d.wrench + np.pad(size * b, (0, 3)))
    yield "load_point", (), 3, POINT, lambda d, b: replace(d, point=d.point + POINT * b)
    for name in (station(one.frame) for one in unloaded(data)):
        own = read_by(data, name)[:, None, None]

        def still(d: Dataset, b: Array, own: Mask = own) -> Dataset:
            moved = SHIFT * (b[:3] + np.cross(b[3:], d.after - centre))
            return replace(d, after=np.where(own, d.after - moved, d.after))

        yield "tracker_moved", () if data.station is None else (str(name),), 6, SHIFT, still
    groups = levels(data)
    for mask in groups if len(groups) > 1 else ():
        load = np.linalg.norm(data.wrench[mask, :3], axis=1).mean()

        def weighed(d: Dataset, b: Array, mask: Mask = mask) -> Dataset:
            return pushed(d, d.wrench * np.where(mask, 1 + FACTOR * b[0], 1)[:, None])

        yield "level", (f"{load:.4g} N",), 1, FACTOR, weighed


def _single(own: Learnt) -> Iterator[Hypothesis]:
    """Single runs with another load, single runs and single readings that are of anything."""
    read, data = own.read, own.data
    expected = (read.A @ own.pi).ravel()
    size = BUMP / np.repeat(read.unit, 3)
    ends = np.searchsorted(read.run, np.arange(data.runs + 1))
    for r, (first, end) in enumerate(pairwise(ends)):
        if first == end:
            continue
        name, every = str(data.run[r]), slice(3 * first, 3 * end)
        yield Hypothesis("run_load", (name,), _tested(own, FACTOR * expected[every, None], every), FACTOR)
        yield Hypothesis("run", (name,), _tested(own, np.diag(size[every]), every), BUMP)
        for k in range(first, end):
            one, target = slice(3 * k, 3 * k + 3), read.marker[k]
            label = data.markers[target] if target >= 0 else "the tool's turn"
            yield Hypothesis("reading", (name, label), _tested(own, np.diag(size[one]), one), BUMP)


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


def pushed(data: Dataset, wrench: Array) -> Dataset:
    """The dataset with other loads, (runs, 6) [N, N m]."""
    return replace(data, wrench=wrench)


def other_loads(vjm: Vjm, data: Dataset) -> Iterator[tuple[str, tuple[str, ...], Dataset]]:
    """Mistakes of all loads that have no size: kind, what the loads are in truth, the data without it."""
    w, rotation = data.wrench.reshape(-1, 2, 3), tool_pose(vjm, data.q)[1]
    turned = np.einsum("rxy,rky->rkx", rotation, w)
    yield "force_axes", ("tool",), pushed(data, turned.reshape(-1, 6))
    for order in list(permutations(range(3)))[1:]:
        for sign, said in ((1, "+"), (-1, "-")):
            axes = "".join("xyz"[k] for k in order)
            yield "force_axes", (axes, said), pushed(data, sign * w[:, :, list(order)].reshape(-1, 6))
    groups = levels(data)
    sizes = [np.linalg.norm(data.wrench[own, :3], axis=1).mean() for own in groups]
    shifted = [np.roll(sizes, -k) for k in range(1, len(sizes))]
    for place, values in enumerate([*shifted, np.array(sizes[::-1])] if len(groups) > 1 else ()):
        factor = np.ones(data.runs)
        for own, size, value in zip(groups, sizes, values, strict=True):
            factor[own] = value / size
        named = ("reversed",) if place == len(shifted) else ()
        yield "levels", named, pushed(data, data.wrench * factor[:, None])
