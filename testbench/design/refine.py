"""Local refinement of a plan: from the best candidates to better joint angles, pose after pose.

It is a random search with a shrinking step, an evolution strategy with one parent. Many neighbours of a pose
are judged at once by updates of the information matrix. Only those that would help are checked for
feasibility.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from testbench.design.criteria import Criterion
from testbench.design.relaxation import sensitivity
from testbench.design.rows import suffix_information, sum_information
from testbench.errors import Array, Ids, Mask
from testbench.progress import stepwise

NEIGHBOURS = 32  #: Neighbours of a pose that are judged at a time by `refine_plan`.
#: Neighbours of a pose that are judged at a time by `ascend_poses`, where many poses climb at once.
ASCEND_NEIGHBOURS = 16
REFINE_ROUNDS, ASCEND_ROUNDS = 22, 14  #: Rounds of `refine_plan` and of `ascend_poses`.
STEP, SHRINK = 0.25, 0.7
"""First standard deviation of a joint's step [rad], and its factor after a round without gain."""
CHECKED_NEIGHBOURS = 8  #: Neighbours, the best first, whose feasibility is checked in a round.
MIN_REFINEMENT = 1e-6  #: Relative gain below which a step does not count [1].

POSES_AT_ONCE = 32  #: Poses of the plan whose neighbours' rows are computed together.

Rows = Callable[[Array, Ids], Array]
"""Function of joints (poses, n) [rad, m] and places in the plan (poses,) to whitened rows (poses, k, r).

Each pose is measured as the pose in its place of the plan is, such as under the same load.
"""
Measured = Callable[[Array, Ids, Array | None], Array]
"""Function of joints (poses, n) [rad, m], loads (poses,) and lift (n, r) to whitened rows (poses, k, r).

Rows are per unit of a, where x = lift @ a, or of x itself where the lift is None.
"""
Feasible = Callable[[Array], Mask]
"""Function of joints (poses, n) [rad, m] to whether each pose is feasible, (poses,)."""


@dataclass(frozen=True)
class Feasibility:
    """Tell where the arm can go: which poses are feasible, and which ways between two poses are clear."""

    feasible: Feasible  #: Which poses (poses, n) [rad, m] the arm can take and the tracker can see.
    #: Whether the arm can go straight from one pose (n,) to another [rad].
    clear: Callable[[Array, Array], bool] = lambda _start, _end: True


@dataclass(frozen=True)
class Search:
    """Describe how poses are searched for, whatever they are measured for."""

    measured: Measured  #: Whitened rows of poses, each under its own load, whose index is given.
    poses: int  #: Number of poses to measure.
    limits: Array  #: Lower and upper joint limits, (2, n) [rad, m].
    #: Which poses near the candidates are feasible, and which ways between them are clear.
    reach: Feasibility
    rng: np.random.Generator  #: Source of starts and steps.
    #: Function that moves dependent joints of poses, (..., n) [rad, m], to where the others bring them.
    followed: Callable[[Array], Array] = lambda q: q

    def around(self, q: Array, step: Array) -> Array:
        """Draw poses around others within the joint limits, with normal steps.

        Args:
            q: Actuated joints, (..., n) [rad, m].
            step: Standard deviation of the step, (..., n) [rad, m]; broadcasts with q.

        Returns:
            Poses, (..., n) [rad, m].
        """
        shape = np.broadcast_shapes(q.shape, step.shape)
        return self.followed(np.clip(q + step * self.rng.standard_normal(shape), *self.limits))


