"""What would help: the same poses measured in another way, judged by rank and expected prediction error."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_triangular

from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify.fold import reduce
from testbench.identify.metric import Metric, whitened
from testbench.identify.regression import Regression, rank
from testbench.identify.weighed import marker_points
from testbench.model.vjm import Vjm, chain, observation

OFFSET = 0.3  #: Distance of a second load point or of one more marker [m].
SIGMA_ROTATION = 250e-6
"""Standard deviation of one orientation reading where the data have none, as in section 5.2 [rad]."""
REPEAT = "the same runs once more"  #: The yardstick: what only averages noise is no better.
TASKS = 50  #: Random poses in which predictions are judged.
TIE = 0.02  #: Expected errors within this share of each other are the same.
BLIND = 1e-12
"""Share of the largest diagonal entry of a posterior's triangular factor below which it is singular."""


@dataclass(frozen=True)
class Tasks:
    """Where predictions are wanted: random poses, the loads of the data, the data's markers."""

    rows: Array  #: Deflections per unit of x, (poses, 3 m, n) [m].
    deflection: float  #: RMS distance that a marker is expected to move [m].


@dataclass(frozen=True)
class Proposal:
    """One more way to measure, and what it would bring."""

    words: str  #: What to do.
    rank: int  #: Directions that all data then see.
    #: RMS distance of predicted from true deflections then to be expected [m]; infinite if nothing fixes the
    #: common scale.
    error: float
    place: int  #: 1 for the best; ties share it.


def imagined(data: Dataset, **changes: object) -> Dataset:
    """The dataset with other runs, markers or loads, and all readings zero: only its rows are wanted."""
    other = {"run": data.run, "q": data.q, "markers": data.markers, **changes}
    runs, markers = len(np.asarray(other["run"])), len(tuple(other["markers"]))  # type: ignore[arg-type]
    blank = np.zeros((runs, markers, 3))
    turned = None if data.rotation_before is None else np.zeros((runs, 3))
    plain = {"precision": None, "station": None}
    fields = {"rotation_before": turned, "rotation_after": turned, **plain, **other}
    return replace(data, before=blank, after=blank, **fields)  # type: ignore[arg-type]


def more_poses(vjm: Vjm, data: Dataset, count: int, *, seed: int) -> Dataset:
    """Runs in random poses within the joint limits, under the loads of the data in turn.

    Where the data have more runs than are asked for, these are evenly spaced among them.
    """
    lower, upper = vjm.arm.limits
    rng = np.random.Generator(np.random.Philox(seed))
    q = rng.uniform(lower, upper, (count, vjm.arm.n_joints))
    turn = np.arange(count) % data.runs
    if data.runs > count:
        turn = np.linspace(0, data.runs - 1, count).astype(int)
    ids = np.arange(count)
    return imagined(data, run=ids, pose=ids, q=q, wrench=data.wrench[turn], point=data.point[turn])


def tasks(vjm: Vjm, data: Dataset, metric: Metric) -> Tasks:
    """The predictions that are wanted."""
    wanted = more_poses(vjm, data, TASKS, seed=1)
    args = (chain(vjm, wanted.q), metric.structure, wanted.wrench, wanted.point)
    A = observation(*args, marker_points(vjm, data.markers)) @ metric.L
    moved = np.linalg.norm(A @ metric.expected, axis=-1)
    return Tasks(A.reshape(TASKS, -1, metric.structure.n), math.sqrt(np.square(moved).mean()))


def posterior(*rows: Array) -> Array | None:
    """Triangular factor R, (n, n): x has the covariance (R^T R)^-1; None where a direction has no bound."""
    R: Array = np.asarray(np.linalg.qr(np.vstack(rows), mode="r"))
    size = np.abs(np.diag(R))
    return R if size.min() > BLIND * size.max() else None


def variances(R: Array | None, rows: Array) -> Array:
    """Posterior variance, (k,), of linear functions of x, (k, n), by the posterior's factor or None."""
    if R is None:
        return np.full(len(rows), np.inf)
    return np.asarray((solve_triangular(R, rows.T, trans="T") ** 2).sum(axis=0))


