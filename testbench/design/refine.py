"""From the best candidates to better angles: a local search in the joint angles, pose after pose.

A random search with a shrinking step (an evolution strategy with one parent): many neighbours of a pose are
judged at once by updates of the information matrix, and only those that would help are asked whether they
are feasible.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from testbench.design.criteria import Criterion
from testbench.design.relaxation import sensitivity
from testbench.design.rows import behind, total
from testbench.errors import Array, Ids, Mask
from testbench.session import stepwise

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
Feasible = Callable[[Array], Mask]


@dataclass(frozen=True)
class Reach:
    """Where the arm can go."""

    feasible: Feasible  #: Which poses (poses, n) [rad, m] the arm can take and the tracker can see.
    #: Whether the arm can go straight from one pose (n,) to another [rad].
    clear: Callable[[Array, Array], bool] = lambda _start, _end: True


@dataclass(frozen=True)
class Search:
    """How poses are looked for, whatever they are measured for."""

    measured: Rows  #: What a pose tells per unit of x, each under its own load (poses,).
    poses: int  #: How many may be measured.
    limits: Array  #: Lower and upper joint limits, (2, n joints) [rad, m].
    reach: Reach  #: Which poses near the candidates are feasible, and which ways between them are clear.
    rng: np.random.Generator  #: Source of starts and steps.
    #: Poses (..., n) with joints that follow others where these bring them [rad, m].
    followed: Callable[[Array], Array] = lambda q: q

    def around(self, q: Array, step: Array) -> Array:
        """Poses drawn around q within the limits; q and step broadcast to the shape of the draw."""
        shape = np.broadcast_shapes(q.shape, step.shape)
        return self.followed(np.clip(q + step * self.rng.standard_normal(shape), *self.limits))


def refine(q: Array, prior: Array, criterion: Criterion, rows: Rows, search: Search) -> Array:
    """Better joint angles for every pose of a plan (poses, n) [rad, m], none of them worse.

    The prior is the information before any reading, (r, r); rows are what a pose tells.
    """
    q, step, own = q.copy(), np.full(len(q), STEP), rows(q, np.arange(len(q)))
    M = total(prior, own)
    for _ in stepwise(range(ROUNDS), "refining poses"):
        before, after = prior, behind(own)
        for places in np.array_split(np.arange(len(q)), -(-len(q) // TOGETHER)):
            trials = search.around(q[places, None], np.tile(step[places, None, None], (NEIGHBOURS, 1)))
            seen = rows(trials.reshape(-1, q.shape[1]), np.repeat(places, NEIGHBOURS))
            for k, trial, tells in zip(places, trials, np.split(seen, len(places)), strict=True):
                rest = before + after[k + 1]
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
    """Which of some rows (trials, k, r) make Phi larger than that of M, the best first, `TRIES` at most.

    In the place of M's own rows (k, r); the rest is the information without them, (r, r). Only those are
    tried that a tangent leaves hope: Phi(M') is no more than <Z, M'>.
    """
    floor, Z = (1 + BETTER) * criterion.information(M), criterion.tangent(M).Z
    without = (Z * M).sum() - sensitivity(own[None], Z)
    hopeful = np.flatnonzero(without + sensitivity(rows, Z) > floor)
    if not len(hopeful):
        return hopeful
    reached = criterion.after(rest, rows[hopeful])
    first = np.argsort(-reached)[:TRIES]
    return np.asarray(hopeful[first[reached[first] > floor]])


def ascend(q: Array, usefulness: Callable[[Array], Array], search: Search) -> Array:
    """Poses (poses, n) [rad, m] more useful than their starts q, by a measure that asks one pose alone."""
    q, value, step = q.copy(), usefulness(q), np.full(len(q), STEP)
    for _ in range(ASCENT):
        trial = search.around(q, np.tile(step[:, None], (FEWER, 1, 1)))
        reached = usefulness(trial.reshape(-1, q.shape[1])).reshape(FEWER, -1)
        best = reached.argmax(axis=0)
        trial, reached = trial[best, np.arange(len(q))], reached.max(axis=0)
        better = np.flatnonzero(reached > (1 + BETTER) * value)
        better = better[search.reach.feasible(trial[better])] if len(better) else better
        q[better], value[better] = trial[better], reached[better]
        step[np.setdiff1d(np.arange(len(q)), better)] *= SHRINK
    return q
