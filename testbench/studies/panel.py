"""Two jobs on a curved panel, the robot's program for them, and the forces of the process."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.correct.compensated import joints_along_path
from testbench.correct.predicted import process_wrench
from testbench.design.rows import Tasks
from testbench.errors import Array, BenchError
from testbench.model.load import Load
from testbench.workflows.cell import Cell

START = (0.3, -1.2, 1.6, 0.1, -0.4, 0.0)  #: Joints near the panel [rad].
DRILLING, MILLING = "drilling", "milling"
FORCE_RANGE = (1000.0, 3000.0)  #: Least and largest force of the process [N].
TIP = (0.5, 0.0, 0.0)  #: Where the tool cuts, in the tool's frame [m].
RADIUS, NEAREST, HEIGHT = 2.0, 2.4, 1.6
"""Of the panel, a cylinder about a level axis along y: how far its nearest line is from the robot [m]."""
HOLES, PATTERN = (6, 5), (0.6, 0.4)  #: Along y and up the panel, and half of the pattern's size [m].
WINDOW, CORNER, STEPS = (0.5, 0.3), 0.1, 64
"""Half of the milled window's size, the radius of its corners [m], and points of the path around it."""
MIN_FORCE_COMPONENT = 0.3  #: Of a component of the milling force before scaling, over the largest.


@dataclass(frozen=True)
class Job:
    """Hold points on the panel, in order, world axes, both (points, 3)."""

    name: str
    position: Array  #: [m].
    axis: Array  #: Of the spindle, into the panel.
    typical: Array  #: Direction of the force that a plan is made for: along the feed, across, axial, (3,).

    @property
    def rotation(self) -> Array:
        """Compute the orientation, world from tool: x is the spindle, y level, (points, 3, 3)."""
        y = np.cross([0.0, 0.0, 1.0], self.axis)
        y /= np.linalg.norm(y, axis=1, keepdims=True)
        return np.asarray(np.stack([self.axis, y, np.cross(self.axis, y)], axis=-1))


def jobs() -> tuple[Job, Job]:
    """Make both jobs; a drill is pushed back along its spindle alone."""
    milled = np.array([-1.0, 1.0, -1.0]) / np.sqrt(3)
    return _on_panel(DRILLING, _pattern(), np.array([0.0, 0.0, -1.0])), _on_panel(MILLING, _window(), milled)


def _on_panel(name: str, at: Array, typical: Array) -> Job:
    """A job at places of the panel, (points, 2) along y and up it [m]."""
    angle = at[:, 1] / RADIUS
    cosine = np.cos(angle)
    sine = np.sin(angle)
    level = np.zeros(len(at))
    position = np.column_stack([NEAREST + RADIUS * (1 - cosine), at[:, 0], HEIGHT + RADIUS * sine])
    return Job(name, position, np.column_stack([cosine, level, -sine]), typical)


def _pattern() -> Array:
    """Holes, row by row, there and back."""
    y, s = (np.linspace(-half, half, n) for half, n in zip(PATTERN, HOLES, strict=True))
    return np.array([(one, up) for k, up in enumerate(s) for one in (y if k % 2 == 0 else y[::-1])])


def _window() -> Array:
    """Points around a window with rounded corners, evenly spaced: straight and round parts in turn."""
    a, b = (half - CORNER for half in WINDOW)
    quarter = np.pi / 2 * CORNER
    lengths = np.tile([2 * b, quarter, 2 * a, quarter], 2)
    starts = np.cumsum(np.r_[0.0, lengths])
    way = (np.arange(STEPS) + 0.5) * starts[-1] / STEPS
    part = np.searchsorted(starts, way, side="right") - 1
    gone, round_it = way - starts[part], part % 2 == 1
    turn = np.pi / 2 * (part // 2) + np.where(round_it, gone / CORNER, 0.0)
    straight = np.where(round_it, 0.0, gone - lengths[part])
    cosine, sine = np.cos(turn), np.sin(turn)
    centres = np.array([(a, b), (-a, b), (-a, -b), (a, -b)])[part // 2]
    return np.asarray(
        centres + np.column_stack([CORNER * cosine - straight * sine, CORNER * sine + straight * cosine])
    )


def drawn(job: Job, rng: np.random.Generator) -> Array:
    """Draw forces of a trial along the feed, across it and along the spindle.

    A mill is held back, pushed aside to either side and out of the panel.

    Args:
        job: The job.
        rng: Source of randomness.

    Returns:
        Forces, (3,) [N].
    """
    size = rng.uniform(*FORCE_RANGE)
    parts = rng.uniform(MIN_FORCE_COMPONENT, 1, 3)
    side = rng.choice([-1.0, 1.0])
    milled = parts / np.linalg.norm(parts) * [-1.0, side, -1.0]
    return np.asarray(size * (job.typical if job.name == DRILLING else milled))


def tasks(q: Array, forces: Sequence[Array]) -> Tasks:
    """Collect the points of all jobs, one job after the other, each job under forces of its own.

    Args:
        q: Programmed joints, (points, n) [rad].
        forces: Along the feed, across it and along the spindle, a job each.

    Returns:
        The tasks.
    """
    wrench = np.concatenate(
        [
            process_wrench(np.tile(own, (len(job.position), 1)), job.position, job.axis)
            for job, own in zip(jobs(), forces, strict=True)
        ]
    )
    return Tasks(q, Load(wrench, np.array(TIP)).for_poses(len(wrench)))


def program(cell: Cell, job: Job) -> Array:
    """Compute the joints that a controller takes which knows the drawing alone.

    Args:
        cell: The arm with its model and its truth.
        job: The job.

    Returns:
        Joints, (points, n) [rad].

    Raises:
        BenchError: When a point is out of reach.
    """
    start, tip = np.array(START), np.array(TIP)
    reached = joints_along_path(cell.vjm, job.position, job.rotation, start=start, point=tip)
    if not reached.converged.all():
        raise BenchError(
            f"{job.name}: {cell.arm.name} does not reach point {np.argmin(reached.converged) + 1}"
        )
    return reached.q
