"""The default method: an average of models, weighted by their evidence.

The models are joints only; links and joints; links and joints with joint laws; links and joints with coupled
joints. Each is fitted under two priors: links as expected, and softened links, whose rotations and shears are
less coupled than those of a beam.

If links are so stiff that the readings hardly show them, their fitted compliances are noise, and joints only
predict better. If joints stiffen, stick or have backlash, a linear model errs. If a torque on one joint also
turns another one, GCO bends links to explain it. Held-out errors of few poses are too noisy to select a
model; the evidence is not. Where the evidence is undecided, an average errs less than a selection: selecting
by the same evidence loses to joints only twice as often where links are 10 or 30 times stiffer than their CAD
values. A mean of positive semi-definite matrices is positive semi-definite.

`pose_to_pose_variation` learns from the readings how much link compliances vary from pose to pose. No linear
model contains this variation, and its prior would explain it by links that are far off. In pose p every link
k has (1 + rho e_pk) times its compliance, with e_pk standard normal. With W the rows pi_k of a fit, one per
link, the readings of a pose with rows A_p have the covariance

    S_p = 1 + rho^2 A_p W^T W A_p^T

in units of the noise. Multiplied by S_p^-1/2 they are rows of a linear model again. rho maximises the
evidence under the prior that was learnt without it; it is 0 unless the evidence gains enough. Links vary as
much in new poses, so this variance is added to that of predictions.

`LinksVersusJointsOnly` compares links with joints only in poses that are left out of the fit. The evidence
trusts the prior's form; for links ten times stiffer than the prior's it may prefer a model that fits noise.
So where the evidence is not overwhelming, links count only if they predict the poses left out better than
joints only, by a paired test. Links that vary from pose to pose count unless they predict these poses worse.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import ndtri, stdtrit

from testbench.errors import Array, BenchError, Ids
from testbench.identify.estimate import Constraint, Estimate, ModelAverage, make_estimate
from testbench.identify.hierarchy import LOG_MISFIT_DEVIATION, joints_only_log_evidence, learn_prior
from testbench.identify.interior import SMALLEST_DIVISOR
from testbench.identify.prior import PriorScaling, WeightedPrior, prior_rows
from testbench.identify.regression import (
    Regression,
    embed_parameters,
    f_m,
    regression_from_terms,
    restrict_regression,
    term_from_triangle,
    triangular_factor,
)
from testbench.identify.solve import solve
from testbench.identify.trace import SELECTION_CONFIDENCE, mean_and_standard_error
from testbench.model.laws import add_coupling_parameters, remove_coupling_parameters
from testbench.model.laws import remove_law_parameters as linear
from testbench.model.structure import Structure

TRIED_POSE_VARIATIONS = 0.0, 0.03, 0.05, 0.07, 0.1, 0.14, 0.2, 0.28, 0.4, 0.56
"""Relative variations rho of link compliances from pose to pose that are tried [1]."""
MIN_VARIATION_EVIDENCE_GAIN = math.log(10)
"""Log evidence that rho must gain. 19 arms of the family with all disturbances do not gain it. Of 13
undisturbed ones one does, and then errs 5 % more (`kr500_l480`, seeds 5000 on, 8 poses)."""
MAX_VARIATION_EVIDENCE_LOSS = 1.5
"""Log evidence that a larger rho may be below the best: the learnt prior already explains some of the
variation."""
ROW_ROUNDING = 1e-9
"""Size of a row over the largest one in a pose, below which it is only rounding [1]."""


# --- Links that vary from pose to pose ----------------------------------------------------------------------


def pose_to_pose_variation(
    regression: Regression, estimate: Estimate, max_evidence_loss: float = 0.0
) -> float:
    """Find the relative variation rho of link compliances from pose to pose that has the greatest evidence.

    Args:
        regression: The reduced dataset, with its rows pose by pose.
        estimate: A fit to this dataset with a learnt prior.
        max_evidence_loss: Log evidence that a larger rho may have below that of the best rho; the largest
            such rho is taken [1].

    Returns:
        rho: standard deviation of a link's compliance over poses, relative to its mean; 0 if the log evidence
        gains less than `MIN_VARIATION_EVIDENCE_GAIN` [1].
    """
    gains = _variation_evidence(regression, _uncoupled_fit(estimate))
    if gains.max() - gains[0] < MIN_VARIATION_EVIDENCE_GAIN:
        return 0.0
    return TRIED_POSE_VARIATIONS[np.flatnonzero(gains >= gains.max() - max_evidence_loss)[-1]]


def _variation_evidence(regression: Regression, fit: Estimate) -> Array:
    """Compute the log evidence of every one of `TRIED_POSE_VARIATIONS` under the prior of a fit."""
    weighted_prior = fit.weighted_prior
    assert weighted_prior is not None
    regression = restrict_regression(regression, fit.structure)
    poses = [
        _pose_variances(rows, _parameters_by_link(regression, fit.pi)) for rows in regression.rows_by_pose
    ]
    unused = regression.n_equations - sum(len(w) for w, _ in poses)
    rest = math.fsum(t.n_equations / 3 * (t.unexplained + float(t.z @ t.z)) for t in regression.terms)
    rest -= math.fsum(float(y @ y) for y in _readings(poses))
    return np.array(
        [_log_evidence(rho, weighted_prior, poses, unused, rest) for rho in TRIED_POSE_VARIATIONS]
    )


def _uncoupled_fit(estimate: Estimate) -> Estimate:
    """Return the fit without coupled joints; with joint laws if these are more probable."""
    if estimate.averaged_models is None:
        return estimate
    with_laws = estimate.averaged_models.with_joint_laws
    return (
        with_laws
        if with_laws is not None and estimate.averaged_models.joint_laws_weight > 0.5
        else estimate.averaged_models.links_and_joints
    )


def _parameters_by_link(regression: Regression, pi: Array) -> Array:
    """Split the parameters by link, (links, n): row k has those of link k, and zeros for all others."""
    of_link = np.arange(regression.structure.n_links)[:, None] == regression.structure.rows // 6
    return np.asarray(of_link * np.pad(pi, (0, regression.structure.n_parameters - len(pi))))


def _pose_variances(rows: Array, links: Array) -> tuple[Array, Array]:
    """Compute the variances of a pose's rows per rho^2, (k,), and the rows along uncorrelated directions."""
    R: Array = np.asarray(np.linalg.qr(rows, mode="r"))
    long = np.abs(R).max(axis=1)
    R = R[long > ROW_ROUNDING * long.max(initial=0)]
    G = R[:, :-1] @ links.T
    values, Q = np.linalg.eigh(G @ G.T)
    return np.maximum(values, 0), Q.T @ R


