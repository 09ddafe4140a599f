"""Joints that MuJoCo couples: equalities of joints, of fixed tendons, and closed loops."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import mujoco
import numpy as np

LOOPS = {int(mujoco.mjtEq.mjEQ_CONNECT): "connect", int(mujoco.mjtEq.mjEQ_WELD): "weld"}
JOINT, SITE = int(mujoco.mjtWrap.mjWRAP_JOINT), int(mujoco.mjtWrap.mjWRAP_SITE)
ENDS = SITE, int(mujoco.mjtWrap.mjWRAP_SPHERE), int(mujoco.mjtWrap.mjWRAP_CYLINDER)
"""What a tendon leads over: joints of one that is fixed, sites and geoms of one in space."""


@dataclass(frozen=True, eq=False)
class Coupling:
    """Describe an equation of joints, sum of terms times joints = constant, or a closed loop."""

    label: str  #: Name in messages.
    terms: Mapping[str, float] = field(default_factory=dict)  #: Coefficients by the joints' names [1].
    constant: float = 0.0  #: Right-hand side [rad, m].
    follower: str = ""  #: The dependent joint that the file names; "" for none.
    bent: bool = False  #: Whether it is nonlinear.
    #: The two bodies that a loop ties together, -1 for the world; None for an equation.
    bodies: tuple[int, int] | None = None


def couplings_of(model: mujoco.MjModel, names: Mapping[int, str], index: Mapping[int, int]) -> list[Coupling]:
    """Read the couplings that MuJoCo's equalities and tendons state.

    Args:
        model: The robot, as MuJoCo compiles it.
        names: Our names of its joints, by MuJoCo's id.
        index: Our places of its bodies, by MuJoCo's id.

    Returns:
        The couplings.
    """
    couplings: list[Coupling] = []
    for e in np.flatnonzero(model.eq_active0).tolist():
        kind, label = int(model.eq_type[e]), model.equality(e).name or f"{e + 1}"
        ends = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
        if kind in LOOPS:
            if int(model.eq_objtype[e]) == int(mujoco.mjtObj.mjOBJ_SITE):
                ends = int(model.site_bodyid[ends[0]]), int(model.site_bodyid[ends[1]])
            led = [b for b in ends if model.body_mocapid[b] >= 0]  # a hand that leads the arm, no rod
            bodies = index[ends[0]], index[ends[1]]
            couplings += [Coupling(f"{LOOPS[kind]} {label!r}", bodies=bodies)] if not led else []
        elif kind == int(mujoco.mjtEq.mjEQ_JOINT):
            both = [{end: 1.0} if end >= 0 else {} for end in ends]
            coupling = _equation(model, names, e, both)
            couplings.append(replace(coupling, label=f"joint equality {label!r}", follower=names[ends[0]]))
        elif kind == int(mujoco.mjtEq.mjEQ_TENDON):
            tendons = [end for end in ends if end >= 0]
            coupling = _equation(model, names, e, [_tendon(model, end) if end >= 0 else {} for end in ends])
            bent = coupling.bent or not all(map(partial(_is_fixed, model), tendons))
            couplings.append(replace(coupling, label=f"tendon equality {label!r}", bent=bent))
    return couplings


def _wraps(model: mujoco.MjModel, tendon: int) -> range:
    first = int(model.tendon_adr[tendon])
    return range(first, first + int(model.tendon_num[tendon]))


def _is_fixed(model: mujoco.MjModel, tendon: int) -> bool:
    """Tell whether a tendon's length is a sum of joints; that of a spatial tendon is nonlinear."""
    return all(int(model.wrap_type[k]) == JOINT for k in _wraps(model, tendon))


def _tendon(model: mujoco.MjModel, tendon: int) -> dict[int, float]:
    """Return coefficients of a tendon's joints; for a spatial one 1 for all joints that move its ends."""
    own = [(int(model.wrap_type[k]), int(model.wrap_objid[k]), k) for k in _wraps(model, tendon)]
    if _is_fixed(model, tendon):
        return {j: sum(float(model.wrap_prm[k]) for _, i, k in own if i == j) for _, j, _ in own}
    bodies = [
        model.site_bodyid[i] if kind == SITE else model.geom_bodyid[i] for kind, i, _ in own if kind in ENDS
    ]
    joints = [_joints_above(model, int(b)) for b in bodies]
    shared = joints[0].intersection(*joints) if joints else set[int]()
    return dict.fromkeys(sorted(set[int]().union(*joints) - shared), 1.0)


def _joints_above(model: mujoco.MjModel, body: int) -> set[int]:
    """List joints between the world and a body of MuJoCo."""
    found = set[int]()
    while body:
        first = int(model.body_jntadr[body])
        found |= set(range(first, first + int(model.body_jntnum[body])))
        body = int(model.body_parentid[body])
    return found


def _equation(
    model: mujoco.MjModel, names: Mapping[int, str], e: int, both: Sequence[dict[int, float]]
) -> Coupling:
    """Convert X - x_0 = a_0 + a_1 (y - y_0) + ..., x and y sums of joints, to an equation of the joints."""
    a = model.eq_data[e, :5].tolist()
    terms: dict[str, float] = {}
    constant = a[0]
    for part, factor in zip(both, (1.0, -a[1]), strict=True):
        for j, c in part.items():
            terms[names[j]] = terms.get(names[j], 0.0) + factor * c
            constant += factor * c * float(model.qpos0[model.jnt_qposadr[j]])
    return Coupling("", terms, constant, bent=bool(both[1]) and any(a[2:]))
