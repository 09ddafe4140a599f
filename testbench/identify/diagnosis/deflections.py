"""Mistakes in loads and deflections, found with the nominal compliances as prior.

The model is linear, and its prior is learnt from the readings (`hierarchy`): y ~ N(A s e, S). A mistake of
size b adds Z b to the readings: the score test estimates b. A mistake without a size, such as exchanged
axes, is corrected; then the prior is learnt again, and the losses are compared.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.data.dataset import Dataset, select_runs
from testbench.errors import Array, BenchError, Mask
from testbench.identify.absolute.state import compliance_unknowns
from testbench.identify.diagnosis.gravity import (
    DOWN,
    MIN_TILT,
    GravityDirection,
    angle_between,
    loads_are_weights,
    mounting_issue,
    suspected_gravity,
)
from testbench.identify.diagnosis.kinematics import (
    Correction,
    Hypothesis,
    Issue,
    correct_one_by_one,
    score_test,
)
from testbench.identify.equations import (
    WeightedReadings,
    flatten_readings,
    jacobian,
    undeflected_arm,
    weighted_readings,
    whiten_deflections,
)
from testbench.identify.hierarchy import evidence_posterior, maximise_evidence, prior_evidence_model
from testbench.identify.prior import PriorScaling
from testbench.identify.regression import reduce
from testbench.model.kinematics import JointErrorTerms
from testbench.model.load import Load
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm, marker_positions

USUAL_BACKLASH, USUAL_STIFFENING = 6e-5, 200.0
"""Half width of the usual backlash or friction of a joint [rad, m], and its stiffening per radian [1/rad].

Both are a little larger than in `plant.disturbance.TYPICAL_DISTURBANCES`."""
MIN_GAIN, MIN_GAIN_OF_RUN, MIN_GAIN_OF_ALL_LOADS = 7.0, 12.0, 20.0
"""Least log-likelihood gain of an issue [nats]: of a mistake with a size, of one in a single run or load
level, and of one that changes all loads, such as exchanged axes."""
MIN_GAIN_WITHOUT_RUN = 3.0
"""Gain from which a run is left out on trial [nats]: strong evidence (Kass and Raftery 1995)."""
MAX_QUIET_MISFIT, MAX_QUIET_SCALE = 1.3, 2.5
"""Misfit, and factor between prior and readings, up to which mistakes without a size are not tried [1]."""
MAX_NOISE_MISFIT, MIN_NOISE_SHARE = 8.0, 0.005
"""Misfit, and share of the typical deflection, above which the stated noise raises a warning [1].

Model errors explain smaller ones."""
MAX_MISFIT_RATIO, MIN_RUNS_TO_LEAVE_ONE_OUT = 0.5, 5
"""Misfit without a run over that with it, below which that run alone is wrong [1]; fewest runs to tell."""
MIN_MOUNTING_GAIN_RATIO = 0.8
"""Gain of a wrong mounting, over the largest gain of the other mistakes, above which it is preferred [1]."""
SINGLE_RUN_GAIN_WEIGHT = 0.5  #: Weight of the gain of a mistake in one run when mistakes are ranked [1].
MAX_DEFLECTION_SCALE, LIGHT_LOAD_SCALE, LIGHT_LOAD_SHARE = 5.0, 4.5, 0.35
"""Factors between readings and prior that raise a warning [1].

