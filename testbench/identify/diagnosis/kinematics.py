"""Mistakes as data (issue, correction, hypothesis), and the test of positions against the kinematics.

A `Hypothesis` is one kind of mistake. Its corrections change the readings, the loads or the arm so that the
mistake is gone. The diagnosis corrects one mistake at a time, fits the corrected data again and compares
both fits. With the loss L, the negative log-likelihood of a fit, the mistake has the log-likelihood gain

    gain = L(as read) - L(corrected) - cost of the correction's parameters   [nats]

The most probable mistake becomes an `Issue`. If a mistake of size b adds Z b to the readings, no second fit
is needed. With the residuals e, a projector 1 - P that takes out all that the fit explains, and b ~ N(0, 1)
in the units of Z, the gain is the logarithm of a Bayes factor (Kass and Raftery 1995):

    g = Z^T (1 - P) e,   M = Z^T (1 - P) Z + I,   gain = (g^T M^-1 g - log det M) / 2

`hypotheses` holds the table of all mistakes.

Positions must agree with the kinematics up to the usual errors of an arm: calibration, own weight, a target
that is a few millimetres off. Cauchy's loss keeps a few wrong readings from being taken for a mistake in all.

Two mistakes have more candidates than can be fitted: orders of the joints, and rows that slipped.

Of six joints there are 720 orders. With the joints in the right one, the tool's pose R, p by the kinematics
and a target m on the tool, readings y fit some frame where

    A y + b = R m + p

The form is linear in A, b and, if it is unknown, m. Its residual is small only for the right order. The few
orders that fit it best are then fitted with a frame, whose A is a rotation.

If a cell of a table was deleted, all readings from its row on are shifted against their poses. One half of
the rows is all correct or all shifted: it determines the frame. The shift begins at the row where the summed
losses are least.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, permutations
from typing import Generic, Literal, TypeVar

import numpy as np

from testbench.arm.folder import Arm
from testbench.data.dataset import Dataset, Series, evenly_spaced
from testbench.errors import Array, Ids, Mask
from testbench.identify.base_frame import RegisteredDataset, with_markers
from testbench.identify.registration import Frame, kabsch
from testbench.model.vjm import (
    ChainState,
    Vjm,
    evaluate_chain,
    rotation_matrices,
    skew,
    tool_poses,
    translational_jacobian,
)

# --- A mistake as data --------------------------------------------------------------------------------------

MAX_CORRECTION_ROUNDS = 5  #: Most rounds in which mistakes are corrected one after the other.
Case = TypeVar("Case")
ReadingKind = Literal["unloaded", "loaded", "all"]
"""Readings of an arm that are compared with its kinematics; "all" are those of absolute series."""


def _nothing() -> Array:
    return np.zeros(0)


@dataclass(frozen=True)
class Issue:
    """Hold one suspected mistake in readings, loads or arm; `hypotheses.describe` returns its sentence."""

    name: str  #: Name of the hypothesis, such as "frame".
    where: tuple[str, ...] = ()  #: Names of the joints, links, targets, runs or series with the mistake.
    size: Array = field(default_factory=_nothing)  #: Estimated size of the mistake, (k,), SI units.
    #: Other numbers that the sentence states, by name, SI units.
    details: Mapping[str, float] = field(default_factory=dict)
    #: Log-likelihood gained by correcting the mistake [nats]; None if it is certain without a fit.
    log_likelihood_gain: float | None = None
    #: Which readings do not fit the kinematics; None for mistakes of other kinds.
    reading_kind: ReadingKind | None = None


@dataclass(frozen=True)
class Correction(Generic[Case]):
    """Hold one way to correct a mistake, and how to test it.

    If it has `corrected_data`, these are fitted again. If it has a `jacobian`, the score test estimates the
    size of the mistake. If it has neither, the mistake is certain without a fit.
    """

    where: tuple[str, ...] = ()  #: Names of the joints, links, targets or runs, as in `Issue`.
    size: Array = field(default_factory=_nothing)  #: Size, as in `Issue`; a fit adds its free parameters.
    details: Mapping[str, float] = field(default_factory=dict)  #: Other numbers, as in `Issue`.
    corrected_data: Case | None = None  #: The data without the mistake, to be fitted again.
    #: Change Z of the whitened readings per prior deviation of each of z parameters, (rows, z) [1].
    jacobian: Array | None = None
    #: First of the equations that the Jacobian covers, and the one after the last; None for all equations.
    equation_range: tuple[int, int] | None = None
    prior_deviation: float = 1.0  #: Prior standard deviation of the mistake's size, SI units.
    parameter_count: int = 0  #: Number of free parameters that the choice of this correction counts as.
    #: Tells whether a size exceeds that in usual arms and readings.
    is_large: Callable[[Array], bool] = lambda _: True


@dataclass(frozen=True)
class Hypothesis(Generic[Case]):
    """Define one kind of mistake: how to correct it, and how to describe it."""

    name: str  #: Identifier in programs and in models.json.
    #: Yields the ways to correct the mistake in the data.
    corrections: Callable[[Case], Iterable[Correction[Case]]]
    sentence: Callable[[Issue, Arm], str]  #: Describes an issue of this kind: the mistake and its size.
    question: str = ""  #: Question that the user should answer to find the cause.
    min_gain: float = 0.0  #: Least log-likelihood gain of a mistake in the loads [nats].
    #: Whether it has so many parameters that any other mistake of sufficient gain is preferred.
    many_parameters: bool = False


@dataclass(frozen=True)
class Submission:
    """Hold an arm and its runs as a user submits them."""

    vjm: Vjm  #: Nominal model of the arm.
    data: Dataset  #: The runs as read from the file.
    #: The runs in the base's frame, with targets found from the unloaded readings.
    registered_runs: RegisteredDataset
    frame_stated: bool  #: Whether the frame of the readings was stated, not guessed.

    @property
    def nominal_model(self) -> Vjm:
        """Build the arm's model with the targets of its folder at their nominal places."""
        nominal = dict(zip(self.vjm.arm.markers, self.vjm.markers, strict=True))
        return with_markers(self.registered_runs.vjm, nominal)


