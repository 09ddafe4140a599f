"""Programs whose path jumps: between two points the arm would go a way that nobody wrote down."""

import math

import numpy as np

from testbench.arm.folder import Arm
from testbench.data.columns import Columns
from testbench.errors import Array, InputError

FARTHEST_TURN = math.radians(45)
"""Largest turn of a hinge, or of the tool, from one point to the next [rad]."""
FARTHEST_STEP = 1.0  #: Largest way of a slide, or of the tool [m].
ALLOW = "--jumps allows it"


def refuse_joint_jumps(columns: Columns, arm: Arm, q: Array | None) -> None:
    """InputError at the first two points, (points, n) [rad, m], of which a joint lies too far apart."""
    if q is None:
        return
    most = np.array([FARTHEST_STEP if joint.prismatic else FARTHEST_TURN for joint in arm.joints])
    far = np.argwhere(np.abs(np.diff(q, axis=0)) > most * (1 + 1e-9))
    if not len(far):
        return
    i, k = far[0]
    joint = arm.joints[k]
    here, there = (joint.shown * q[[i, i + 1], k]).tolist()
    got = f"{joint.name} from {here:g} to {there:g} {joint.shown_unit}"
    _refuse(columns, i, got, f"{joint.shown * most[k]:g} {joint.shown_unit}")


def refuse_tool_jumps(columns: Columns, position: Array | None, rotation: Array | None) -> None:
    """InputError at the first two poses, (points, 3) [m] and (points, 3, 3), that lie too far apart."""
    if position is None or rotation is None:
        return
    step = np.linalg.norm(np.diff(position, axis=0), axis=1)
    far = np.flatnonzero(step > FARTHEST_STEP)
    if len(far):
        _refuse(columns, far[0], f"the tool by {step[far[0]]:g} m", f"{FARTHEST_STEP:g} m")
    cosine = (np.einsum("pxy,pxy->p", rotation[1:], rotation[:-1]) - 1) / 2
    turn = np.arccos(np.clip(cosine, -1, 1))
    far = np.flatnonzero(turn > FARTHEST_TURN * (1 + 1e-9))
    if len(far):
        got = f"the tool by {math.degrees(turn[far[0]]):g} deg"
        _refuse(columns, far[0], got, f"{math.degrees(FARTHEST_TURN):g} deg")


def _refuse(columns: Columns, i: int, got: str, most: str) -> None:
    lines = columns.table.lines[[i, i + 1]].tolist()
    problem = f"the path jumps, {got}: expected at most {most} from point to point; {ALLOW}"
    raise InputError(columns.table.path, f"lines {lines[0]} and {lines[1]}", problem)
