"""The mechanism of the diagnosis, and its fit of positions to the kinematics.

A mistake is data: a change of readings, loads or arm that undoes it, and the words that describe it. Every
mistake is undone in turn, the changed data are fitted again, and both fits are compared by

    nats = loss as read - loss with the mistake undone - cost of its parameters

Where the mistake b adds Z b to the readings, no second fit is needed: with the residuals e, a projector 1 - P
that takes out all that the fit explains, and b ~ N(0, 1) in the units of Z, the same number is

    g = Z^T (1 - P) e,   M = Z^T (1 - P) Z + 1,   nats = (g^T M^-1 g - log det M) / 2

the logarithm of a Bayes factor (Kass and Raftery 1995). `hypotheses` holds the table of mistakes.

Positions must agree with the kinematics up to the errors of a sound arm: calibration, own weight, a target
that is a few millimetres off. Cauchy's loss keeps a few wrong readings from being taken for a mistake in all.

Two searches among more candidates than can be fitted: orders of the joints, and rows that slipped.

Of six joints there are 720 orders. With the joints in the right one, the tool's pose R, p by the kinematics
and a target m on the tool, readings y fit some frame where

    A y + b = R m + p

The form is linear in A, b and, if it is unknown, m. Its residual is small only for the right order. The few
orders that fit it best are then fitted with a frame, whose A is a rotation.

If a cell of a table was deleted, all readings from its row on are shifted against their poses. One half of
the rows is all sound or all shifted: it determines the frame. The shift begins at the row where the summed
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
from testbench.identify.registered import RegisteredDataset, with_markers
from testbench.identify.registration import Frame, kabsch
from testbench.model.vjm import Chain, Vjm, chain, rotation_matrices, skew, tool_pose, translation_rows

# --- A mistake as data --------------------------------------------------------------------------------------

MAX_ROUNDS = 5  #: Most rounds of undoing mistakes one after the other.
Case = TypeVar("Case")
Data = TypeVar("Data")
Model = TypeVar("Model")
ReadingKind = Literal["unloaded", "loaded", "all"]
"""Readings of an arm that are compared with its kinematics; "all" are those of absolute series."""


def _nothing() -> Array:
    return np.zeros(0)


@dataclass(frozen=True)
class Issue:
    """Hold one suspected mistake in readings; `hypotheses.describe` puts it into a sentence."""

    name: str  #: Name of the hypothesis, such as "frame".
    where: tuple[str, ...] = ()  #: Names of the joints, links, targets, runs or series that it concerns.
    size: Array = field(default_factory=_nothing)  #: Size of the mistake, (k,), SI.
    #: Other numbers for the sentence, by name, SI.
    numbers: Mapping[str, float] = field(default_factory=dict)
    #: Log-likelihood gained by assuming the mistake [nats]; None for a plain mistake.
    nats: float | None = None
    #: Which readings do not fit the kinematics; None for mistakes of other kinds.
    readings: ReadingKind | None = None


@dataclass(frozen=True)
class Change(Generic[Case]):
    """Hold one way to undo a mistake.

    A change with `undone` is fitted again; one with `columns` is tested by the score test. One that has
    neither is plain and needs no fit.
    """

    where: tuple[str, ...] = ()  #: Places of the mistake, as in `Issue`.
    size: Array = field(default_factory=_nothing)  #: Size, as in `Issue`; a fit adds its free parameters.
    numbers: Mapping[str, float] = field(default_factory=dict)  #: Numbers, as in `Issue`.
    undone: Case | None = None  #: The data without the mistake, to be fitted again.
    columns: Array | None = None  #: Z of the score test on `rows`, (rows, z) [standard deviations].
    rows: tuple[int, int] | None = None  #: First row, and the one after the last; None for all.
    prior_deviation: float = 1.0  #: Size of a mistake b = 1 of the score test, SI.
    parameters: int = 0  #: Number of parameters that the choice of this change counts as.
    #: Tells whether a size is larger than those of arms and readings without a mistake.
    is_large: Callable[[Array], bool] = lambda _: True


@dataclass(frozen=True)
class Hypothesis(Generic[Case]):
    """Define one kind of mistake: a row of the table."""

    name: str  #: Identifier in programs and in models.json.
    changes: Callable[[Case], Iterable[Change[Case]]]  #: Yields the ways to undo the mistake in the data.
    words: Callable[[Issue, Arm], str]  #: Describes an issue: the mistake and its size.
    remedy: str = ""  #: Check that the user should make.
    nats: float = 0.0  #: Log-likelihood that a mistake of loads has to gain [nats].
    #: Whether it has so many parameters that any other mistake of sufficient gain is preferred.
    many_parameters: bool = False


@dataclass(frozen=True)
class Submission:
    """Hold what a user submits: an arm and its runs."""

    vjm: Vjm  #: The arm as its folder has it.
    data: Dataset  #: The runs as they were read.
    #: The runs in the base's frame, with targets found from the unloaded readings.
    registered: RegisteredDataset
    declared: bool  #: Whether the frame of the readings was stated, not guessed.

    @property
    def folder_model(self) -> Vjm:
        """Build the model with targets where the arm's folder has them.

        Targets that the folder lacks are where the registration found them.
        """
        nominal = dict(zip(self.vjm.arm.markers, self.vjm.markers, strict=True))
        return with_markers(self.registered.vjm, nominal)


def listed_issues(case: Case, hypotheses: Sequence[Hypothesis[Case]]) -> list[Issue]:
    """List the mistakes that need no fit.

    Args:
        case: Data that the hypotheses test, such as the submitted runs.
        hypotheses: Rows of the table.

    Returns:
        One issue per change that they find, in the order of the table.
    """
    return [
        Issue(row.name, change.where, change.size, change.numbers)
        for row in hypotheses
        for change in row.changes(case)
    ]


def longer_than(*least: float) -> Callable[[Array], bool]:
    """Make a test of a mistake's size: whether one of its vectors of three numbers exceeds its limit, SI."""
    return lambda size: any(np.linalg.norm(size[3 * k : 3 * k + 3]) > limit for k, limit in enumerate(least))