def expected_error(wanted: Tasks, R: Array | None) -> float:
    """RMS distance between predicted and true deflection of a marker, posterior [m]."""
    rows = wanted.rows
    variance = variances(R, rows.reshape(-1, rows.shape[-1]))
    return math.sqrt(3 * variance.mean())  # three axes a marker


def proposals(
    vjm: Vjm, data: Dataset, regression: Regression, metric: Metric, prior_rows: Array
) -> tuple[Proposal, ...]:
    """Every way to measure more, the best first; `prior_rows`, (n, n), add to those of the data."""
    wanted = tasks(vjm, data, metric)
    now = whitened(regression, metric)[0]
    seen = np.vstack([term.R for term in regression.terms])
    found = []
    for words, more in _rows(vjm, data, regression):
        rows = whitened(more, metric)[0]
        error = expected_error(wanted, posterior(now, rows, prior_rows))
        found.append(Proposal(words, rank(np.vstack([seen, *(t.R for t in more.terms)])), error, 0))
    return _placed(sorted(found, key=lambda p: (p.error, -p.rank)))


def _placed(found: list[Proposal]) -> tuple[Proposal, ...]:
    placed: list[Proposal] = []
    first = 0
    for k, proposal in enumerate(found):
        best = found[first]
        if proposal.error > (1 + TIE) * best.error or proposal.rank != best.rank:
            first = k
        placed.append(replace(proposal, place=first + 1))
    return tuple(placed)


def _rows(vjm: Vjm, data: Dataset, regression: Regression) -> Iterator[tuple[str, Regression]]:
    """What each proposal adds, reduced."""
    structure = regression.structure
    for words, extra in _loads(data):
        yield words, reduce(vjm, structure, imagined(data, **extra))
    poses = np.unique(data.q, axis=0, return_inverse=True)[1].ravel()
    fresh = more_poses(vjm, data, poses.max() + 1, seed=2).q[poses]
    yield "as many poses again at random", reduce(vjm, structure, imagined(data, q=fresh))
    points = marker_points(vjm, data.markers)
    name = f"one more marker off the {'plane' if len(points) > 2 else 'line'} of the {len(points)}"
    name = "a second marker" if len(points) == 1 else name
    marker = reduce(with_marker(vjm, points, name), structure, imagined(data, markers=(name,)))
    yield name, replace(marker, terms=marker.terms[:1])
    if data.rotation_before is None:
        blank = np.zeros((data.runs, 3))
        turned = replace(
            imagined(data), rotation_before=blank, rotation_after=blank, sigma_rotation=SIGMA_ROTATION
        )
        read = reduce(vjm, structure, turned)
        yield (
            f"orientation of the tool read to {1e6 * SIGMA_ROTATION:g} urad",
            replace(read, terms=read.terms[1:]),
        )


def _loads(data: Dataset) -> Iterator[tuple[str, dict[str, Array]]]:
    yield REPEAT, {}
    yield "half the load", {"wrench": data.wrench / 2}
    force = np.linalg.norm(data.wrench[:, :3], axis=1)
    if force.any():
        for k, axis in enumerate("xy"):
            side = np.zeros((data.runs, 6))
            side[:, k] = force
            yield f"the force as a side load along world {axis}", {"wrench": side}
        for k, axis in enumerate("xyz"):
            point = data.point + OFFSET * np.eye(3)[k]
            yield f"load point moved {OFFSET:g} m along tool {axis}", {"point": point}


def with_marker(vjm: Vjm, points: Array, name: str) -> Vjm:
    """The model with one more marker, fixed to the tool off the line or plane of others, (m, 3) [m]."""
    centre = points.mean(axis=0)
    away = np.linalg.svd(points - centre)[2][-1]
    arm = replace(vjm.arm, markers=(*vjm.arm.markers, name))
    return replace(vjm, arm=arm, markers=np.vstack([vjm.markers, centre + OFFSET * away]))
