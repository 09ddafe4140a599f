"""Joints that put the tool of the drawn arm into poses: damped Newton within limits, all poses at once."""

from dataclasses import dataclass

import numpy as np

from testbench.correct.newton import Target
from testbench.data.dataset import in_order
from testbench.errors import Array, Mask
from testbench.model.tool_motion import tool_motion
from testbench.model.turn import turn_between
from testbench.model.vjm import Vjm

THERE = 1e-9  #: A tool this close to its pose has reached it [m, rad].
TINY = 1e-12  #: Error at which a pose is left alone [m].
LEVER = 0.25  #: Radius at which a wrong orientation counts, over the arm's reach [1].
DAMPING = 1e-2  #: Of the first step, over the squared error: it fades as the tool comes near [1].
FLOOR = 1e-14  #: Damping that stays, over the square of the lever [1].
LARGEST = 0.5  #: Largest motion of a joint in one step [rad, m].
STALLED, PATIENCE = 1e-4, 4
"""Relative gain of a step that leads nowhere [1], and how many of these it takes to give a pose up."""
MOST = 60  #: Steps.


@dataclass(frozen=True)
class Reached:
    """Joints, and how far the tool stays away."""

    q: Array  #: Within the limits, (poses, n) [rad, m].
    distance: Array  #: From the tool to where it should be, (poses,) [m].
    angle: Array  #: Between its orientation and what it should be, (poses,) [rad].

    @property
    def there(self) -> Mask:
        """Which poses are reached, (poses,)."""
        return np.asarray((self.distance <= THERE) & (self.angle <= THERE))


def reach(vjm: Vjm, target: Target, start: Array) -> Reached:
    """Joints near others that put the tool's origin into poses; where none do, as near as these lead.

    Damped least squares with least motion. A joint at its limit that would go on stays there.

    Args:
        vjm: The arm as drawn.
        target: Poses of the tool's origin.
        start: Joints to start from, (poses, n) [rad, m].
    """
    lower, upper = vjm.arm.limits
    lever = LEVER * vjm.reach
    q = np.clip(start, lower, upper)
    e, J = _error(vjm, lever, q, target)
    cost, damping, dull = _square(e), np.full(len(q), DAMPING), np.zeros(len(q), dtype=int)
    for _ in range(MOST):
        some = np.flatnonzero((cost > TINY**2) & (dull < PATIENCE))
        if not len(some):
            break
        weight = damping[some] * cost[some] + FLOOR * lever**2
        trial = np.clip(q[some] + _step(J[some], e[some], weight, q[some], vjm.arm.limits), lower, upper)
        e_trial, J_trial = _error(vjm, lever, trial, in_order(target, some))
        gain = 1 - _square(e_trial) / cost[some]
        better = gain > 0
        taken = some[better]
        q[taken], e[taken], J[taken] = trial[better], e_trial[better], J_trial[better]
        cost[taken] = _square(e[taken])
        damping[some] *= np.where(better, 0.2, 10.0)
        dull[some] = np.where(gain > STALLED, 0, dull[some] + 1)
    return Reached(q, np.linalg.norm(e[:, :3], axis=1), np.linalg.norm(e[:, 3:], axis=1) / lever)


def _square(e: Array) -> Array:
    return np.asarray((e * e).sum(axis=1))


def _error(vjm: Vjm, lever: float, q: Array, target: Target) -> tuple[Array, Array]:
    """What is left to the pose, (poses, 6) [m], and how the joints take it away, (poses, 6, n)."""
    p, R, J = tool_motion(vjm, q)
    J[:, 3:] *= lever
    return np.hstack([target.position - p, lever * turn_between(R, target.rotation)]), J


def _step(J: Array, e: Array, weight: Array, q: Array, limits: Array) -> Array:
    """Least motion of the joints that takes most of the error away, (poses, n) [rad, m]."""
    step = _damped(J, e, weight)
    blocked = ((q <= limits[0]) & (step < 0)) | ((q >= limits[1]) & (step > 0))
    some = np.flatnonzero(blocked.any(axis=1))
    if len(some):
        step[some] = _damped(J[some] * ~blocked[some][:, None], e[some], weight[some])
    size = np.abs(step).max(axis=1, keepdims=True)
    return np.asarray(step * np.minimum(1, LARGEST / np.maximum(size, LARGEST)))


def _damped(J: Array, e: Array, weight: Array) -> Array:
    """J^T (J J^T + weight)^-1 e, (poses, n)."""
    A = J @ J.swapaxes(1, 2)
    A[:, range(6), range(6)] += weight[:, None]
    return np.asarray((J.swapaxes(1, 2) @ np.linalg.solve(A, e[..., None]))[..., 0])
