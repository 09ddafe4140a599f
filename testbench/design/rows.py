"""Specification of a plan, and whitened rows: the information of a reading in a pose before it is taken.

Whitened rows F are rows of the observation matrix, Eq. (12), over the standard deviation of a deflection, per
unit of x, where pi = L x in units of the prior. The information of readings is F^T F. A candidate is a pose
with a load. `build_design_problem` restricts x to the directions that the candidates can observe.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.errors import Array, BenchError, Ids
from testbench.identify.absolute.state import compliance_unknowns
from testbench.identify.equations import jacobian, undeflected_arm
from testbench.identify.prior import PriorScaling, PriorUncertainty, prior_rows
from testbench.identify.regression import RANK_TOLERANCE
from testbench.model.load import Load
from testbench.model.vjm import Vjm, rigid_motion_matrix

SCALE_UNCERTAINTY = 10.0
"""Relative uncertainty of the scale common to all compliances [1]: so large that the readings decide."""
INFORMATION_RIDGE = 1e-13
"""Information added in every direction without a prior, over the candidates' mean [1]: keeps M invertible.

It is small enough: the weakest direction that MGCO56 observes under gravity has 2e-11 of the information of
the strongest one.
"""
CANDIDATES_PER_BLOCK = 128
"""Candidates whose products are computed at once: 128 of six rows of 89 numbers are 0.5 MB."""


@dataclass(frozen=True)
class MeasurementSetup:
    """Describe how every pose is measured: model, units of the unknowns, targets and noise."""

    vjm: Vjm  #: Virtual joint model of the arm.
    scaling: PriorScaling  #: Unknowns x in units of the prior, pi = L x.
    targets: Array  #: Points on the tool that are read, in the tool's frame, (m, 3) [m].
    sigma: float  #: Standard deviation of one reading along one axis [m].


@dataclass(frozen=True)
class Tasks:
    """Hold the poses and loads of the robot's work, at which its deflections are to be predicted."""

    q: Array  #: Actuated joints of the poses, (tasks, n) [rad, m].
    load: Load  #: Load in every pose: a wrench of the process or a hung weight.


@dataclass(frozen=True)
class PlanSpecification:
    """Specify a plan: the measurement, possible loads, tasks, workspace, prior and number of poses."""

    setup: MeasurementSetup  #: How every pose is measured.
    loads: tuple[Load, ...]  #: Possible loads; a plan chooses one for every pose.
    tasks: Tasks  #: Poses and loads of the robot's work.
    #: Poses of the predictions that the criteria I and G judge, under the first load, (poses, n) [rad, m].
    workspace_poses: Array
    #: Relative standard deviation of the prior [1]; None to plan for an identification without a prior.
    prior_uncertainty: float | None
    n_poses: int  #: Number of poses to measure.


@dataclass(frozen=True)
class DesignProblem:
    """Hold the whitened rows and the prior of all candidates, in the r directions that they can observe.

    The unknowns are x = e + B a + z. e is their expectation, the columns of the matrix B (`lift`) are the r
    observable directions, and a are the coordinates along these. No candidate observes the remainder z.
    """

    rows: Array  #: Whitened rows F of every candidate per unit of a, (candidates, k, r) [1].
    prior_information: Array  #: Information of the prior on a, (r, r) [1].
    lift: Array  #: Unknowns x per unit of a, (n, r) [1].
    #: Covariance of the rest of x, which no candidate reduces, (n, n) [1]; zero without a prior.
    remaining_covariance: Array
    #: Directions of x that no candidate observes and no prior bounds, (n, n - r); none with a prior, (n, 0).
    unobservable_directions: Array

    @property
    def n_directions(self) -> int:
        """Return the number r of directions of x that the candidates can observe."""
        return int(self.prior_information.shape[0])


def whitened_rows(setup: MeasurementSetup, q: Array, load: Load, basis: Array | None = None) -> Array:
    """Compute whitened rows of the deflections of all targets in every pose, Eq. (12) over sqrt(2) sigma.

    In the tool's axes the deflections of targets on a rigid tool are a constant matrix times its twist. The
    triangular factor of that matrix leaves k of at most six rows per pose.

    Mathematics: `pose-1`.

    Args:
        setup: How every pose is measured.
        q: Actuated joints, (poses, n_joints) [rad, m].
        load: Load, the same in all poses or with one row per pose.
        basis: Matrix of coordinates a in place of x, x = basis @ a, (n, r); None for x itself.

    Returns:
        Rows per unit of x, (poses, k, n), or of a, (poses, k, r) [1].

    Raises:
        BenchError: When the load has rows for another number of poses.
    """
    G: Array = np.asarray(np.linalg.qr(rigid_motion_matrix(setup.targets), mode="r"))
    return _rows(setup, q, load, G / (math.sqrt(2) * setup.sigma), basis)


