"""A prediction: poses of any table of ours and what acts in them, deflections, stiffness, a map."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.campaign.campaign import Cell, clear_poses, stream
from testbench.campaign.compensate import drawn_joints, loads_of
from testbench.campaign.plan_input import read_payload, read_pulls
from testbench.correct.arm_model import ArmModel
from testbench.correct.beyond import Extent, extent
from testbench.correct.newton import Aim
from testbench.correct.predicted import Prediction, predict
from testbench.correct.stiffness import Stiffness, give_halves, stiffness
from testbench.data.dataset import Ids
from testbench.data.posefile import read_poses
from testbench.data.program import Program, read_program, unread
from testbench.data.table import read_table
from testbench.errors import Array, InputError, NoEquilibrium
from testbench.model.load import Load
from testbench.model.poses import WorkArea
from testbench.model.vjm import tool_pose

T = TypeVar("T")
PLACES = 600  #: Poses of the map.
FORCE = 1000.0  #: Of the map where neither a flag nor the arm's payload says one [N].
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
    notes: tuple[str, ...] = ()  #: How the file was read, sentences without a full stop.

    @property
    def words(self) -> str:
        """What acts, for people."""
        own = self.loads[: -1 if self.hung.any() else None]
        force, moment = (
            np.linalg.norm(sum((load.wrench[:, part] for load in own), np.zeros((1, 3))), axis=1)
            for part in (slice(0, 3), slice(3, 6))
        )
        parts = ((self.hung, "kg"), (force, "N"), (moment, "N m"))
        return " and ".join(f"{_between(size)} {unit}" for size, unit in parts if size.any())


def _between(values: Array) -> str:
    low, high = (f"{x:.4g}" if abs(x) < 1000 else f"{x:,.0f}" for x in (values.min(), values.max()))
    return low if low == high else f"{low} to {high}"


def read_asked(path: Path, model: ArmModel, mapping: Path | None, mass: Callable[[], float]) -> Asked:
    """Poses of a plan or of a program; of a corrected program its joints, which are what is commanded.

    Args:
        path: The file.
        model: The arm.
        mapping: A map of other names, of a program.
        mass: Gives what hangs where the file says of no load [kg].

    Raises:
        InputError: Names the line, and what was expected.
    """
    if PROMISED in read_table(path, lambda name: name == PROMISED).names:
        return _of_plan(path, model, mass)
    program = read_program(path, model.arm, mapping, jumps=True)
    aim, notes = Aim(), unread(program)
    if program.corrected and program.q is not None:
        notes += ("The program was corrected: its joints count as they stand",)
        program = replace(program, position=None, rotation=None)
    program, said = with_payload(model, program, mass)
    q = drawn_joints(model, program, aim, None)
    loads, hung, notes = loads_of(model, program, aim, q), program.mass, (*notes, *said)
    return Asked(path, program.line, program.labels, q, loads, hung, notes)


def with_payload(
    model: ArmModel, program: Program, mass: Callable[[], float]
) -> tuple[Program, tuple[str, ...]]:
    """A program that says of no load with what hangs then [kg], and that in words."""
    if program.mass.any() or program.wrench.any() or program.along.any():
        return program, ()
    hung = mass()
    return replace(program, mass=np.full(program.points, hung)), (no_load(model, hung),)


def _of_plan(path: Path, model: ArmModel, mass: Callable[[], float]) -> Asked:
    """Poses that `testbench plan` wrote, in which a weight hangs or a force pulls."""
    q, found, pulls = read_poses(path, model.arm), read_payload(path), read_pulls(path)
    hung = np.full(len(q), mass()) if found is None else found
    notes = (no_load(model, hung[0]),) if found is None else ()
    labels = tuple(map(str, range(1, len(q) + 1)))
    forces = [] if pulls is None else [Load(np.hstack([pulls, 0 * pulls]), model.vjm.load).over(len(q))]
    return Asked(path, np.arange(len(q)) + 2, labels, q, (*forces, hanging(model, hung)), hung, notes)


def no_load(model: ArmModel, mass: float) -> str:
    """What hangs [kg] where the file says of no load, a sentence."""
    if not mass:
        return "No load in the file: nothing hangs"
    what = f"the payload of {mass:g} kg hangs" if mass == model.arm.payload else f"{mass:g} kg hang"
    return f"No load in the file: {what}"


def hanging(model: ArmModel, mass: Array) -> Load:
    """Weights at the arm's load point, (poses,) [kg]."""
    weight = np.zeros((len(mass), 6))
    weight[:, 2] = -GRAVITY * mass
    return Load(weight, model.vjm.load).over(len(mass))


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


@dataclass(frozen=True)
class StiffnessMap:
    """Poses all over the workspace, the softest first."""

    force: float  #: [N].
    q: Array  #: Joints, (places, n) [rad, m].
    position: Array  #: Tool, (places, 3) [m].
    worst: Array  #: How far the force moves the tool in the worst direction, (places,) [m].
    direction: Array  #: That direction, unit vectors, (places, 3).
    #: Half widths of how far it moves the tool along the principal axes, the softest first, (places, 3) [m].
    half: Array


@dataclass(frozen=True, eq=False)
class Predicted:
    """All that is known of the poses that were asked for."""

    model: ArmModel
    cell: Cell  #: The same arm and its room.
    asked: Asked
    linear: bool  #: Whether by Eq. (6).
    found: Prediction
    stiffness: Stiffness  #: Of the loaded tool.
    #: Half widths of how far the map's force moves the loaded tool along its principal axes, the softest
    #: first, (poses, 3) [m].
    give_half: Array
    extent: Extent  #: How large the loads are.
    map: StiffnessMap

    @property
    def names(self) -> tuple[str, ...]:
        """Of the points: the tool's origin, then the markers."""
        return (self.model.arm.tool, *self.model.arm.markers)

    @property
    def worst_first(self) -> Ids:
        """Poses by the deflection of the tool, the largest first, (poses,)."""
        return np.argsort(-self.found.size[:, 0], kind="stable")


def predicted(
    model: ArmModel, asked: Asked, force: float, area: WorkArea | None = None, *, linear: bool = False
) -> Predicted:
    """Predict all poses of a file.

    Args:
        model: The arm.
        asked: Poses and their loads.
        force: Of the map [N].
        area: Of the map; None for all that the arm reaches.
        linear: By Eq. (6) instead of Eq. (7).

    Raises:
        InputError: When a pose has no equilibrium; names its line.
        PoseError: When too few poses have their tool in the area of the map.
    """
    cell = Cell(model.arm, model.vjm)
    found = carried(asked, lambda q, loads: predict(model, q, loads, linear=linear))
    tool = carried(asked, lambda q, loads: stiffness(model, q, loads))
    return Predicted(
        model=model,
        cell=cell,
        asked=asked,
        linear=linear,
        found=found,
        stiffness=tool,
        give_half=give_halves(model, asked.q, tool, force),
        extent=extent(model, asked.q, asked.loads),
        map=_map(model, cell, force, area),
    )


def _map(model: ArmModel, cell: Cell, force: float, area: WorkArea | None) -> StiffnessMap:
    """The compliance of Eq. (7) under own weight alone, times a force, at clear poses drawn at random."""
    q = clear_poses(cell, area, PLACES, stream(0))
    found = stiffness(model, q)
    position, _ = tool_pose(model.vjm, q)
    half = give_halves(model, q, found, force)
    worst: Array = force * found.give[:, 0]
    order = np.argsort(-worst, kind="stable")
    return StiffnessMap(force, *(x[order] for x in (q, position, worst, found.softest, half)))
