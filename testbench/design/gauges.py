"""Places of gauges: in every pose of a plan, which markers are read and along which axes.

A gauge reads one number, so that a pose offers a choice that a tracker does not have. A candidate is a pose
with some of its markers, each touched along an axis of the world or of the tool. Candidates are chosen by the
criterion of the poses. A tilt of the direction counts as noise: gauges avoid directions across a large
deflection.
"""

from dataclasses import dataclass
from itertools import combinations, cycle, islice, product

import numpy as np

from testbench.design.criteria import Criterion
from testbench.design.exchange import exchange, greedy, sensitivity
from testbench.design.rows import DesignProblem, Specification, deflection_rows, loads_of, row_products
from testbench.errors import Array, BenchError, Ids
from testbench.model.vjm import tool_pose

MIN_GAIN, SWEEPS = 1e-6, 20
"""Relative gain of Phi below which an exchange does not count [1]; most passes over all poses."""


@dataclass(frozen=True)
class Gauges:
    """Describe the gauges that are available."""

    count: int  #: Number of gauges per pose, each at a different marker.
    sigma: float  #: Standard deviation of one reading [m].
    tilt: float  #: Standard deviation of a direction about each axis across it [rad].


@dataclass(frozen=True)
class GaugePlan:
    """Hold the gauges of every pose of a plan."""

    pose: Ids  #: Indices of the poses among the candidates, (poses,).
    marker: Ids  #: Index of the marker of every gauge, (poses, count).
    axis: Ids  #: Axis of every gauge, 0 to 2 for x, y, z, (poses, count).
    information: Array  #: Information matrix M of all readings, prior included, (r, r).


def gauge_rows(spec: Specification, q: Array, load: Ids, gauges: Gauges, lift: Array) -> Array:
    """Compute whitened rows of a gauge at every marker along every axis.

    The row is u . J over sqrt(2 sigma^2 + tilt^2 |u x d|^2), d the deflection that the prior expects.

    Args:
        spec: Specification of the plan.
        q: Actuated joints, (poses, n) [rad, m].
        load: Index into the specification's loads, (poses,).
        gauges: The gauges.
        lift: Unknowns x per unit of the coordinates a, (n, r).

    Returns:
        Rows per unit of a, (poses, m, 3, r) [1].
    """
    D = _motions(spec, q, load)
    poses, markers = D.shape[:2]
    deviation = _deviations(D @ spec.experiment.scaling.expected, gauges)
    rows = D.reshape(poses, markers * 3, -1) / deviation.reshape(poses, -1, 1)
    return row_products(rows, lift).reshape(poses, markers, 3, -1)


def _motions(spec: Specification, q: Array, load: Ids) -> Array:
    """Compute motions of all markers per unit of x along world axes, (poses, m, 3, n) [m]."""
    D = deflection_rows(spec.experiment, q, loads_of(spec, load))  # tool axes
    D = D.reshape(len(q), len(spec.experiment.targets), 3, -1)
    return np.asarray(np.einsum("pxy,pmyn->pmxn", tool_pose(spec.experiment.vjm, q)[1], D))


def _deviations(d: Array, gauges: Gauges) -> Array:
    """Compute the deviation of a gauge along each axis u under the motions d, (poses, m, 3) [m]."""
    across = (d**2).sum(axis=2, keepdims=True) - d**2  # |u x d|^2
    return np.asarray(np.sqrt(2 * gauges.sigma**2 + gauges.tilt**2 * across))


@dataclass(frozen=True)
class PlacedGauges:
    """Hold the gauges of a plan in the order of measuring."""

    gauges: Gauges  #: Number and accuracy of the gauges.
    marker: Ids  #: Index of the marker of every gauge, (poses, count).
    axis: Ids  #: Axis of every gauge, 0 to 2 for x, y, z, (poses, count).
    deviation: Array  #: Standard deviation of every reading, a tilt included, (poses, count) [m].

    def rows(self, spec: Specification, q: Array, load: Ids) -> Array:
        """Compute whitened rows of the gauges per unit of a specification's unknowns x.

        Args:
            spec: Specification with its unknowns and loads.
            q: The plan's poses, (poses, n) [rad, m].
            load: Index into the specification's loads, (poses,).

        Returns:
            Rows, (poses, count, n) [1].
        """
        D = _motions(spec, q, load)
        return np.asarray(D[np.arange(len(q))[:, None], self.marker, self.axis] / self.deviation[..., None])