def any_above(least: float) -> Callable[[Array], bool]:
    """Make a test of a mistake's size: whether the magnitude of any of its numbers exceeds a limit, SI."""
    return lambda size: bool(np.abs(size).max() > least)


@dataclass(frozen=True)
class Score:
    """Hold size and likelihood gain of linear mistakes, for one or for a batch."""

    b: Array  #: Expected sizes, in units of their prior deviation, (..., z) [1].
    gain: Array  #: Twice the decrease of the loss, g^T (M + I)^-1 g, (...) [1].
    nats: Array  #: Logarithms of the Bayes factors, (...) [nats].


def score_test(g: Array, M: Array) -> Score:
    """Compare readings with and without a linear mistake b ~ N(0, 1), without a second fit.

    With H = M + I, the expected size is b = H^-1 g, and the logarithm of the Bayes factor is

        nats = (g^T H^-1 g - log det H) / 2

    Args:
        g: Z^T W e, with e the residuals and W = 1 - P on whitened equations, (..., z) [1].
        M: Z^T W Z, (..., z, z) [1].

    Returns:
        Expected sizes, gains g^T H^-1 g and nats (Kass and Raftery 1995).
    """
    H = M + np.eye(g.shape[-1])
    b = np.asarray(np.linalg.solve(H, g[..., None])[..., 0])
    gain = np.asarray((b * g).sum(axis=-1))
    return Score(b, gain, np.asarray((gain - np.linalg.slogdet(H)[1]) / 2))


