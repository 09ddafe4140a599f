"""The default method: an average of models, weighted by their evidence.

The models are joints only; links and joints; these with laws of joints; and these with coupled joints. Each
is fitted under two priors: links as expected, and softened ones, which are less of a beam.

If links are so stiff that the readings hardly show them, their fitted compliances are noise, and joints only
predict better. If joints stiffen, stick or have backlash, a linear model errs. If a torque on one joint turns
another one too, the cone bends links to explain it. Held-out errors of few poses are too noisy to select a
model; the evidence is not. Where it is undecided, an average errs less than a selection: selecting by the
same evidence loses to joints only twice as often where links are 10 or 30 times stiffer than the folder's. A
mean of positive semi-definite matrices is positive semi-definite.
"""

import math
from dataclasses import replace

import numpy as np

from testbench.errors import BenchError, Ids
from testbench.identify.estimate import Average, Constraint, Estimate, make_estimate
from testbench.identify.hierarchy import learn, log_evidence_alone
from testbench.identify.metric import Metric
from testbench.identify.regression import Regression, f_m, places, some_columns, spread
from testbench.identify.solve import solve
from testbench.identify.wander import BACK, size, wandering
from testbench.model.laws import with_ties, without_ties
from testbench.model.laws import without_laws as linear
from testbench.model.structure import Structure

ODDS = 10.0
"""Of joints alone beforehand: links count half where the readings make them ten times likelier.

Odds of three lose to joints alone, by more than 5 %, in 4 of 54 arms whose links are 10, 30 or 100 times
stiffer than the folder's, these in none of them; other kinds of arms do not move (`kr500_l480`, seeds 740001
to 740018, 8 poses)."""
LINEAR = 10.0
"""Odds of linear joints beforehand. On undisturbed arms of the family even odds lose more than 5 % in 18 % of
arms, these in 5 %; disturbed ones do not mind (`kr500_l480`, seeds 1 to 40, 8 poses)."""
BEAMS = 20.0
"""Odds of links as coupled as the prior's over softened ones beforehand. Coupled links and soft bearings have
a tenth less error by these, and undisturbed arms of the family 1 % more, by odds of 3 5 %; coverage in the
worst tenth rises by 1 to 3 points of all kinds (`kr500_l480`, seeds 1 to 40, 8 poses)."""
UNTIED = 10.0
"""Odds beforehand of joints that turn each with its own torque alone. With them coupled joints weigh less
than `OPEN` in all of 19 arms of the family with all disturbances (`kr500_l480`, seeds 5000 to 5018, 8
poses), and more than half in 11 of 12 arms with coupled neighbours (seeds 9000 to 9011)."""
RIGID = 0.25
"""Weight of joints alone where links change with the pose: a few poses do not teach what they do in others.

On 108 arms of seven such kinds the default loses more than 5 % to joints alone on 2 with it, on 4 without.
In the worst twentieth it errs 0.97 times as much as joints alone or more, 1.02 times without. Its errors are
0.995 times as large (95 % interval 0.977 to 1.013), with 0.4 they are 1.037 times (`kr500_l480`, seeds 740001
to 740026 and 790001 to 790013, 8 poses). A weight learnt by leaving poses out is no better in losses, and
errs up to 15 % more."""
NEGLIGIBLE = 0.01  #: Weight below which joints alone are left out.
ROOT = 0.5
"""Power with which odds of models count in widths, even beforehand: of few readings Laplace's evidence is not
sure. Coverage in the worst tenth of disturbed arms rises by it from 78 to 84 % (seeds 1 to 40, 11 poses).
For the two priors it does so by 0 to 3 points. Where links are 30 or 100 times stiffer, intervals that count
joints alone are 40 % narrower and hold 97 % (seeds 740001 to 740012, 8 poses)."""
OPEN = 0.05  #: Probability, and weight, below which laws are left out, and above one less it all else.


def of_two_priors(r: Regression, constraint: Constraint, prior: Metric, softened: Metric) -> Estimate:
    """Average estimates under a prior and a softened prior by their evidence, with intervals.

    If the readings want links whose compliance varies from pose to pose, they are weighted for it first, see
    `wander`; joint stiffness only then weighs at least `RIGID`.

    Mathematics: `prior-12`.

    Args:
        r: The reduced dataset, of a structure with laws.
        constraint: Least squares or GCO.
        prior: Metric of the prior.
        softened: Metric of the softened prior.

    Returns:
        The averaged estimate.

    Raises:
        BenchError: When the best common scale of a prior is not above 0.
    """
    found = _of_two(r, constraint, prior, softened)
    rho = size(r, found) if r.poses else 0.0
    if not rho:
        return found
    try:
        first = averaged(wandering(r, found.pi, rho), constraint, prior, widths=False)
        rho = size(r, first, BACK)
        if not rho:
            return found
        found = _of_two(wandering(r, first.pi, rho), constraint, prior, softened)
    except BenchError:  # readings weighed so want a scale of the prior that is not above 0
        return found
    found = _steadied(r, constraint, prior, found)
    return replace(found, f_m=f_m(some_columns(r, found.structure), found.pi))