The first holds for any load. The second holds where the largest load is light as newtons, but not if its
number were kilograms: light is below LIGHT_LOAD_SHARE of the stated payload."""
MIN_RUNS_OF_LEVEL, MAX_FORCE_DIFFERENCE = 3, 0.02
"""Fewest runs of a load level, and how far its forces may differ, over the largest force [1]."""


@dataclass(frozen=True)
class ResidualModel:
    """Hold a compliance model fitted to loaded runs, with the residuals and their inverse covariance.

    The k whitened equations are y = A pi + e. The prior is pi = L (s m + d x) with x ~ N(0, I), units L and
    expected compliances L m. Scale s and widths d are learnt from the readings.
    """

    readings: WeightedReadings  #: The whitened equations of every single reading.
    neg_log_evidence: float  #: Negative logarithm of the evidence [nats].
    pi: Array  #: Posterior mean of the compliances, (n,) [m/N, rad/(N m)].
    #: Factor U of the readings' inverse covariance W = I / misfit^2 - U U^T, (k, r) [1]. Readings share few
    #: unknowns, so that no matrix of size (k, k) is needed.
    inverse_covariance_factor: Array
    weighted_residual: Array  #: W times the residuals of the readings from the prior mean, (k,) [1].
    hyperparameters: Array  #: Hyperparameters of the prior, all logarithms; the last one is log misfit.

    @property
    def misfit(self) -> float:
        """Compute the ratio kappa of the estimated noise of the readings to their stated noise [1]."""
        return float(np.exp(self.hyperparameters[-1]))

    def residuals(self, readings: WeightedReadings) -> Array:
        """Compute the residuals y - A pi of whitened equations, (k,) [1].

        Args:
            readings: The equations, of these or of corrected readings.
        """
        return np.asarray((readings.y - readings.A @ self.pi).ravel())


@dataclass(frozen=True)
class LoadedRuns:
    """Hold loaded runs that are tested for mistakes, with the prior of the compliances."""

    vjm: Vjm  #: The arm's virtual joint model.
    compliance_prior: PriorScaling  #: Prior of the compliances.
    data: Dataset  #: The runs.
    #: Gravity in the nominal world by a level tracker, a unit vector, (3,) [1]; None if unknown.
    tracker_gravity: Array | None = None
    #: Suspected direction of gravity other than the nominal one; None if nothing suggests it.
    suspected_gravity: GravityDirection | None = None

    @property
    def largest_force(self) -> float:
        """Compute the largest force of all runs [N]."""
        return float(np.linalg.norm(self.data.wrench[:, :3], axis=1).max())


@dataclass(frozen=True)
class FittedRuns:
    """Hold loaded runs and the model that is fitted to them; its residuals show mistakes with a size."""

    runs: LoadedRuns  #: The runs with their prior.
    model: ResidualModel  #: The fitted compliances, with residuals and covariance.

    def mistake_jacobian(self, corrected_data: Sequence[Dataset]) -> Array:
        """Compute the change Z of the whitened residuals per unit of each parameter of a mistake.

        Column i is the residual y - A pi of the data as read, minus that of the data with one unit of
        parameter i corrected.

        Args:
            corrected_data: The data with one unit of each of z parameters corrected.

        Returns:
            Z, (k, z) [1].

        Raises:
            BenchError: When there are too many readings to weigh them one by one.
        """
        as_read, structure = self.model.residuals(self.model.readings), self.runs.compliance_prior.structure
        every = (weighted_readings(self.runs.vjm, structure, data) for data in corrected_data)
        return np.column_stack([as_read - self.model.residuals(readings) for readings in every])

    def issue_by_score_test(self, name: str, correction: "Correction[FittedRuns]") -> Issue:
        """Estimate the size and the log-likelihood gain of a mistake that enters linearly, by `score_test`.

        The score is g = Z^T W e and the information M = Z^T W Z. W is the inverse covariance of the readings,
        e are their residuals from the prior mean.

        Args:
            name: Name of the hypothesis.
            correction: A correction with a Jacobian Z.

        Returns:
            The issue, with its expected size in SI units.
        """
        assert correction.jacobian is not None
        Z, rows = correction.jacobian, slice(*(correction.equation_range or (None,)))
        half = self.model.inverse_covariance_factor[rows].T @ Z
        M = Z.T @ Z / self.model.misfit**2 - half.T @ half
        score = score_test(Z.T @ self.model.weighted_residual[rows], M)
        size = correction.prior_deviation * score.expected_size
        return Issue(name, correction.where, size, correction.details, float(score.log_bayes_factor))


@dataclass(frozen=True)
class LoadHypotheses:
    """Hold the kinds of mistakes in loads and deflections, by the way in which they are tested."""

    mounting: tuple[Hypothesis[LoadedRuns], ...]  #: Gravity in another direction: the runs are fitted again.
    other_loads: tuple[Hypothesis[LoadedRuns], ...]  #: Loads of another kind: the runs are fitted again.
    sized: tuple[Hypothesis[FittedRuns], ...]  #: Mistakes in all runs with a size, by the score test.
    single_runs: tuple[Hypothesis[FittedRuns], ...]  #: Mistakes in single runs, by the score test.

    @property
    def single_run_names(self) -> frozenset[str]:
        """Return the names of the mistakes in single runs."""
        return frozenset(row.name for row in self.single_runs)


def deflection_scale(loads: LoadedRuns) -> float:
    """Compute the factor between measured deflections and those that the prior predicts, by least squares.

    It is y^T A pi / |A pi|^2, with A the whitened observation matrix and pi the expected compliances.

    Args:
        loads: The runs, with the prior of the compliances.

    Returns:
        The factor [1].

    Raises:
        BenchError: When there is no run, a number is too large, or a marker is none of the arm's.
    """
    prior = loads.compliance_prior
    regression, pi = reduce(loads.vjm, prior.structure, loads.data), prior.L @ prior.expected_x
    rows = [(t.R @ pi, t.z) for t in regression.terms]
    return float(sum(a @ z for a, z in rows) / sum(a @ a for a, _ in rows))


def fit_residual_model(loads: LoadedRuns, hyperparameters: Array | None = None) -> ResidualModel:
    """Fit the compliances with a prior learnt from the readings, and compute residuals and covariance.

    With kappa the ratio of estimated to stated noise, the inverse covariance of the readings is

        W = (kappa^2 I + H H^T)^-1 = I / kappa^2 - U U^T

    H has the columns of compliances, and of the usual backlash and stiffening of joints, times their prior
    standard deviations. The weighted residual is W (y - A E[pi]), with the prior mean E[pi].

    Args:
        loads: The runs, with the prior of the compliances.
        hyperparameters: Hyperparameters of the prior, (h,), learnt from other readings; None to learn them
            here.

    Returns:
        The fitted model with its residuals and their covariance.

    Raises:
        BenchError: When no compliance moves as the readings do.
    """
    vjm, data, structure = loads.vjm, loads.data, loads.compliance_prior.structure
    reduced = reduce(vjm, structure, data)
    model = prior_evidence_model(reduced, loads.compliance_prior, shared_link_uncertainty=True)
    evidence = (
        maximise_evidence(model.evidence, model.hyperparameter_medians)
        if hyperparameters is None
        else evidence_posterior(model.evidence, hyperparameters)
    )
    read = weighted_readings(vjm, structure, data)
    G = read.A.reshape(-1, structure.n_parameters) @ model.scaling.L
    # The most probable compliances: least squares over the rows of the readings and of the prior.
    s, kappa = model.entry_scales(evidence.h), np.exp(evidence.h[-1])
    width = np.exp(model.evidence.log_deviation_rows @ evidence.h)
    residual = read.y.ravel() - G @ (s * model.scaling.expected_x)
    half = G * width
    expected = np.concatenate([residual, np.zeros(len(width))])
    x = np.linalg.lstsq(np.vstack([half, kappa * np.eye(len(width))]), expected)[0]
    pi = model.scaling.L @ (s * model.scaling.expected_x + width * x)
    # Covariance by compliances, backlash and stiffening, in the singular vectors of H.
    if vjm.arm.joints:
        half = np.hstack([half, backlash_and_stiffening_columns(vjm, data, structure, pi)])
    left, size, _ = np.linalg.svd(half, full_matrices=False)
    U = left * (size / np.hypot(size, kappa) / kappa)
    weighted_residual = residual / kappa**2 - U @ (U.T @ residual)
    least = evidence.neg_log_evidence
    return ResidualModel(read, least, pi, U, weighted_residual, evidence.h)


def backlash_and_stiffening_columns(vjm: Vjm, data: Dataset, structure: Structure, pi: Array) -> Array:
    """Compute the columns of backlash and stiffening in the whitened equations, for usual sizes.

    A joint with compliance c turns by t = c u under its torque u. Its backlash adds USUAL_BACKLASH sign(t),
    its stiffening USUAL_STIFFENING t |t|.

    Args:
        vjm: The arm's virtual joint model.
        data: The runs.
        structure: The compliances, n of them.
        pi: Values of the compliances, (n,) [m/N, rad/(N m)].

    Returns:
        Two columns per joint, backlash first, (rows, 2 joints) [1].
    """
    state, first = undeflected_arm(vjm, data.q, [Load(data.wrench, data.point)]), 6 * len(vjm.arm.links)
    turn = np.diag(structure.C_theta_of(pi))[first:, None] * state.generalised_loads[first:]
    motions = [USUAL_BACKLASH * np.sign(turn), USUAL_STIFFENING * turn * np.abs(turn)]
    state = replace(state, error_basis=np.stack(motions, axis=1))
    unknowns = replace(
        compliance_unknowns(vjm, structure), error_terms=JointErrorTerms(play=True, stiffening=True)
    )
    points, read = marker_positions(vjm, data.markers), data.sigma_rotation is not None
    A = jacobian(unknowns, state, points, with_orientation=read)[:, :, unknowns.columns("errors")]
    return flatten_readings(A, whiten_deflections(A, data, np.arange(data.n_runs))).reshape(-1, A.shape[2])


def load_levels(data: Dataset) -> list[Mask]:
    """Group runs by the magnitude of their force: one mask per load level, (runs,) each, the largest first.

    The list is empty when a run has no force, or a level has fewer than MIN_RUNS_OF_LEVEL runs.
    """
    force = np.linalg.norm(data.wrench[:, :3], axis=1)
    masks: list[Mask] = []
    left = np.ones(len(force), dtype=bool)
    while left.any():
        level = left & (np.abs(force - force[left].max()) <= MAX_FORCE_DIFFERENCE * force.max())
        masks.append(level)
        left &= ~level
    often = all(level.sum() >= MIN_RUNS_OF_LEVEL for level in masks)
    return masks if often and force.min() > 0 else []


def find_load_issues(loads: LoadedRuns, hypotheses: LoadHypotheses) -> list[Issue]:
    """Find the mistakes in loads and deflections whose correction makes the readings fit the prior best.

    If gravity certainly acts in another direction, the mounting is the only issue. Otherwise, single wrong
    runs that make all others look noisy are left out first. Mistakes with a size are then tested by the score
    test; the others are corrected and fitted again.

    Args:
        loads: The runs with their prior.
        hypotheses: Kinds of mistakes.

    Returns:
        Issues, the most probable first; none for runs without a mistake.
    """
    factor, kinds = deflection_scale(loads), hypotheses.single_run_names
    gravity = suspected_gravity(loads.vjm, loads.compliance_prior, loads.data, loads.tracker_gravity)
    loads = replace(loads, suspected_gravity=gravity)
    if gravity is not None and gravity.is_certain:
        return [mounting_issue(loads.vjm, gravity)]
    try:
        model = fit_residual_model(loads)
    except BenchError:  # no compliance moves so: only other loads can
        refitted = (_refitted(rows, loads) for rows in (hypotheses.mounting, hypotheses.other_loads))
        return next(filter(None, refitted), [_wild_reading(loads.data, factor)])
    issues, fitted = correct_one_by_one(FittedRuns(loads, model), partial(_without_worst, hypotheses))
    loads, model = fitted.runs, fitted.model
    best = _likeliest(fitted, hypotheses)
    loads = replace(loads, suspected_gravity=gravity or _missing_weight(loads, best))
    # A wrong mounting, if it rivals the best other mistake; weights have no force offset.
    hung = _refitted(hypotheses.mounting, loads, model)
    rival = max((_gain(issue) for issue in best if issue.name != "force_offset"), default=0.0)
    if hung and (hung[0].details["tracker_agrees"] or _gain(hung[0]) > MIN_MOUNTING_GAIN_RATIO * rival):
        return [*hung, *(issue for issue in (*issues, *best) if issue.name in kinds)]
    issues += best
    # Mistakes without a size, if the model does not explain the readings well.
    if model.misfit > MAX_QUIET_MISFIT or not 1 / MAX_QUIET_SCALE < factor < MAX_QUIET_SCALE:
        issues += _refitted(hypotheses.other_loads, loads, model)
    issues.sort(key=lambda issue: -_gain(issue) * (SINGLE_RUN_GAIN_WEIGHT if issue.name in kinds else 1))
    issues += _scale_issue(loads, factor)
    data = loads.data
    typical = float(np.median(np.linalg.norm(data.deflection, axis=2)[data.is_measured]))
    noisy = model.misfit > MAX_NOISE_MISFIT and model.misfit * data.sigma > MIN_NOISE_SHARE * typical
    if not issues and noisy:
        issues.append(Issue("noise", details={"factor": model.misfit, "sigma": data.sigma}))
    return issues


def _gain(issue: Issue) -> float:
    return issue.log_likelihood_gain or 0.0


def _sized_issues(
    fitted: FittedRuns, hypotheses: Sequence[Hypothesis[FittedRuns]]
) -> Iterator[tuple[Issue, bool]]:
    """Score every mistake that enters linearly; yield it with whether it is likely and large."""
    for hypothesis in hypotheses:
        for correction in hypothesis.corrections(fitted):
            issue = fitted.issue_by_score_test(hypothesis.name, correction)
            yield issue, _gain(issue) > hypothesis.min_gain and correction.is_large(issue.size)


def _without_worst(hypotheses: LoadHypotheses, fitted: FittedRuns) -> tuple[list[Issue], FittedRuns] | None:
    """Leave out the run that alone makes all others look noisy; None if no run does.

    The other runs determine noise and prior: with the wrong run among them, its mistake would hide in both.
    """
    loads, model = fitted.runs, fitted.model
    if model.misfit <= MAX_QUIET_MISFIT or loads.data.n_runs < MIN_RUNS_TO_LEAVE_ONE_OUT:
        return None
    likeliest = max((issue for issue, _ in _sized_issues(fitted, hypotheses.single_runs)), key=_gain)
    if _gain(likeliest) < MIN_GAIN_WITHOUT_RUN:
        return None
    worst = likeliest.where[0]
    others = replace(loads, data=select_runs(loads.data, loads.data.run_id.astype(str) != worst))
    try:
        rest = fit_residual_model(others)
    except BenchError:  # no compliance moves as the other runs do: it is not this run that is wrong
        return None
    if rest.misfit > MAX_MISFIT_RATIO * model.misfit:
        return None
    # The mistakes of this run, by the noise and the prior of the others.
    judged = FittedRuns(loads, fit_residual_model(loads, rest.hyperparameters))
    large = (issue for issue, is_large in _sized_issues(judged, hypotheses.single_runs) if is_large)
    issues = [issue for issue in large if issue.where[0] == worst]
    return ([max(issues, key=_gain)], FittedRuns(others, rest)) if issues else None


def _likeliest(fitted: FittedRuns, hypotheses: LoadHypotheses) -> list[Issue]:
    """Select the most probable mistake; if it is of a single run, also the mistakes of other single runs."""
    issues: list[Issue] = []
    kinds, every = hypotheses.single_run_names, (*hypotheses.sized, *hypotheses.single_runs)
    large = [issue for issue, large in _sized_issues(fitted, every) if large]
    for candidate in sorted(large, key=_gain, reverse=True):
        wrong = {other.where[0] for other in issues if other.name in kinds}
        if not issues or (wrong and candidate.name in kinds and candidate.where[0] not in wrong):
            issues.append(candidate)
    return issues


def _refitted(
    hypotheses: Sequence[Hypothesis[LoadedRuns]], loads: LoadedRuns, before: ResidualModel | None = None
) -> list[Issue]:
    """Find the mistake without a size that explains the readings best, if one does.

    `before` is the model of the runs as they are; None if no compliances fit them.
    """
    tried = list[tuple[ResidualModel, Issue, float]]()
    for hypothesis in hypotheses:
        for correction in hypothesis.corrections(loads):
            assert correction.corrected_data is not None
            try:
                refit = fit_residual_model(correction.corrected_data)
            except BenchError:  # moves against the force
                continue
            gain = None if before is None else before.neg_log_evidence - refit.neg_log_evidence
            issue = Issue(hypothesis.name, correction.where, correction.size, correction.details, gain)
            confirmed = correction.details.get("tracker_agrees")
            tried.append((refit, issue, MIN_GAIN if confirmed else hypothesis.min_gain))
    if not tried:
        return []
    refit, issue, min_gain = min(tried, key=lambda trial: trial[0].neg_log_evidence)
    explains = refit.misfit <= MAX_NOISE_MISFIT if before is None else _gain(issue) >= min_gain
    return [issue] if explains else []


def _missing_weight(loads: LoadedRuns, best: Sequence[Issue]) -> GravityDirection | None:
    """Find the direction of gravity if a constant additional force explains the readings best; else None."""
    constant = bool(best) and best[0].name == "force_offset"
    if loads.tracker_gravity is not None or not constant or not loads_are_weights(loads.data):
        return None
    total = loads.data.wrench[:, :3].mean(axis=0) + best[0].size
    gravity = GravityDirection(total / np.linalg.norm(total))
    return gravity if angle_between(gravity.g, DOWN) > MIN_TILT else None


def _wild_reading(data: Dataset, factor: float) -> Issue:
    """Name the largest deflection where no compliance fits: it may be wrong, and outweigh all others."""
    size = np.where(data.is_measured, np.linalg.norm(data.deflection, axis=-1), 0)
    (i, k), median = np.unravel_index(np.argmax(size), size.shape), float(np.median(size[data.is_measured]))
    details = {"factor": factor, "largest": float(size[i, k]), "median": median}
    return Issue("scale", (data.markers[k], str(data.run_id[i])), details=details)


def _scale_issue(loads: LoadedRuns, factor: float) -> list[Issue]:
    """List an issue if the factor between prior and readings is absurd."""
    size = abs(math.log(max(abs(factor), 1e-12)))
    payload, force = loads.vjm.arm.payload, loads.largest_force
    light = payload is not None and LIGHT_LOAD_SHARE * payload < force < LIGHT_LOAD_SHARE * payload * GRAVITY
    if size <= math.log(MAX_DEFLECTION_SCALE) and not (light and factor > LIGHT_LOAD_SCALE):
        return []
    return [Issue("scale", details={"factor": factor, "force": force}, log_likelihood_gain=size**2 / 2)]
