"""Mistakes of loads and deflections, with the compliances of the arm's folder as prior.

The model is linear, and its prior is learnt from the readings (`hierarchy`): y ~ N(A s e, S). A mistake of
size b adds Z b to the readings: the score test estimates it. A mistake without a size, such as exchanged
axes, is undone; then the prior is learnt again, and the losses are compared.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.data.dataset import Dataset, select
from testbench.errors import Array, BenchError, Mask
from testbench.identify.absolute.state import compliance_unknowns
from testbench.identify.diagnosis.gravity import (
    DOWN,
    MIN_TILT,
    GravityDirection,
    angle,
    mounting,
    suspected_gravity,
    weights_only,
)
from testbench.identify.diagnosis.kinematics import Change, Hypothesis, Issue, score_test, undo_one_by_one
from testbench.identify.hierarchy import evidence_model, evidence_posterior, maximise_evidence
from testbench.identify.metric import PriorScaling
from testbench.identify.regression import reduce
from testbench.identify.rows import (
    WeightedReadings,
    each_reading,
    jacobian,
    nominal_chain,
    single_readings,
    whiten,
)
from testbench.model.kinematics import JointErrors
from testbench.model.load import Load
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm, marker_points

SOUND_BACKLASH, SOUND_STIFFENING = 6e-5, 200.0
"""Half width of a joint's backlash or friction [rad, m], and its relative stiffening per radian [1/rad].

Both are a little larger than in `plant.disturbance.TYPICAL`."""
MIN_NATS, MIN_NATS_OF_RUN = 7.0, 12.0
"""Log-likelihood that a mistake has to gain to be an issue, and that of a single run or level [nats]."""
MIN_NATS_OF_AXES = 20.0  #: The same for mistakes that change all loads, such as other axes or levels [nats].
QUIET_LIMITS = 1.3, 2.5
"""Limits of misfit, and of the factor between prior and readings [1].

Above one of them, mistakes without a size are tried."""
NOISE_MISFIT, NOISE_SHARE = 8.0, 0.005
"""Misfit, and share of the typical deflection, above which the stated noise raises a warning [1].

Model errors explain smaller ones."""
MAX_MISFIT_RATIO, MIN_RUNS = 0.5, 5
"""Misfit without a run over that with it, below which that run alone is wrong [1]; fewest runs to tell."""
TRIAL_NATS = 3.0  #: Evidence from which a run is left out on trial [nats]: strong (Kass and Raftery 1995).
RIVAL_SHARE = 0.8  #: Share of another mistake's nats above which a mounting is preferred to it [1].
RUN_WEIGHT = 0.5  #: Weight of the evidence for a mistake of one run, relative to a mistake of all runs [1].
MAX_SCALE, LIGHT_LOAD_SCALE, LIGHT_LOAD_SHARE = 5.0, 4.5, 0.35
"""Factors between readings and prior that raise a warning [1].

