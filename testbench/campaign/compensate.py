"""A robot's program in, a corrected one out: set-points, process forces and a model become joints."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.correct.arm_model import ArmModel
from testbench.correct.compensated import Compensated, compensate
from testbench.correct.inverse import joints_along
from testbench.correct.newton import Aim
from testbench.correct.process import process_wrench
from testbench.data.program import Program, refuse_joint_jumps
from testbench.errors import Array, BenchError, InputError, NoEquilibrium
from testbench.model.load import Load
from testbench.model.vjm import tool_pose
from testbench.plant import Room

NAMED = 5  #: Points that a message names; more are counted.


@dataclass(frozen=True)
class CorrectedProgram:
    """A program, what acts at its points, and its correction."""

    program: Program
    model: ArmModel
    aim: Aim
    loads: tuple[Load, ...]  #: Each with a row a point.
    found: Compensated

    @property
    def unreached(self) -> tuple[str, ...]:
        """Points that cannot be put right, each with its line and its reason."""
        lines, labels = self.program.line, self.program.labels
        return tuple(
            f"line {lines[k]} (point {labels[k]}): {reason}"
            for k, reason in enumerate(self.found.refused)
            if reason is not None
        )


def correct_program(
    model: ArmModel, program: Program, aim: Aim, room: Room | None = None, *, start: Array | None = None
) -> CorrectedProgram:
    """Correct a program.

    Args:
        model: The arm.
        program: What it is to do.
        aim: Tool point, spindle, what of the tool is put right.
        room: Where the arm stands; None leaves collisions unchecked.
        start: Joints near those of the first point, where the program has poses of the tool, (n,) [rad, m].

    Raises:
        InputError: When a set-point is out of the drawn arm's reach, the feed is nowhere, or the arm cannot
            bear a load.
    """
    q = drawn_joints(model, program, aim, start)
    loads = loads_of(model, program, aim, q)
    try:
        found = compensate(model, q, loads, aim, room)
    except NoEquilibrium as err:
        raise InputError(program.path, "", str(err)) from err
    return CorrectedProgram(program, model, aim, loads, found)


def drawn_joints(model: ArmModel, program: Program, aim: Aim, start: Array | None) -> Array:
    """Joints of the program: its own, or those that bring the drawn arm's tool to its poses."""
    if program.position is None or program.rotation is None:
        assert program.q is not None
        return program.q
    near = start if program.q is None else program.q
    found = joints_along(model.vjm, program.position, program.rotation, start=near, point=np.array(aim.point))
    far = np.flatnonzero(~found.there)
    if len(far):
        missing = 1e3 * np.column_stack([found.distance, found.angle])
        names = [
            "line {} by {:.3g} mm and {:.3g} mrad".format(program.line[k], *missing[k]) for k in far[:NAMED]
        ]
        more = f" and {len(far) - NAMED} more" if len(far) > NAMED else ""
        raise InputError(program.path, "", f"out of the arm's reach: {', '.join(names)}{more}")
    if not program.jumps:
        refuse_joint_jumps(program.path, model.arm, program.line, found.q)
    return found.q


def loads_of(model: ArmModel, program: Program, aim: Aim, q: Array) -> tuple[Load, ...]:
    """What acts at every point: the process at the tool point or where the file says, and what hangs."""
    position, rotation = tool_pose(model.vjm, q)
    tip = np.array(aim.point)
    try:
        names = [f"line {line}" for line in program.line]
        spindle = rotation @ np.array(aim.spindle)
        along = process_wrench(program.along, position + rotation @ tip, spindle, names)
    except BenchError as err:
        raise InputError(program.path, "", str(err)) from err
    at = np.tile(tip, (program.points, 1)) if program.point is None else program.point
    loads = [Load(program.wrench + along, at)]
    if program.mass.any():
        weight = np.zeros((program.points, 6))
        weight[:, 2] = -GRAVITY * program.mass
        loads.append(Load(weight, np.tile(model.vjm.load, (program.points, 1))))
    return tuple(loads)


def more_columns(found: CorrectedProgram) -> dict[str, Array | Sequence[str]]:
    """What a corrected program says beside its joints, by column."""
    own, arm = found.found, found.model.arm
    moved = own.q - own.start
    columns: dict[str, Array | Sequence[str]] = {
        f"correction_{joint.shown_column}": joint.shown * moved[:, k] for k, joint in enumerate(arm.joints)
    }
    columns |= {f"before_{x}_mm": 1e3 * own.before[:, k] for k, x in enumerate("xyz")}
    half = np.where(np.isfinite(own.half), own.half, np.nan)
    columns |= {f"half_95_{x}_mm": 1e3 * half[:, k] for k, x in enumerate("xyz")}
    columns["turn_left_mrad"] = 1e3 * np.linalg.norm(own.turned, axis=1)
    columns["left_out"] = ["" if reason is None else reason for reason in own.refused]
    return columns