def _log_evidence(
    rho: float, weighted_prior: WeightedPrior, poses: list[tuple[Array, Array]], unused: int, rest: float
) -> float:
    """Compute the log density of the readings, up to a constant, with stated noise or learnt noise."""
    B, c = (
        part / weighted_prior.noise_factor
        for part in prior_rows(weighted_prior.scaling, weighted_prior.uncertainty)
    )
    prior = np.c_[B, c].T @ np.c_[B, c]
    L = weighted_prior.scaling.L
    best = -math.inf
    for kappa in {1.0, weighted_prior.noise_factor}:
        H, spread = prior.copy(), 2 * unused * math.log(kappa)
        for values, rows in poses:
            variance = kappa**2 + rho**2 * values
            whitened = np.c_[rows[:, :-1] @ L, rows[:, -1]] / np.sqrt(variance)[:, None]
            H += whitened.T @ whitened
            spread += float(np.log(variance).sum())
        _, size_of = np.linalg.slogdet(H[:-1, :-1])
        chi = float(H[-1, -1] - H[-1, :-1] @ np.linalg.solve(H[:-1, :-1], H[:-1, -1])) + rest / kappa**2
        best = max(best, -(chi + spread + float(size_of) + (math.log(kappa) / LOG_MISFIT_DEVIATION) ** 2) / 2)
    return best


def weight_for_pose_variation(regression: Regression, pi: Array, rho: float) -> Regression:
    """Weight equations as if the compliance of every link varied from pose to pose by a share rho.

    Mathematics: `prior-13`.

    Args:
        regression: The reduced dataset, with its rows pose by pose.
        pi: Parameters of a fit, (n,) or the first of them [m/N, rad/(N m), rad/N].
        rho: Standard deviation of a link's compliance over poses, relative to its mean [1].

    Returns:
        The weighted equations, with the variation that predictions of new poses must add.
    """
    links, [term] = _parameters_by_link(regression, pi), regression.terms
    poses, points = [_pose_variances(rows, links) for rows in regression.rows_by_pose], term.n_equations / 3
    weighted = [rows / np.sqrt(1 + rho**2 * values)[:, None] for values, rows in poses]
    rest = term.unexplained + float(term.z @ term.z) - sum(float(y @ y) for y in _readings(poses)) / points
    weighted_term = term_from_triangle(
        triangular_factor(np.vstack(weighted) / math.sqrt(points)), max(0.0, rest), term.n_equations
    )
    # rho is known from as many poses only: Student's quantile in place of the normal one
    width = float(stdtrit(len(poses) - 1, POSE_VARIATION_QUANTILE) / ndtri(POSE_VARIATION_QUANTILE))
    return replace(
        regression_from_terms(regression.structure, (weighted_term,)), pose_variation=width * rho * links
    )