def deflection_rows(setup: MeasurementSetup, q: Array, load: Load) -> Array:
    """Compute the deflections of the targets per unit of x, in the tool's axes, Eq. (12) with pi = L x.

    Args:
        setup: Model of the arm, units L of the prior, and m targets.
        q: Actuated joints, (poses, n_joints) [rad, m].
        load: Load, the same in all poses or with one row per pose.

    Returns:
        Deflections, three axes per target, (poses, 3 m, n) [m].

    Raises:
        BenchError: When the load has rows for another number of poses.
    """
    return _rows(setup, q, load, rigid_motion_matrix(setup.targets))


def task_rows(spec: PlanSpecification) -> Array:
    """Compute the deflections of the m targets at the tasks per unit of x, (tasks, 3 m, n) [m]."""
    return deflection_rows(spec.setup, spec.tasks.q, spec.tasks.load)


def workspace_rows(spec: PlanSpecification) -> Array:
    """Compute the deflections in the workspace under the first load per unit of x, (poses, 3 m, n) [m]."""
    return deflection_rows(spec.setup, spec.workspace_poses, spec.loads[0])


def select_loads(spec: PlanSpecification, load_index: Ids) -> Load:
    """Select the load of every pose by its index into the possible loads of a specification.

    Args:
        spec: Specification with its possible loads.
        load_index: Index of every pose's load, (poses,).

    Returns:
        The loads, one row per pose.
    """
    wrench, point = (
        np.stack([getattr(option, part) for option in spec.loads]) for part in ("wrench", "point")
    )
    return Load(wrench[load_index], point[load_index])


def whitened_rows_by_load(
    spec: PlanSpecification, q: Array, load_index: Ids, basis: Array | None = None
) -> Array:
    """Compute whitened rows of the deflections of all targets in poses, each under one of the possible loads.

    Args:
        spec: Specification with its possible loads.
        q: Actuated joints, (poses, n_joints) [rad, m].
        load_index: Index of every pose's load into the possible loads, (poses,).
        basis: Matrix of coordinates a in place of x, x = basis @ a, (n, r); None for x itself.

    Returns:
        Rows per unit of x, (poses, k, n), or of a, (poses, k, r) [1].
    """
    return whitened_rows(spec.setup, q, select_loads(spec, load_index), basis)


