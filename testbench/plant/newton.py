"""Newton on MuJoCo's generalised forces, all poses of a step at once.

With the actuated joints held, theta is at rest where K_theta theta = Q(theta), Q the generalised force of
the arm's own weight and of the external wrench. Newton's matrix is K_theta - K_w (Eq. 7). K_w is small for
an arm that can carry its load, so K_theta alone serves until it does not: theta <- C_theta Q(theta) gains two
digits a step. Where it gains less than a factor four, the pose's tangent is taken by finite differences.

What a pose comes to does not depend on those beside it: it takes its own steps and stops by itself, and
matrices meet its vectors alone, since how BLAS rounds a product of two matrices depends on their sizes.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from testbench.errors import Array, NoEquilibrium
from testbench.plant.build import Index, Plant
from testbench.plant.state import Row, State, evaluate

STEP_TOLERANCE = 1e-9  #: A pose is in equilibrium when the last Newton step is below this [m, rad].
MAX_ITERATIONS = 50
MAX_SAG = 0.5  #: A virtual joint beyond this [m, rad] is no longer an elastic deflection.


@dataclass(frozen=True)
class Poses:
    """Poses that take their Newton steps together."""

    plant: Plant  #: The arm.
    run: slice  #: Which of the caller's runs they are.
    held: Array  #: Configuration with the actuated joints where they are held and theta = 0, (poses, nv).
    wrench: Array  #: Force and moment, world axes, (poses, 6) [N, N m].
    point: Array  #: Where it acts, in the tool's frame, (poses, 3) [m].


@dataclass(frozen=True)
class Statics:
    """Forces and springs of some poses. `some` are indices into them, with repeats where a pose is varied.

    At rest the actuated joints are where they are held, and all others at deflect(force()).
    """

    #: Generalised force Q where MuJoCo finds the arm, springs apart, (some, nv) [N, N m].
    force: Callable[[State, Index], Array]
    #: Deflection under a generalised force, zero at the actuated joints, (some, nv) [m, rad].
    deflect: Callable[[Array, Index], Array]
    compliance: Callable[[Array, Index], Array]  #: Its derivative at a generalised force, (some, nv, nv).
    #: Generalised force of the springs at qpos, (some, nv) [N, N m]; they are told Q, since a joint with play
    #: or friction has no force of its own.
    springs: Callable[[Array, Array, Index], Array]
    bodies: tuple[int, ...] = ()  #: Ids of the bodies that forces act on, their own weight apart.
    #: First guess of the inverse of C (K_theta - K_w), Eq. (7), applied to steps, (some, nv).
    start: Callable[[Array, Index], Array] = lambda step, _: step


def newton(statics: Statics, poses: Poses, row: Row) -> tuple[Array, Array, Index]:
    """Move the virtual joints from `held` to rest. A pose at rest, or lost, takes no further steps.

    Returns:
        Configurations (poses, nv), last steps (poses,) [m, rad], and numbers of steps (poses,).

    Raises:
        NoEquilibrium: When a pose has none; names the first.
    """
    held, active = poses.held, np.arange(len(poses.held))
    qpos, steps = held.copy(), np.zeros_like(active)
    size: Array = np.full(len(held), np.inf)
    inverses: dict[int, Array] = {}
    lost: dict[int, str] = {}
    for k in range(1, MAX_ITERATIONS + 1):
        at, last = qpos[active], size[active]
        Q = statics.force(evaluate(row, at, statics.bodies), active)
        step = _corrected(statics, inverses, held[active] + statics.deflect(Q, active) - at, active)
        now = np.sqrt(np.vecdot(step, step))
        qpos[active], size[active], steps[active] = at + step, now, k
        done, going = now < STEP_TOLERANCE, (now >= STEP_TOLERANCE) & (now < MAX_SAG)
        for i in active[~done & ~going].tolist():
            lost[i] = _not_found(k, size[i])
        for i in active[going & (now > last / 4)].tolist():
            inverses[i] = np.asarray(np.linalg.inv(tangent(statics, row, qpos[i], i)), dtype=float)
        for i in inverses.keys() & set(active[done].tolist()):
            if _unstable(tangent(statics, row, qpos[i], i)):
                lost[i] = f"only an unstable equilibrium after {k} Newton steps, it buckles"
        active = active[going]
        if not active.size:
            break
    lost |= {i: _not_found(MAX_ITERATIONS, size[i]) for i in active.tolist()}
    for i in sorted(lost):
        raise _no_equilibrium(lost[i], poses, i)
    return qpos, size, steps


def _corrected(statics: Statics, inverses: dict[int, Array], step: Array, some: Index) -> Array:
    """Newton's steps from those of the springs alone: by a pose's own tangent, or the first guess of it."""
    corrected = statics.start(step, some)
    for i in inverses.keys() & set(some.tolist()):
        (j,) = np.flatnonzero(some == i)
        corrected[j] = inverses[i] @ step[j]
    return corrected


def tangent(statics: Statics, row: Row, qpos: Array, pose: int) -> Array:
    """I - C dQ/dqpos = C (K_theta - K_w) of Eq. (7) of one pose, by central differences, (nv, nv)."""
    h, unit = 1e-6, np.eye(len(qpos))
    around = np.concatenate([qpos[None], qpos + h * unit, qpos - h * unit])
    Q = statics.force(evaluate(row, around, statics.bodies), np.full(len(around), pose))
    ahead, behind = Q[1 : len(unit) + 1], Q[len(unit) + 1 :]
    (C,) = statics.compliance(Q[:1], np.array([pose]))
    return np.asarray(unit - C @ (ahead - behind).T / (2 * h))


def _unstable(C_K: Array) -> bool:
    """Whether K_theta - K_w has an eigenvalue not above zero: those of C (K_theta - K_w) share the signs.

    Asked only where Newton needed the tangent: theta <- C Q(theta) moves away from an unstable point, unless
    the arm is so symmetric that nothing pushes it.
    """
    return bool(np.linalg.eigvals(C_K).real.min() <= 0)


def _not_found(steps: int, size: float) -> str:
    return f"no static equilibrium in {steps} Newton steps, the last one {size:.3g} m or rad"


def _no_equilibrium(problem: str, poses: Poses, pose: int) -> NoEquilibrium:
    q, wrench = poses.plant.arm.words(poses.held[pose, poses.plant.joints]), poses.wrench[pose]
    return NoEquilibrium(
        f"{problem} at q = {q} under wrench {wrench.round(1).tolist()} N, N m: "
        "too soft for its load, or buckled"
    )