def _readings(poses: list[tuple[Array, Array]]) -> list[Array]:
    """Select the residuals that the rows of every pose can explain, (k,) each."""
    return [rows[:, -1] for _, rows in poses]


JOINTS_ONLY_PRIOR_ODDS = 10.0
"""Prior odds of joints only to links and joints: both have the same weight if the readings make links ten
times more probable.

With odds of 3, 4 of 54 arms whose links are 10, 30 or 100 times stiffer than the prior's have errors more
than 5 % above those of joints only; with odds of 10 none has. Other kinds of arms do not change
(`kr500_l480`, seeds 740001 to 740018, 8 poses)."""
LINEAR_JOINTS_PRIOR_ODDS = 10.0
"""Prior odds of linear joints to joint laws. With even odds the error of 18 % of the undisturbed arms of the
family rises by more than 5 %, with odds of 10 that of 5 %. Results of disturbed arms do not change
(`kr500_l480`, seeds 1 to 40, 8 poses)."""
BEAM_LIKE_LINKS_PRIOR_ODDS = 20.0
"""Prior odds of links coupled as in a beam to links with weaker couplings. They lower the error of coupled
links and soft bearings by a tenth, and raise that of undisturbed arms of the family by 1 %; odds of 3 by 5 %.
Coverage in the worst tenth rises by 1 to 3 points for all kinds (`kr500_l480`, seeds 1 to 40, 8 poses)."""
UNCOUPLED_JOINTS_PRIOR_ODDS = 10.0
"""Prior odds of joints that move by their own torque alone to coupled joints. With them coupled joints have a
weight below `MIN_MODEL_PROBABILITY` in all of 19 arms of the family with all disturbances (`kr500_l480`,
seeds 5000 to 5018, 8 poses), and above one half in 11 of 12 arms with coupled neighbours (seeds 9000 to
9011)."""
POSE_VARIATION_QUANTILE = 0.975
"""Probability at which the normal variation of links in new poses gets the quantile of Student's distribution
[1]. Its degrees of freedom are the number of poses less one: the variation is learnt from these poses."""
MIN_JOINTS_ONLY_WEIGHT, JOINTS_ONLY_WEIGHT_IF_UNSURE = 0.33, 0.5
"""Weights of joints only if links vary from pose to pose [1]: a few poses do not determine how links vary in
others. The first applies if links predict the poses left out better by a paired test, the second if neither
model does.

With both, four of nine such arms that erred more than 5 % more than joints only still do, and 34 others err
3 % more (`kr500_l480`, seeds 770001 to 770048 and 793001 to 793012, 8 poses)."""
DECISIVE_LOG_EVIDENCE = 15.0
"""Log evidence of links over joints only beyond which the two are not compared in poses left out of the fit.
Eight poses are few: for 2 of 16 arms of the family, cast and coupled ones, the paired test does not decide
for links, although their errors without links are 2.5 times as large; their log evidence is 30 to 136. For
five arms with links 10 times stiffer than the prior's, whose fits with links are worse than joints only, it
is 4, 5, 7, 12 and 23 (`kr500_l480`, seeds 793001 to 793006, 770015 to 770044, 8 poses)."""
NEGLIGIBLE_JOINTS_ONLY_WEIGHT = 0.01  #: Weight below which joints only are not part of an average [1].
INTERVAL_ODDS_EXPONENT = 0.5
"""Exponent of the odds of models in intervals, where their prior odds are even [1]: Laplace's evidence of few
readings is uncertain. It raises the coverage in the worst tenth of disturbed arms from 78 to 84 % (seeds 1 to
40, 11 poses); for the two priors by 0 to 3 points. Where links are 30 or 100 times stiffer than the prior's,
intervals that include joints only are 40 % narrower and cover 97 % (seeds 740001 to 740012, 8 poses)."""
JOINTS_ONLY_ODDS_EXPONENT = 0.25
"""Exponent of the odds of joints only in intervals, if joints only are more probable [1]: links that change
no reading still deflect in other poses. It raises the coverage in the worst tenth from 70 to 79 % for arms
whose links are 10 times stiffer than the prior's, and from 86 to 90 % for links 30 and 100 times stiffer;
intervals are 7 to 12 % wider (`kr500_l480`, seeds 792101 to 792212 and the eleven of 770001 to 770049 with
the worst coverage, 8 poses)."""
MIN_MODEL_PROBABILITY = 0.05
"""Probability, and weight, below which a model is not part of an average, and above one minus which it is
alone [1]."""