def undo_one_by_one(
    data: Data,
    model: Model,
    undo: Callable[[Data, Model], tuple[Sequence[Issue], Data, Model] | None],
) -> tuple[list[Issue], Data, Model]:
    """Find the worst mistake, undo it, fit again and look for the next, up to MAX_ROUNDS times.

    Args:
        data: The readings.
        model: Model fitted to them.
        undo: Function of data and model. It returns the worst mistakes, the data without them and the model
            fitted to these; None when it finds no mistake. The search ends when it returns the same data.

    Returns:
        The mistakes in the order in which they were found, the data without them and the last model.
    """
    issues: list[Issue] = []
    for _ in range(MAX_ROUNDS):
        step = undo(data, model)
        if step is None:
            break
        before = data
        more, data, model = step
        issues += more
        if data is before:
            break
    return issues, data, model


# --- Readings and the arm's kinematics: the fit, and mistakes that explain the readings better --------------

SOUND_DISTANCE = 1.5e-3  #: Distance of targets of a sound arm from its kinematics, over its reach [1].
IDENTITY_FRAME = Frame(np.eye(3), np.zeros(3))
PARAMETER_NATS = 4.0  #: Log-likelihood that a free number has to gain [nats].
ROUNDS = 8  #: Most rounds of reweighting and fitting.
LOSS_TOLERANCE = 1e-6  #: Change of the loss below which the rounds end [nats].
MAX_ROWS = 300  #: Most rows that are compared, selected evenly.
HALF, NEARLY_ALL = 0.5, 0.95
"""Quantiles of the reported distance [1]: NEARLY_ALL where half of the readings fit in spite of a mistake."""
MIN_NATS_PER_READING, MIN_NATS = 0.3, 20.0
"""Log-likelihood that a mistake has to gain to be an issue, per reading and in total [nats]."""
MIN_GAIN_SHARE = 0.9  #: Share of the largest gain that a mistake has to reach to be an issue [1].
UNFIT_DISTANCE = 8.0  #: Median distance, over `scale`, above which readings do not fit the arm [1].
ORIENTATION_ARM = 0.3  #: Distance of the three targets that hold an orientation from the first target [m].


@dataclass(frozen=True)
class FreeParameters:
    """Select which parameters a fit leaves free."""

    frame: bool = False  #: Position and orientation of the arm's base in the frame of the readings.
    targets: bool = False  #: Positions of the targets in the tool's frame.
    theta: tuple[int, ...] = ()  #: Virtual joints with a free constant: a joint's zero, a link's end.
    mirrored: bool = False  #: Whether the frame is left-handed.
    #: Whether no nominal targets are known: distant readings then count too, at first.
    targets_unknown: bool = False


@dataclass(frozen=True)
class Observations:
    """Hold readings of targets in poses, and their unknowns."""

    vjm: Vjm  #: The arm's virtual joint model.
    q: Array  #: Actuated joints, (poses, n) [rad, m].
    markers: Array  #: Nominal targets in the tool's frame, (m, 3) [m].
    position: Array  #: Positions of the targets as read, (poses, m, 3) [m].
    seen: Mask  #: Tells which targets were read, (poses, m).
    names: tuple[str, ...]  #: Names of the targets.
    runs: Ids  #: Run of each row, (poses,).
    poses: Ids  #: Pose of each row, (poses,).
    scale: float  #: Typical distance of a sound reading from the arm's kinematics [m].
    free: FreeParameters = FreeParameters()
    #: Orientations, tracker from target, (poses, 3, 3) [1], held as the last three targets; None if not read.
    rotation: Array | None = None

    def select(self, rows: Ids) -> "Observations":
        """Select some rows.

        Args:
            rows: Indices of the rows, (r,).
        """
        rotation = None if self.rotation is None else self.rotation[rows]
        return replace(
            self,
            q=self.q[rows],
            position=self.position[rows],
            seen=self.seen[rows],
            runs=self.runs[rows],
            poses=self.poses[rows],
            rotation=rotation,
        )

    def oriented(self, position: Array, rotation: Array) -> "Observations":
        """Replace positions and orientations of the readings.

        An orientation R is held as three more targets, ORIENTATION_ARM from the first one along the columns
        of R.

        Args:
            position: Positions of the m targets, (poses, m, 3) [m].
            rotation: Orientations, tracker from target, (poses, 3, 3) [1].

        Returns:
            The readings, (poses, m + 3, 3) [m], with these positions and orientations.
        """
        more = position[:, :1] + ORIENTATION_ARM * np.where(
            self.seen[:, -3:, None], rotation.swapaxes(1, 2), 0
        )
        return replace(self, position=np.concatenate([position, more], axis=1), rotation=rotation)