def issues_without_fit(data: Case, hypotheses: Sequence[Hypothesis[Case]]) -> list[Issue]:
    """List the mistakes that are certain without a fit.

    Args:
        data: Data that the hypotheses examine, such as the submitted runs.
        hypotheses: Kinds of mistakes whose corrections have neither corrected data nor a Jacobian.

    Returns:
        One issue per correction, in the order of the hypotheses.
    """
    return [
        Issue(row.name, correction.where, correction.size, correction.details)
        for row in hypotheses
        for correction in row.corrections(data)
    ]


def any_vector_longer_than(*limits: float) -> Callable[[Array], bool]:
    """Make a function of a size, (3 k,), that tells whether any of its k vectors is longer than its limit."""
    return lambda size: any(np.linalg.norm(size[3 * k : 3 * k + 3]) > limit for k, limit in enumerate(limits))


def any_component_above(limit: float) -> Callable[[Array], bool]:
    """Make a function of a size, (k,), that tells whether any of its numbers is larger than a limit."""
    return lambda size: bool(np.abs(size).max() > limit)


@dataclass(frozen=True)
class ScoreTest:
    """Hold the result of `score_test` for one linear mistake or for a batch of them."""

    expected_size: Array  #: Expected sizes b, in units of their prior deviation, (..., z) [1].
    chi2_decrease: Array  #: Decrease of the weighted sum of squares, g^T (M + I)^-1 g, (...) [1].
    log_bayes_factor: Array  #: Logarithms of the Bayes factors for the mistakes, (...) [nats].


def score_test(score: Array, information: Array) -> ScoreTest:
    """Test for a mistake b ~ N(0, I) that adds Z b to the readings, without a second fit.

    With the score g, the information M and H = M + I, the expected size is b = H^-1 g, and the logarithm of
    the Bayes factor for the mistake is (g^T H^-1 g - log det H) / 2 (Kass and Raftery 1995).

    Args:
        score: Score g = Z^T W e, with e the residuals and W their inverse covariance, (..., z) [1].
        information: Information M = Z^T W Z about b from the readings, (..., z, z) [1].

    Returns:
        Expected sizes, decreases of chi squared and logarithms of the Bayes factors.
    """
    H = information + np.eye(score.shape[-1])
    b = np.asarray(np.linalg.solve(H, score[..., None])[..., 0])
    decrease = np.asarray((b * score).sum(axis=-1))
    return ScoreTest(b, decrease, np.asarray((decrease - np.linalg.slogdet(H)[1]) / 2))


def correct_one_by_one(
    case: Case, correct_worst: Callable[[Case], tuple[Sequence[Issue], Case] | None]
) -> tuple[list[Issue], Case]:
    """Correct the worst mistake, fit again and look for the next one, up to MAX_CORRECTION_ROUNDS times.

    Args:
        case: The readings, with the model fitted to them.
        correct_worst: Function that returns the worst mistakes, and the case without them, fitted again; None
            when it finds no mistake. The search ends when it returns the same case.

    Returns:
        The mistakes in the order in which they were found, and the case without them.
    """
    issues: list[Issue] = []
    for _ in range(MAX_CORRECTION_ROUNDS):
        step = correct_worst(case)
        if step is None:
            break
        more, corrected = step
        issues += more
        if corrected is case:
            break
        case = corrected
    return issues, case