# --- The average of the default -----------------------------------------------------------------------------


def average_two_priors(
    regression: Regression, constraint: Constraint, prior: PriorScaling, softened_prior: PriorScaling
) -> Estimate:
    """Average the estimates under a prior, and under one with less coupled links, weighted by their evidence.

    If the readings show that compliances of links vary from pose to pose, the equations are weighted for it
    (`weight_for_pose_variation`), and the model of joint stiffness only has at least the weight
    `MIN_JOINTS_ONLY_WEIGHT`.

    Mathematics: `prior-12`.

    Args:
        regression: The reduced dataset, of a structure with joint laws.
        constraint: "none" for least squares, "psd" for GCO.
        prior: Prior with links coupled as in a beam, as units pi = L x.
        softened_prior: Prior with less coupled links, see `with_weaker_coupling`, as units pi = L x.

    Returns:
        The averaged estimate; its field `averaged_models` holds the models and their weights.

    Raises:
        BenchError: When the best common scale of a prior is not above 0.
    """
    estimate = _average_priors(regression, constraint, prior, softened_prior)
    if not regression.rows_by_pose:
        return estimate
    changing = _with_varying_links(regression, constraint, (prior, softened_prior), estimate)
    mean = changing or estimate
    rivals = links_versus_joints_only(regression, mean, prior)
    errors = None if rivals is None or rivals.links_certain else rivals.held_out_errors
    weight = joints_only_weight(errors, links_vary=changing is not None)
    return average_with_joints_only(regression, constraint, prior, mean, weight)


def _with_varying_links(
    regression: Regression,
    constraint: Constraint,
    priors: tuple[PriorScaling, PriorScaling],
    estimate: Estimate,
) -> Estimate | None:
    """Fit again with rows weighted for links that vary from pose to pose; None if there is no need."""
    start = _fit_before_laws(regression, estimate)
    rho = pose_to_pose_variation(regression, start)
    if not rho:
        return None
    try:
        first = average_models(
            weight_for_pose_variation(regression, start.pi, rho), constraint, priors[0], for_intervals=False
        )
        rho = pose_to_pose_variation(regression, first, MAX_VARIATION_EVIDENCE_LOSS)
        return (
            _average_priors(weight_for_pose_variation(regression, first.pi, rho), constraint, *priors)
            if rho
            else None
        )
    except BenchError:  # such weights require a scale of the prior that is not above 0
        return None


def _fit_before_laws(regression: Regression, estimate: Estimate) -> Estimate:
    """Select the fit without joint laws if links that vary are more probable, otherwise the average.

    Joint laws can explain the effect of links that vary, but then predict new poses badly.
    """
    known = estimate.averaged_models
    if known is None or known.with_joint_laws is None or known.joint_laws_weight <= 0.5:
        return estimate
    plain, with_laws = (model.weighted_prior for model in (known.links_and_joints, known.with_joint_laws))
    if plain is None or with_laws is None or plain.log_evidence is None or with_laws.log_evidence is None:
        return estimate
    gains = _variation_evidence(regression, known.links_and_joints)
    changing = plain.log_evidence + gains.max() - gains[0] - MIN_VARIATION_EVIDENCE_GAIN
    return (
        known.links_and_joints
        if changing > with_laws.log_evidence - math.log(LINEAR_JOINTS_PRIOR_ODDS)
        else estimate
    )


# --- Links or joints only, by poses left out ----------------------------------------------------------------


@dataclass(frozen=True)
class LinksVersusJointsOnly:
    """Compare the most probable model with links against joints only, in poses left out of the fit."""

    regression: Regression  #: The reduced dataset, with its rows pose by pose.
    most_probable: Estimate  #: Model of greatest weight in an average, except joints only.
    links_prior: WeightedPrior  #: Learnt prior of `most_probable`.
    joints_only_regression: Regression  #: The same readings in joint compliances alone.
    joints_only_prior: WeightedPrior  #: Prior of the joints' compliances where links are rigid.
    log_bayes_factor: float  #: Log evidence of `most_probable` less that of joints only.

    @property
    def links_certain(self) -> bool:
        """Tell whether link compliances have decisive evidence, and do not vary from pose to pose."""
        return (
            self.most_probable.regression.pose_variation is None
            and self.log_bayes_factor > DECISIVE_LOG_EVIDENCE
        )

    @cached_property
    def held_out_errors(self) -> tuple[Array, Array]:
        """Compute the RMS errors of both models in every pose, predicted from all other poses.

        The learnt prior is that of all poses, so that a fit without a pose is one solution of normal
        equations. The fits are not constrained to positive semi-definite compliances.

        Returns:
            Errors of `most_probable` and of joints only in standard deviations of a reading, (poses,) each
            [1].
        """
        pose_variation, joints_poses = (
            self.most_probable.regression.pose_variation,
            self.joints_only_regression.rows_by_pose,
        )
        poses = restrict_regression(self.regression, self.most_probable.structure).rows_by_pose
        weighted = (
            poses if pose_variation is None else tuple(_weigh_pose(rows, pose_variation) for rows in poses)
        )
        ours = _held_out_errors(poses, weighted, self.links_prior)
        return ours, _held_out_errors(joints_poses, joints_poses, self.joints_only_prior)