def refine_plan(q: Array, prior: Array, criterion: Criterion, rows: Rows, search: Search) -> Array:
    """Improve the joint angles of every pose of a plan; no step makes the criterion worse.

    Args:
        q: Poses of the plan, (poses, n) [rad, m].
        prior: Information before any reading, (r, r).
        criterion: Information function.
        rows: Function that gives whitened rows of poses, each measured as the pose in its place of the plan.
        search: Limits, feasibility and source of the steps.

    Returns:
        Improved poses, (poses, n) [rad, m].
    """
    q, step, own = q.copy(), np.full(len(q), STEP), rows(q, np.arange(len(q)))
    M = sum_information(prior, own)
    for _ in stepwise(range(REFINE_ROUNDS), "refining poses"):
        before, after = prior, suffix_information(own)
        for places in np.array_split(np.arange(len(q)), -(-len(q) // POSES_AT_ONCE)):
            # neighbours of some poses at once, (places, NEIGHBOURS, n), and what they would tell
            trials = search.around(q[places, None], np.tile(step[places, None, None], (NEIGHBOURS, 1)))
            seen = rows(trials.reshape(-1, q.shape[1]), np.repeat(places, NEIGHBOURS))
            for k, trial, tells in zip(places, trials, np.split(seen, len(places)), strict=True):
                rest = before + after[k + 1]
                # the best feasible neighbour that helps replaces the pose; without one its step shrinks
                better = _better(criterion, M, own[k], tells, rest)
                allowed = better[search.reach.feasible(trial[better])] if len(better) else better
                if len(allowed):
                    q[k], own[k] = trial[allowed[0]], tells[allowed[0]]
                    M = rest + own[k].T @ own[k]
                else:
                    step[k] *= SHRINK
                before = before + own[k].T @ own[k]
    return q


def _better(criterion: Criterion, M: Array, own: Array, rows: Array, rest: Array) -> Ids:
    """Find the trials that increase Phi in the place of a pose, the best first, at most `CHECKED_NEIGHBOURS`.

    Only trials are computed that a tangent leaves hope: Phi(M') is no more than <Z, M'>.

    Args:
        criterion: Information function.
        M: Information of the plan, (r, r).
        own: Rows of the pose that would be replaced, (k, r).
        rows: Rows of the trials, (trials, k, r).
        rest: Information of the plan without that pose, (r, r).

    Returns:
        Indices of trials, (found,).
    """
    floor, Z = (1 + MIN_REFINEMENT) * criterion.information(M), criterion.tangent(M).Z
    without = (Z * M).sum() - sensitivity(own[None], Z)
    hopeful = np.flatnonzero(without + sensitivity(rows, Z) > floor)
    if not len(hopeful):
        return hopeful
    reached = criterion.after(rest, rows[hopeful])
    first = np.argsort(-reached)[:CHECKED_NEIGHBOURS]
    return np.asarray(hopeful[first[reached[first] > floor]])


def ascend_poses(q: Array, usefulness: Callable[[Array], Array], search: Search) -> Array:
    """Improve poses by a measure that judges each pose alone.

    Args:
        q: Poses to start from, (poses, n) [rad, m].
        usefulness: Function of poses, (count, n) with a multiple of (poses,) rows, to their usefulness,
            (count,).
        search: Limits, feasibility and source of the steps.

    Returns:
        Poses at least as useful as their starts, (poses, n) [rad, m].
    """
    q, value, step = q.copy(), usefulness(q), np.full(len(q), STEP)
    for _ in range(ASCEND_ROUNDS):
        trial = search.around(q, np.tile(step[:, None], (ASCEND_NEIGHBOURS, 1, 1)))
        # every pose is replaced by its most useful neighbour if that is better and feasible; else its step
        # shrinks
        reached = usefulness(trial.reshape(-1, q.shape[1])).reshape(ASCEND_NEIGHBOURS, -1)
        best = reached.argmax(axis=0)
        trial, reached = trial[best, np.arange(len(q))], reached.max(axis=0)
        better = np.flatnonzero(reached > (1 + MIN_REFINEMENT) * value)
        better = better[search.reach.feasible(trial[better])] if len(better) else better
        q[better], value[better] = trial[better], reached[better]
        step[np.setdiff1d(np.arange(len(q)), better)] *= SHRINK
    return q
