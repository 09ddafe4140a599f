"""Programs whose path jumps: between two points the arm would go a way that nobody wrote down."""

import math
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm
from testbench.data.dataset import Ids
from testbench.errors import Array, InputError

FARTHEST_TURN = math.radians(45)
"""Largest turn of a hinge, or of the tool, from one point to the next [rad]."""
FARTHEST_STEP = 1.0  #: Largest way of a slide, or of the tool [m].
ALLOW = "--jumps allows it"


def refuse_joint_jumps(path: Path, arm: Arm, line: Ids, q: Array) -> None:
    """Refuse joints of which one goes too far from one point to the next.

    Args:
        path: The program's file.
        arm: The arm.
        line: Line of every point, (points,).
        q: Joints, (points, n) [rad, m].

    Raises:
        InputError: Names the first two lines and the joint.
    """
    most = np.array([FARTHEST_STEP if joint.prismatic else FARTHEST_TURN for joint in arm.joints])
    far = np.argwhere(np.abs(np.diff(q, axis=0)) > most * (1 + 1e-9))
    if not len(far):
        return
    i, k = far[0]
    joint = arm.joints[k]
    here, there = (joint.shown * q[[i, i + 1], k]).tolist()
    got = f"{joint.name} from {here:g} to {there:g} {joint.shown_unit}"
    _refuse(path, line[i : i + 2], got, f"{joint.shown * most[k]:g} {joint.shown_unit}")


def refuse_tool_jumps(path: Path, line: Ids, position: Array, rotation: Array) -> None:
    """InputError at the first two poses, (points, 3) [m] and (points, 3, 3), that lie too far apart."""
    step = np.linalg.norm(np.diff(position, axis=0), axis=1)
    far = np.flatnonzero(step > FARTHEST_STEP)
    if len(far):
        _refuse(path, line[far[0] : far[0] + 2], f"the tool by {step[far[0]]:g} m", f"{FARTHEST_STEP:g} m")
    cosine = (np.einsum("pxy,pxy->p", rotation[1:], rotation[:-1]) - 1) / 2
    turn = np.arccos(np.clip(cosine, -1, 1))
    far = np.flatnonzero(turn > FARTHEST_TURN * (1 + 1e-9))
    if len(far):
        got = f"the tool by {math.degrees(turn[far[0]]):g} deg"
        _refuse(path, line[far[0] : far[0] + 2], got, f"{math.degrees(FARTHEST_TURN):g} deg")


def _refuse(path: Path, lines: Ids, got: str, most: str) -> None:
    problem = f"the path jumps, {got}: expected at most {most} from point to point; {ALLOW}"
    raise InputError(path, f"lines {lines[0]} and {lines[1]}", problem)
