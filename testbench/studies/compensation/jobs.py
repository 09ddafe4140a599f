"""What the robot does: a drilling pattern and a milling path on a curved panel, and the forces of both."""

from dataclasses import dataclass

import numpy as np

from testbench.correct.process import process_wrench
from testbench.errors import Array
from testbench.studies.compensation.settings import DRILLING, FORCE, JOBS, MILLING

TIP = (0.5, 0.0, 0.0)  #: Where the tool cuts, in the tool's frame [m].
RADIUS, NEAREST, HEIGHT = 2.0, 2.4, 1.6
"""Of the panel, a cylinder about a level axis along y: how far its nearest line is from the robot [m]."""
HOLES, PATTERN = (6, 5), (0.6, 0.4)  #: Along y and up the panel, and half of the pattern's size [m].
WINDOW, CORNER, STEPS = (0.5, 0.3), 0.1, 64
"""Half of the milled window's size, the radius of its corners [m], and points of the path around it."""
LEAST = 0.3  #: Of a component of the milling force before scaling, over the largest.


@dataclass(frozen=True)
class Job:
    """Points on the panel, in order, world axes, all (points, 3)."""

    name: str
    position: Array  #: [m].
    axis: Array  #: Of the spindle, into the panel.

    @property
    def rotation(self) -> Array:
        """World from tool: x is the spindle, y level, (points, 3, 3)."""
        y = np.cross([0.0, 0.0, 1.0], self.axis)
        y /= np.linalg.norm(y, axis=1, keepdims=True)
        return np.asarray(np.stack([self.axis, y, np.cross(self.axis, y)], axis=-1))


def job(name: str) -> Job:
    """One of JOBS."""
    at = window() if name == MILLING else pattern()
    angle = at[:, 1] / RADIUS
    return Job(name, on_panel(at), np.column_stack([np.cos(angle), np.zeros(len(at)), -np.sin(angle)]))


def on_panel(at: Array) -> Array:
    """Places of the panel, (n, 2) along y and up it, in the world, (n, 3) [m]."""
    angle = at[:, 1] / RADIUS
    return np.column_stack(
        [NEAREST + RADIUS * (1 - np.cos(angle)), at[:, 0], HEIGHT + RADIUS * np.sin(angle)]
    )


def pattern() -> Array:
    """Holes, row by row, there and back, (holes, 2): along y and up the panel [m]."""
    y, s = (np.linspace(-half, half, n) for half, n in zip(PATTERN, HOLES, strict=True))
    return np.array([(one, up) for k, up in enumerate(s) for one in (y if k % 2 == 0 else y[::-1])])


def window() -> Array:
    """Points around a window with rounded corners, evenly spaced, (STEPS, 2): along y and up it [m]."""
    a, b = (half - CORNER for half in WINDOW)
    quarter = np.pi / 2 * CORNER
    lengths = np.tile([2 * b, quarter, 2 * a, quarter], 2)
    starts = np.cumsum(np.r_[0.0, lengths])
    centres = np.array([(a, b), (-a, b), (-a, -b), (a, -b)])
    at = []
    for way in (np.arange(STEPS) + 0.5) * starts[-1] / STEPS:
        part = int(np.searchsorted(starts, way, side="right")) - 1
        side, gone, round_it = part // 2, way - starts[part], part % 2
        turn = np.pi / 2 * side + (gone / CORNER if round_it else 0.0)
        out = np.array([np.cos(turn), np.sin(turn)])
        straight = 0.0 if round_it else gone - lengths[part]
        at.append(centres[side] + CORNER * out + straight * np.array([-out[1], out[0]]))
    return np.array(at)


def drawn(job: Job, rng: np.random.Generator) -> Array:
    """Forces of a trial along the feed, across it and along the spindle, (3,) [N].

    A drill is pushed back along its spindle alone; a mill is held back, pushed aside and out of the panel.
    """
    size, parts, side = rng.uniform(*FORCE), rng.uniform(LEAST, 1, 3), rng.choice([-1.0, 1.0])
    if job.name == DRILLING:
        return np.asarray(size * typical(job))
    return np.asarray(size * parts / np.linalg.norm(parts) * [-1.0, side, -1.0])


def typical(job: Job) -> Array:
    """Direction of the force that a plan is made for, the same three, (3,) [1]."""
    return np.array([0.0, 0.0, -1.0]) if job.name == DRILLING else np.array([-1.0, 1.0, -1.0]) / np.sqrt(3)


def wrenches(job: Job, along: Array) -> Array:
    """What the same forces, (3,) [N], are at every point, world, (points, 6) [N, N m]."""
    return process_wrench(np.tile(along, (len(job.position), 1)), job.position, job.axis)


def jobs() -> tuple[Job, ...]:
    """All of them."""
    return tuple(map(job, JOBS))