def _steadied(r: Regression, constraint: Constraint, prior: Metric, found: Estimate) -> Estimate:
    """Average a fit with joints alone by `RIGID`; laws and coupled joints keep their weight.

    Joints alone are fitted to the readings as they are: weighed for links that change, they err a third more.
    """
    known = found.average or Average(0.0, found)
    weight = RIGID * (1 - known.laws) * (1 - known.ties)
    if not weight:
        return found
    own, bare = _joints(r, prior)
    rigid = solve(own, constraint, log_evidence_alone(own, bare)[1])
    pi = (1 - weight) * found.pi + weight * spread(rigid.pi, rigid.structure, found.structure)
    return replace(
        make_estimate(found.regression, pi, method=found.method, constraint=constraint),
        belief=found.belief,
        status=found.status if found.status != "solved" else rigid.status,
        solver_seconds=found.solver_seconds + rigid.solver_seconds,
        average=replace(known, weight=weight + (1 - weight) * known.weight),
    )


def _of_two(r: Regression, constraint: Constraint, prior: Metric, softened: Metric) -> Estimate:
    """Average the fits under both priors, for readings with given weights."""
    first, log_evidence = _of_prior(r, constraint, prior, widths=True)
    if log_evidence is None:
        return first
    second, log_other = _of_prior(r, constraint, softened, widths=True)
    assert log_other is not None
    # Weights by evidence: for the mean, and for intervals.
    odds = log_other - log_evidence
    share, likely = _logistic(odds - math.log(BEAMS)), _logistic(ROOT * odds)
    if not OPEN < likely < 1 - OPEN:
        return second if likely > 0.5 else first
    share = share if share > OPEN else 0.0
    likelier, widest = (second if share > 0.5 else first), max(first, second, key=lambda e: e.structure.n)
    # The mean, and the models that it contains.
    pi, weighed = np.zeros(widest.structure.n), ((1 - share, first), (share, second))
    for weight, own in weighed:
        pi[: own.structure.n] += weight * own.pi
    known = [(weight, own.average or Average(0.0, own)) for weight, own in weighed]
    return replace(
        make_estimate(widest.regression, pi, method=likelier.method, constraint=constraint),
        belief=likelier.belief,
        status=first.status if first.status != "solved" else second.status,
        solver_seconds=first.solver_seconds + second.solver_seconds,
        average=Average(
            weight=sum(weight * own.weight for weight, own in known),
            whole=known[share > 0.5][1].whole,
            laws=sum(weight * own.laws for weight, own in known),
            likely=sum(weight * own.likely for weight, own in known),
            lawful=next((own.lawful for _, own in known if own.lawful is not None), None),
            ties=sum(weight * own.ties for weight, own in known),
            tied=next((own.tied for _, own in known if own.tied is not None), None),
            parts=((1 - likely, first), (likely, second)),
        ),
    )


def averaged(r: Regression, constraint: Constraint, prior: Metric, *, widths: bool) -> Estimate:
    """Fit a dataset with a prior learnt from it, and average the fit with simpler models.

    Mathematics: `prior-12`.

    Args:
        r: The reduced dataset; if its structure has joint laws, the average includes them.
        constraint: Least squares or GCO.
        prior: Prior, in the metric of the structure.
        widths: Whether the uncertainty of the learnt prior is computed, which intervals need.

    Returns:
        The averaged estimate.

    Raises:
        BenchError: If the dataset requires a common scale of the prior that is not above 0.
    """
    return _of_prior(r, constraint, prior, widths=widths)[0]


def _of_prior(
    r: Regression, constraint: Constraint, prior: Metric, *, widths: bool
) -> tuple[Estimate, float | None]:
    """Fit under one prior and average with simpler models; also return the evidence, None without one."""
    if not prior.ties.any():
        return _untied(r, constraint, prior, widths=widths)
    bare, tied = (
        metric_of(prior, own) for own in (without_ties(prior.structure), with_ties(linear(prior.structure)))
    )
    mean, log_evidence = _untied(some_columns(r, bare.structure), constraint, bare, widths=widths)
    if log_evidence is None:
        return mean, None
    coupled = some_columns(r, tied.structure)
    belief = learn(coupled, tied, widths=widths)
    assert belief.log_evidence is not None
    odds = belief.log_evidence - log_evidence - math.log(UNTIED)
    together, share = log_evidence + float(np.logaddexp(0, odds)), _logistic(odds)
    if share < OPEN:
        return mean, together
    share = share if share < 1 - OPEN else 1.0
    own, known = solve(coupled, constraint, belief), mean.average or Average(0.0, mean)
    pi = share * spread(own.pi, own.structure, r.structure)
    pi[: len(mean.pi)] += (1 - share) * mean.pi
    found = replace(
        make_estimate(r, pi, method=own.method, constraint=constraint),
        belief=belief if share > 0.5 else mean.belief,
        status=own.status if mean.status == "solved" else mean.status,
        solver_seconds=mean.solver_seconds + own.solver_seconds,
        average=replace(known, laws=(1 - share) * known.laws, ties=share, tied=own),
    )
    return found, together