The first holds for any load. The second holds where the largest load is light as newtons, but not if its
number were kilograms: light is below LIGHT_LOAD_SHARE of the stated payload."""
LEVEL_RUNS, SAME_FORCE = 3, 0.02
"""Fewest runs of a load level, and how far its forces may differ, over the largest force [1]."""


@dataclass(frozen=True)
class ResidualModel:
    """Hold a fitted compliance model with the residuals of all readings and their covariance.

    The k whitened equations are y = A pi + e. The prior is pi = L (s m + d x) with x ~ N(0, I); s and d are
    learnt from the readings.
    """

    vjm: Vjm  #: The arm's virtual joint model.
    scaling: PriorScaling  #: Units of the prior.
    data: Dataset  #: The runs.
    readings: WeightedReadings  #: The equations of every single reading.
    loss: float  #: Negative logarithm of the evidence [nats].
    pi: Array  #: Posterior mean of the compliances, (n,) [m/N, rad/(N m)].
    #: Factor U of the readings' inverse covariance W = I / misfit^2 - U U^T, (k, r) [1]. Readings share few
    #: unknowns, so that no matrix of size (k, k) is needed.
    U: Array
    weighted_residual: Array  #: W times the residuals of the readings from the prior mean, (k,) [1].
    h: Array  #: Hyperparameters of the prior, all logarithms; the last one is log misfit.

    @property
    def misfit(self) -> float:
        """Compute the ratio kappa of the readings' scatter to their stated noise [1]."""
        return float(np.exp(self.h[-1]))

    def columns(self, undone: Sequence[Dataset]) -> Array:
        """Compute the change Z of the residuals per unit of each parameter of a mistake.

        Column i is (y - A pi) of these data minus (y_i - A_i pi) of the data with one unit of parameter i
        undone.

        Args:
            undone: The data with one unit of each parameter undone, z of them.

        Returns:
            Z, (k, z) [standard deviations].

        Raises:
            BenchError: When there are too many readings to weigh them one by one.
        """
        left = [self._residuals(data) for data in (self.data, *undone)]
        return np.column_stack([left[0] - changed for changed in left[1:]])

    def _residuals(self, data: Dataset) -> Array:
        read = single_readings(self.vjm, self.scaling.structure, data)
        return np.asarray((read.y - read.A @ self.pi).ravel())

    def score_issue(self, name: str, change: "Change[LoadedRuns]") -> Issue:
        """Weigh a mistake that enters linearly, by the score test of `score_test`.

        Its arguments are g = Z^T W e and M = Z^T W Z, with W the inverse covariance of the readings and e
        their residuals from the prior.

        Args:
            name: Name of the hypothesis.
            change: A change that has `columns` Z.

        Returns:
            The issue, with its expected size [SI] and the nats it gains.
        """
        assert change.columns is not None
        Z, rows = change.columns, slice(*(change.rows or (None,)))
        half = self.U[rows].T @ Z
        score = score_test(Z.T @ self.weighted_residual[rows], Z.T @ Z / self.misfit**2 - half.T @ half)
        return Issue(name, change.where, change.prior_deviation * score.b, change.numbers, float(score.nats))


@dataclass(frozen=True)
class LoadedRuns:
    """Hold loaded runs with the prior of their compliances and, once it is fitted, their model."""

    vjm: Vjm  #: The arm's virtual joint model.
    scaling: PriorScaling  #: Units of the compliances' prior.
    data: Dataset  #: The runs.
    #: Gravity in the folder's world by a level tracker, a unit vector, (3,) [1]; None if unknown.
    level: Array | None = None
    #: Gravity from another side than in the folder; None where nothing suggests it.
    gravity: GravityDirection | None = None
    model: ResidualModel | None = None  #: The fitted model; None before the fit, or where no compliance fits.

    @property
    def largest_force(self) -> float:
        """Compute the largest force of all runs [N]."""
        return float(np.linalg.norm(self.data.wrench[:, :3], axis=1).max())

    def fit(self, data: Dataset | None = None, h: Array | None = None) -> ResidualModel:
        """Fit the model to these runs, or to changed ones.

        Args:
            data: The changed runs; None for these runs.
            h: Hyperparameters of the prior, (h,), learnt from other readings; None to learn them here.

        Returns:
            The fitted model with its residuals.

        Raises:
            BenchError: When no compliance moves as the readings do.
        """
        return residual_model(self.vjm, self.scaling, self.data if data is None else data, h)


def deflection_scale(vjm: Vjm, scaling: PriorScaling, data: Dataset) -> float:
    """Compute the factor between the read deflections and those that the prior predicts, by least squares.

    It is y^T A pi / |A pi|^2, with A the whitened observation matrix and pi the expected compliances.

    Args:
        vjm: The arm's virtual joint model.
        scaling: Prior of its compliances.
        data: The runs.

    Returns:
        The factor [1].

    Raises:
        BenchError: When there is no run, a number is too large, or a marker is none of the arm's.
    """
    regression = reduce(vjm, scaling.structure, data)
    pi = scaling.L @ scaling.expected
    rows = [(t.R @ pi, t.z) for t in regression.terms]
    return float(sum(a @ z for a, z in rows) / sum(a @ a for a, _ in rows))


