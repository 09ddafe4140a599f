"""Unloaded readings against the arm's kinematics, with some of what was handed in left free.

Readings have to lie where the kinematics has the targets, up to a sound arm's errors: calibration, own
weight, a target a few millimetres off. The loss is Cauchy's: a few wrong readings do not speak for a mistake
in all.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from testbench.data.dataset import Ids
from testbench.errors import Array
from testbench.identify.closed_form import kabsch
from testbench.model.vjm import Vjm, body_poses, rotation


@dataclass(frozen=True)
class Rigid:
    """x -> R x + t."""

    R: Array  #: Orthogonal, (3, 3).
    t: Array  #: (3,) [m].

    def of(self, points: Array) -> Array:
        """Points, (..., 3), moved."""
        return np.asarray(points @ self.R.T + self.t)

    @property
    def turn(self) -> Array:
        """Rotation vector of a rotation, (3,) [rad]."""
        from scipy.spatial.transform import Rotation  # here: it takes long to import

        return np.asarray(Rotation.from_matrix(self.R).as_rotvec())


STILL = Rigid(np.eye(3), np.zeros(3))


def turned_by(vector: Array) -> Array:
    """Rotation matrix of a rotation vector, (3,) [rad] (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    return np.eye(3) if angle < 1e-15 else rotation(vector / angle, angle)


def weights(residual: Array, scale: float) -> Array:
    """Weights of Cauchy's loss, of residuals, (..., 3) [m]."""
    return np.asarray(1 / (1 + np.square(residual / scale).sum(axis=-1) / 3))


def losses(residual: Array, scale: float) -> Array:
    """Cauchy's loss of residuals, (..., 3): minus the logarithm of a density in three dimensions [nats]."""
    return np.asarray(1.5 * np.log1p(np.square(residual / scale).sum(axis=-1) / 3))


def cost(residual: Array, scale: float) -> float:
    """Cauchy's loss of all residuals, (..., 3) [nats]."""
    return float(losses(residual, scale).sum())


PENALTY = 4.0  #: Nats that a free number has to earn.
ROUNDS = 8  #: Most of weights and fits in turn.
SETTLED = 1e-6  #: Change of the loss after which a round is the last [nats].


Bodies = list[tuple[Array, Array]]
"""Positions, (poses, 3) [m], and orientations, (poses, 3, 3), of the arm's bodies and the tool."""


@dataclass(frozen=True)
class Seen:
    """Unloaded readings, one of a pose and target."""

    vjm: Vjm  #: The kinematics.
    q: Array  #: (poses, n) [rad, m].
    markers: Array  #: Nominal targets in the tool's frame, (m, 3) [m].
    read: Array  #: (poses, m, 3) [m].
    there: npt.NDArray[np.bool_]  #: Which were read, (poses, m).
    names: tuple[str, ...]  #: Of the targets.
    runs: Ids  #: Run of each row, (poses,).
    poses: Ids  #: Its pose.
    scale: float  #: How far a sound reading may lie off [m].


@dataclass(frozen=True)
class Free:
    """What is left free."""

    frame: bool = False  #: Position and orientation of the arm's base in the frame of the readings.
    targets: bool = False  #: Places of the targets in the tool's frame.
    joint: int | None = None  #: A joint whose zero is free.
    link: int | None = None  #: A link whose end is free.
    mirrored: bool = False  #: Whether the frame is left-handed.


@dataclass(frozen=True)
class Fit:
    """Readings with something left free."""

    frame: Rigid  #: From the arm's base to the frame of the readings.
    markers: Array  #: Targets in the tool's frame, (m, 3) [m].
    offset: float  #: Of the joint [rad, m].
    step: Array  #: Of the link's end, in its axes, (3,) [m].
    residual: Array  #: (poses, m, 3) [m], zero where nothing was read.
    loss: float  #: Cauchy's [nats].
    numbers: int  #: How many were free.

    @property
    def cost(self) -> float:
        """The loss with what the free numbers have to earn [nats]."""
        return self.loss + PENALTY * self.numbers


def fit(seen: Seen, free: Free) -> Fit:
    """The best fit of what is free: in closed form where a frame is, then refined together."""
    count = 6 * free.frame + 3 * len(seen.markers) * free.targets + (free.joint is not None)
    count += 3 * (free.link is not None)
    now = Fit(STILL, seen.markers, 0.0, np.zeros(3), seen.read, np.inf, count)
    bodies = _bodies(seen, free, now)
    if free.frame:
        where = _where(bodies, now)
        R, t = kabsch(where[seen.there], seen.read[seen.there], mirrored=free.mirrored)
        now = replace(now, frame=Rigid(R, t))
    now = _judged(seen, bodies, now)
    for _ in range(ROUNDS if count else 0):
        before, now = now.loss, _refined(seen, free, bodies, now)
        if free.joint is not None or free.link is not None:
            bodies = _bodies(seen, free, now)
        now = _judged(seen, bodies, now)
        if abs(now.loss - before) < SETTLED:
            break
    return now


def _judged(seen: Seen, bodies: Bodies, now: Fit) -> Fit:
    off = np.where(seen.there[..., None], now.frame.of(_where(bodies, now)) - seen.read, 0)
    return replace(now, residual=off, loss=cost(off, seen.scale))


def _where(bodies: Bodies, now: Fit) -> Array:
    """Where the kinematics has the targets, in the arm's base, (poses, m, 3) [m]."""
    p, R = bodies[-1]
    return np.asarray(p[:, None] + now.markers @ R.transpose(0, 2, 1))


def _bodies(seen: Seen, free: Free, now: Fit) -> Bodies:
    """Where the bodies from the base on and the tool are."""
    vjm, q = seen.vjm, seen.q
    if free.joint is not None:
        q = q.copy()
        q[:, free.joint] += now.offset
    if free.link is not None:
        placements = vjm.placements.copy()
        placements[free.link, :3, 3] += now.step
        vjm = replace(vjm, placements=placements)
    return body_poses(vjm, q)


def _refined(seen: Seen, free: Free, bodies: Bodies, now: Fit) -> Fit:
    """One weighted Gauss-Newton step of all that is free."""
    base = _where(bodies, now)
    columns: list[Array] = []
    if free.frame:
        moved = now.frame.of(base)
        columns += [np.broadcast_to(e, base.shape) for e in np.eye(3)]
        columns += [np.cross(e, moved - now.frame.t) for e in np.eye(3)]
    if free.link is not None:
        R = now.frame.R @ bodies[free.link][1]
        columns += [np.broadcast_to(R[:, None, :, axis], base.shape) for axis in range(3)]
    if free.joint is not None:
        columns.append(_turned(seen.vjm, free.joint, bodies, base) @ now.frame.R.T)
    root = np.sqrt(weights(now.residual, seen.scale) * seen.there)[..., None]
    left, held = root * np.stack([-now.residual, *columns]), np.zeros_like(now.markers)
    if free.targets:  # a target moves its own readings alone: they are left out of all others' columns first
        R = root[..., None] * (now.frame.R @ bodies[-1][1])[:, None]
        count = np.maximum((root**2).sum(axis=0), 1e-12)
        own = np.einsum("pmxa,cpmx->cma", R, left) / count
        left = left - np.einsum("pmxa,cma->cpmx", R, own)
    off, *common = left.reshape(len(left), -1)
    step = np.zeros(0)
    if common:
        size = np.maximum([np.linalg.norm(root * column) for column in columns], 1e-12)
        step = np.linalg.lstsq(np.stack(common, axis=1) / size, off)[0] / size
    if free.targets:
        held = own[0] - np.tensordot(step, own[1:], 1)
    return _stepped(free, replace(now, markers=now.markers + held), step)


def _turned(vjm: Vjm, joint: int, bodies: Bodies, where: Array) -> Array:
    """How targets move with a joint, in the arm's base, (poses, m, 3) [m, 1]."""
    p, R = bodies[joint + 1]
    axis = (R @ vjm.axes[joint])[:, None]
    if vjm.arm.joints[joint].prismatic:
        return np.broadcast_to(axis, where.shape)
    return np.cross(axis, where - p[:, None])


def _stepped(free: Free, now: Fit, step: Array) -> Fit:
    frame, offset = now.frame, now.offset
    if free.joint is not None:
        offset, step = offset + float(step[-1]), step[:-1]
    end = now.step
    if free.link is not None:
        end, step = end + step[-3:], step[:-3]
    if free.frame:
        frame = Rigid(turned_by(step[3:6]) @ frame.R, frame.t + step[:3])
    return replace(now, frame=frame, offset=offset, step=end)


def away(seen: Seen, own: Fit) -> Array:
    """Distances of all readings from where they should be, (readings,) [m]."""
    return np.asarray(np.linalg.norm(own.residual, axis=2)[seen.there])
