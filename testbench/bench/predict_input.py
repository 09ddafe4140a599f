"""What a prediction is asked for: poses of any table of ours, and what acts in them."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.bench.plan_input import read_payload
from testbench.correct.arm_model import ArmModel
from testbench.data.dataset import Ids
from testbench.data.posefile import read_poses
from testbench.data.program import Program, read_program
from testbench.data.table import read_table
from testbench.errors import Array, InputError, NoEquilibrium
from testbench.model.load import Load

T = TypeVar("T")
PROMISED = "expected_error_mm"  #: Column that only plans have.


@dataclass(frozen=True, eq=False)
class Asked:
    """Poses and their loads."""

    path: Path  #: The file.
    line: Ids  #: Line of every pose in it, (poses,).
    labels: tuple[str, ...]  #: What every pose is called.
    q: Array  #: Joints, (poses, n) [rad, m].
    loads: tuple[Load, ...]  #: With a row a pose.
    hung: Array  #: Mass that hangs, part of the loads, (poses,) [kg].

    @property
    def words(self) -> str:
        """What acts, for people."""
        process = sum((np.linalg.norm(load.wrench[:, :3], axis=1) for load in self.loads[:-1]), np.zeros(1))
        parts = [f"{_between(self.hung)} kg"] if self.hung.any() else []
        return " and ".join([*parts, *([f"{_between(process)} N"] if process.any() else [])]) or "moments"


def _between(values: Array) -> str:
    low, high = (f"{x:.4g}" if abs(x) < 1000 else f"{x:,.0f}" for x in (values.min(), values.max()))
    return low if low == high else f"{low} to {high}"


def read_asked(path: Path, model: ArmModel, mapping: Path | None, mass: Callable[[], float]) -> Asked:
    """Poses of a plan or of a program.

    Args:
        path: The file.
        model: The arm.
        mapping: A map of other names, of a program.
        mass: Gives what hangs where the file says of no load [kg].

    Raises:
        InputError: Names the line, and what was expected.
    """
    if PROMISED in read_table(path, lambda name: name == PROMISED).names:
        q, found = read_poses(path, model.arm), read_payload(path)
        hung = np.full(len(q), mass()) if found is None else found
        line, labels, process = np.arange(len(q)) + 2, tuple(map(str, range(1, len(q) + 1))), None
    else:
        program = read_program(path, model.arm, mapping, jumps=True)
        q, line, labels = joints_of(program), program.line, program.labels
        process = Load(program.wrench, program.point)
        idle = not (program.mass.any() or program.wrench.any())
        hung = np.full(len(q), mass()) if idle else program.mass
    weight = np.zeros((len(q), 6))
    weight[:, 2] = -GRAVITY * hung
    hanging = Load(weight, model.vjm.load).over(len(q))
    return Asked(path, line, labels, q, (*([process] if process else []), hanging), hung)


def joints_of(program: Program) -> Array:
    """The joints of a program, (points, n) [rad, m]."""
    if program.q is None:
        raise InputError(program.path, "", "expected joints of every point")
    turning = np.flatnonzero(program.along.any(axis=1))
    if len(turning):
        problem = "expected forces along world axes, got one along the feed"
        raise InputError(program.path, f"line {program.line[turning[0]]}", problem)
    return program.q


def carried(asked: Asked, compute: Callable[[Array, list[Load]], T]) -> T:
    """What follows from all poses and loads; a pose that bears its load not is named by its line.

    Raises:
        InputError: When a pose has no equilibrium.
    """
    try:
        return compute(asked.q, list(asked.loads))
    except NoEquilibrium:
        low, high = 0, len(asked.q)
        while high - low > 1:  # the first half that has none, until one pose is left
            middle = (low + high) // 2
            if _bears(asked, slice(low, middle), compute):
                low = middle
            else:
                high = middle
        try:
            return compute(asked.q[low:high], [load.of(slice(low, high)) for load in asked.loads])
        except NoEquilibrium as err:
            raise InputError(asked.path, f"line {asked.line[low]}", str(err)) from err


def _bears(asked: Asked, some: slice, compute: Callable[[Array, list[Load]], T]) -> bool:
    try:
        compute(asked.q[some], [load.of(some) for load in asked.loads])
    except NoEquilibrium:
        return False
    return True