def placed_gauges(
    spec: Specification, q: Array, load: Ids, gauges: Gauges, chosen: GaugePlan
) -> PlacedGauges:
    """Collect the gauges of a plan with the deviation of their readings, as `gauge_rows` counts it.

    Args:
        spec: Specification of the plan.
        q: The plan's poses, (poses, n) [rad, m].
        load: Index into the specification's loads, (poses,).
        gauges: The gauges.
        chosen: Their markers and axes.
    """
    d = _motions(spec, q, load) @ spec.experiment.scaling.expected
    index = np.arange(len(q))[:, None], chosen.marker, chosen.axis
    return PlacedGauges(gauges, chosen.marker, chosen.axis, _deviations(d, gauges)[index])


def most_informative_gauges(rows: Array, Z: Array, count: int) -> tuple[Ids, Ids, Array]:
    """Choose the gauges of each pose by a plane of the criterion: each marker's best axis, the best markers.

    Args:
        rows: Rows of the poses, `gauge_rows`, (poses, m, 3, r) [1].
        Z: Matrix of a supporting plane, (r, r).
        count: How many gauges are read in a pose.

    Returns:
        Markers and axes, (poses, count) each, and the sensitivity <Z, F^T F> of the poses, (poses,).
    """
    sensitivities = sensitivity(rows.reshape(-1, 1, rows.shape[-1]), Z).reshape(rows.shape[:3])
    best = sensitivities.max(axis=2)
    marker = np.sort(np.argsort(-best, axis=1, kind="stable")[:, :count], axis=1)
    every = np.arange(len(rows))[:, None]
    return marker, sensitivities.argmax(axis=2)[every, marker], best[every, marker].sum(axis=1)


def choose_places(
    rows: Array, problem: DesignProblem, criterion: Criterion, gauges: Gauges, poses: int
) -> GaugePlan:
    """Choose poses, and the gauges in each of them, by exchange over all of both.

    Args:
        rows: Rows of all candidates, `gauge_rows`, (candidates, m, 3, r) [1].
        problem: Gives the prior's information.
        criterion: Information function.
        gauges: The gauges.
        poses: How many poses are measured.

    Returns:
        The poses with their gauges; a pose may occur more than once.

    Raises:
        BenchError: When there are more gauges than markers.
    """
    marker, axis = _gauge_choices(rows.shape[1], gauges.count)
    every = rows[:, marker, axis].reshape(-1, *rows[0][marker, axis].shape[1:])
    chosen = exchange(problem, criterion, every, greedy(problem, criterion, every, poses))
    pose, way = np.divmod(np.sort(chosen), len(marker))
    A = every[chosen].reshape(-1, every.shape[-1])
    return GaugePlan(pose, marker[way], axis[way], problem.prior + A.T @ A)


def choose_gauges(rows: Array, problem: DesignProblem, criterion: Criterion, gauges: Gauges) -> GaugePlan:
    """Choose the gauges in given poses: each pose in turn, until no pose gains by other gauges.

    Args:
        rows: Rows of the poses, `gauge_rows`, (poses, m, 3, r) [1].
        problem: Gives the prior's information.
        criterion: Information function.
        gauges: The gauges.

    Returns:
        The gauges of all poses, in their order.

    Raises:
        BenchError: When there are more gauges than markers.
    """
    marker, axis = _gauge_choices(rows.shape[1], gauges.count)
    every, poses = rows[:, marker, axis], len(rows)
    M, way, left = problem.prior, np.full(poses, -1), poses
    for p in islice(cycle(range(poses)), SWEEPS * poses):
        present = every[p, way[p]] if way[p] >= 0 else np.zeros_like(every[p, 0])
        rest = M - present.T @ present
        reached = criterion.with_candidate(rest, every[p])
        better = way[p] < 0 or reached.max() > (1 + MIN_GAIN) * reached[way[p]]
        way[p] = int(reached.argmax()) if better else way[p]
        M = rest + every[p, way[p]].T @ every[p, way[p]]
        left = poses if better else left - 1
        if left == 0:
            break
    return GaugePlan(np.arange(poses), marker[way], axis[way], M)


def _gauge_choices(markers: int, count: int) -> tuple[Ids, Ids]:
    """List markers and axes of all ways to place gauges in a pose, (ways, count) each."""
    if not 1 <= count <= markers:
        raise BenchError(f"gauges: expected 1 to {markers}, one per marker, got {count}")
    choices = [(m, a) for m in combinations(range(markers), count) for a in product(range(3), repeat=count)]
    marker, axis = zip(*choices, strict=True)
    return np.array(marker), np.array(axis)
