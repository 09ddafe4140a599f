"""Links and joints, or joints alone: whichever the readings make likelier.

Where links are so stiff that the readings hardly see them, their fitted compliances are noise, and joints
alone predict better. Errors held out of few poses are too noisy to tell. The evidence tells: the density of
the readings under either model, all its unknowns and what is learnt of the prior integrated out.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from testbench.errors import Array, BenchError
from testbench.identify.estimate import Constraint, Estimate, Rigid, make_estimate
from testbench.identify.hierarchy import ALONE, evidence, log_evidence_alone
from testbench.identify.metric import Belief, Metric
from testbench.identify.prior import Strength
from testbench.identify.regression import Regression, Term, regression_of
from testbench.identify.regularised import fit_each, fit_reduced
from testbench.model.structure import Ids

MOST_ODDS = 1e6  #: That are said.


def likelier(
    regressions: Sequence[Regression], constraint: Constraint, beliefs: Sequence[Belief], metric: Metric
) -> list[Estimate]:
    """Fit datasets with a learnt prior; links are rigid where joints alone are likelier.

    Args:
        regressions: The reduced datasets.
        constraint: Least squares or GCO.
        beliefs: The prior as each of them corrects it.
        metric: The prior as it was.
    """
    found = fit_each(regressions, constraint, beliefs)
    s = metric.structure
    joints = np.flatnonzero((s.a == s.b) & (s.a >= 6 * s.links))
    if len(joints) < s.links - 1:  # some are counted in links
        return found
    return [_likelier(estimate, metric, joints) for estimate in found]


def _likelier(whole: Estimate, metric: Metric, joints: Ids) -> Estimate:
    assert whole.belief is not None
    assert whole.belief.log_evidence is not None
    own = _of_joints(whole.regression, joints)
    try:
        seen = evidence(own, _metric_of_joints(metric, own, joints))
    except BenchError:  # no joint is loaded, or all turn against their loads
        return whole
    log_evidence, kappa = log_evidence_alone(seen)
    gain = log_evidence - whole.belief.log_evidence
    if gain <= 0:
        return whole
    alone = fit_reduced(own, whole.constraint, Belief(seen.metric, Strength(ALONE / kappa)))
    pi = np.zeros_like(whole.pi)
    pi[joints] = alone.pi
    rigid = Rigid(math.exp(min(gain, math.log(MOST_ODDS))), whole)
    found = make_estimate(whole.regression, pi, method=whole.method, constraint=whole.constraint)
    return replace(
        found,
        belief=whole.belief,
        status=alone.status,
        solver_seconds=whole.solver_seconds + alone.solver_seconds,
        advice=(*whole.advice, words(rigid)),
        rigid=rigid,
    )


def words(rigid: Rigid) -> str:
    """Why links are rigid."""
    return (
        f"link compliances do not improve the model: joint stiffness only is {rigid.odds:.2g} times likelier "
        "given the readings, so links are taken as rigid"
    )


def _of_joints(regression: Regression, joints: Ids) -> Regression:
    """The dataset with rigid links."""

    def term(whole: Term) -> Term:
        n = len(joints)
        T: Array = np.asarray(np.linalg.qr(np.c_[whole.R[:, joints], whole.z], mode="r"))
        return Term(T[:n, :n], T[:n, n], whole.rest + float(T[n:, n] @ T[n:, n]), whole.equations)

    structure = regression.structure.keep(joints, "Joints")
    return regression_of(structure, tuple(term(whole) for whole in regression.terms))


def _metric_of_joints(metric: Metric, own: Regression, joints: Ids) -> Metric:
    columns = np.flatnonzero(np.any(metric.L[joints] != 0, axis=0))
    sizes = (1,) * len(joints)
    return Metric(
        metric.prior, own.structure, metric.L[np.ix_(joints, columns)], metric.expected[columns], sizes
    )
