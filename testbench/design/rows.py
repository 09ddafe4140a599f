"""What a plan is for, and what a reading in a pose tells of the unknowns before it is taken."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.errors import Array, BenchError, Ids
from testbench.identify.absolute.unknowns import compliances
from testbench.identify.metric import Metric, precision_root
from testbench.identify.prior import Strength
from testbench.identify.regression import RANK_TOLERANCE
from testbench.identify.rows import jacobian, straight
from testbench.model.load import Load
from testbench.model.vjm import Vjm, skew

SCALE_UNCERTAINTY = 10.0
"""Relative uncertainty of the scale common to all compliances [1]: left to the data, but finite."""
RIDGE = 1e-13
"""Information without a prior, over the mean of the candidates: only keeps the first poses invertible.

The weakest direction that MGCO56 shows under gravity has 2e-11 of the strongest one's information.
"""


@dataclass(frozen=True)
class Experiment:
    """How every pose is measured."""

    vjm: Vjm  #: The model.
    metric: Metric  #: The unknowns in units of what a prior expects.
    targets: Array  #: Points that the tracker reads, in the tool's frame, (m, 3) [m].
    sigma: float  #: Standard deviation of one reading along one axis [m].


@dataclass(frozen=True)
class Tasks:
    """Where the robot works, and under which load."""

    q: Array  #: Actuated joints, (tasks, n) [rad, m].
    load: Load  #: In each of them; a wrench of the process or a hung weight.


@dataclass(frozen=True)
class Specification:
    """What a plan is for."""

    experiment: Experiment  #: How poses are measured.
    loads: tuple[Load, ...]  #: What may be hung; a plan chooses for every pose.
    tasks: Tasks  #: Where predictions are wanted.
    #: Poses over which the criteria I and G judge, under the first load, (poses, n) [rad, m].
    workspace: Array
    #: Relative uncertainty of the prior [1]; None to plan for an identification without one.
    uncertainty: float | None
    poses: int  #: How many may be measured.


@dataclass(frozen=True)
class Problem:
    """Candidates to choose from, in the coordinates that their loads can show.

    The unknowns are x = expected + lift a + what no candidate shows; a has the prior's information.
    """

    rows: Array  #: Readings per unit of a over their standard deviation, (candidates, k, r) [1].
    prior: Array  #: Information on a before any reading, (r, r).
    lift: Array  #: x per unit of a, (n, r).
    #: Covariance of x that stays whatever is measured, (n, n); infinite entries are left at zero.
    hidden: Array
    #: Directions of x that no candidate shows and no prior bounds, (n, n - r); (n, 0) with a prior.
    unseen: Array

    @property
    def r(self) -> int:
        """Number of directions that the candidates can show."""
        return int(self.prior.shape[0])


def reading_rows(experiment: Experiment, q: Array, load: Load) -> Array:
    """Whitened rows of a loaded and an unloaded reading of all targets in every pose.

    In the tool's axes the deflections of targets on a rigid tool are a constant matrix times its twist; the
    triangular factor of that matrix leaves at most six rows a pose, Eq. (12): (poses, k, n) [1].
    """
    G: Array = np.asarray(np.linalg.qr(marker_motion(experiment.targets), mode="r"))
    return _rows(experiment, q, load, G / (math.sqrt(2) * experiment.sigma))


def deflection_rows(experiment: Experiment, q: Array, load: Load) -> Array:
    """Deflections of the targets per unit of x, in the tool's axes, (poses, 3 m, n) [m]."""
    return _rows(experiment, q, load, marker_motion(experiment.targets))


def task_rows(spec: Specification) -> Array:
    """Deflections in the tasks per unit of x, (tasks, 3 m, n) [m]."""
    return deflection_rows(spec.experiment, spec.tasks.q, spec.tasks.load)


def workspace_rows(spec: Specification) -> Array:
    """The same over the workspace under the first load, (poses, 3 m, n) [m]."""
    return deflection_rows(spec.experiment, spec.workspace, spec.loads[0])


def loads_of(spec: Specification, load: Ids) -> Load:
    """The load of every pose, from its index into the specification's loads, (poses,)."""
    wrench, point = (np.stack([getattr(each, part) for each in spec.loads]) for part in ("wrench", "point"))
    return Load(wrench[load], point[load])