def residual_model(vjm: Vjm, scaling: PriorScaling, data: Dataset, h: Array | None = None) -> ResidualModel:
    """Fit the compliances with a prior learnt from the readings, and find residuals and covariance.

    With kappa the ratio of scatter to noise, the inverse covariance of the readings is

        W = (kappa^2 I + H H^T)^-1 = I / kappa^2 - U U^T

    H has the columns of compliances, and of backlash and stiffening of sound joints, times their prior
    standard deviations. The weighted residual is W (y - A E[pi]), with the prior mean E[pi].

    Args:
        vjm: The arm's virtual joint model.
        scaling: Prior of its compliances.
        data: The runs.
        h: Hyperparameters of the prior, (h,), learnt from other readings; None to learn them here.

    Returns:
        The fitted model with its residuals and their covariance.

    Raises:
        BenchError: When no compliance moves as the readings do.
    """
    structure = scaling.structure
    model = evidence_model(reduce(vjm, structure, data), scaling, shared_width=True)
    h = maximise_evidence(model.problem, model.start) if h is None else h
    read = single_readings(vjm, structure, data)
    G = read.A.reshape(-1, structure.n) @ model.scaling.L
    # The most probable compliances, by rows of readings and of the prior.
    s, kappa = model.scale(h), np.exp(h[-1])
    width = np.exp(model.problem.log_deviation_rows @ h)
    residual = read.y.ravel() - G @ (s * model.scaling.expected)
    half = G * width
    expected = np.concatenate([residual, np.zeros(len(width))])
    x = np.linalg.lstsq(np.vstack([half, kappa * np.eye(len(width))]), expected)[0]
    pi = model.scaling.L @ (s * model.scaling.expected + width * x)
    # Their covariance, and that of sound joints, by the singular values of H.
    if vjm.arm.joints:
        half = np.hstack([half, sound_joint_columns(vjm, data, structure, pi)])
    left, size, _ = np.linalg.svd(half, full_matrices=False)
    U = left * (size / np.hypot(size, kappa) / kappa)
    weighted_residual = residual / kappa**2 - U @ (U.T @ residual)
    least = evidence_posterior(model.problem, h).loss
    return ResidualModel(vjm, model.scaling, data, read, least, pi, U, weighted_residual, h)


def sound_joint_columns(vjm: Vjm, data: Dataset, structure: Structure, pi: Array) -> Array:
    """Compute how backlash and stiffening, as sound joints have them, move the readings.

    A joint with compliance c turns by t = c u under its torque u. Its backlash adds SOUND_BACKLASH sign(t),
    its stiffening SOUND_STIFFENING t |t|.

    Args:
        vjm: The arm's virtual joint model.
        data: The runs.
        structure: The compliances, n of them.
        pi: Values of the compliances, (n,) [m/N, rad/(N m)].

    Returns:
        Two columns per joint, (rows, 2 joints) [standard deviations].
    """
    state, first = nominal_chain(vjm, data.q, [Load(data.wrench, data.point)]), 6 * len(vjm.arm.links)
    turn = np.diag(structure.matrix(pi))[first:, None] * state.u[first:]
    state = replace(
        state, phi=np.stack([SOUND_BACKLASH * np.sign(turn), SOUND_STIFFENING * turn * np.abs(turn)], axis=1)
    )
    unknowns = replace(compliance_unknowns(vjm, structure), errors=JointErrors(play=True, stiffening=True))
    points, read = marker_points(vjm, data.markers), data.sigma_rotation is not None
    A = jacobian(unknowns, state, points, rotations=read)[:, :, unknowns.columns("errors")]
    return each_reading(A, whiten(A, data, np.arange(data.runs))).reshape(-1, A.shape[2])


def load_levels(data: Dataset) -> list[Mask]:
    """Group runs by the size of their force: one mask per load, (runs,) each, the largest load first.

    The list is empty when a run has no force, or a load occurs in fewer than LEVEL_RUNS runs.
    """
    force = np.linalg.norm(data.wrench[:, :3], axis=1)
    masks: list[Mask] = []
    left = np.ones(len(force), dtype=bool)
    while left.any():
        level = left & (np.abs(force - force[left].max()) <= SAME_FORCE * force.max())
        masks.append(level)
        left &= ~level
    often = all(level.sum() >= LEVEL_RUNS for level in masks)
    return masks if often and force.min() > 0 else []


