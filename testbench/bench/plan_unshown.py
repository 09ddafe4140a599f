"""Joints that the tasks turn and no load of a plan does, and the pull that would."""

import math
from dataclasses import dataclass

import numpy as np

from testbench.data.dataset import Mask
from testbench.design.planning import Plan
from testbench.design.specification import loads_of
from testbench.errors import Array
from testbench.model.load import Load, on_joints
from testbench.model.vjm import Vjm, chain

OPEN = 0.1  #: Share of the expected error that has to stay open for such joints to be told [1].
NONE = 1e-6  #: Share of the largest torque below which a joint is not turned [1].


@dataclass(frozen=True)
class Unshown:
    """Joints that the tasks turn and no load of the plan does, and the pull that would turn some of them.

    None where no force at the load point turns any.
    """

    joints: list[str]
    turned_by_pull: list[str]
    pull_N: list[float] | None


def unshown(plan: Plan, share: float) -> Unshown | None:
    """Which joints' compliances no load of a plan can show though the tasks need them; None where all are.

    The pull is along the world's axis that turns them most in the plan's poses, about as strong as the first
    load.

    Args:
        plan: The plan.
        share: Of the expected error at the tasks what stays open, whatever is measured [1].
    """
    if share <= OPEN:
        return None
    spec, examined = plan.specification, plan.examined
    vjm, tasks = spec.experiment.vjm, spec.tasks
    needed = _turned(_torques(vjm, tasks.q, tasks.load))
    shown = _turned(_torques(vjm, examined.q, loads_of(spec, examined.load)))
    closed = np.flatnonzero(needed & ~shown)
    if not len(closed):
        return None
    size = _first_digit(float(np.linalg.norm(spec.loads[0].wrench[:3])))
    pulls = [Load(np.append(force, np.zeros(3)), vjm.load) for force in size * np.eye(3)]
    torques = np.stack([_torques(vjm, plan.q, pull) for pull in pulls])  # (3, n, poses)
    names = [joint.name for joint in vjm.arm.joints]
    able = closed[_turned(torques.transpose(1, 0, 2).reshape(len(names), -1))[closed]]
    if not len(able):
        return Unshown([names[k] for k in closed], [], None)
    best = pulls[int((torques[:, able] ** 2).mean(axis=2).min(axis=1).argmax())]
    return Unshown([names[k] for k in closed], [names[k] for k in able], best.wrench[:3].tolist())


def _torques(vjm: Vjm, q: Array, load: Load) -> Array:
    """Torques of the joints, forces of slides, under a load, (n, poses) [N m, N]."""
    u = on_joints(chain(vjm, q), [load.over(len(q))])
    return np.asarray(u[-vjm.arm.n_joints :])


def _turned(torques: Array) -> Mask:
    """Which joints are turned in any of the poses, (n,)."""
    most = np.abs(torques).max(axis=1)
    return np.asarray(most > NONE * most.max())


def _first_digit(value: float) -> float:
    """A number above 0, all but its first digit left out."""
    step: float = 10.0 ** math.floor(math.log10(value))
    return step * math.floor(value / step)
