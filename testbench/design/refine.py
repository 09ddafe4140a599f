"""From the best candidates to better angles: a local search in the joint angles, pose after pose.

A random search with a shrinking step (an evolution strategy with one parent): many neighbours of a pose are
judged at once by updates of the information matrix, and only those that would help are asked whether they
are feasible.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from testbench.design.criteria import Criterion
from testbench.design.relaxation import sensitivity
from testbench.design.rows import Ids, behind, total
from testbench.errors import Array

NEIGHBOURS = 32  #: Neighbours of a pose that are judged at a time.
FEWER = 16  #: The same where many poses climb at once.
ROUNDS, ASCENT = 22, 14  #: Rounds for a plan, and where many poses climb at once.
STEP, SHRINK = 0.25, 0.7
"""First standard deviation of a joint's step [rad], and its factor after a round without gain."""
TRIES = 8  #: Neighbours, the best first, that are asked for feasibility in a round.
BETTER = 1e-6  #: Relative gain below which a step does not count.

TOGETHER = 32  #: Poses of the plan whose neighbours' rows are found together.

Rows = Callable[[Array, Ids], Array]
"""Whitened rows (poses, k, r) of angles (poses, n), each measured as the pose in its place of the plan is."""
Feasible = Callable[[Array], npt.NDArray[np.bool_]]


@dataclass(frozen=True)
class Reach:
    """Where the arm can go."""

    feasible: Feasible  #: Which poses (poses, n) [rad, m] the arm can take and the tracker can see.
    #: Whether the arm can go straight from one pose (n,) to another [rad].
    clear: Callable[[Array, Array], bool] = lambda _start, _end: True


@dataclass(frozen=True)
class Neighbourhood:
    """Where and how a local search steps."""

    feasible: Feasible  #: Which poses (poses, n) [rad, m] it may take.
    limits: Array  #: Lower and upper joint limits, (2, n) [rad, m].
    rng: np.random.Generator  #: Source of the steps.

    def around(self, q: Array, step: Array) -> Array:
        """Poses drawn around q within the limits; q and step broadcast to the shape of the draw."""
        shape = np.broadcast_shapes(q.shape, step.shape)
        return np.clip(q + step * self.rng.standard_normal(shape), *self.limits)


def refine(q: Array, prior: Array, criterion: Criterion, rows: Rows, near: Neighbourhood) -> Array:
    """Better joint angles for every pose of a plan (poses, n) [rad, m], none of them worse.

    The prior is the information before any reading, (r, r); rows are what a pose tells.
    """
    q, step = q.copy(), np.full(len(q), STEP)
    plan = _Plan(prior, criterion, rows(q, np.arange(len(q))))
    for _ in range(ROUNDS):
        before, after = prior, behind(plan.own)
        for places in np.array_split(np.arange(len(q)), -(-len(q) // TOGETHER)):
            trials = near.around(q[places, None], np.tile(step[places, None, None], (NEIGHBOURS, 1)))
            seen = rows(trials.reshape(-1, q.shape[1]), np.repeat(places, NEIGHBOURS))
            for k, trial, tells in zip(places, trials, np.split(seen, len(places)), strict=True):
                rest = before + after[k + 1]
                better = plan.better(k, tells, rest)
                allowed = better[near.feasible(trial[better])] if len(better) else better
                if len(allowed):
                    q[k] = trial[allowed[0]]
                    plan.exchange(k, tells[allowed[0]], rest)
                else:
                    step[k] *= SHRINK
                before = before + plan.own[k].T @ plan.own[k]
    return q


class _Plan:
    """The rows of a plan, its Phi and a tangent there."""

    def __init__(self, prior: Array, criterion: Criterion, own: Array) -> None:
        self.criterion, self.own = criterion, own
        self._look(total(prior, own))

    def _look(self, M: Array) -> None:
        self.M = M
        self.value = self.criterion.information(M)
        self.Z = self.criterion.tangent(M).Z

    def exchange(self, k: int, rows: Array, rest: Array) -> None:
        """Other rows (k, r) in a place; the rest is the information without it, (r, r)."""
        self.own[k] = rows
        self._look(rest + rows.T @ rows)

    def better(self, k: int, rows: Array, rest: Array) -> Ids:
        """Which of some rows (trials, k, r) make Phi larger in a place, the best first, `TRIES` at most.

        Only those are tried that a tangent leaves hope: Phi(M) is no more than <Z, M>.
        """
        floor = (1 + BETTER) * self.value
        without = (self.Z * self.M).sum() - sensitivity(self.own[k, None], self.Z)
        hopeful = np.flatnonzero(without + sensitivity(rows, self.Z) > floor)
        if not len(hopeful):
            return hopeful
        reached = self.criterion.after(rest, rows[hopeful])
        first = np.argsort(-reached)[:TRIES]
        return np.asarray(hopeful[first[reached[first] > floor]])


def ascend(q: Array, usefulness: Callable[[Array], Array], near: Neighbourhood) -> Array:
    """Poses (poses, n) [rad, m] more useful than their starts q, by a measure that asks one pose alone."""
    q, value, step = q.copy(), usefulness(q), np.full(len(q), STEP)
    for _ in range(ASCENT):
        trial = near.around(q, np.tile(step[:, None], (FEWER, 1, 1)))
        reached = usefulness(trial.reshape(-1, q.shape[1])).reshape(FEWER, -1)
        best = reached.argmax(axis=0)
        trial, reached = trial[best, np.arange(len(q))], reached.max(axis=0)
        better = np.flatnonzero(reached > (1 + BETTER) * value)
        better = better[near.feasible(trial[better])] if len(better) else better
        q[better], value[better] = trial[better], reached[better]
        step[np.setdiff1d(np.arange(len(q)), better)] *= SHRINK
    return q
