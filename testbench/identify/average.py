"""Links and joints averaged with joints alone, each by its evidence.

Where links are so stiff that the readings hardly see them, their fitted compliances are noise: joints alone
predict better. Errors held out of few poses are too noisy to tell; the evidence tells, and where it does not
the mean of both models errs less than a choice: a choice by the same evidence loses twice as often to joints
alone where links are 10 or 30 times stiffer than the folder's. A mean of positive semi-definite matrices is
one.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from testbench.errors import BenchError
from testbench.identify.estimate import Average, Constraint, Estimate, make_estimate
from testbench.identify.hierarchy import log_evidence_alone
from testbench.identify.metric import Belief, Metric
from testbench.identify.regression import Regression, regression_of, term_of, triangle
from testbench.identify.solve import solve
from testbench.model.structure import Ids

ODDS = 3.0
"""Of joints alone beforehand: links count half where the readings make them three times likelier.

Even odds lose to joints alone, by more than 5 %, in 8 % of arms whose links are 100 times stiffer than the
folder's, these in 4 % (`kr500_l480`, seeds 1 to 30, 8 to 20 poses)."""
NEGLIGIBLE = 0.01  #: Weight below which joints alone are left out.


def averaged(
    regressions: Sequence[Regression], constraint: Constraint, beliefs: Sequence[Belief], metric: Metric
) -> list[Estimate]:
    """Fit datasets with a learnt prior, and average each fit with joints alone.

    Args:
        regressions: The reduced datasets.
        constraint: Least squares or GCO.
        beliefs: The prior as each of them corrects it.
        metric: The prior as it was.
    """
    found = [solve(r, constraint, own) for r, own in zip(regressions, beliefs, strict=True)]
    joints = joint_columns(metric)
    if len(joints) < metric.structure.links - 1 or len(joints) == metric.structure.n:
        return found
    return [_with_joints(estimate, metric, joints) for estimate in found]


def joint_columns(metric: Metric) -> Ids:
    """Parameters that are joints of their own, (joints,)."""
    s = metric.structure
    return np.flatnonzero((s.a == s.b) & (s.a >= 6 * s.links))


def _with_joints(whole: Estimate, metric: Metric, joints: Ids) -> Estimate:
    assert whole.belief is not None
    assert whole.belief.log_evidence is not None
    own = _of_joints(whole.regression, joints)
    try:
        log_evidence, belief = log_evidence_alone(own, _metric_of_joints(metric, own, joints))
    except BenchError:  # no joint is loaded, or all turn against their loads: joints alone are no model
        return whole
    weight = _logistic(log_evidence - whole.belief.log_evidence + math.log(ODDS))
    if weight < NEGLIGIBLE:
        return whole
    alone = solve(own, whole.constraint, belief)
    pi = (1 - weight) * whole.pi
    pi[joints] += weight * alone.pi
    mean = make_estimate(whole.regression, pi, method=whole.method, constraint=whole.constraint)
    return replace(
        mean,
        belief=whole.belief,
        status=whole.status if whole.status != "solved" else alone.status,
        solver_seconds=whole.solver_seconds + alone.solver_seconds,
        average=Average(weight, whole),
    )


def _of_joints(regression: Regression, joints: Ids) -> Regression:
    """The dataset with rigid links."""
    structure = regression.structure.keep(joints, "Joints")
    parts = ((triangle(np.c_[own.R[:, joints], own.z]), own) for own in regression.terms)
    return regression_of(structure, tuple(term_of(T, own.rest, own.equations) for T, own in parts))


def _metric_of_joints(metric: Metric, own: Regression, joints: Ids) -> Metric:
    columns = np.flatnonzero(np.any(metric.L[joints] != 0, axis=0))
    sizes = (1,) * len(joints)
    return Metric(
        metric.prior, own.structure, metric.L[np.ix_(joints, columns)], metric.expected[columns], sizes
    )


def _logistic(x: float) -> float:
    return float(1 / (1 + np.exp(-np.clip(x, -700, 700))))
