"""Baselines of a plan: greedy and random plans, the part that rests on the prior, observability indices.

O1: Borm and Menq (IJRR 1991). O2: Driels and Pathre (J. Robotic Systems 1990). O3: Nahvi, Hollerbach and
Hayward (ICRA 1994). O4: Nahvi and Hollerbach (ICRA 1996). O5: Sun and Hollerbach (ICRA 2008). Reports compare
them with the plan.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from testbench.design.criteria import mean_square
from testbench.design.exchange import greedy
from testbench.design.planning import Plan
from testbench.design.rows import DesignProblem, information
from testbench.errors import Array, Ids
from testbench.identify.regression import RANK_TOLERANCE
from testbench.progress import stepwise


@dataclass(frozen=True)
class Observability:
    """Hold indices of the singular values s of the stacked whitened rows of a plan, without a prior.

    The unknowns are in units of the prior, so that all s have one unit, 1. All indices are zero where the
    plan leaves a direction unseen that the candidates can show.
    """

    o1: float  #: (product of s)^(1/r) / sqrt(poses): volume.
    o2: float  #: s_min / s_max: inverse condition number.
    o3: float  #: s_min: noise amplification of the worst direction.
    o4: float  #: s_min^2 / s_max: noise amplification index.
    o5: float  #: 1 / sum(1 / s): harmonic mean over r.
    seen: int  #: Directions that the plan sees.
    of: int  #: Directions that the candidates can show.


def observability(problem: DesignProblem, chosen: Ids) -> Observability:
    """Compute the observability indices O1 to O5 of a plan.

    Mathematics: `pose-13`.

    Args:
        problem: Candidates.
        chosen: Indices of the candidates in the plan, (poses,).

    Returns:
        The indices, and how many directions the plan sees.
    """
    s = np.linalg.svd(problem.rows[chosen].reshape(-1, problem.r), compute_uv=False)
    seen = int((s > RANK_TOLERANCE * s[0]).sum())
    if seen < problem.r:
        return Observability(0.0, 0.0, 0.0, 0.0, 0.0, seen, problem.r)
    return Observability(
        o1=float(np.exp(np.log(s).mean()) / np.sqrt(len(chosen))),
        o2=float(s[-1] / s[0]),
        o3=float(s[-1]),
        o4=float(s[-1] ** 2 / s[0]),
        o5=float(1 / (1 / s).sum()),
        seen=seen,
        of=problem.r,
    )


RANDOM_PLANS = 200  #: Random plans per number of poses that the plan is compared with.
POSE_COUNTS = (4, 6, 8, 12, 16, 20, 30, 40)  #: Numbers of poses for which errors are reported.


@dataclass(frozen=True)
class Baselines:
    """Hold errors at the tasks of other plans from the same candidates.

    Without a prior an error is infinite where a plan leaves a direction unseen that the candidates can show.
    """

    greedy: Array  #: RMS errors of the greedy plans of 1, 2, ... poses, (largest count,) [m].
    #: RMS errors of `RANDOM_PLANS` random plans, (RANDOM_PLANS,) [m], by number of poses.
    random: dict[int, Array]


@dataclass(frozen=True)
class PriorInfluence:
    """Hold how far a plan's forecast rests on the prior instead of its readings."""

    outweighed: int  #: Directions that the plan's readings determine better than the prior does.
    #: Share of the mean square error at the tasks that the prior leaves open, not noise [1].
    prior_share: float
    hidden: float  #: Mean square error at the tasks in directions that no candidate shows [m^2].


def prior_influence(plan: Plan, rows: Array) -> PriorInfluence:
    """Compute how far a plan's forecast rests on the prior.

    With M = prior + readings, the error's covariance M^-1 is the part of the noise plus M^-1 prior M^-1, the
    part that the prior leaves open.

    Args:
        plan: The plan.
        rows: Predictions at the tasks per unit of x, (tasks, 3 m, n) [m].

    Returns:
        Directions in which the readings outweigh the prior, and the prior's share of the mean square error.
    """
    problem, M = plan.examined.problem, plan.information
    I = np.linalg.inv(M)  # noqa: E741 - used on both sides
    W, hidden = mean_square(rows @ problem.lift), hidden_square(problem, rows)
    left_open = hidden + float(np.trace(W @ I @ problem.prior @ I))
    # readings over the prior, direction by direction: generalised eigenvalues above one outweigh it
    half = np.linalg.inv(np.linalg.cholesky(problem.prior))
    against = np.linalg.eigvalsh(half @ (M - problem.prior) @ half.T)
    return PriorInfluence(
        outweighed=int((against > 1).sum()),
        prior_share=left_open / (hidden + float(np.trace(W @ I))),
        hidden=hidden,
    )


def baselines(plan: Plan, rows: Array, *, random_candidates: int, rng: np.random.Generator) -> Baselines:
    """Compute errors at the tasks of greedy and random plans from the same candidates.

    Args:
        plan: The plan, with the candidates that were examined.
        rows: Predictions at the tasks per unit of x, (tasks, 3 m, n) [m].
        random_candidates: Number of examined candidates, the first ones, that were drawn at random; random
            plans use these.
        rng: Source of the random plans.

    Returns:
        Errors by number of poses.
    """
    spec, problem = plan.specification, plan.examined.problem
    error = error_after(problem, rows)

    def errors(plans: Iterable[Ids]) -> Array:
        whole = spec.uncertainty is not None
        return np.array(
            [error(p) if whole or observability(problem, p).seen == problem.r else np.inf for p in plans]
        )

    counts = sorted({*POSE_COUNTS, spec.poses})
    order = greedy(problem, plan.criterion, problem.rows, counts[-1])
    return Baselines(
        greedy=errors(order[: k + 1] for k in range(len(order))),
        random={
            count: errors(
                [
                    rng.choice(random_candidates, count, replace=random_candidates < count)
                    for _ in range(RANDOM_PLANS)
                ]
            )
            for count in stepwise(counts, "drawing random plans")
        },
    )


def error_after(problem: DesignProblem, rows: Array) -> Callable[[Ids], float]:
    """Make a function that predicts the RMS error at some predictions after some candidates were read.

    Args:
        problem: Candidates.
        rows: Predictions per unit of x, (poses, 3 m, n) [m].

    Returns:
        Function of a plan's indices, (poses,), to its RMS error sqrt(tr(W M^-1) + hidden) [m].
    """
    hidden, W = hidden_square(problem, rows), mean_square(rows @ problem.lift)
    return lambda plan: math.sqrt(hidden + float((np.linalg.inv(information(problem, plan)) * W).sum()))


def hidden_square(problem: DesignProblem, rows: Array) -> float:
    """Compute the mean square prediction error in directions that no candidate shows.

    Args:
        problem: Candidates.
        rows: Predictions per unit of x, (poses, 3 m, n) [m].

    Returns:
        Mean square error, at least 0 whatever rounding does [m^2].
    """
    return max(0.0, float(np.trace(mean_square(rows) @ problem.hidden)))