def links_versus_joints_only(
    regression: Regression, estimate: Estimate, prior: PriorScaling
) -> LinksVersusJointsOnly | None:
    """Prepare the comparison of the most probable model with links against joints only.

    Args:
        regression: The reduced dataset, with its rows pose by pose.
        estimate: An average of models, weighted by their evidence.
        prior: Prior of the structure of the dataset, as units pi = L x.

    Returns:
        Both models, or None if joints only cannot be fitted or the evidence of links is not known.
    """
    joints_regression, scaling = _joints_only(regression, prior)
    try:
        log_evidence, joints_prior = joints_only_log_evidence(joints_regression, scaling)
    except BenchError:  # no joint is loaded, or all turn against their loads
        return None
    likeliest = _likeliest(estimate)
    weighted_prior = likeliest.weighted_prior
    if weighted_prior is None or weighted_prior.log_evidence is None:
        return None
    over = weighted_prior.log_evidence - log_evidence
    return LinksVersusJointsOnly(regression, likeliest, weighted_prior, joints_regression, joints_prior, over)


def _likeliest(estimate: Estimate) -> Estimate:
    """Select the model of greatest weight in an average, except joints only."""
    known = estimate.averaged_models
    if known is not None and known.with_joint_couplings is not None and known.joint_couplings_weight > 0.5:
        return known.with_joint_couplings
    return _uncoupled_fit(estimate)


def _weigh_pose(rows: Array, pose_variation: Array) -> Array:
    """Weight the rows of a pose for links that vary: the result is uncorrelated, with noise of one."""
    G = rows[:, :-1] @ pose_variation.T
    values, Q = np.linalg.eigh(np.eye(len(rows)) + G @ G.T)
    return np.asarray(Q.T @ rows / np.sqrt(values)[:, None])


def _held_out_errors(
    poses: tuple[Array, ...], weighted: tuple[Array, ...], weighted_prior: WeightedPrior
) -> Array:
    """Compute for every pose the error of the fit to all others, from their weighted rows [1]."""
    L, (B, c) = weighted_prior.scaling.L, prior_rows(weighted_prior.scaling, weighted_prior.uncertainty)
    grams = [rows.T @ rows for rows in (np.c_[rows[:, :-1] @ L, rows[:, -1]] for rows in weighted)]
    whole = np.c_[B, c].T @ np.c_[B, c] + sum(grams)
    errors = []
    for rows, gram in zip(poses, grams, strict=True):
        H = whole - gram
        x = np.linalg.solve(H[:-1, :-1], H[:-1, -1])
        errors.append(np.linalg.norm(rows[:, :-1] @ (L @ x) - rows[:, -1]) / math.sqrt(len(rows)))
    return np.array(errors)


def joints_only_weight(held_out_errors: tuple[Array, Array] | None, *, links_vary: bool) -> float:
    """Choose the weight of the rigid-link model (joints only) by errors in poses left out of the fit.

    A paired test over the poses decides whether the model with links predicts better, at the confidence
    `SELECTION_CONFIDENCE`.

    Mathematics: `prior-14`.

    Args:
        held_out_errors: Errors of the model with links and of joints only, (poses,) each, in standard
            deviations of a reading [1]; None where the evidence already decides for links.
        links_vary: Whether link compliances vary from pose to pose.

    Returns:
        Weight from 0 to 1 [1]. If links predict better: 0, or `MIN_JOINTS_ONLY_WEIGHT` if they vary. If not:
        1, or `JOINTS_ONLY_WEIGHT_IF_UNSURE` if they vary and the test does not show them worse.
    """
    better = MIN_JOINTS_ONLY_WEIGHT if links_vary else 0.0
    if held_out_errors is None:
        return better
    with_links, joints_only = np.log(np.maximum(held_out_errors, SMALLEST_DIVISOR))
    gain, error = mean_and_standard_error(joints_only - with_links)
    sure = float(stdtrit(len(with_links) - 1, SELECTION_CONFIDENCE)) * error
    if gain > sure:
        return better
    return JOINTS_ONLY_WEIGHT_IF_UNSURE if links_vary and gain > -sure else 1.0