def candidate_rows(spec: PlanSpecification, q: Array, load_index: Ids) -> Array:
    """Compute whitened rows of many candidates in blocks, whose memory is used again and again.

    Fresh memory for thousands of candidates at once takes longer than their rows.

    Args:
        spec: Specification with its loads.
        q: Actuated joints, (candidates, n_joints) [rad, m].
        load_index: Index into the specification's loads, (candidates,).

    Returns:
        Rows per unit of x, (candidates, k, n) [1].
    """
    parts = np.array_split(np.arange(len(q)), -(-len(q) // CANDIDATES_PER_BLOCK))
    return np.concatenate([whitened_rows_by_load(spec, q[part], load_index[part]) for part in parts])


def _rows(setup: MeasurementSetup, q: Array, load: Load, motion: Array, basis: Array | None = None) -> Array:
    """Compute motion (k, 6) times the tool's twist per unit of x or a, in the tool's own axes, (poses, k, n).

    See `whitened_rows`.
    """
    equilibrium, scaling = undeflected_arm(setup.vjm, q, [load.for_poses(len(q))]), setup.scaling
    unknowns = compliance_unknowns(setup.vjm, scaling.structure)
    A = jacobian(unknowns, equilibrium, np.zeros((1, 3)), with_orientation=True)[:, :, :-1]
    # twist in world axes, pose by pose, then the motion of its turned translation and rotation
    twist = np.ascontiguousarray(A.transpose(3, 0, 1, 2)).reshape(len(q), 6, -1)
    turned = np.einsum("ksy,rxy->rksx", motion.reshape(-1, 2, 3), equilibrium.chain.tool_rotation)
    X = scaling.L if basis is None else scaling.L @ basis
    return np.asarray(turned.reshape(len(q), -1, 6) @ row_products(twist, X))


def row_products(rows: Array, X: Array) -> Array:
    """Multiply the rows of many poses by a matrix, rows @ X, as one product.

    One product per pose takes two to three times as long.

    Args:
        rows: Rows of every pose, (poses, k, n).
        X: Matrix, (n, r).

    Returns:
        rows @ X, (poses, k, r).
    """
    return np.asarray((rows.reshape(-1, len(X)) @ X).reshape(*rows.shape[:2], -1))


def split_into_blocks(rows: Array) -> list[Array]:
    """Split the rows of many candidates into blocks whose products stay in the processor's cache.

    Products of thousands of candidates at once take a third longer, and memory that is new each time.

    Args:
        rows: Rows of every candidate, (candidates, k, r).

    Returns:
        Blocks of rows in order, of at most `CANDIDATES_PER_BLOCK` candidates; one empty block for none.
    """
    return np.split(rows, range(CANDIDATES_PER_BLOCK, len(rows), CANDIDATES_PER_BLOCK))


def build_design_problem(
    setup: MeasurementSetup, rows: Array, prior_uncertainty: float | None
) -> DesignProblem:
    """Restrict the unknowns to the directions that the candidates can observe, and project the prior on them.

    Mathematics: `pose-3`.

    Args:
        setup: Measurement, with the units of the prior.
        rows: Whitened rows of every candidate per unit of x, (candidates, k, n) [1].
        prior_uncertainty: Relative standard deviation of the prior [1]; None for no prior.

    Returns:
        The rows and the prior in coordinates a of the observable directions, and x per unit of a.

    Raises:
        BenchError: When no candidate moves a target.
    """
    n = rows.shape[-1]
    # observable directions of x, and the rest, by the triangular factor of the blocks' factors
    factors = [np.linalg.qr(block.reshape(-1, n), mode="r") for block in split_into_blocks(rows)]
    _, s, Vt = np.linalg.svd(np.linalg.qr(np.concatenate(factors), mode="r"))
    if not s[0] > 0:
        raise BenchError("candidates: expected loads that move a target; these change no reading")
    r = int((s > RANK_TOLERANCE * s[0]).sum())
    seen, rest = Vt[:r].T, Vt[r:].T
    if prior_uncertainty is None:
        ridge = INFORMATION_RIDGE * float(s[0] ** 2) / len(rows) * np.eye(r)
        return DesignProblem(row_products(rows, seen), ridge, seen, np.zeros((n, n)), rest)
    B, _ = prior_rows(setup.scaling, PriorUncertainty(prior_uncertainty, SCALE_UNCERTAINTY))
    M = B.T @ B
    # the rest follows the seen part in the prior's mean; its Schur complement is the prior on the seen part
    covariance = np.linalg.inv(rest.T @ M @ rest)
    follow = covariance @ (rest.T @ M @ seen)
    prior = seen.T @ M @ seen - (seen.T @ M @ rest) @ follow
    lift = seen - rest @ follow
    return DesignProblem(row_products(rows, seen), prior, lift, rest @ covariance @ rest.T, np.zeros((n, 0)))


def information(problem: DesignProblem, chosen: Sequence[int] | Ids) -> Array:
    """Compute the information matrix of a plan, M = prior + sum F^T F over its poses.

    Mathematics: `pose-2`.

    Args:
        problem: Whitened rows F of all candidates, and the prior's information.
        chosen: Indices of the candidates in the plan, (poses,); one may be chosen several times.

    Returns:
        M, (r, r) [1].
    """
    return add_information(problem.prior_information, problem.rows[np.asarray(chosen, dtype=int)])


def suffix_information(rows: Array) -> Array:
    """Compute the sum of F^T F from every pose of a plan to its last one.

    The information without one pose is the sum over the poses before and after it. A difference would lose
    the digits that only that pose contributes.

    Args:
        rows: Whitened rows F of every pose of the plan, (poses, k, r).

    Returns:
        Sums in order of their first pose, and zero after the last, (poses + 1, r, r) [1].
    """
    r = rows.shape[2]
    sums = np.zeros((len(rows) + 1, r, r))
    for k in range(len(rows) - 1, -1, -1):
        sums[k] = sums[k + 1] + rows[k].T @ rows[k]
    return sums


def add_information(prior_information: Array, rows: Array) -> Array:
    """Compute the information matrix M = prior + sum F^T F of readings in some poses.

    Args:
        prior_information: Information before the readings, (r, r) [1].
        rows: Whitened rows F of every pose, (poses, k, r).

    Returns:
        M, (r, r) [1].
    """
    A = rows.reshape(-1, prior_information.shape[0])
    return np.asarray(prior_information + A.T @ A)