# --- Readings and the arm's kinematics: the fit, and mistakes that explain the readings better --------------

#: Usual distance of targets from the nominal kinematics of an arm, over its reach [1].
EXPECTED_DISTANCE_OVER_REACH = 1.5e-3
IDENTITY_FRAME = Frame(np.eye(3), np.zeros(3))
PARAMETER_COST = 4.0  #: Log-likelihood that each free parameter has to gain [nats].
MAX_STEPS = 8  #: Most Gauss-Newton steps of a fit.
LOSS_TOLERANCE = 1e-6  #: Change of the loss below which the steps end [nats].
MAX_COMPARED_ROWS = 300  #: Most rows that are compared, selected evenly.
MEDIAN, HIGH_QUANTILE = 0.5, 0.95
"""Quantiles of the distance that a sentence states [1]: the high one if half of the readings fit anyway."""
MIN_GAIN_PER_READING, MIN_GAIN = 0.3, 20.0
"""Least log-likelihood gain of an issue, per reading and in total [nats]."""
MIN_RELATIVE_GAIN = 0.9  #: Least gain of an issue, over the largest gain of all mistakes [1].
#: Median distance over the expected distance above which readings do not fit the arm [1].
MAX_MEDIAN_DISTANCE = 8.0
#: Distance of the three targets that represent an orientation from the first target [m].
ORIENTATION_TARGET_DISTANCE = 0.3


@dataclass(frozen=True)
class FreeParameters:
    """Select the parameters that a fit of readings to the kinematics estimates."""

    frame: bool = False  #: Whether the pose of the arm's base in the frame of the readings is free.
    targets: bool = False  #: Whether the positions of the targets in the tool's frame are free.
    #: Indices of the virtual joints with a free constant, such as a joint's zero or a link's end.
    theta: tuple[int, ...] = ()
    mirrored: bool = False  #: Whether the frame is left-handed.
    #: Whether no nominal targets are known; the fit then gives distant readings more weight at first.
    targets_unknown: bool = False


@dataclass(frozen=True)
class Observations:
    """Hold readings of m targets that are compared with the kinematics, and the parameters that are free."""

    vjm: Vjm  #: The arm's virtual joint model.
    q: Array  #: Joint positions, (rows, n) [rad, m].
    markers: Array  #: Nominal targets in the tool's frame, (m, 3) [m].
    position: Array  #: Measured positions of the targets, (rows, m, 3) [m].
    is_measured: Mask  #: Tells which targets were read, (rows, m).
    target_names: tuple[str, ...]  #: Names of the targets.
    run_id: Ids  #: Identifier of each row's run, (rows,).
    pose_id: Ids  #: Identifier of each row's pose, (rows,).
    #: Usual distance of a correct reading from the kinematics [m]: the scale of Cauchy's loss.
    expected_distance: float
    free_parameters: FreeParameters = FreeParameters()  #: Parameters that a fit estimates.
    #: Orientations, tracker from target, (rows, 3, 3) [1], also held as the last three targets; None if not
    #: read.
    rotation: Array | None = None

    def select(self, rows: Ids) -> "Observations":
        """Return the readings of some rows.

        Args:
            rows: Indices of the rows, (r,).
        """
        rotation = None if self.rotation is None else self.rotation[rows]
        return replace(
            self,
            q=self.q[rows],
            position=self.position[rows],
            is_measured=self.is_measured[rows],
            run_id=self.run_id[rows],
            pose_id=self.pose_id[rows],
            rotation=rotation,
        )

    def with_free(
        self,
        *,
        frame: bool = False,
        targets: bool = False,
        theta: tuple[int, ...] = (),
        mirrored: bool = False,
    ) -> "Observations":
        """Return the readings with further free parameters.

        Args:
            frame: Whether to free the frame.
            targets: Whether to free the targets.
            theta: Indices of the virtual joints whose constants are free.
            mirrored: Whether the frame is left-handed.
        """
        now = self.free_parameters
        free = FreeParameters(
            now.frame or frame,
            now.targets or targets,
            theta or now.theta,
            now.mirrored or mirrored,
            now.targets_unknown,
        )
        return replace(self, free_parameters=free)

    def with_orientations(self, position: Array, rotation: Array) -> "Observations":
        """Return the readings with other positions and orientations.

        Three more targets represent an orientation R. They are ORIENTATION_TARGET_DISTANCE from the first
        target, along the columns of R.

        Args:
            position: Positions of the m targets, (rows, m, 3) [m].
            rotation: Orientations, tracker from target, (rows, 3, 3) [1].

        Returns:
            The readings; their positions are (rows, m + 3, 3) [m].
        """
        more = position[:, :1] + ORIENTATION_TARGET_DISTANCE * np.where(
            self.is_measured[:, -3:, None], rotation.swapaxes(1, 2), 0
        )
        return replace(self, position=np.concatenate([position, more], axis=1), rotation=rotation)