def of_series(vjm: Vjm, series: Series) -> Observations:
    """Prepare absolute readings whose frame and targets are both unknown.

    Args:
        vjm: The arm's virtual joint model.
        series: The readings.

    Returns:
        The readings, with frame and targets free. Orientations, if read, are three more targets.
    """
    there, m = series.seen, len(series.markers)
    if series.rotation is not None:
        there = np.hstack([there, np.repeat(series.oriented[:, None] & there[:, :1], 3, axis=1)])
    observations = Observations(
        vjm=vjm,
        q=series.q,
        markers=np.zeros((there.shape[1], 3)),
        position=series.position[:, :m],
        seen=there,
        names=series.markers,
        runs=series.row,
        poses=series.pose,
        scale=SOUND_DISTANCE * vjm.reach,
        free=FreeParameters(frame=True, targets=True, targets_unknown=True),
    )
    return (
        observations if series.rotation is None else observations.oriented(series.position, series.rotation)
    )


@dataclass(frozen=True)
class Fit:
    """Hold the best fit of the free parameters."""

    frame: Frame  #: From the arm's base to the frame of the readings.
    markers: Array  #: Targets in the tool's frame, (m, 3) [m].
    theta: Array  #: Constants of the virtual joints, (n_theta,) [m, rad].
    residual: Array  #: Fit minus readings, (poses, m, 3) [m]; zero where nothing was read.
    loss: float  #: Cauchy's loss [nats].
    free_numbers: int  #: Number of free parameters.

    @property
    def cost(self) -> float:
        """Compute the loss plus PARAMETER_NATS for every free number [nats]."""
        return self.loss + PARAMETER_NATS * self.free_numbers

    def distances(self, observations: Observations) -> Array:
        """Compute the distance of every reading from the fitted position of its target.

        Args:
            observations: The readings that were fitted.

        Returns:
            Distances, (readings,) [m].
        """
        return np.asarray(np.linalg.norm(self.residual, axis=2)[observations.seen])

    def distance_quantile(self, observations: Observations, share: float = HALF) -> float:
        """Compute a quantile of the distances between readings and fit.

        Args:
            observations: The readings that were fitted.
            share: The quantile, 0 to 1 [1]; the median by default.

        Returns:
            The distance below which that share of the readings lies [m].
        """
        return float(np.quantile(self.distances(observations), share))


@dataclass(frozen=True)
class FittedObservations:
    """Hold readings with their fit, after a mistake of all of them is undone."""

    observations: Observations  #: The readings.
    fit: Fit  #: The fit to them.


def cauchy(residual: Array, scale: float) -> Array:
    """Compute Cauchy's loss 3/2 log(1 + |r|^2 / (3 scale^2)).

    Its second-order term is that of a Gauss loss; large residuals count only logarithmically.

    Args:
        residual: Residuals r, (..., 3) [m].
        scale: Typical distance of a sound reading [m].

    Returns:
        Losses, (...) [nats].
    """
    return np.asarray(1.5 * np.log1p(np.square(residual / scale).sum(axis=-1) / 3))