LoadHypotheses = Sequence[Hypothesis[LoadedRuns]]
"""Rows of the table about all loads, or about single runs."""


def load_issues(loads: LoadedRuns, every: LoadHypotheses, runs: LoadHypotheses) -> list[Issue]:
    """Find the mistakes of loads and deflections whose correction makes the readings fit the prior best.

    If gravity plainly acts in another direction, the mounting is the only issue. Otherwise, single wrong runs
    that make all others look noisy are left out first. Mistakes with a size are then tested by the score
    test; the others are undone and fitted again.

    Args:
        loads: The runs with their prior.
        every: Hypotheses about all loads.
        runs: Hypotheses about single runs.

    Returns:
        Issues, the most probable first; none for sound runs.
    """
    factor = deflection_scale(loads.vjm, loads.scaling, loads.data)
    pull = suspected_gravity(loads.vjm, loads.scaling, loads.data, loads.level)
    loads = replace(loads, gravity=pull)
    refitted, kinds = partial(_refitted, every), {row.name for row in runs}
    if pull is not None and pull.is_certain:
        return [mounting(loads.vjm, pull)]
    try:
        start = loads.fit()
    except BenchError:  # no compliance moves so: only other loads can
        return refitted(loads, hung=True) or refitted(loads) or [_wild_reading(loads.data, factor)]
    undo = partial(_without_worst, loads, runs)
    issues, kept, model = undo_one_by_one(loads.data, start, undo)
    loads = replace(loads, data=kept, model=model)
    best = _likeliest(loads, every, runs)
    loads = replace(loads, gravity=pull or _missing_weight(loads, best))
    hung = refitted(loads, hung=True)
    # no weight has one
    rival = max((_nats(issue) for issue in best if issue.name != "force_offset"), default=0.0)
    if hung and (hung[0].numbers["level"] or _nats(hung[0]) > RIVAL_SHARE * rival):
        return [*hung, *(issue for issue in (*issues, *best) if issue.name in kinds)]
    issues += best
    if model.misfit > QUIET_LIMITS[0] or not 1 / QUIET_LIMITS[1] < factor < QUIET_LIMITS[1]:
        issues += refitted(loads)
    issues.sort(key=lambda issue: -_nats(issue) * (RUN_WEIGHT if issue.name in kinds else 1))
    issues += _scale_issue(loads, factor)
    data = loads.data
    typical = float(np.median(np.linalg.norm(data.deflection, axis=2)[data.seen]))
    if not issues and model.misfit > NOISE_MISFIT and model.misfit * data.sigma > NOISE_SHARE * typical:
        issues.append(Issue("noise", numbers={"factor": model.misfit, "sigma": data.sigma}))
    return issues


def _nats(issue: Issue) -> float:
    return issue.nats or 0.0


def _sized_issues(loads: LoadedRuns, hypotheses: LoadHypotheses) -> Iterator[tuple[Issue, bool]]:
    """Score every mistake that enters linearly; yield it with whether it is likely and large."""
    assert loads.model is not None
    for hypothesis in hypotheses:
        for change in hypothesis.changes(loads):
            if change.columns is not None:
                issue = loads.model.score_issue(hypothesis.name, change)
                yield issue, _nats(issue) > hypothesis.nats and change.is_large(issue.size)