def observations_of_series(vjm: Vjm, series: Series) -> Observations:
    """Convert absolute readings to observations with free frame and targets.

    Args:
        vjm: The arm's virtual joint model.
        series: The readings.

    Returns:
        The observations. Orientations, if read, are three more targets.
    """
    there, m = series.is_measured, len(series.markers)
    if series.rotation is not None:
        there = np.hstack([there, np.repeat(series.is_oriented[:, None] & there[:, :1], 3, axis=1)])
    observations = Observations(
        vjm=vjm,
        q=series.q,
        markers=np.zeros((there.shape[1], 3)),
        position=series.position[:, :m],
        is_measured=there,
        target_names=series.markers,
        run_id=series.row_id,
        pose_id=series.pose_id,
        expected_distance=EXPECTED_DISTANCE_OVER_REACH * vjm.reach,
        free_parameters=FreeParameters(frame=True, targets=True, targets_unknown=True),
    )
    if series.rotation is None:
        return observations
    return observations.with_orientations(series.position, series.rotation)


@dataclass(frozen=True)
class KinematicFit:
    """Hold a fit of readings to the kinematics: the free parameters of the smallest loss, and residuals."""

    frame: Frame  #: Frame of the readings from the arm's base.
    markers: Array  #: Targets in the tool's frame, (m, 3) [m].
    theta: Array  #: Constants of the virtual joints, (n_theta,) [m, rad].
    residual: Array  #: Fitted minus measured positions, (rows, m, 3) [m]; zero where nothing was read.
    loss: float  #: Cauchy's loss, summed over the readings [nats].
    parameter_count: int  #: Number of free parameters.

    @property
    def cost(self) -> float:
        """Compute the loss plus PARAMETER_COST for each free parameter [nats]."""
        return self.loss + PARAMETER_COST * self.parameter_count

    def distances(self, observations: Observations) -> Array:
        """Compute the distance between the measured and the fitted position for every reading.

        Args:
            observations: The readings that were fitted.

        Returns:
            Distances, (readings,) [m].
        """
        return np.asarray(np.linalg.norm(self.residual, axis=2)[observations.is_measured])

    def distance_quantile(self, observations: Observations, quantile: float = MEDIAN) -> float:
        """Compute a quantile of the distances between measured and fitted positions.

        Args:
            observations: The readings that were fitted.
            quantile: The quantile, 0 to 1 [1]; the median by default.

        Returns:
            The distance below which that share of the readings lies [m].
        """
        return float(np.quantile(self.distances(observations), quantile))


@dataclass(frozen=True)
class FittedObservations:
    """Hold readings and their fit to the kinematics; its residuals show single wrong poses and readings."""

    observations: Observations  #: The readings, after a mistake in all of them is corrected.
    fit: KinematicFit  #: Their fit.


def cauchy_loss(residual: Array, scale: float) -> Array:
    """Compute Cauchy's robust loss 3/2 log(1 + |r|^2 / (3 scale^2)).

    It equals half the squared error for small residuals; large residuals count only logarithmically.

    Args:
        residual: Residuals r, (..., 3) [m].
        scale: Usual distance of a correct reading [m].

    Returns:
        Losses, (...) [nats].
    """
    return np.asarray(1.5 * np.log1p(np.square(residual / scale).sum(axis=-1) / 3))


