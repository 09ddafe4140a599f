"""A calibration beside the truth behind its readings: its numbers, positions, and the least error."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from testbench.campaign.absolute_model import belief_of
from testbench.campaign.absolute_truth import Truth, true_poses
from testbench.campaign.rows import MM
from testbench.data.dataset import Mask
from testbench.data.series import Series, select_rows
from testbench.data.tracker import Tracker, read_positions
from testbench.errors import Array
from testbench.identify.absolute.choose import GEOMETRY
from testbench.identify.absolute.evidence import Choice, Learnt, choice, solve, squares
from testbench.identify.absolute.fit import Calibration, Gathered
from testbench.identify.absolute.inner import moved
from testbench.identify.absolute.intervals import Part, Z, deviations_root, functionals, own_values, placed
from testbench.identify.absolute.noise import Noise
from testbench.identify.absolute.posterior import inside, predict
from testbench.identify.absolute.reduced import Point, Weighting, reduce
from testbench.identify.absolute.rows import rows_of
from testbench.identify.absolute.unknowns import Unknowns, unknowns_of
from testbench.identify.metric import metric
from testbench.identify.prior import Prior, Strength
from testbench.model.joint_errors import JointErrors
from testbench.model.structure import all153

SHAPE = 0.3  #: How well compliances are known beside a common factor, standard deviation [1].


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


def judged(calibration: Calibration, truth: Truth) -> Mapping[Part, tuple[Mask, Array]]:
    """All numbers of a calibration that have an interval, beside the truth.

    A joint's true compliance has that of the link before it about its axis, of a rigid model's links too.

    Returns:
        Of each part which numbers lie in their 95 % interval, (k,), and found over true, less one, (k,); NaN
        where the truth is zero.
    """
    own, root = calibration.own, deviations_root(calibration)
    found, true, parts = own_values(calibration), true_unknowns(own.unknowns, truth), {}
    for group in functionals(own):
        sought = group.of @ true if group.part != "joint compliances" else true_joints(own.unknowns, truth)
        off = group.of @ found - sought
        deviation = np.linalg.norm(group.of[:, own.columns] @ root, axis=1)
        parts[group.part] = np.abs(off) < Z * deviation, off / np.where(sought == 0, np.nan, sought)
    return parts


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


def check(calibration: Calibration, true: Series, rng: np.random.Generator) -> tuple[Array, Array]:
    """Positions by a calibration beside the true ones of a series that it has, and readings of these.

    Returns:
        Distance of the model's from the true ones, (rows, m) [m], and which readings lie in their 95 %
        ellipsoid, (rows, m).
    """
    read = replace(true, position=read_positions(Tracker(true.sigma, None), true.position, rng))
    found = predict(placed(calibration, read), belief_of(calibration), read)
    turn = calibration.state.frame(true).rotation
    error = np.linalg.norm(found.left - (read.position - true.position) @ turn, axis=2)
    return np.asarray(error), inside(found)


def optimum_mm(found: Gathered, truth: Truth, check: Series) -> float:
    """Expected RMS distance from the true positions of the best linear estimate, at the truth.

    It knows the standard deviations that geometry, joint errors and noise were drawn with, which orders the
    joint errors have, and compliances to SHAPE around the true ones, and has no other errors to look for.
    """
    vjm, asked = found.vjm, truth.arm.disturbances
    assert asked.geometry is not None
    orders = 0 if asked.gear is None else asked.gear.orders
    errors = JointErrors(tuple(range(1, orders + 1)))
    unknowns = unknowns_of(vjm, found.series, errors, all153(vjm.arm))
    kinds = GEOMETRY | ({"harmonics"} if orders else frozenset())
    own = choice(unknowns, kinds, metric(Prior("truth", truth.C_theta), vjm, unknowns.structure))
    x = true_unknowns(unknowns, truth)
    n = np.zeros((vjm.arm.n_joints, errors.size))
    true = moved(replace(found.state, errors=errors, n=n), own, x[own.columns])
    true = replace(true, frames=found.state.frames, mounts=found.state.mounts)
    weighting = [
        Weighting(np.ones((len(s.markers), s.rows)), np.zeros(s.rows, dtype=int)) for s in found.series
    ]
    reduced = reduce(Point(unknowns, true, Noise()), found.series, weighting)
    sizes = {
        "geometry shift": asked.geometry.position,
        "geometry turn": float(np.hypot(asked.geometry.angle, asked.sensor_offset / np.sqrt(3))),
        "harmonics": 0.0 if asked.gear is None else asked.gear.sigma,
    }
    deviation = np.full(unknowns.size, np.inf)
    for kind, columns in unknowns.groups:
        deviation[columns] = sizes[kind]
    known = Learnt(deviation, np.ones(len(reduced.kinds)))
    V = solve(own, squares(own, reduced.gram), known, Strength(SHAPE), covariance=True).covariance
    assert V is not None
    A = _lines(own, rows_of(unknowns, true, check).A)
    return MM * float(np.sqrt(3 * np.einsum("ec,cd,ed->e", A, V, A).mean()))


def _lines(own: Choice, A: Array) -> Array:
    """Equations of all positions, (e, c), compliances in the metric."""
    lines = A[:, :, own.columns].transpose(0, 1, 3, 2).reshape(-1, len(own.columns))
    assert own.elastic is not None
    return np.hstack([lines[:, : own.rigid], lines[:, own.rigid :] @ own.elastic.L])