def measured_rows(spec: Specification, q: Array, load: Ids) -> Array:
    """Whitened rows of poses (poses, n) [rad, m], each under its own load (poses,), (poses, k, n) [1]."""
    return reading_rows(spec.experiment, q, loads_of(spec, load))


def problem_of(spec: Specification, q: Array, load: Ids) -> Problem:
    """Poses (poses, n) [rad, m] as candidates, each under its own load (poses,)."""
    return build_problem(spec.experiment, measured_rows(spec, q, load), spec.uncertainty)


def _rows(experiment: Experiment, q: Array, load: Load, motion: Array) -> Array:
    """Of the tool's twist, motion (k, 6), per unit of x: in its own axes, (poses, k, n)."""
    told, metric = straight(experiment.vjm, q, [load.over(len(q))]), experiment.metric
    unknowns = compliances(experiment.vjm, metric.structure)
    A = jacobian(unknowns, told, np.zeros((1, 3)), turned=True)[:, :, :-1]
    twist = np.einsum("rxy,sxcr->rsyc", told.where.rotation, A, optimize=True)
    return np.asarray(motion @ (twist.reshape(len(q), 6, -1) @ metric.L))


def marker_motion(points: Array) -> Array:
    """How markers at (m, 3) [m] move per unit twist of the tool, all in the tool's frame, (3 m, 6) [1, m]."""
    turns = np.array([skew(point).T for point in points])
    return np.concatenate([np.broadcast_to(np.eye(3), turns.shape), turns], axis=2).reshape(-1, 6)


def times(rows: Array, X: Array) -> Array:
    """Rows (poses, k, n) times (n, r), as one product: one a pose takes two to three times as long."""
    return np.asarray((rows.reshape(-1, len(X)) @ X).reshape(*rows.shape[:2], -1))


def build_problem(experiment: Experiment, rows: Array, uncertainty: float | None) -> Problem:
    """Candidates, whitened rows (candidates, k, n), in the coordinates that they can show.

    The prior's uncertainty is relative [1], None for no prior. BenchError where no candidate moves a target.
    """
    n = rows.shape[-1]
    R: Array = np.asarray(np.linalg.qr(rows.reshape(-1, n), mode="r"))
    _, s, Vt = np.linalg.svd(R)
    if not s[0] > 0:
        raise BenchError("candidates: expected loads that move a target, no reading changes under them")
    r = int((s > RANK_TOLERANCE * s[0]).sum())
    seen, rest = Vt[:r].T, Vt[r:].T
    if uncertainty is None:
        ridge = RIDGE * float(s[0] ** 2) / len(rows) * np.eye(r)
        return Problem(times(rows, seen), ridge, seen, np.zeros((n, n)), rest)
    B, _ = precision_root(experiment.metric, Strength(uncertainty, SCALE_UNCERTAINTY))
    M = B.T @ B
    covariance = np.linalg.inv(rest.T @ M @ rest)
    follow = covariance @ (rest.T @ M @ seen)
    prior = seen.T @ M @ seen - (seen.T @ M @ rest) @ follow
    lift = seen - rest @ follow
    return Problem(times(rows, seen), prior, lift, rest @ covariance @ rest.T, np.zeros((n, 0)))


def information(problem: Problem, chosen: Sequence[int] | Ids) -> Array:
    """Information matrix M of a plan, prior included, (r, r); a candidate may be chosen several times."""
    return total(problem.prior, problem.rows[np.asarray(chosen, dtype=int)])


def behind(rows: Array) -> Array:
    """What the poses from each one on tell, and from none, rows (poses, k, r) to (poses + 1, r, r).

    With what those before tell, information without one pose after the other is a sum: a difference would
    lose the digits of what that pose alone tells.
    """
    r = rows.shape[2]
    found = np.zeros((len(rows) + 1, r, r))
    for k in range(len(rows) - 1, -1, -1):
        found[k] = found[k + 1] + rows[k].T @ rows[k]
    return found


def total(prior: Array, rows: Array) -> Array:
    """Information after rows (poses, k, r) were read, prior included, (r, r)."""
    A = rows.reshape(-1, prior.shape[0])
    return np.asarray(prior + A.T @ A)
