"""A calibration beside the truth behind its readings: its numbers, and positions that it never saw."""

from dataclasses import dataclass, replace

import numpy as np

from testbench.bench.absolute_model import belief_of
from testbench.bench.absolute_truth import Truth, true_poses
from testbench.data.series import Series, select_rows
from testbench.data.tracker import Tracker, read_positions
from testbench.errors import Array
from testbench.identify.absolute.fit import Calibration
from testbench.identify.absolute.intervals import (
    Z,
    deviations_root,
    functionals,
    own_values,
    placed,
)
from testbench.identify.absolute.posterior import inside, predict
from testbench.identify.absolute.unknowns import Unknowns


def true_unknowns(unknowns: Unknowns, truth: Truth) -> Array:
    """What the truth has for every unknown of the arm, (size,) SI; zero for frames and mounts.

    A joint's offset is a turn of the link before it about its axis, as in the model.
    """
    arm, theta = unknowns.vjm.arm, truth.theta_0.copy()
    links = 6 * len(arm.links)
    for j in range(1, arm.n_joints):
        about = 6 * j + (0 if arm.joints[j].prismatic else 3) + np.arange(3)
        theta[about] += unknowns.vjm.beam_axes[j] * theta[links + j]
    orders, gears = unknowns.errors.orders, truth.gears
    n = np.zeros((arm.n_joints, unknowns.errors.size))
    if gears is not None:
        for k, order in enumerate(orders):
            if order <= len(gears.sine):
                n[:, k], n[:, len(orders) + k] = gears.sine[order - 1], gears.cosine[order - 1]
        if unknowns.errors.ratio:
            n[:, 2 * len(orders)] = gears.ratio
    x = np.zeros(unknowns.size)
    x[unknowns.columns("geometry")] = theta[unknowns.inner]
    x[unknowns.columns("errors")] = n.ravel()
    x[unknowns.columns("elastic")] = unknowns.structure.entries(truth.C_theta)
    return x


@dataclass(frozen=True)
class Judged:
    """Numbers of one part, such as geometry, beside the truth."""

    part: str
    off: Array  #: Found minus true, over the standard deviation that the calibration gives it, (k,) [1].
    relative: Array  #: Found over true, less one, (k,) [1]; NaN where the truth is zero.

    @property
    def inside(self) -> Array:
        """Which lie in their 95 % interval, (k,)."""
        return np.asarray(np.abs(self.off) < Z)


def judged(calibration: Calibration, truth: Truth) -> tuple[Judged, ...]:
    """All numbers of a calibration that have an interval, beside the truth.

    A joint's true compliance has that of the link before it about its axis, of a rigid model's links too.
    """
    own, root = calibration.own, deviations_root(calibration)
    found, true = own_values(calibration), true_unknowns(own.unknowns, truth)
    parts = []
    for group in functionals(own):
        sought = group.of @ true if group.part != "joint compliances" else true_joints(own.unknowns, truth)
        off = group.of @ found - sought
        deviation = np.linalg.norm(group.of[:, own.columns] @ root, axis=1)
        relative = off / np.where(sought == 0, np.nan, sought)
        parts.append(Judged(group.part, off / deviation, relative))
    return tuple(parts)


def true_joints(unknowns: Unknowns, truth: Truth) -> Array:
    """True compliance of every joint with that of the link before about its axis, (n,) [rad/(N m), m/N]."""
    vjm, C = unknowns.vjm, truth.C_theta
    links = 6 * len(vjm.arm.links)
    found = np.diag(C)[links:].copy()
    for k, joint in enumerate(vjm.arm.joints):
        own = 6 * k + (0 if joint.prismatic else 3) + np.arange(3)
        found[k] += vjm.beam_axes[k] @ C[np.ix_(own, own)] @ vjm.beam_axes[k]
    return np.asarray(found)


def checking(
    series: Series, truth: Truth, place: int, q: Array, load: tuple[Array, Array] | None = None
) -> Series:
    """Where the targets of a series truly are in other poses, as its tracker sees them.

    Args:
        series: A series of the truth; gives names and sigma.
        truth: The arm.
        place: Which of its series that is, from 0.
        q: Poses, (rows, n) [rad, m].
        load: Wrench, (rows, 6) [N, N m], and where it acts, (rows, 3) [m]; None for own weight alone.
    """
    rows, ids = len(q), np.arange(len(q)) + 1
    wrench, point = load or (np.zeros((rows, 6)), np.zeros((rows, 3)))
    position, _ = true_poses(truth, place, q, wrench, point)
    return replace(
        select_rows(series, np.zeros(rows, dtype=int)),
        row=ids,
        pose=ids,
        q=q,
        wrench=wrench,
        point=point,
        position=position,
        precision=None,
        rotation=None,
        sigma_rotation=None,
        torque=None,
        temperature=None,
        time=None,
    )


@dataclass(frozen=True)
class Checked:
    """Positions in checking poses."""

    error: Array  #: Distance of the model's from the true ones, (rows, m) [m].
    inside: Array  #: Which readings lie in their 95 % ellipsoid, (rows, m).


def check(calibration: Calibration, true: Series, rng: np.random.Generator) -> Checked:
    """Positions by a calibration beside the true ones of a series that it has, and readings of these."""
    read = replace(true, position=read_positions(Tracker(true.sigma, None), true.position, rng))
    found = predict(placed(calibration, read), belief_of(calibration), read)
    turn = calibration.state.frame(true).rotation
    error = np.linalg.norm(found.left - (read.position - true.position) @ turn, axis=2)
    return Checked(error, inside(found))