def average_with_joints_only(
    regression: Regression, constraint: Constraint, prior: PriorScaling, estimate: Estimate, weight: float
) -> Estimate:
    """Average an estimate and the rigid-link model (joints only) with a given weight.

    Joint laws and coupled joints keep their weight unless joints only have a weight of 1.

    Joints only are fitted to unweighted readings: weighted for links that vary, they err a third more.
    Intervals keep the width that the estimate gives them, about the new mean.

    Args:
        regression: The reduced dataset, with its rows pose by pose.
        constraint: "none" for least squares, "psd" for GCO.
        prior: Prior of the structure of the dataset, as units pi = L x.
        estimate: An average of models, weighted by their evidence.
        weight: Weight of joints only, see `joints_only_weight`, 0 to 1 [1].

    Returns:
        The averaged estimate, F_M that of the unweighted readings.
    """
    known = _models_of(estimate)
    if weight < 1:
        weight *= (1 - known.joint_laws_weight) * (1 - known.joint_couplings_weight)
    if not weight:
        return replace(estimate, f_m=f_m(restrict_regression(regression, estimate.structure), estimate.pi))
    # Joints only, fitted with their wide prior, and the average of both.
    joints_regression, scaling = _joints_only(regression, prior)
    joints_prior = joints_only_log_evidence(joints_regression, scaling)[1]
    joints_fit = solve(joints_regression, constraint, joints_prior)
    average = replace(
        known,
        joints_only_weight=weight + (1 - weight) * known.joints_only_weight,
        joint_laws_weight=(weight < 1) * known.joint_laws_weight,
    )
    weighted = (1 - weight, estimate), (weight, joints_fit)
    mean = _average(estimate.regression, weighted, estimate.weighted_prior, average)
    return replace(mean, f_m=f_m(restrict_regression(regression, mean.structure), mean.pi))


# --- Averages by evidence, under two priors and under one ---------------------------------------------------


def _average_priors(
    regression: Regression, constraint: Constraint, prior: PriorScaling, softened_prior: PriorScaling
) -> Estimate:
    """Average the fits under both priors, for given weights of the rows."""
    first, log_evidence = _average_joint_couplings(regression, constraint, prior, for_intervals=True)
    if log_evidence is None:
        return first
    second, log_other = _average_joint_couplings(regression, constraint, softened_prior, for_intervals=True)
    assert log_other is not None
    # Weights by evidence: for the mean, and for intervals.
    odds = log_other - log_evidence
    share, probability = (
        _logistic(odds - math.log(BEAM_LIKE_LINKS_PRIOR_ODDS)),
        _logistic(INTERVAL_ODDS_EXPONENT * odds),
    )
    if not MIN_MODEL_PROBABILITY < probability < 1 - MIN_MODEL_PROBABILITY:
        return second if probability > 0.5 else first
    share = share if share > MIN_MODEL_PROBABILITY else 0.0
    likelier = second if share > 0.5 else first
    # The mean, and the models that it contains.
    weighted, probable = (
        ((1 - share, first), (share, second)),
        ((1 - probability, first), (probability, second)),
    )
    known = [(weight, _models_of(model)) for weight, model in weighted]
    by_size = sorted(probable, key=lambda part: -part[1].structure.n_parameters)
    average = ModelAverage(
        links_and_joints=known[share > 0.5][1].links_and_joints,
        interval_models=tuple(by_size),
        joints_only_weight=sum(weight * model.joints_only_weight for weight, model in known),
        joint_laws_weight=sum(weight * model.joint_laws_weight for weight, model in known),
        with_joint_laws=next(
            (model.with_joint_laws for _, model in known if model.with_joint_laws is not None), None
        ),
        joint_couplings_weight=sum(weight * model.joint_couplings_weight for weight, model in known),
        with_joint_couplings=next(
            (model.with_joint_couplings for _, model in known if model.with_joint_couplings is not None), None
        ),
    )
    return _average(by_size[0][1].regression, weighted, likelier.weighted_prior, average)