def best_hypothesis(
    observations: Observations,
    hypotheses: Sequence[Hypothesis[Observations]],
    reading_kind: ReadingKind = "unloaded",
) -> tuple[Issue | None, KinematicFit]:
    """Find the mistake that explains readings best: correct each in turn, fit again and compare.

    The gain of a mistake is the cost of the fit as read, minus the cost of the corrected fit, minus
    PARAMETER_COST times the correction's parameters. It has to exceed MIN_GAIN, and MIN_GAIN_PER_READING
    times the number of readings.

    Args:
        observations: The readings, with the parameters that are free in any case, such as an unknown frame.
        hypotheses: Kinds of mistakes with corrected data.
        reading_kind: Kind of the readings, for the sentence.

    Returns:
        The issue, and the fit of all readings with this mistake corrected. If the readings do not fit and no
        hypothesis explains them, the issue is "kinematics"; if they fit, it is None. The fit is then that of
        the readings as they are.
    """
    sample = _thinned(observations)
    start = fit_kinematics(sample)
    typical = start.distance_quantile(sample)
    unfit = (
        Issue("kinematics", details={"now": typical}, reading_kind=reading_kind)
        if typical > MAX_MEDIAN_DISTANCE * observations.expected_distance
        else None
    )
    needed = max(MIN_GAIN, MIN_GAIN_PER_READING * sample.is_measured.sum())
    as_read = start if sample is observations else fit_kinematics(observations)
    if start.loss <= needed:  # no mistake saves more than the loss
        return unfit, as_read

    # Correct every mistake; the most probable one is large, gains enough, and leaves readings that fit.
    trials = list(_trials(observations, hypotheses, start.cost))
    needed = max(needed, MIN_RELATIVE_GAIN * max((trial.gain for trial in trials), default=0.0))
    good = [
        trial
        for trial in trials
        if trial.gain > needed and trial.correction.is_large(trial.where_and_size(observations)[1])
    ]
    if not good:
        return unfit, as_read
    best = max(good, key=lambda trial: (not trial.hypothesis.many_parameters, trial.gain))
    now = best.fit.distance_quantile(best.sample)
    if now > MAX_MEDIAN_DISTANCE * observations.expected_distance:
        return unfit, as_read

    # Distance of most readings from the fit, as read and corrected.
    share = MEDIAN if now < MEDIAN * typical else HIGH_QUANTILE
    details = {
        "was": start.distance_quantile(sample, share),
        "now": best.fit.distance_quantile(best.sample, share),
        "share": share,
    }
    where, size = best.where_and_size(observations)
    issue = Issue(best.hypothesis.name, where, size, details, best.gain, reading_kind)
    return issue, best.fit if best.sample is best.corrected else fit_kinematics(best.corrected)