def _without_worst(
    loads: LoadedRuns, runs: LoadHypotheses, data: Dataset, fitted: ResidualModel
) -> tuple[list[Issue], Dataset, ResidualModel] | None:
    """Leave out the run that alone makes all others look noisy; None if no run does.

    The other runs determine noise and prior: with the wrong run among them, its mistake would hide in both.
    """
    if fitted.misfit <= QUIET_LIMITS[0] or data.runs < MIN_RUNS:
        return None
    now = replace(loads, data=data, model=fitted)
    likeliest = max((issue for issue, _ in _sized_issues(now, runs)), key=_nats)
    if _nats(likeliest) < TRIAL_NATS:
        return None
    worst = likeliest.where[0]
    others = data.run.astype(str) != worst
    try:
        rest = loads.fit(select(data, others))
    except BenchError:  # no compliance moves as the other runs do: it is not this run that is wrong
        return None
    if rest.misfit > MAX_MISFIT_RATIO * fitted.misfit:
        return None
    now = replace(now, model=loads.fit(data, rest.h))
    issues = [issue for issue, large in _sized_issues(now, runs) if large and issue.where[0] == worst]
    return ([max(issues, key=_nats)], rest.data, rest) if issues else None


def _likeliest(loads: LoadedRuns, every: LoadHypotheses, runs: LoadHypotheses) -> list[Issue]:
    """Select the most probable mistake; if it is of a single run, also the mistakes of other single runs."""
    issues: list[Issue] = []
    kinds = {row.name for row in runs}
    large = [issue for issue, large in _sized_issues(loads, (*every, *runs)) if large]
    for candidate in sorted(large, key=_nats, reverse=True):
        wrong = {other.where[0] for other in issues if other.name in kinds}
        if not issues or (wrong and candidate.name in kinds and candidate.where[0] not in wrong):
            issues.append(candidate)
    return issues


def _refitted(hypotheses: LoadHypotheses, loads: LoadedRuns, *, hung: bool = False) -> list[Issue]:
    """Find the mistake without a size that explains the readings best, if one does."""
    before, tried = loads.model, list[tuple[ResidualModel, Issue, float]]()
    loads = replace(loads, model=None)  # linear mistakes have been tested
    for hypothesis in hypotheses:
        for change in hypothesis.changes(loads) if (hypothesis.name == "mounting") == hung else ():
            if change.undone is None:
                continue
            try:
                refit = change.undone.fit()
            except BenchError:  # moves against the force
                continue
            nats = None if before is None else before.loss - refit.loss
            issue = Issue(hypothesis.name, change.where, change.size, change.numbers, nats)
            tried.append((refit, issue, MIN_NATS if change.numbers.get("level") else hypothesis.nats))
    if not tried:
        return []
    refit, issue, needed = min(tried, key=lambda trial: trial[0].loss)
    return [issue] if (refit.misfit <= NOISE_MISFIT if issue.nats is None else issue.nats >= needed) else []


def _missing_weight(loads: LoadedRuns, best: Sequence[Issue]) -> GravityDirection | None:
    """Find the direction of gravity if a constant additional force explains the readings best; else None."""
    constant = bool(best) and best[0].name == "force_offset"
    if loads.level is not None or not constant or not weights_only(loads.data):
        return None
    total = loads.data.wrench[:, :3].mean(axis=0) + best[0].size
    pull = GravityDirection(total / np.linalg.norm(total))
    return pull if angle(pull.g, DOWN) > MIN_TILT else None


def _wild_reading(data: Dataset, factor: float) -> Issue:
    """Name the largest deflection where no compliance fits: it may be wrong, and outweigh all others."""
    size = np.where(data.seen, np.linalg.norm(data.deflection, axis=-1), 0)
    (i, k), median = np.unravel_index(np.argmax(size), size.shape), float(np.median(size[data.seen]))
    numbers = {"factor": factor, "largest": float(size[i, k]), "median": median}
    return Issue("scale", (data.markers[k], str(data.run[i])), numbers=numbers)


def _scale_issue(loads: LoadedRuns, factor: float) -> list[Issue]:
    """List an issue if the factor between prior and readings is absurd."""
    size = abs(math.log(max(abs(factor), 1e-12)))
    payload, force = loads.vjm.arm.payload, loads.largest_force
    light = payload is not None and LIGHT_LOAD_SHARE * payload < force < LIGHT_LOAD_SHARE * payload * GRAVITY
    if size <= math.log(MAX_SCALE) and not (light and factor > LIGHT_LOAD_SCALE):
        return []
    return [Issue("scale", numbers={"factor": factor, "force": force}, nats=size**2 / 2)]