def _average(
    regression: Regression,
    weighted: Sequence[tuple[float, Estimate]],
    prior: WeightedPrior | None,
    average: ModelAverage,
) -> Estimate:
    """Average models by their weights; parameters that a model lacks count as zero.

    The status is that of the first model that is not solved.
    """
    models = [model for _, model in weighted]
    parameters = (
        w * embed_parameters(model.pi, model.structure, regression.structure) for w, model in weighted
    )
    pi = np.sum(list(parameters), axis=0)
    mean = make_estimate(regression, pi, method=models[0].method, constraint=models[0].constraint)
    return replace(
        mean,
        weighted_prior=prior,
        status=next((model.status for model in models if model.status != "solved"), "solved"),
        solver_seconds=sum(model.solver_seconds for model in models),
        averaged_models=average,
    )


def average_models(
    regression: Regression, constraint: Constraint, prior: PriorScaling, *, for_intervals: bool
) -> Estimate:
    """Fit a dataset with a prior learnt from it, and average the fit with simpler models by evidence.

    Mathematics: `prior-12`.

    Args:
        regression: The reduced dataset; if its structure has joint laws, the average includes them.
        constraint: "none" for least squares, "psd" for GCO.
        prior: Prior of the structure of the dataset, as units pi = L x.
        for_intervals: Whether to compute the uncertainty of the learnt prior, which intervals need.

    Returns:
        The averaged estimate; its field `averaged_models` holds the models and their weights.

    Raises:
        BenchError: If the dataset requires a common scale of the prior that is not above 0.
    """
    return _average_joint_couplings(regression, constraint, prior, for_intervals=for_intervals)[0]


def _average_joint_couplings(
    regression: Regression, constraint: Constraint, prior: PriorScaling, *, for_intervals: bool
) -> tuple[Estimate, float | None]:
    """Average fits with and without coupled joints; also return the evidence, None without one."""
    if not prior.is_joint_coupling.any():
        return _average_laws(regression, constraint, prior, for_intervals=for_intervals)
    # Both models: without and with couplings between joints.
    uncoupled, coupled_scaling = (
        restrict_scaling(prior, structure)
        for structure in (
            remove_coupling_parameters(prior.structure),
            add_coupling_parameters(linear(prior.structure)),
        )
    )
    mean, log_evidence = _average_laws(
        restrict_regression(regression, uncoupled.structure),
        constraint,
        uncoupled,
        for_intervals=for_intervals,
    )
    if log_evidence is None:
        return mean, None
    coupled = restrict_regression(regression, coupled_scaling.structure)
    weighted_prior = learn_prior(coupled, coupled_scaling, for_intervals=for_intervals)
    assert weighted_prior.log_evidence is not None
    # Their odds by evidence; a model that hardly counts is left out.
    odds = weighted_prior.log_evidence - log_evidence - math.log(UNCOUPLED_JOINTS_PRIOR_ODDS)
    total_evidence, share = log_evidence + float(np.logaddexp(0, odds)), _logistic(odds)
    if share < MIN_MODEL_PROBABILITY:
        return mean, total_evidence
    share = share if share < 1 - MIN_MODEL_PROBABILITY else 1.0
    estimate, known = solve(coupled, constraint, weighted_prior), _models_of(mean)
    average = replace(
        known,
        interval_models=_mixed((share, estimate), known),
        joint_laws_weight=(1 - share) * known.joint_laws_weight,
        joint_couplings_weight=share,
        with_joint_couplings=estimate,
    )
    likelier = weighted_prior if share > 0.5 else mean.weighted_prior
    return _average(regression, ((1 - share, mean), (share, estimate)), likelier, average), total_evidence


def _average_laws(
    regression: Regression, constraint: Constraint, prior: PriorScaling, *, for_intervals: bool
) -> tuple[Estimate, float | None]:
    """Average models with uncoupled joints, with and without laws; also return the evidence."""
    structure = linear(prior.structure)
    plain = prior if structure is prior.structure else restrict_scaling(prior, structure)
    compliances = regression if plain is prior else restrict_regression(regression, plain.structure)
    linear_mean, log_evidence = _average_joints(compliances, constraint, plain, for_intervals)
    if plain is prior or log_evidence is None:
        return linear_mean, log_evidence
    # Odds of joint laws, and the mean by them.
    weighted_prior = learn_prior(regression, prior, for_intervals=for_intervals)
    assert weighted_prior.log_evidence is not None
    odds = weighted_prior.log_evidence - log_evidence
    total_evidence = log_evidence + float(np.logaddexp(0, odds - math.log(LINEAR_JOINTS_PRIOR_ODDS)))
    weight, probability = (
        _logistic(odds - math.log(LINEAR_JOINTS_PRIOR_ODDS)),
        _logistic(INTERVAL_ODDS_EXPONENT * odds),
    )
    if probability < MIN_MODEL_PROBABILITY:
        return linear_mean, total_evidence
    with_laws = solve(regression, constraint, weighted_prior)
    if probability > 1 - MIN_MODEL_PROBABILITY:
        weight = probability = 1.0
    elif weight < MIN_MODEL_PROBABILITY:
        weight = 0.0
    known = _models_of(linear_mean)
    average = replace(
        known,
        interval_models=_mixed((probability, with_laws), known),
        joint_laws_weight=weight,
        with_joint_laws=with_laws,
    )
    likelier = weighted_prior if weight > 0.5 else known.links_and_joints.weighted_prior
    return _average(
        regression, ((1 - weight, linear_mean), (weight, with_laws)), likelier, average
    ), total_evidence