@dataclass(frozen=True)
class _Trial:
    """Hold readings with one mistake corrected, and their fit."""

    hypothesis: Hypothesis[Observations]  #: The kind of mistake.
    correction: Correction[Observations]  #: The way in which it is corrected.
    corrected: Observations  #: All readings without the mistake.
    sample: Observations  #: Those of them that were fitted.
    fit: KinematicFit  #: The fit to the sample.
    gain: float  #: Cost as read, minus the cost without the mistake and that of the choice [nats].

    def where_and_size(self, observations: Observations) -> tuple[tuple[str, ...], Array]:
        """Find which joint, link or target has the mistake, and the size of the mistake.

        Args:
            observations: The readings as they are, with the mistake.

        Returns:
            Names of the joints, links or targets, and the size: rotation vector and translation of a frame,
            (6,) [rad, m]; shift of a target or link, (3,) [m]; else that of the correction, in SI units.
        """
        where, size, free = self.correction.where, self.correction.size, self.corrected.free_parameters
        theta = self.fit.theta[list(free.theta)]
        if len(theta) == 3:
            return where, np.asarray(observations.vjm.arm.links[free.theta[0] // 6].beam_axes @ theta)
        if len(theta):
            return where, size + theta
        if free.targets and not observations.free_parameters.targets:
            shifts = self.fit.markers - observations.markers
            farthest = int(np.argmax(np.linalg.norm(shifts, axis=1)))
            return (observations.target_names[farthest],), shifts[farthest]
        if free.frame and not (observations.free_parameters.frame or free.mirrored):
            return where, np.concatenate([self.fit.frame.rotation_vector, self.fit.frame.translation])
        return where, size


def _trials(
    observations: Observations, hypotheses: Sequence[Hypothesis[Observations]], cost: float
) -> Iterator[_Trial]:
    """Correct every mistake in turn, and fit again; `cost` is that of the readings as they are."""
    for hypothesis in hypotheses:
        for correction in hypothesis.corrections(observations):
            assert correction.corrected_data is not None
            sample = _thinned(correction.corrected_data)
            fitted = fit_kinematics(sample)
            gain = cost - fitted.cost - PARAMETER_COST * correction.parameter_count
            yield _Trial(hypothesis, correction, correction.corrected_data, sample, fitted, float(gain))


def _thinned(observations: Observations) -> Observations:
    """Select at most MAX_COMPARED_ROWS rows, evenly spaced: more would not change which mistake fits."""
    n = len(observations.q)
    if n <= MAX_COMPARED_ROWS:
        return observations
    return observations.select(evenly_spaced(n, MAX_COMPARED_ROWS))


def fit_kinematics(observations: Observations) -> KinematicFit:
    """Fit the free parameters of readings by reweighted least squares for Cauchy's loss.

    A free frame starts from its closed form; up to MAX_STEPS Gauss-Newton steps then refine all parameters.

    Args:
        observations: The readings, with their free parameters.

    Returns:
        The parameters, with loss and residuals.
    """
    free = observations.free_parameters
    count = 6 * free.frame + 3 * len(observations.markers) * free.targets + len(free.theta)
    now = KinematicFit(
        IDENTITY_FRAME,
        observations.markers,
        np.zeros(observations.vjm.arm.n_theta),
        observations.position,
        np.inf,
        count,
    )
    where = _chain(observations, now)
    # Start with the frame in closed form.
    if free.frame:
        base = where.tool_points_in_world(now.markers)
        frame = Frame(
            *kabsch(
                base[observations.is_measured],
                observations.position[observations.is_measured],
                mirrored=free.mirrored,
            )
        )
        now = replace(now, frame=frame)
    now = _with_loss(observations, where, now)
    # Gauss-Newton steps with the weights of the last residuals.
    for _ in range(MAX_STEPS if count else 0):
        before, now = now.loss, _gauss_newton_step(observations, where, now)
        if free.theta:
            where = _chain(observations, now)
        now = _with_loss(observations, where, now)
        if abs(now.loss - before) < LOSS_TOLERANCE:
            break
    return now


def _chain(observations: Observations, now: KinematicFit) -> ChainState:
    theta = np.tile(now.theta, (len(observations.q), 1)) if now.theta.any() else None
    return evaluate_chain(observations.vjm, observations.q, theta)


def _with_loss(observations: Observations, chain: ChainState, now: KinematicFit) -> KinematicFit:
    off = fit_residuals(observations, chain, now)
    return replace(now, residual=off, loss=float(cauchy_loss(off, observations.expected_distance).sum()))


def fit_residuals(observations: Observations, chain: ChainState, fitted: KinematicFit) -> Array:
    """Compute the residuals R x(q) + t - y: fitted minus measured positions of the targets.

    Args:
        observations: The readings y.
        chain: The extended chain in their poses.
        fitted: The fit, with frame R, t and targets.

    Returns:
        Residuals, (rows, m, 3) [m]; 0 where nothing was read.
    """
    x = chain.tool_points_in_world(fitted.markers) @ fitted.frame.rotation.T + fitted.frame.translation
    return np.where(observations.is_measured[..., None], x - observations.position, 0.0)


def _gauss_newton_step(observations: Observations, chain: ChainState, now: KinematicFit) -> KinematicFit:
    """Take one weighted Gauss-Newton step of all free parameters."""
    free = observations.free_parameters
    # Targets relative to the frame's origin.
    about = now.residual - now.frame.translation + observations.position
    columns: list[Array] = []
    if free.frame:
        columns += [*np.broadcast_to(np.eye(3)[:, None, None], (3, *about.shape))]
        columns += [*skew(about).transpose(2, 0, 1, 3)]
    if free.theta:
        J = translational_jacobian(chain, now.markers)[:, free.theta].reshape(
            *observations.markers.shape, -1, len(observations.q)
        )
        columns += list(np.einsum("mxcp,yx->cpmy", J, now.frame.rotation))
    scale = (
        max(observations.expected_distance, now.distance_quantile(observations))
        if free.targets_unknown
        else observations.expected_distance
    )
    weight = observations.is_measured / (1 + np.square(now.residual / scale).sum(axis=-1) / 3)
    root = np.sqrt(weight)[..., None]
    left, held = root * np.stack([-now.residual, *columns]), np.zeros_like(now.markers)
    size = np.maximum([np.linalg.norm(column) for column in left[1:]], 1e-12)
    # A target moves its own readings alone: its part is eliminated from the other columns first.
    if free.targets:
        R = root[..., None] * (now.frame.rotation @ chain.tool_rotation)[:, None]
        by_target = np.einsum("pmxa,cpmx->cma", R, left) / np.maximum((root**2).sum(axis=0), 1e-12)
        left = left - np.einsum("pmxa,cma->cpmx", R, by_target)
    off, *common = left.reshape(len(left), -1)
    step = np.zeros(0)
    if common:
        step = np.linalg.lstsq(np.stack(common, axis=1) / size, off)[0] / size
    if free.targets:
        held = by_target[0] - np.tensordot(step, by_target[1:], 1)
    frame, theta = now.frame, now.theta.copy()
    theta[list(free.theta)] += step[len(step) - len(free.theta) :]
    if free.frame:
        frame = Frame(rotation_matrices(step[None, 3:6])[0] @ frame.rotation, frame.translation + step[:3])
    return replace(now, frame=frame, theta=theta, markers=now.markers + held)


# --- Searches among more candidates than can be fitted: orders of the joints, and rows that slipped ---------

#: Most joints of which every order is tried; of more joints, every exchange of two and the reverse order.
MAX_PERMUTED_JOINTS = 7
SCREENED_ROWS, SCREENED_TARGETS = 30, 2  #: Most rows, evenly spaced, and first targets that screen orders.
MAX_FITTED_JOINT_ORDERS = 6  #: Number of orders that are fitted, the best ones of the screening.
N_REWEIGHTINGS = 3  #: Reweighted solutions of the linear form, so that an outlier does not choose the order.
MAX_JOINT_ORDERS_IN_MEMORY = 720  #: Number of orders whose equations are in memory together.
#: Ridge of the normal equations, over their mean diagonal, for undetermined directions.
RELATIVE_RIDGE = 1e-9
MIN_ROWS_BESIDE_SLIP = 3  #: Fewest rows of half a file, and of the part with slipped rows.


def likely_joint_orders(observations: Observations) -> Iterator[Ids]:
    """Find the most probable orders of the joints in the file.

    In the right order, readings y and the tool's pose R, p satisfy A y + b = R m + p with constant A, b and
    target m. The orders with the smallest residual of this linear form are the most probable.

    Yields:
        At most MAX_FITTED_JOINT_ORDERS orders, (n,) each, the most probable first: joint k has the angles of
        column order[k].
    """
    n = len(observations.vjm.arm.joints)
    if n <= MAX_PERMUTED_JOINTS:
        every = np.array(list(permutations(range(n)))[1:], dtype=int).reshape(-1, n)
    else:
        every = np.array(
            [np.arange(n)[::-1], *(exchanged_order(n, *pair) for pair in combinations(range(n), 2))]
        )
    rows = np.flatnonzero(observations.is_measured.any(axis=1))
    rows = rows[evenly_spaced(len(rows), SCREENED_ROWS)]
    parts = np.array_split(every, -(-len(every) // MAX_JOINT_ORDERS_IN_MEMORY)) if len(every) else []
    cost = [loss for part in parts for loss in _screened(observations, rows, part)]
    yield from every[np.argsort(cost, kind="stable")[:MAX_FITTED_JOINT_ORDERS]]


def exchanged_order(n: int, i: int, j: int) -> Ids:
    """Return the order of n things in which two are exchanged.

    Args:
        n: Number of things.
        i: Index of one of the two.
        j: Index of the other.

    Returns:
        Indices of the things in the new order, (n,).
    """
    order = np.arange(n)
    order[[i, j]] = j, i
    return order


def _screened(observations: Observations, rows: Ids, orders: Ids) -> Array:
    """Compute the robustly weighted loss of the linear form for every order, (orders,) [nats]."""
    count = len(orders)
    p, R = tool_poses(
        observations.vjm, observations.q[rows][:, orders].swapaxes(0, 1).reshape(-1, orders.shape[1])
    )
    row, target = np.nonzero(observations.is_measured[rows, :SCREENED_TARGETS])
    p, R = p.reshape(count, -1, 3)[:, row], R.reshape(count, -1, 3, 3)[:, row]
    y = observations.position[rows][row, target]
    right, columns = p + np.matvec(R, observations.markers[target]), np.zeros((count, len(row), 3, 0))
    if not observations.free_parameters.frame:
        right = right - y
    else:
        fixed = np.zeros((len(row), 3, 12))  # of A, by rows, and of b: the same in every order
        for axis in range(3):
            fixed[:, axis, 3 * axis : 3 * axis + 3] = y
            fixed[:, axis, 9 + axis] = 1
        columns = np.broadcast_to(fixed, (count, *fixed.shape))
    if observations.free_parameters.targets:
        of = np.equal(target[:, None], np.arange(observations.is_measured[:, :SCREENED_TARGETS].shape[1]))
        target_columns = -R[:, :, :, None, :] * of[None, :, None, :, None]
        columns = np.concatenate([columns, target_columns.reshape(*target_columns.shape[:3], -1)], axis=3)
    weight, left = np.ones(right.shape[:2]), right
    for _ in range(N_REWEIGHTINGS if columns.shape[3] else 0):
        held = columns * weight[..., None, None]
        H = np.einsum("orxa,orxb->oab", held, columns, optimize=True)
        g = np.einsum("orxa,orx->oa", held, right)
        ridge = RELATIVE_RIDGE * np.trace(H, axis1=1, axis2=2) / H.shape[1]
        x = np.linalg.solve(H + ridge[:, None, None] * np.eye(H.shape[1]), g[..., None])
        left = right - (columns @ x[:, None])[..., 0]
        off = np.linalg.norm(left, axis=2)
        weight = 1 / (
            1 + (off / np.maximum(np.median(off, axis=1, keepdims=True), observations.expected_distance)) ** 2
        )
    return np.asarray(cauchy_loss(left, observations.expected_distance).sum(axis=1))


@dataclass(frozen=True)
class RowShift:
    """Describe rows that slipped: from one row on, all readings belong to the previous or the next pose."""

    first_row: int  #: Index of the first slipped row.
    shift: int  #: 1 if readings belong to the pose before, -1 if they belong to the pose after.
    q: Array  #: Joint positions that the readings belong to, (rows, n) [rad, m].


def find_row_shift(observations: Observations) -> RowShift | None:
    """Find the row from which readings belong to the previous or next pose; all rows before are correct.

    The result is None when no slip explains the readings clearly better.
    """
    n, far = len(observations.q), MAX_MEDIAN_DISTANCE * observations.expected_distance
    head = _fit_half(observations, slice(n // 2))
    if head is None or _misfits(observations, head, np.arange(n)[-MAX_COMPARED_ROWS:]) < MIN_ROWS_BESIDE_SLIP:
        return None
    _, gain, first, shift, best_fit = min(_slip_costs(observations, head), key=lambda candidate: candidate[0])
    while first > 1 and _misfits(observations, best_fit, np.array([first - 1])):
        first -= 1  # the row that was deleted has no pose at all
    q = np.roll(observations.q, shift, axis=0)
    q[:first] = observations.q[:first]
    # Both parts fit, and the slip gains enough.
    distance = _distances_from(replace(observations, q=q), best_fit)
    parts = (distance[rows][observations.is_measured[rows]] for rows in (slice(first), slice(first, None)))
    fits = all(not len(part) or np.median(part) < far for part in parts)
    enough = gain > MIN_GAIN_PER_READING * observations.is_measured[first:].sum()
    return RowShift(first, shift, q) if enough and fits else None


def _slip_costs(
    observations: Observations, head: KinematicFit
) -> Iterator[tuple[float, float, int, int, KinematicFit]]:
    """Yield the cost of all readings if they slipped one way from the best row, and the gain [nats].

    With them the row, the way and the fit: of the first half, all correct, or of the second, all slipped.
    """
    for shift in (1, -1):
        moved = replace(observations, q=np.roll(observations.q, shift, axis=0))
        for half_fit in (head, _fit_half(moved, slice(len(observations.q) // 2, None)) or head):
            as_read, slipped = (
                cauchy_loss(
                    fit_residuals(observed, evaluate_chain(observed.vjm, observed.q), half_fit),
                    observed.expected_distance,
                ).sum(axis=1)
                for observed in (observations, moved)
            )
            cost = np.cumsum(as_read - slipped)[:-MIN_ROWS_BESIDE_SLIP] + slipped.sum()
            # An inserted row fits either way: the last of equal rows is the first that slipped.
            alike = cost < cost.min() + MIN_GAIN_PER_READING * observations.is_measured.shape[1]
            first = 1 + int(np.flatnonzero(alike)[-1])
            yield float(cost.min()), float(as_read.sum() - cost.min()), first, shift, half_fit


def _fit_half(observations: Observations, half: slice) -> KinematicFit | None:
    """Fit frame and targets to half of the rows; None if there are too few."""
    rows = np.arange(len(observations.q))[half]
    sample = observations.select(rows[evenly_spaced(len(rows), MAX_COMPARED_ROWS)])
    return fit_kinematics(sample) if len(rows) >= MIN_ROWS_BESIDE_SLIP and sample.is_measured.any() else None


def _misfits(observations: Observations, fitted: KinematicFit, rows: Ids) -> int:
    """Count how many of the given rows do not fit the arm in the fitted frame."""
    far = MAX_MEDIAN_DISTANCE * observations.expected_distance
    return int((_distances_from(observations.select(rows), fitted) > far).any(axis=1).sum())


def _distances_from(observations: Observations, fitted: KinematicFit) -> Array:
    """Compute the distances of readings from the fit to others of the series, (rows, m) [m]."""
    chain = evaluate_chain(observations.vjm, observations.q)
    return np.asarray(np.linalg.norm(fit_residuals(observations, chain, fitted), axis=2))