def best_hypothesis(
    observations: Observations,
    hypotheses: Sequence[Hypothesis[Observations]],
    which: ReadingKind = "unloaded",
) -> tuple[Issue | None, Fit]:
    """Find the mistake that explains readings best: each is undone, fitted again and compared.

    The gain of a mistake is the cost of the fit as read, minus the cost with the mistake undone, minus
    PARAMETER_NATS times its parameters. It has to exceed MIN_NATS, and MIN_NATS_PER_READING per reading.

    Args:
        observations: The readings, with the parameters that are free in any case, such as an unknown frame.
        hypotheses: Rows of the table.
        which: ReadingKind readings these are, for the sentence.

    Returns:
        The mistake, and the fit of all readings with it undone. The mistake is "kinematics" when the readings
        do not fit and no hypothesis explains them, and None when they fit; the fit is then that of the
        readings as they are.
    """
    sample = _thinned(observations)
    start = fit(sample)
    typical = start.distance_quantile(sample)
    unfit = (
        Issue("kinematics", numbers={"now": typical}, readings=which)
        if typical > UNFIT_DISTANCE * observations.scale
        else None
    )
    needed = max(MIN_NATS, MIN_NATS_PER_READING * sample.seen.sum())
    as_read = start if sample is observations else fit(observations)
    if start.loss <= needed:  # no mistake saves more than the loss
        return unfit, as_read

    # Undo every mistake; the most probable one is large, gains enough, and leaves readings that fit.
    trials = list(_undone(observations, hypotheses, start.cost))
    needed = max(needed, MIN_GAIN_SHARE * max((trial.gain for trial in trials), default=0.0))
    good = [
        trial for trial in trials if trial.gain > needed and trial.change.is_large(trial.size(observations))
    ]
    if not good:
        return unfit, as_read
    best = max(good, key=lambda trial: (not trial.hypothesis.many_parameters, trial.gain))
    now = best.fit.distance_quantile(best.sample)
    if now > UNFIT_DISTANCE * observations.scale:
        return unfit, as_read

    # How far most readings were off, and are with the mistake undone.
    share = HALF if now < HALF * typical else NEARLY_ALL
    numbers = {
        "was": start.distance_quantile(sample, share),
        "now": best.fit.distance_quantile(best.sample, share),
        "share": share,
    }
    where = best.change.where
    if best.undone.free.targets and not observations.free.targets:
        where = (observations.names[_farthest(observations, best.fit)],)
    issue = Issue(best.hypothesis.name, where, best.size(observations), numbers, best.gain, which)
    return issue, best.fit if best.sample is best.undone else fit(best.undone)