def _models_of(estimate: Estimate) -> ModelAverage:
    """Return the models that an estimate averages, or the estimate as the only one."""
    return estimate.averaged_models or ModelAverage(estimate, ((1.0, estimate),))


def _mixed(part: tuple[float, Estimate], others: ModelAverage) -> tuple[tuple[float, Estimate], ...]:
    """Put a model with its probability before other models, which share the rest."""
    rest = 1 - part[0]
    return (part, *((rest * p, model) for p, model in others.interval_models if rest))


# --- Parts of a model ---------------------------------------------------------------------------------------


def restrict_scaling(scaling: PriorScaling, structure: Structure) -> PriorScaling:
    """Restrict a prior, as units pi = L x, to fewer unknowns; the others are zero.

    Args:
        scaling: Units L and expectation of x of the prior.
        structure: Some of the prior's unknowns.

    Returns:
        Units and expectation of these unknowns alone.
    """
    places = structure.indices_in(scaling.structure)
    keep = np.flatnonzero(np.isin(scaling.structure.parameter_of_entry, places))
    return PriorScaling(
        scaling.prior_name, structure, scaling.L[np.ix_(places, keep)], scaling.expected_x[keep]
    )


def _average_joints(
    r: Regression, constraint: Constraint, prior: PriorScaling, for_intervals: bool
) -> tuple[Estimate, float | None]:
    """Average links and joints with joints only, without laws; also return the evidence, None without one."""
    weighted_prior, joints = (
        learn_prior(r, prior, for_intervals=for_intervals),
        joint_compliance_indices(prior),
    )
    whole = solve(r, constraint, weighted_prior)
    if (
        weighted_prior.log_evidence is None or len(joints) < prior.structure.n_links - 1
    ):  # of links or joints only
        return whole, None
    regression, scaling = _joints_only(r, prior)
    try:
        log_evidence, joints_prior = joints_only_log_evidence(regression, scaling)
    except BenchError:  # no joint is loaded, or all turn against their loads: joints only cannot be fitted
        return whole, weighted_prior.log_evidence
    odds = log_evidence - weighted_prior.log_evidence + math.log(JOINTS_ONLY_PRIOR_ODDS)
    weight = _logistic(odds)
    total_evidence = weighted_prior.log_evidence + float(np.logaddexp(0, odds))
    if weight < NEGLIGIBLE_JOINTS_ONLY_WEIGHT:
        return whole, total_evidence
    joints_fit = solve(regression, constraint, joints_prior)
    probability = min(
        _logistic(power * (odds - math.log(JOINTS_ONLY_PRIOR_ODDS)))
        for power in (INTERVAL_ODDS_EXPONENT, JOINTS_ONLY_ODDS_EXPONENT)
    )
    average = ModelAverage(
        whole, ((1 - probability, whole), (probability, joints_fit)), joints_only_weight=weight
    )
    return _average(r, ((1 - weight, whole), (weight, joints_fit)), weighted_prior, average), total_evidence


def _joints_only(r: Regression, prior: PriorScaling) -> tuple[Regression, PriorScaling]:
    """Restrict a dataset, and the units of its prior, to joint compliances only."""
    structure = prior.structure.select_parameters(joint_compliance_indices(prior), "Joints")
    return restrict_regression(r, structure), restrict_scaling(prior, structure)


def joint_compliance_indices(scaling: PriorScaling) -> Ids:
    """Find the indices of the parameters that are compliances of joints, (joints,)."""
    s = scaling.structure
    return np.flatnonzero((s.rows == s.columns) & (s.rows >= 6 * s.n_links) & (s.rows < s.n_compliance_rows))


def _logistic(x: float) -> float:
    """Return the probability of odds whose logarithm is x."""
    return float(1 / (1 + np.exp(-np.clip(x, -700, 700))))
