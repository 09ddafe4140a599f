"""Readings against the arm's kinematics: what explains them, and which mistake explains them better.

Readings have to lie where the kinematics has the targets, up to a sound arm's errors: calibration, own
weight, a target a few millimetres off. The loss is Cauchy's: a few wrong readings do not speak for a mistake
in all.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from testbench.data.dataset import Series
from testbench.errors import Array, Ids, Mask
from testbench.identify.closed_form import kabsch
from testbench.identify.diagnosis.hypothesis import Change, Hypothesis, Issue
from testbench.identify.registration import Frame
from testbench.model.vjm import Chain, Vjm, chain, rotation_matrices, skew, translation_rows

PRECISE = 1.5e-3  #: How far targets of a sound arm lie from its kinematics, over its reach [1].
ORIGIN = Frame(np.eye(3), np.zeros(3))
PENALTY = 4.0  #: Log-likelihood that a free number has to gain [nats].
ROUNDS = 8  #: Most rounds of reweighting and fitting.
SETTLED = 1e-6  #: Change of the loss below which the rounds end [nats].
ROWS = 300  #: Most rows that are compared, selected evenly.
HALF, NEARLY_ALL = 0.5, 0.95
"""Quantiles of the reported distance [1]: NEARLY_ALL where half of the readings fit in spite of a mistake."""
BETTER, LEAST = 0.3, 20.0
"""Log-likelihood that a mistake has to gain to be an issue, per reading and in total [nats]."""
SHARE = 0.9  #: Share of the largest gain that a mistake has to reach to be an issue [1].
LOST = 8.0  #: Median distance, over `scale`, above which readings do not fit the arm [1].
ARM = 0.3  #: Distance of the three targets that hold an orientation from the first target [m].
Which = Literal["unloaded", "loaded", "all"]
"""Selects the readings that are compared."""


@dataclass(frozen=True)
class FreeParameters:
    """Select which parameters a fit leaves free."""

    frame: bool = False  #: Position and orientation of the arm's base in the frame of the readings.
    targets: bool = False  #: Positions of the targets in the tool's frame.
    theta: tuple[int, ...] = ()  #: Virtual joints with a free constant: a joint's zero, a link's end.
    mirrored: bool = False  #: Whether the frame is left-handed.
    lost: bool = False  #: Whether the targets are unknown: distant readings then count too, at first.


@dataclass(frozen=True)
class Observations:
    """Hold readings of targets in poses, and what is unknown about them."""

    vjm: Vjm  #: The arm's virtual joint model.
    q: Array  #: Actuated joints, (poses, n) [rad, m].
    markers: Array  #: Nominal targets in the tool's frame, (m, 3) [m].
    read: Array  #: Readings of the targets, (poses, m, 3) [m].
    there: Mask  #: Which were read, (poses, m).
    names: tuple[str, ...]  #: Names of the targets.
    runs: Ids  #: Run of each row, (poses,).
    poses: Ids  #: Pose of each row, (poses,).
    scale: float  #: Typical distance of a sound reading from the arm's kinematics [m].
    free: FreeParameters = FreeParameters()
    #: Orientations, tracker from target, (poses, 3, 3) [1], held as the last three targets; None if not read.
    rotation: Array | None = None

    def rows(self, some: Ids) -> "Observations":
        """Select some rows.

        Args:
            some: Indices of rows, (r,).

        Returns:
            The readings of these rows.
        """
        rotation = None if self.rotation is None else self.rotation[some]
        return replace(
            self,
            q=self.q[some],
            read=self.read[some],
            there=self.there[some],
            runs=self.runs[some],
            poses=self.poses[some],
            rotation=rotation,
        )

    def oriented(self, position: Array, rotation: Array) -> "Observations":
        """Replace positions and orientations of the readings.

        An orientation R is held as three more targets, ARM from the first one along the columns of R.

        Args:
            position: Positions of the m targets, (poses, m, 3) [m].
            rotation: Orientations, tracker from target, (poses, 3, 3) [1].

        Returns:
            The readings, (poses, m + 3, 3) [m], with these positions and orientations.
        """
        more = position[:, :1] + ARM * np.where(self.there[:, -3:, None], rotation.swapaxes(1, 2), 0)
        return replace(self, read=np.concatenate([position, more], axis=1), rotation=rotation)


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
        there = np.hstack([there, np.repeat(series.turned[:, None] & there[:, :1], 3, axis=1)])
    observations = Observations(
        vjm=vjm,
        q=series.q,
        markers=np.zeros((there.shape[1], 3)),
        read=series.position[:, :m],
        there=there,
        names=series.markers,
        runs=series.row,
        poses=series.pose,
        scale=PRECISE * vjm.reach,
        free=FreeParameters(frame=True, targets=True, lost=True),
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
    numbers: int  #: Number of free parameters.

    @property
    def cost(self) -> float:
        """Compute the loss plus PENALTY for every free number [nats]."""
        return self.loss + PENALTY * self.numbers

    def away(self, observations: Observations) -> Array:
        """Compute the distance of every reading from where the fit has its target.

        Args:
            observations: The readings that were fitted.

        Returns:
            Distances, (readings,) [m].
        """
        return np.asarray(np.linalg.norm(self.residual, axis=2)[observations.there])

    def typical(self, observations: Observations, share: float = HALF) -> float:
        """Compute a quantile of the distances between readings and fit.

        Args:
            observations: The readings that were fitted.
            share: The quantile, 0 to 1 [1]; the median by default.

        Returns:
            The distance below which that share of the readings lies [m].
        """
        return float(np.quantile(self.away(observations), share))


@dataclass(frozen=True)
class Placed:
    """Hold readings with their fit, after a mistake of all of them is undone."""

    seen: Observations
    fit: Fit


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
    observations: Observations, hypotheses: Sequence[Hypothesis[Observations]], which: Which = "unloaded"
) -> tuple[Issue | None, Fit]:
    """Find the mistake that explains readings best: each is undone, fitted again and compared.

    The gain of a mistake is the cost of the fit as read, minus the cost with the mistake undone, minus
    PENALTY times its parameters. It has to exceed LEAST, and BETTER per reading.

    Args:
        observations: The readings, with the parameters that are free in any case, such as an unknown frame.
        hypotheses: Rows of the table.
        which: Which readings these are, for the sentence.

    Returns:
        The mistake, and the fit of all readings with it undone. The mistake is "kinematics" when the readings
        do not fit and no hypothesis explains them, and None when they fit; the fit is then that of the
        readings as they are.
    """
    few = _thinned(observations)
    start = fit(few)
    typical = start.typical(few)
    unfit = (
        Issue("kinematics", (which,), numbers={"now": typical})
        if typical > LOST * observations.scale
        else None
    )
    needed = max(LEAST, BETTER * few.there.sum())
    as_read = start if few is observations else fit(observations)
    if start.loss <= needed:  # no mistake saves more than the loss
        return unfit, as_read
    tried = []
    for hypothesis in hypotheses:
        for change in hypothesis.changes(observations):
            assert change.undone is not None
            found = fit(_thinned(change.undone))
            tried.append((start.cost - found.cost - PENALTY * change.parameters, hypothesis, change, found))
    needed = max(needed, SHARE * max((float(gain) for gain, *_ in tried), default=0.0))
    good = [one for one in tried if one[0] > needed and one[2].large(_size(observations, one[2], one[3]))]
    if not good:
        return unfit, as_read
    gain, hypothesis, change, found = max(good, key=lambda one: (not one[1].loose, one[0]))
    assert change.undone is not None
    undone = _thinned(change.undone)
    now = found.typical(undone)
    if now > LOST * observations.scale:
        return unfit, as_read
    share = HALF if now < HALF * typical else NEARLY_ALL
    numbers = {"was": start.typical(few, share), "now": found.typical(undone, share), "share": share}
    where = change.where
    if change.undone.free.targets and not observations.free.targets:
        where = (observations.names[_farthest(observations, found)],)
    issue = Issue(hypothesis.name, (which, *where), _size(observations, change, found), numbers, float(gain))
    return issue, found if undone is change.undone else fit(change.undone)


def _thinned(observations: Observations) -> Observations:
    """As many rows as tell what is wrong."""
    n = len(observations.q)
    return observations if n <= ROWS else observations.rows(np.linspace(0, n - 1, ROWS).astype(int))


def _farthest(observations: Observations, found: Fit) -> int:
    return int(np.argmax(np.linalg.norm(found.markers - observations.markers, axis=1)))


def _size(observations: Observations, change: Change[Observations], found: Fit) -> Array:
    """Size a mistake, SI: turn and shift of a frame, way of a target or link, else one number."""
    assert change.undone is not None
    free = change.undone.free
    if len(free.theta) == 3:
        return np.asarray(
            observations.vjm.arm.links[free.theta[0] // 6].frame @ found.theta[list(free.theta)]
        )
    if free.theta:
        return change.size + found.theta[list(free.theta)]
    if free.targets and not observations.free.targets:
        return np.asarray((found.markers - observations.markers)[_farthest(observations, found)])
    if free.frame and not (observations.free.frame or free.mirrored):
        return np.concatenate([found.frame.rotation_vector, found.frame.translation])
    return change.size


def fit(observations: Observations) -> Fit:
    """Fit the free parameters by reweighted least squares for Cauchy's loss.

    A free frame starts from its closed form; up to ROUNDS Gauss-Newton steps then refine all parameters.

    Args:
        observations: The readings, with their free parameters.

    Returns:
        The best fit.
    """
    free = observations.free
    count = 6 * free.frame + 3 * len(observations.markers) * free.targets + len(free.theta)
    now = Fit(
        ORIGIN, observations.markers, np.zeros(observations.vjm.arm.n_theta), observations.read, np.inf, count
    )
    where = _chain(observations, now)
    # Start with the frame in closed form.
    if free.frame:
        base = where.points(now.markers)
        frame = Frame(
            *kabsch(base[observations.there], observations.read[observations.there], mirrored=free.mirrored)
        )
        now = replace(now, frame=frame)
    now = _judged(observations, where, now)
    # Gauss-Newton steps with the weights of the last residuals.
    for _ in range(ROUNDS if count else 0):
        before, now = now.loss, _refined(observations, where, now)
        if free.theta:
            where = _chain(observations, now)
        now = _judged(observations, where, now)
        if abs(now.loss - before) < SETTLED:
            break
    return now


def _chain(observations: Observations, now: Fit) -> Chain:
    return chain(
        observations.vjm,
        observations.q,
        np.tile(now.theta, (len(observations.q), 1)) if now.theta.any() else None,
    )


def _judged(observations: Observations, where: Chain, now: Fit) -> Fit:
    off = residuals(observations, where, now)
    return replace(now, residual=off, loss=float(cauchy(off, observations.scale).sum()))


def residuals(observations: Observations, where: Chain, now: Fit) -> Array:
    """Compute the residuals R x(q) + t - y: targets by the fit minus readings.

    Args:
        observations: The readings y.
        where: The extended chain in their poses.
        now: The fit, with frame R, t and targets.

    Returns:
        Residuals, (poses, m, 3) [m]; 0 where nothing was read.
    """
    x = where.points(now.markers) @ now.frame.rotation.T + now.frame.translation
    return np.where(observations.there[..., None], x - observations.read, 0.0)


def _refined(observations: Observations, where: Chain, now: Fit) -> Fit:
    """One weighted Gauss-Newton step of all that is free."""
    free = observations.free
    about = now.residual - now.frame.translation + observations.read  # the targets about the frame's origin
    columns: list[Array] = []
    if free.frame:
        columns += [*np.broadcast_to(np.eye(3)[:, None, None], (3, *about.shape))]
        columns += [*skew(about).transpose(2, 0, 1, 3)]
    if free.theta:
        J = translation_rows(where, now.markers)[:, free.theta].reshape(
            *observations.markers.shape, -1, len(observations.q)
        )
        columns += list(np.einsum("mxcp,yx->cpmy", J, now.frame.rotation))
    scale = max(observations.scale, now.typical(observations)) if free.lost else observations.scale
    weight = observations.there / (1 + np.square(now.residual / scale).sum(axis=-1) / 3)
    root = np.sqrt(weight)[..., None]
    left, held = root * np.stack([-now.residual, *columns]), np.zeros_like(now.markers)
    size = np.maximum([np.linalg.norm(column) for column in left[1:]], 1e-12)
    if free.targets:  # a target moves its own readings alone: they are left out of all others' columns first
        R = root[..., None] * (now.frame.rotation @ where.rotation)[:, None]
        own = np.einsum("pmxa,cpmx->cma", R, left) / np.maximum((root**2).sum(axis=0), 1e-12)
        left = left - np.einsum("pmxa,cma->cpmx", R, own)
    off, *common = left.reshape(len(left), -1)
    step = np.zeros(0)
    if common:
        step = np.linalg.lstsq(np.stack(common, axis=1) / size, off)[0] / size
    if free.targets:
        held = own[0] - np.tensordot(step, own[1:], 1)
    frame, theta = now.frame, now.theta.copy()
    theta[list(free.theta)] += step[len(step) - len(free.theta) :]
    if free.frame:
        frame = Frame(rotation_matrices(step[None, 3:6])[0] @ frame.rotation, frame.translation + step[:3])
    return replace(now, frame=frame, theta=theta, markers=now.markers + held)