def _untied(
    r: Regression, constraint: Constraint, prior: Metric, *, widths: bool
) -> tuple[Estimate, float | None]:
    """Average models with uncoupled joints, with and without laws; also return the evidence."""
    plain = without_laws(prior)
    compliances = r if plain is prior else some_columns(r, plain.structure)
    straight, log_evidence = _linear(compliances, constraint, plain, widths)
    if plain is prior or log_evidence is None:
        return straight, log_evidence
    # Odds of joint laws, and the mean by them.
    belief = learn(r, prior, widths=widths)
    assert belief.log_evidence is not None
    odds = belief.log_evidence - log_evidence
    together = log_evidence + float(np.logaddexp(0, odds - math.log(LINEAR)))
    weight, likely = _logistic(odds - math.log(LINEAR)), _logistic(ROOT * odds)
    if likely < OPEN:
        return straight, together
    lawful = solve(r, constraint, belief)
    if likely > 1 - OPEN:
        weight = likely = 1.0
    elif weight < OPEN:
        weight = 0.0
    pi = weight * lawful.pi
    pi[r.structure.a < r.structure.plain] += (1 - weight) * straight.pi
    mean = make_estimate(r, pi, method=lawful.method, constraint=constraint)
    own = straight.average or Average(0.0, straight)
    mean = replace(
        mean,
        belief=belief if weight > 0.5 else own.whole.belief,
        status=lawful.status if straight.status == "solved" else straight.status,
        solver_seconds=straight.solver_seconds + lawful.solver_seconds,
        average=replace(own, laws=weight, likely=likely, lawful=lawful),
    )
    return mean, together


def without_laws(metric: Metric) -> Metric:
    """Return the metric of compliances alone, without joint laws."""
    return metric if not metric.law.any() else metric_of(metric, linear(metric.structure))


def metric_of(metric: Metric, structure: Structure) -> Metric:
    """Restrict a metric to a structure without some joint laws or couplings, which a prior expects to be 0.

    Args:
        metric: The metric of the prior.
        structure: Some of its unknowns.

    Returns:
        The metric of these unknowns.
    """
    own = places(structure, metric.structure)
    row, column = metric.structure.triangles
    wanted = set(zip(structure.a.tolist(), structure.b.tolist(), strict=True))
    found = [pair in wanted for pair in zip(row.tolist(), column.tolist(), strict=True)]
    keep = np.flatnonzero(found)
    sizes = tuple(len(block) for block in structure.blocks)
    return Metric(metric.prior, structure, metric.L[np.ix_(own, keep)], metric.expected[keep], sizes)


def _linear(
    r: Regression, constraint: Constraint, prior: Metric, widths: bool
) -> tuple[Estimate, float | None]:
    """Average links and joints with joints only, without laws; also return the evidence, None without one."""
    belief, joints = learn(r, prior, widths=widths), joint_columns(prior)
    whole = solve(r, constraint, belief)
    if belief.log_evidence is None or len(joints) < prior.structure.links - 1:  # of links or joints alone
        return whole, None
    own, bare = _joints(r, prior)
    try:
        log_evidence, alone = log_evidence_alone(own, bare)
    except BenchError:  # no joint is loaded, or all turn against their loads: joints alone are no model
        return whole, belief.log_evidence
    odds = log_evidence - belief.log_evidence + math.log(ODDS)
    weight = _logistic(odds)
    together = belief.log_evidence + float(np.logaddexp(0, odds))
    if weight < NEGLIGIBLE:
        return whole, together
    rigid = solve(own, constraint, alone)
    pi = (1 - weight) * whole.pi
    pi[joints] += weight * rigid.pi
    mean = replace(
        make_estimate(r, pi, method=whole.method, constraint=constraint),
        belief=belief,
        status=whole.status if whole.status != "solved" else rigid.status,
        solver_seconds=whole.solver_seconds + rigid.solver_seconds,
        average=Average(weight, whole, rigid=_logistic(ROOT * (odds - math.log(ODDS))), alone=rigid),
    )
    return mean, together


def _joints(r: Regression, prior: Metric) -> tuple[Regression, Metric]:
    """A dataset, and the metric of its prior, of joints alone."""
    joints = joint_columns(prior)
    own = some_columns(r, prior.structure.keep(joints, "Joints"))
    entries = np.flatnonzero(np.any(prior.L[joints] != 0, axis=0))
    L, sizes = prior.L[np.ix_(joints, entries)], (1,) * len(joints)
    return own, Metric(prior.prior, own.structure, L, prior.expected[entries], sizes)


def joint_columns(metric: Metric) -> Ids:
    """Find the parameters that are joints of their own, (joints,)."""
    s = metric.structure
    return np.flatnonzero((s.a == s.b) & (s.a >= 6 * s.links) & (s.a < s.plain))


def _logistic(x: float) -> float:
    return float(1 / (1 + np.exp(-np.clip(x, -700, 700))))
