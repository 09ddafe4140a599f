"""Readings against the arm's kinematics, with some of what was handed in left free.

Readings have to lie where the kinematics has the targets, up to a sound arm's errors: calibration, own
weight, a target a few millimetres off. The loss is Cauchy's: a few wrong readings do not speak for a mistake
in all.
"""

from dataclasses import dataclass, replace

import numpy as np

from testbench.errors import Array, Ids, Mask
from testbench.identify.closed_form import kabsch
from testbench.identify.registration import Frame
from testbench.model.tool_motion import turned
from testbench.model.vjm import Chain, Vjm, chain, skew, translation_rows

STILL = Frame(np.eye(3), np.zeros(3))
PENALTY = 4.0  #: Nats that a free number has to earn.
ROUNDS = 8  #: Most of weights and fits in turn.
SETTLED = 1e-6  #: Change of the loss after which a round is the last [nats].


@dataclass(frozen=True)
class Seen:
    """Readings, one of a pose and target."""

    vjm: Vjm  #: The kinematics.
    q: Array  #: (poses, n) [rad, m].
    markers: Array  #: Nominal targets in the tool's frame, (m, 3) [m].
    read: Array  #: (poses, m, 3) [m].
    there: Mask  #: Which were read, (poses, m).
    names: tuple[str, ...]  #: Of the targets.
    runs: Ids  #: Run of each row, (poses,).
    poses: Ids  #: Its pose.
    scale: float  #: How far a sound reading may lie off [m].


@dataclass(frozen=True)
class Free:
    """What is left free."""

    frame: bool = False  #: Position and orientation of the arm's base in the frame of the readings.
    targets: bool = False  #: Places of the targets in the tool's frame.
    theta: tuple[int, ...] = ()  #: Virtual joints whose constants are free: a joint's zero, a link's end.
    mirrored: bool = False  #: Whether the frame is left-handed.
    lost: bool = False  #: Whether nothing is known of the targets: readings far off count too, at first.


@dataclass(frozen=True)
class Fit:
    """Readings with something left free."""

    frame: Frame  #: From the arm's base to the frame of the readings.
    markers: Array  #: Targets in the tool's frame, (m, 3) [m].
    theta: Array  #: Constants of the virtual joints, (n_theta,) [m, rad].
    residual: Array  #: (poses, m, 3) [m], zero where nothing was read.
    loss: float  #: Cauchy's [nats].
    numbers: int  #: How many were free.

    @property
    def cost(self) -> float:
        """The loss with what the free numbers have to earn [nats]."""
        return self.loss + PENALTY * self.numbers


def losses(residual: Array, scale: float) -> Array:
    """Cauchy's loss of residuals, (..., 3): minus the logarithm of a density in three dimensions [nats]."""
    return np.asarray(1.5 * np.log1p(np.square(residual / scale).sum(axis=-1) / 3))


def away(seen: Seen, own: Fit) -> Array:
    """Distances of all readings from where they should be, (readings,) [m]."""
    return np.asarray(np.linalg.norm(own.residual, axis=2)[seen.there])


def fit(seen: Seen, free: Free) -> Fit:
    """The best fit of what is free: in closed form where a frame is, then refined together."""
    count = 6 * free.frame + 3 * len(seen.markers) * free.targets + len(free.theta)
    now = Fit(STILL, seen.markers, np.zeros(seen.vjm.arm.n_theta), seen.read, np.inf, count)
    where = _chain(seen, now)
    if free.frame:
        base = where.points(now.markers)
        now = replace(
            now, frame=Frame(*kabsch(base[seen.there], seen.read[seen.there], mirrored=free.mirrored))
        )
    now = _judged(seen, where, now)
    for _ in range(ROUNDS if count else 0):
        before, now = now.loss, _refined(seen, free, where, now)
        if free.theta:
            where = _chain(seen, now)
        now = _judged(seen, where, now)
        if abs(now.loss - before) < SETTLED:
            break
    return now


def _chain(seen: Seen, now: Fit) -> Chain:
    return chain(seen.vjm, seen.q, np.tile(now.theta, (len(seen.q), 1)) if now.theta.any() else None)


def _judged(seen: Seen, where: Chain, now: Fit) -> Fit:
    off = residuals(seen, where, now)
    return replace(now, residual=off, loss=float(losses(off, seen.scale).sum()))


def residuals(seen: Seen, where: Chain, now: Fit) -> Array:
    """Where the arm has the targets minus readings, (poses, m, 3) [m]; 0 where nothing was read."""
    x = where.points(now.markers) @ now.frame.rotation.T + now.frame.translation
    return np.where(seen.there[..., None], x - seen.read, 0.0)


def _refined(seen: Seen, free: Free, where: Chain, now: Fit) -> Fit:
    """One weighted Gauss-Newton step of all that is free."""
    about = now.residual - now.frame.translation + seen.read  # the targets about the frame's origin
    columns: list[Array] = []
    if free.frame:
        columns += [*np.broadcast_to(np.eye(3)[:, None, None], (3, *about.shape))]
        columns += [*skew(about).transpose(2, 0, 1, 3)]
    if free.theta:
        J = translation_rows(where, now.markers)[:, free.theta].reshape(*seen.markers.shape, -1, len(seen.q))
        columns += list(np.einsum("mxcp,yx->cpmy", J, now.frame.rotation))
    scale = max(seen.scale, float(np.median(away(seen, now)))) if free.lost else seen.scale
    weight = seen.there / (1 + np.square(now.residual / scale).sum(axis=-1) / 3)
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
        frame = Frame(turned(step[None, 3:6])[0] @ frame.rotation, frame.translation + step[:3])
    return replace(now, frame=frame, theta=theta, markers=now.markers + held)