@dataclass(frozen=True)
class _Trial:
    """Hold readings with one mistake undone, and their fit."""

    hypothesis: Hypothesis[Observations]  #: The kind of mistake.
    change: Change[Observations]  #: The way in which it is undone.
    undone: Observations  #: All readings without the mistake.
    sample: Observations  #: Those of them that were fitted.
    fit: Fit  #: The fit to the sample.
    gain: float  #: Cost as read, minus the cost without the mistake and that of the choice [nats].

    def size(self, observations: Observations) -> Array:
        """Compute the size of the mistake.

        Args:
            observations: The readings as they are, with the mistake.

        Returns:
            Rotation vector and translation of a frame, (6,) [rad, m]; shift of a target or link, (3,) [m];
            else the size of the change, in SI units.
        """
        free, theta = self.undone.free, self.fit.theta[list(self.undone.free.theta)]
        if len(theta) == 3:
            return np.asarray(observations.vjm.arm.links[free.theta[0] // 6].beam_axes @ theta)
        if len(theta):
            return self.change.size + theta
        if free.targets and not observations.free.targets:
            ways = self.fit.markers - observations.markers
            return np.asarray(ways[_farthest(observations, self.fit)])
        if free.frame and not (observations.free.frame or free.mirrored):
            return np.concatenate([self.fit.frame.rotation_vector, self.fit.frame.translation])
        return self.change.size


def _undone(
    observations: Observations, hypotheses: Sequence[Hypothesis[Observations]], cost: float
) -> Iterator[_Trial]:
    """Undo every mistake in turn, and fit again; `cost` is that of the readings as they are."""
    for hypothesis in hypotheses:
        for change in hypothesis.changes(observations):
            assert change.undone is not None
            sample = _thinned(change.undone)
            fitted = fit(sample)
            gain = cost - fitted.cost - PARAMETER_NATS * change.parameters
            yield _Trial(hypothesis, change, change.undone, sample, fitted, float(gain))


def _thinned(observations: Observations) -> Observations:
    """Select at most MAX_ROWS rows, evenly spaced: more would not change which mistake fits."""
    n = len(observations.q)
    return observations if n <= MAX_ROWS else observations.select(evenly_spaced(n, MAX_ROWS))


def _farthest(observations: Observations, fitted: Fit) -> int:
    return int(np.argmax(np.linalg.norm(fitted.markers - observations.markers, axis=1)))


def fit(observations: Observations) -> Fit:
    """Fit the free parameters by reweighted least squares for Cauchy's loss.

    A free frame starts from its closed form; up to ROUNDS Gauss-Newton steps then refine all parameters.

    Args:
        observations: The readings, with their free parameters.
    """
    free = observations.free
    count = 6 * free.frame + 3 * len(observations.markers) * free.targets + len(free.theta)
    now = Fit(
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
        base = where.points(now.markers)
        frame = Frame(
            *kabsch(base[observations.seen], observations.position[observations.seen], mirrored=free.mirrored)
        )
        now = replace(now, frame=frame)
    now = _with_loss(observations, where, now)
    # Gauss-Newton steps with the weights of the last residuals.
    for _ in range(ROUNDS if count else 0):
        before, now = now.loss, _gauss_newton_step(observations, where, now)
        if free.theta:
            where = _chain(observations, now)
        now = _with_loss(observations, where, now)
        if abs(now.loss - before) < LOSS_TOLERANCE:
            break
    return now


def _chain(observations: Observations, now: Fit) -> Chain:
    return chain(
        observations.vjm,
        observations.q,
        np.tile(now.theta, (len(observations.q), 1)) if now.theta.any() else None,
    )


def _with_loss(observations: Observations, chain: Chain, now: Fit) -> Fit:
    off = fit_residuals(observations, chain, now)
    return replace(now, residual=off, loss=float(cauchy(off, observations.scale).sum()))


def fit_residuals(observations: Observations, chain: Chain, now: Fit) -> Array:
    """Compute the residuals R x(q) + t - y: targets by the fit minus readings.

    Args:
        observations: The readings y.
        chain: The extended chain in their poses.
        now: The fit, with frame R, t and targets.

    Returns:
        Residuals, (poses, m, 3) [m]; 0 where nothing was read.
    """
    x = chain.points(now.markers) @ now.frame.rotation.T + now.frame.translation
    return np.where(observations.seen[..., None], x - observations.position, 0.0)


def _gauss_newton_step(observations: Observations, chain: Chain, now: Fit) -> Fit:
    """Take one weighted Gauss-Newton step of all free parameters."""
    free = observations.free
    about = (
        now.residual - now.frame.translation + observations.position
    )  # the targets about the frame's origin
    columns: list[Array] = []
    if free.frame:
        columns += [*np.broadcast_to(np.eye(3)[:, None, None], (3, *about.shape))]
        columns += [*skew(about).transpose(2, 0, 1, 3)]
    if free.theta:
        J = translation_rows(chain, now.markers)[:, free.theta].reshape(
            *observations.markers.shape, -1, len(observations.q)
        )
        columns += list(np.einsum("mxcp,yx->cpmy", J, now.frame.rotation))
    scale = (
        max(observations.scale, now.distance_quantile(observations))
        if free.targets_unknown
        else observations.scale
    )
    weight = observations.seen / (1 + np.square(now.residual / scale).sum(axis=-1) / 3)
    root = np.sqrt(weight)[..., None]
    left, held = root * np.stack([-now.residual, *columns]), np.zeros_like(now.markers)
    size = np.maximum([np.linalg.norm(column) for column in left[1:]], 1e-12)
    if free.targets:  # a target moves its own readings alone: they are left out of all others' columns first
        R = root[..., None] * (now.frame.rotation @ chain.rotation)[:, None]
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

MAX_JOINTS = 7  #: Up to which every order is tried; of more joints, every exchange of two and the reverse.
SCREENED_ROWS, SCREENED_TARGETS = 30, 2  #: Poses, evenly out of more, and first targets that screen orders.
FITTED_ORDERS = 6  #: Orders that are fitted, the best of all.
REWEIGHTINGS = 3  #: Weightings of the linear form: a wild reading must not choose the order.
ORDERS_AT_ONCE = 720  #: Orders whose equations are in memory at a time.
RIDGE = 1e-9  #: Ridge of the normal equations, over their mean diagonal, for undetermined directions.
MIN_ROWS = 3  #: Fewest rows of half a file, and of a slipped part.


def likely_joint_orders(observations: Observations) -> Iterator[Ids]:
    """Find the most probable orders of the joints in the file, by a linear form (see the module).

    Yields:
        At most FITTED_ORDERS orders, (n,) each, the most probable first: joint k has the angles of column
        order[k].
    """
    n = len(observations.vjm.arm.joints)
    if n <= MAX_JOINTS:
        every = np.array(list(permutations(range(n)))[1:], dtype=int).reshape(-1, n)
    else:
        every = np.array([np.arange(n)[::-1], *(_exchange(n, *pair) for pair in combinations(range(n), 2))])
    rows = np.flatnonzero(observations.seen.any(axis=1))
    rows = rows[evenly_spaced(len(rows), SCREENED_ROWS)]
    parts = np.array_split(every, -(-len(every) // ORDERS_AT_ONCE)) if len(every) else []
    cost = [loss for part in parts for loss in _screened(observations, rows, part)]
    yield from every[np.argsort(cost, kind="stable")[:FITTED_ORDERS]]


def _exchange(n: int, i: int, j: int) -> Ids:
    order = np.arange(n)
    order[[i, j]] = j, i
    return order


def _screened(observations: Observations, rows: Ids, orders: Ids) -> Array:
    """Compute the robustly weighted loss of the linear form for every order, (orders,) [nats]."""
    count = len(orders)
    p, R = tool_pose(
        observations.vjm, observations.q[rows][:, orders].swapaxes(0, 1).reshape(-1, orders.shape[1])
    )
    row, target = np.nonzero(observations.seen[rows, :SCREENED_TARGETS])
    p, R = p.reshape(count, -1, 3)[:, row], R.reshape(count, -1, 3, 3)[:, row]
    y = observations.position[rows][row, target]
    right, columns = p + np.matvec(R, observations.markers[target]), np.zeros((count, len(row), 3, 0))
    if not observations.free.frame:
        right = right - y
    else:
        fixed = np.zeros((len(row), 3, 12))  # of A, by rows, and of b: the same in every order
        for axis in range(3):
            fixed[:, axis, 3 * axis : 3 * axis + 3] = y
            fixed[:, axis, 9 + axis] = 1
        columns = np.broadcast_to(fixed, (count, *fixed.shape))
    if observations.free.targets:
        of = np.equal(target[:, None], np.arange(observations.seen[:, :SCREENED_TARGETS].shape[1]))
        target_columns = -R[:, :, :, None, :] * of[None, :, None, :, None]
        columns = np.concatenate([columns, target_columns.reshape(*target_columns.shape[:3], -1)], axis=3)
    weight, left = np.ones(right.shape[:2]), right
    for _ in range(REWEIGHTINGS if columns.shape[3] else 0):
        held = columns * weight[..., None, None]
        H = np.einsum("orxa,orxb->oab", held, columns, optimize=True)
        g = np.einsum("orxa,orx->oa", held, right)
        ridge = RIDGE * np.trace(H, axis1=1, axis2=2) / H.shape[1]
        x = np.linalg.solve(H + ridge[:, None, None] * np.eye(H.shape[1]), g[..., None])
        left = right - (columns @ x[:, None])[..., 0]
        off = np.linalg.norm(left, axis=2)
        weight = 1 / (1 + (off / np.maximum(np.median(off, axis=1, keepdims=True), observations.scale)) ** 2)
    return np.asarray(cauchy(left, observations.scale).sum(axis=1))


@dataclass(frozen=True)
class RowShift:
    """Hold the row from which all readings belong to another pose."""

    first: int  #: The row, counted from 0.
    shift: int  #: 1 if readings belong to the pose before, -1 for the pose after.
    q: Array  #: The joint angles that the readings belong to, (poses, n) [rad, m].


def find_row_shift(observations: Observations) -> RowShift | None:
    """Find the row from which readings are those of the pose before or after, with all rows before it sound.

    It is None when no slip explains the readings clearly better.
    """
    n, far = len(observations.q), UNFIT_DISTANCE * observations.scale
    head = _fit_half(observations, slice(n // 2))
    if head is None or _misfits(observations, head, np.arange(n)[-MAX_ROWS:]) < MIN_ROWS:
        return None
    _, gain, first, shift, best_fit = min(_slip_costs(observations, head), key=lambda candidate: candidate[0])
    while first > 1 and _misfits(observations, best_fit, np.array([first - 1])):
        first -= 1  # the row that was deleted has no pose at all
    q = np.roll(observations.q, shift, axis=0)
    q[:first] = observations.q[:first]
    before, behind = (
        _median_distance(replace(observations, q=q), best_fit, part)
        for part in (slice(first), slice(first, None))
    )
    sound = gain > MIN_NATS_PER_READING * observations.seen[first:].sum() and max(before, behind) < far
    return RowShift(first, shift, q) if sound else None


def _slip_costs(observations: Observations, head: Fit) -> Iterator[tuple[float, float, int, int, Fit]]:
    """Yield the cost of all readings if they slipped one way from the best row, and the gain [nats].

    With them the row, the way and the fit: of the first half, all sound, or of the second, all slipped.
    """
    for shift in (1, -1):
        moved = replace(observations, q=np.roll(observations.q, shift, axis=0))
        for half_fit in (head, _fit_half(moved, slice(len(observations.q) // 2, None)) or head):
            as_read, slipped = (
                cauchy(
                    fit_residuals(observed, chain(observed.vjm, observed.q), half_fit), observed.scale
                ).sum(axis=1)
                for observed in (observations, moved)
            )
            cost = np.cumsum(as_read - slipped)[:-MIN_ROWS] + slipped.sum()
            # an inserted row fits either way
            alike = cost < cost.min() + MIN_NATS_PER_READING * observations.seen.shape[1]
            first = 1 + int(np.flatnonzero(alike)[-1])
            yield float(cost.min()), float(as_read.sum() - cost.min()), first, shift, half_fit


def _fit_half(observations: Observations, half: slice) -> Fit | None:
    """Fit frame and targets to half of the rows; None if there are too few."""
    rows = np.arange(len(observations.q))[half]
    sample = observations.select(rows[evenly_spaced(len(rows), MAX_ROWS)])
    return fit(sample) if len(rows) >= MIN_ROWS and sample.seen.any() else None


def _misfits(observations: Observations, fitted: Fit, rows: Ids) -> int:
    """Count how many of the given rows do not fit the arm in the fitted frame."""
    sample = observations.select(rows)
    off = np.linalg.norm(fit_residuals(sample, chain(sample.vjm, sample.q), fitted), axis=2)
    return int((off > UNFIT_DISTANCE * observations.scale).any(axis=1).sum())


def _median_distance(observations: Observations, fitted: Fit, part: slice) -> float:
    """Compute the median distance of the readings in some rows [m]; 0 without any."""
    off = np.linalg.norm(
        fit_residuals(observations, chain(observations.vjm, observations.q), fitted), axis=2
    )[part][observations.seen[part]]
    return float(np.median(off)) if len(off) else 0.0
