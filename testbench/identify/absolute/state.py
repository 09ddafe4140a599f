"""Model of a calibrated arm, its static equilibrium, and the unknowns of a calibration.

The model holds geometry, springs, joint errors, frames and mounts. The arm is at rest where

    theta = theta_0 + C_theta u(q, theta, loads) + Phi(q) n.

All errors are motions of virtual joints. Constants theta_0 of the inner links are errors of geometry. In
place of the first and the last link, each series has a frame (base in the tracker's frame) and a mount
(targets in the tool's frame).

Gears or encoders of one make share an error pattern, shifted or mirrored:

    error_j(q) = s_j f(s_j q + phi_j) + individual error of joint j,    s_j = 1 or -1

f is periodic. If the waves of each joint are shifted back by phi_j, their mean is the pattern, and their
differences (Helmert) are individual errors; both have a Gaussian prior. Joints that were read at an angle
determine the pattern there for the others.

`Unknowns` orders the columns of the linear equations: frames, mounts, errors of geometry, joint errors,
compliances. Frames and mounts are steps from their current values; all others are absolute, so that a
Gramian remains one in every step.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from testbench.data.dataset import Series
from testbench.display import Displayed
from testbench.errors import Array, BenchError, Ids, NoEquilibrium
from testbench.identify.registration import (
    Frame,
)
from testbench.model.kinematics import ORDER_BANDS, JointErrorTerms, joint_error_basis
from testbench.model.load import BodyMasses, Load, own_weight_load, sum_generalised_loads
from testbench.model.structure import Structure
from testbench.model.vjm import ChainState, Vjm, evaluate_chain, rotation_matrices

if TYPE_CHECKING:  # scipy takes long to import, and few arms have a pattern
    from scipy.sparse import csr_array

# --- State of a calibrated arm, and its static equilibrium --------------------------------------------------

MAX_ROWS_IN_MEMORY = 500
"""Most rows whose Jacobians are in memory together."""
EQUILIBRIUM_TOLERANCE = 1e-11
"""Largest step of a virtual joint at which the equilibrium has converged [m, rad]."""
MAX_EQUILIBRIUM_STEPS = 100
"""Most fixed-point steps to the equilibrium."""
CALIBRATION_EQUILIBRIUM_STEPS = 2
"""Fixed-point steps to the equilibrium in a calibration; each reduces the error at least a hundredfold."""


@dataclass(frozen=True)
class Mount:
    """Hold the targets on the tool: their positions, and the orientation of one of them."""

    points: Array  #: Positions of the targets in the tool's frame, (m, 3) [m].
    rotation: Array  #: Tool from the target that has an orientation, (3, 3); identity without one.
    markers: tuple[str, ...]  #: Names of the targets, in the order of the points.


@dataclass(frozen=True, repr=False)
class ArmState(Displayed):
    """Hold a model of an arm with values of all its errors, such as a calibrated arm.

    Its virtual joints are theta = theta_0 + C_theta u + Phi(q) n, with the loads u and the coefficients n of
    the joint errors.
    """

    vjm: Vjm  #: Nominal virtual joint model.
    body_masses: BodyMasses  #: Masses of the links.
    theta_0: Array  #: Constants of the virtual joints, the errors of geometry, (n_theta,) [m, rad].
    C_theta: Array  #: Compliances of the virtual joints, (n_theta, n_theta) [m/N, rad/(N m)].
    error_terms: JointErrorTerms  #: Kinds of joint errors: the functions Phi(q).
    error_coefficients: Array  #: Coefficients n of the joint errors, k per joint, (joints, k) [rad, m].
    torque_scale: Array  #: RMS torque of every joint, (joints,) [N m, N].
    frames: Mapping[str, Frame] = field(default_factory=dict)  #: Frames (tracker from base) by name.
    mounts: Mapping[str, Mount] = field(default_factory=dict)  #: Mounts (targets on the tool) by name.

    def frame(self, series: Series) -> Frame:
        """Return the frame of a series: tracker from base.

        Args:
            series: The series, which names its frame.

        Raises:
            BenchError: If the frame is not known.
        """
        if series.frame not in self.frames:
            raise BenchError(f"{series.name}: its frame {series.frame!r} is not known")
        return self.frames[series.frame]

    def mount(self, series: Series) -> Mount:
        """Return the mount of a series: its targets on the tool, in the order of the series.

        Args:
            series: The series, which names its mount and its targets.

        Raises:
            BenchError: If the mount or one of its targets is not known.
        """
        if series.mount not in self.mounts:
            raise BenchError(f"{series.name}: its target {series.mount!r} is not known")
        mount = self.mounts[series.mount]
        unknown = [name for name in series.markers if name not in mount.markers]
        if unknown:
            have = ", ".join(mount.markers)
            raise BenchError(f"{series.name}: no target {', '.join(unknown)} is known; there are {have}")
        at = [mount.markers.index(name) for name in series.markers]
        return replace(mount, points=mount.points[at], markers=series.markers)


def nominal_state(vjm: Vjm, body_masses: BodyMasses, torque_scale: Array) -> ArmState:
    """Make the model of the nominal arm: rigid, without errors, frames and mounts.

    Args:
        vjm: The arm's virtual joint model.
        body_masses: Masses of the links.
        torque_scale: RMS torque of every joint, (n,) [N m, N].
    """
    n = vjm.n_theta
    empty = np.zeros((vjm.arm.n_joints, 0))
    return ArmState(vjm, body_masses, np.zeros(n), np.zeros((n, n)), JointErrorTerms(), empty, torque_scale)


def with_error_terms(state: ArmState, error_terms: JointErrorTerms) -> ArmState:
    """Give the model of an arm other kinds of joint errors, with coefficients of zero.

    Args:
        state: The model of the arm.
        error_terms: Kinds of joint errors.

    Returns:
        The model without joint errors.
    """
    coefficients = np.zeros((state.vjm.arm.n_joints, error_terms.n_coefficients))
    return replace(state, error_terms=error_terms, error_coefficients=coefficients)


def moved_frame(frame: Frame, step: Array) -> Frame:
    """Apply a small motion of the base to a frame: shift p and rotation vector r, in base axes.

    Args:
        frame: The frame, tracker from base.
        step: p [m], then r [rad], (6,); then the change of the constant of a draw-wire [m] if the frame has
            one, (7,).

    Returns:
        The moved frame.
    """
    [turn] = rotation_matrices(step[None, 3:6])
    moved = frame.translation + frame.rotation @ step[:3]
    return Frame(frame.rotation @ turn, moved, distance_offset=frame.distance_offset + float(step[6:].sum()))


@dataclass(frozen=True)
class JointEquilibrium:
    """Hold the static equilibrium of an arm in several poses under loads."""

    theta: Array  #: Virtual joints at rest, (runs, n_theta) [m, rad].
    chain: ChainState  #: The extended chain at rest, with tool pose and Jacobian.
    generalised_loads: Array  #: Load u of every virtual joint at rest, (n_theta, runs) [N, N m].
    error_basis: Array  #: Functions Phi(q) of the joint errors, k per joint, (joints, k, runs).


def joint_equilibrium(
    state: ArmState, q: Array, loads: Sequence[Load] = (), n_steps: int | None = None
) -> JointEquilibrium:
    """Solve for the static equilibrium of an arm under own weight and loads, by fixed-point steps.

    Each step applies the loads to the arm as the last step deflected it. The steps converge only if the
    loaded stiffness K_theta - K_w of Eq. (7) is stable, so that buckling is detected.

    Mathematics: `loaded-1`.

    Args:
        state: The model of the arm.
        q: Commanded joint positions, (runs, n) [rad, m].
        loads: Loads that act together, each with one row per run.
        n_steps: Number of steps; None to iterate to convergence.

    Returns:
        The equilibrium in every pose.

    Raises:
        NoEquilibrium: If the steps do not converge in a pose.
    """
    start, u, phi = _unsprung(state, q, loads)
    theta, step = start + (state.C_theta @ u).T, np.zeros(len(q))
    # theta <- theta_0 + Phi(q) n + C_theta u(q, theta), until the step is at rounding.
    for _ in range(MAX_EQUILIBRIUM_STEPS if n_steps is None else n_steps):
        where = evaluate_chain(state.vjm, q, theta)
        u = generalised_loads_at(state, where, loads)
        bent = start + (state.C_theta @ u).T
        step = np.abs(bent - theta).max(axis=1, initial=0)
        theta = bent
        if (step <= EQUILIBRIUM_TOLERANCE).all():  # not of NaN
            return JointEquilibrium(theta, where, u, phi)
    if n_steps is None:
        words = state.vjm.arm.pose_text(q[np.argmin(step <= EQUILIBRIUM_TOLERANCE)])
        raise NoEquilibrium(f"no static equilibrium at q = {words}: too soft for its load, or buckled")
    return JointEquilibrium(theta, evaluate_chain(state.vjm, q, theta), u, phi)


def _unsprung(state: ArmState, q: Array, loads: Sequence[Load]) -> tuple[Array, Array, Array]:
    """Compute virtual joints without springs, (runs, n_theta), the load of the undeflected arm, and phi."""
    arm, theta = state.vjm.arm, np.tile(state.theta_0, (len(q), 1))
    u, joints = (
        generalised_loads_at(state, evaluate_chain(state.vjm, q, theta), loads),
        slice(6 * len(arm.links), arm.n_theta),
    )
    phi = joint_error_basis(state.error_terms, arm, q, u[joints], state.torque_scale)
    theta[:, joints] += np.einsum("jkr,jk->rj", phi, state.error_coefficients)
    return theta, u, phi


def generalised_loads_at(state: ArmState, chain: ChainState, loads: Sequence[Load]) -> Array:
    """Compute the generalised load u of every virtual joint, from own weight and other loads.

    Args:
        state: The model of the arm, for the masses of its links.
        chain: The extended chain in all poses.
        loads: Loads that act together, each with one row per run.

    Returns:
        u, (n_theta, runs) [N, N m].
    """
    return own_weight_load(chain, state.body_masses) + sum_generalised_loads(chain, loads)


def theta_without_springs(state: ArmState, q: Array, loads: Sequence[Load]) -> Array:
    """Compute the virtual joints of an arm with rigid springs: theta_0 + Phi(q) n.

    Args:
        state: The model of the arm.
        q: Joint positions, (runs, n) [rad, m].
        loads: Loads that act together; backlash and stiffening depend on them.

    Returns:
        theta, (runs, n_theta) [m, rad].
    """
    if not state.error_terms.n_coefficients:
        return np.tile(state.theta_0, (len(q), 1))
    return _unsprung(state, q, loads)[0]


def series_equilibrium(state: ArmState, series: Series) -> JointEquilibrium:
    """Compute the static equilibrium of an arm in every row of a series, by two fixed-point steps.

    Mathematics: `abs-1`.

    Args:
        state: The model of the arm.
        series: The readings, which give poses and loads.

    Returns:
        The equilibrium in every row, in base axes.
    """
    loads = [Load(series.wrench, series.point)] if series.wrench.any() else []
    return joint_equilibrium(state, series.q, loads, CALIBRATION_EQUILIBRIUM_STEPS)


def torque_scale(vjm: Vjm, body_masses: BodyMasses, series: tuple[Series, ...]) -> Array:
    """Compute the RMS torque of every joint by own weight and loads, over all rows of some series.

    Args:
        vjm: The arm's virtual joint model.
        body_masses: Masses of the links.
        series: The readings, which give poses and loads.

    Returns:
        RMS torque, (n,) [N m, N]; 0 for joints without torque.
    """
    total = np.zeros(vjm.arm.n_joints)
    for readings in series:
        for first in range(0, readings.n_rows, MAX_ROWS_IN_MEMORY):
            part = slice(first, first + MAX_ROWS_IN_MEMORY)
            where = evaluate_chain(vjm, readings.q[part])
            u = own_weight_load(where, body_masses) + sum_generalised_loads(
                where, [Load(readings.wrench[part], readings.point[part])]
            )
            total += (u[-vjm.arm.n_joints :] ** 2).sum(axis=1)
    scale = np.sqrt(total / sum(readings.n_rows for readings in series))
    return np.where(scale > 1e-6 * scale.max(initial=0), scale, 0.0)


# --- Error pattern of several joints: gears or encoders of one make share an error, shifted or mirrored -----

MIN_PATTERN_ORDER = 3
"""Lowest order of an error pattern: errors of a joint's axis look like orders 1 and 2."""
MIN_SHARED_PATTERN_LOG_ODDS = 10.0
"""Least log odds of a joint's shift of the pattern, against any other shift and against no pattern [nats]."""
MAX_COMPARED_SHIFTS = 8
"""Most shifts of a pattern whose evidence is compared, each a local maximum of the likelihood."""
PATTERN_SIGNS = (1, -1)  #: Signs that a pattern may have in a joint.
TRIED_SHIFTS: Array = np.radians(np.arange(0, 360, 1.0))
"""Shifts of a pattern that are tried in a joint [rad]."""
FINE_SHIFTS: Array = np.radians(np.linspace(-1, 1, 41))
"""Finer shifts that are tried around the best one, relative to it [rad]."""


@dataclass(frozen=True)
class ErrorPattern:
    """Describe a periodic error f that several joints share: joint j has the error s_j f(s_j q_j + phi_j)."""

    #: Indices of two or more joints, ascending; f is a function of the angle of the first one.
    joints: tuple[int, ...]
    shifts: tuple[float, ...]  #: Shift phi of each of these joints [rad].
    signs: tuple[int, ...]  #: Sign s of each of these joints, 1 or -1.


def error_pattern_coefficients(error_terms: JointErrorTerms) -> Ids:
    """List the Fourier coefficients of a joint that an `ErrorPattern` may have, k sines first, (2 k,)."""
    return np.flatnonzero(np.tile(error_terms.orders, 2) >= MIN_PATTERN_ORDER)


def shift_fourier_coefficients(coefficients: Array, shift: Array | float, sign: int, orders: Ids) -> Array:
    """Compute the Fourier coefficients of s f(s q + phi) from those of a periodic function f(q).

    Mathematics: `abs-11`.

    Args:
        coefficients: Coefficients of f, k sines, then k cosines, (..., 2 k).
        shift: Shift phi [rad], one number or (...).
        sign: Sign s, 1 or -1.
        orders: Orders of the sines and cosines, (k,).

    Returns:
        The coefficients, k sines, then k cosines, (..., 2 k).
    """
    (a, b), angle = np.split(coefficients, 2, axis=-1), np.asarray(shift, dtype=float)[..., None] * orders
    c, s = np.cos(angle), np.sin(angle)
    return np.concatenate([a * c - b * s, sign * (a * s + b * c)], axis=-1)


def error_pattern_basis(
    pattern: ErrorPattern, error_terms: JointErrorTerms, first_column: int, n_unknowns: int
) -> "csr_array":
    """Make the basis in which periodic errors of some joints are a shared pattern and differences from it.

    The pattern replaces the periodic errors of its first joint; differences replace those of the others.

    Args:
        pattern: The pattern.
        error_terms: Kinds of joint errors.
        first_column: Column of the first joint error among all unknowns.
        n_unknowns: Number of unknowns.

    Returns:
        Matrix B with x = B y of the unknowns x in SI units and y in the basis, (n_unknowns, n_unknowns).
    """
    from scipy.linalg import helmert  # here: see above
    from scipy.sparse import csr_array

    n = len(pattern.joints)
    waves = error_pattern_coefficients(error_terms)
    k = len(waves) // 2
    # Columns: the pattern, in place of the mean, then the differences between joints.
    mix = helmert(n, full=True).T
    mix[:, 0] = 1.0
    at = first_column + error_terms.n_coefficients * np.array(pattern.joints)[:, None] + waves
    B, orders = np.eye(n_unknowns), np.array(error_terms.orders)[waves[:k]]
    # Waves of joint i: each column, shifted and mirrored to its angle.
    for i in range(n):
        R = shift_fourier_coefficients(np.eye(2 * k), pattern.shifts[i], pattern.signs[i], orders).T
        for j in range(n):
            B[np.ix_(at[i], at[j])] = mix[i, j] * R
    return csr_array(B)


@dataclass(frozen=True)
class _PatternInformation:
    """Hold the information of one joint's readings about the pattern; its individual error is eliminated."""

    W: Array  #: Precision of the pattern's waves, (2 k, 2 k).
    g: Array  #: W times the most probable waves, (2 k,).
    individual_log_odds: float  #: Log odds of individual waves of full size against those of individual size.


def find_error_pattern(
    joint_information: Sequence[tuple[Array, Array]],
    individual_variance: Array,
    shared_variance: Array,
    orders: Ids,
) -> ErrorPattern | None:
    """Find the pattern of periodic errors that some joints share.

    The joint that agrees best with the others starts; others are added in the order of their odds. In the end
    the log odds of each joint, given all others, must exceed `MIN_SHARED_PATTERN_LOG_ODDS`.

    Mathematics: `abs-11`.

    Args:
        joint_information: For every joint the precision of its Fourier coefficients from the readings,
            (2 k, 2 k), and its product with the most probable coefficients, (2 k,); zero for a joint without
            readings.
        individual_variance: Prior variance of the coefficients that are individual to a joint, (2 k,).
        shared_variance: Prior variance of the coefficients of the pattern, (2 k,).
        orders: Orders of the sines and cosines, (k,).

    Returns:
        The pattern; None if no two joints share one.
    """
    every = [
        _pattern_information(*candidate, individual_variance, individual_variance + shared_variance)
        for candidate in joint_information
    ]

    def best_pattern_shift(joint: int, members: dict[int, tuple[float, int]]) -> tuple[float, int, float]:
        """Find the shift [rad] and sign of the pattern in a joint, given those of others, and its log odds.

        Args:
            joint: Index of the joint.
            members: Shift [rad] and sign of each joint with the pattern, by its index.
        """
        # Information about the pattern from the other joints.
        P, b = np.diag(1 / shared_variance), np.zeros(len(shared_variance))
        for other, (shift, sign) in members.items():
            if other != joint:
                R = shift_fourier_coefficients(np.eye(len(b)), shift, sign, orders)
                P, b = P + R @ every[other].W @ R.T, b + R @ every[other].g
        return _best_shift(every[joint], P, b, orders)

    # Start with the joint whose odds with the others are best.
    joints = range(len(every))
    pairs = [[best_pattern_shift(j, {i: (0.0, 1)})[2] for j in joints if j != i] for i in joints]
    members = {int(np.argmax([np.maximum(row, 0).sum() for row in pairs])): (0.0, 1)}
    # Add the joint with the best odds, as long as they suffice.
    while len(members) < len(every):
        found = {j: best_pattern_shift(j, members) for j in joints if j not in members}
        best = max(found, key=lambda j: found[j][2])
        if found[best][2] < MIN_SHARED_PATTERN_LOG_ODDS:
            break
        members[best] = found[best][:2]
    # Remove joints whose odds, given all others, do not suffice.
    while len(members) > 1:
        again = {j: best_pattern_shift(j, members) for j in members}
        worst = min(again, key=lambda j: again[j][2])
        if again[worst][2] >= MIN_SHARED_PATTERN_LOG_ODDS:
            return _relative_to_first({j: (shift, sign) for j, (shift, sign, _) in again.items()})
        del members[worst]
    return None


def _pattern_information(
    precision: Array, product: Array, individual: Array, whole: Array
) -> _PatternInformation:
    """Eliminate the individual error of a joint from the information of its readings.

    `precision`, (2 k, 2 k), is that of the joint's waves, `product`, (2 k,), that times the most probable
    waves; `individual` and `whole`, (2 k,), are variances of waves without and with a pattern.
    """
    solved = np.linalg.solve(precision + np.diag(1 / individual), np.column_stack([precision, product]))
    with_pattern, without = (
        _log_integral(precision + np.diag(1 / d), product) - np.log(d).sum() / 2 for d in (whole, individual)
    )
    return _PatternInformation(
        precision - precision @ solved[:, :-1], product - precision @ solved[:, -1], with_pattern - without
    )


def _best_shift(
    pattern_information: _PatternInformation, P: Array, b: Array, orders: Ids
) -> tuple[float, int, float]:
    """Find the shift and sign in which a joint has a pattern, and the log odds against all alternatives.

    Args:
        pattern_information: Information of the joint's readings.
        P: Precision of the pattern by the other joints, (2 k, 2 k).
        b: Its product with the most probable pattern, (2 k,).
        orders: Orders of the waves, (k,).
    """
    f = np.asarray(np.linalg.solve(P, b), dtype=float)
    before = _log_integral(P, b)

    def log_likelihood(shifts: Array, sign: int) -> Array:
        """Compute the log-likelihood of the other joints' most probable pattern at many shifts.

        Args:
            shifts: Shifts, (shifts,) [rad].
            sign: Sign of the pattern, 1 or -1.

        Returns:
            Log-likelihoods, (shifts,) [nats].
        """
        x = shift_fourier_coefficients(f, shifts, sign, orders)
        return np.asarray(x @ pattern_information.g - ((x @ pattern_information.W) * x).sum(axis=1) / 2)

    every = np.stack([log_likelihood(TRIED_SHIFTS, sign) for sign in PATTERN_SIGNS])
    # Local maxima of the likelihood over the shift.
    peaks = (every > np.roll(every, 1, axis=1)) & (every >= np.roll(every, -1, axis=1))
    rivals = np.argwhere(peaks)[np.argsort(-every[peaks], kind="stable")[:MAX_COMPARED_SHIFTS]]
    # Evidence of each, the pattern integrated out; first that of an individual error.
    odds = [pattern_information.individual_log_odds]
    for way, k in rivals:
        R = shift_fourier_coefficients(np.eye(len(f)), TRIED_SHIFTS[k], PATTERN_SIGNS[way], orders)
        odds.append(
            _log_integral(P + R @ pattern_information.W @ R.T, b + R @ pattern_information.g) - before
        )
    first, *others = np.argsort(odds)[::-1]
    if not first:
        return 0.0, 1, odds[others[0]] - pattern_information.individual_log_odds if others else 0.0
    way, k = rivals[first - 1]
    finer = TRIED_SHIFTS[k] + FINE_SHIFTS
    return (
        float(finer[log_likelihood(finer, PATTERN_SIGNS[way]).argmax()]),
        PATTERN_SIGNS[way],
        odds[first] - odds[others[0]],
    )


def _log_integral(P: Array, b: Array) -> float:
    """Compute the logarithm of the integral of exp(b x - x P x / 2), up to a constant."""
    return float(b @ np.linalg.solve(P, b) - np.linalg.slogdet(P)[1]) / 2


def _relative_to_first(members: dict[int, tuple[float, int]]) -> ErrorPattern:
    """Express the pattern in the angle of the first joint that has it."""
    joints = tuple(sorted(members))
    start, way = members[joints[0]]
    shifts = tuple(float((way * (members[j][0] - start) + np.pi) % (2 * np.pi) - np.pi) for j in joints)
    return ErrorPattern(joints, shifts, tuple(way * members[j][1] for j in joints))


# --- Unknowns of a calibration, and their columns in the linear equations -----------------------------------

PERIODIC_ERROR_KINDS = ("harmonics", "pattern")
"""Kinds of periodic joint errors, in bands of orders: of each joint, and of a pattern that joints share."""


@dataclass(frozen=True)
class Unknowns:
    """List the unknowns of a calibration in the order of their columns in the linear equations.

    The order is: frames, mounts, errors of geometry, joint errors, compliances.
    """

    vjm: Vjm  #: The arm's virtual joint model.
    frames: tuple[str, ...]  #: Names of the frames (tracker from base).
    #: Number of targets of every mount, and whether one of them has an orientation.
    mounts: Mapping[str, tuple[int, bool]]
    error_terms: JointErrorTerms  #: Kinds of joint errors.
    structure: Structure  #: Structure of the compliances.
    has_geometry: bool = True  #: Whether geometry is unknown; it cancels in deflections.
    #: Frames and mounts that the readings leave undetermined, so that a prior determines them.
    undetermined_frames: frozenset[str] = frozenset()
    #: Prior deviations of the frames of distances and heights, from `Series.frame_deviations`.
    frame_deviations: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    #: Normals of the plane faces of each frame of heights.
    plane_normals: Mapping[str, tuple[tuple[float, float, float], ...]] = field(default_factory=dict)
    #: Periodic error that joints share; their columns are then in the basis `equation_basis`.
    shared_pattern: ErrorPattern | None = None

    @cached_property
    def geometry_slice(self) -> slice:
        """Return the slice of virtual joints whose constants are errors of geometry: those of inner links."""
        return slice(6, 6 * max(1, self.vjm.arm.n_joints) if self.has_geometry else 6)

    @cached_property
    def first_columns(self) -> dict[str, int]:
        """Return the first column of each frame, each mount, geometry, joint errors and compliances, by name.

        Names are those of `columns`; "end" is the number of unknowns.
        """
        sizes = {f"frame {name}": len(self.frame_deviations.get(name, range(6))) for name in self.frames}
        sizes |= {f"mount {name}": 3 * m + 3 * turned for name, (m, turned) in self.mounts.items()}
        sizes |= {"geometry": self.geometry_slice.stop - self.geometry_slice.start}
        sizes |= {
            "errors": self.vjm.arm.n_joints * self.error_terms.n_coefficients,
            "elastic": self.structure.n_parameters,
            "end": 0,
        }
        ends = np.cumsum(list(sizes.values()))
        return {key: int(end - size) for (key, size), end in zip(sizes.items(), ends, strict=True)}

    @property
    def unused_rotations(self) -> Ids:
        """Return the columns of unknowns that change no reading: rotations of the frames of fixed points."""
        points = [
            self.first_columns[f"frame {name}"]
            for name, sizes in self.frame_deviations.items()
            if not sizes[3]
        ]
        return np.concatenate([np.zeros(0, dtype=int), *(start + np.arange(3, 6) for start in points)])

    @property
    def size(self) -> int:
        """Count the unknowns."""
        return self.first_columns["end"]

    def columns(self, name: str) -> slice:
        """Return the columns of one kind of unknowns.

        Args:
            name: "frame NAME", "mount NAME", "geometry", "errors" or "elastic".
        """
        keys = list(self.first_columns)
        return slice(self.first_columns[name], self.first_columns[keys[keys.index(name) + 1]])

    @cached_property
    def prior_groups(self) -> tuple[tuple[str, Ids], ...]:
        """Return groups of unknowns that share one prior deviation, each as kind of error and columns.

        All joints share one prior deviation for the periodic errors in a band of orders. If a joint has moved
        through only a part of its range, the other joints show how large its errors elsewhere may be.
        """
        geometry = np.arange(self.size)[self.columns("geometry")].reshape(-1, 6)
        columns_by_kind = [
            ("geometry shift", geometry[:, :3].ravel()),
            ("geometry turn", geometry[:, 3:].ravel()),
        ]
        joints = self.vjm.arm.n_joints
        errors = np.arange(self.size)[self.columns("errors")].reshape(joints, self.error_terms.n_coefficients)
        kinds, bands = np.array(self.error_terms.coefficient_kinds), self.error_terms.coefficient_bands
        # Joints with errors of high orders as large as the pattern: all but those with differences from it.
        as_pattern = np.full(joints, self.shared_pattern is not None)
        as_pattern[list(self.shared_pattern.joints[1:]) if self.shared_pattern else []] = False
        for kind in PERIODIC_ERROR_KINDS:
            for band in np.unique(bands[bands >= 0]):
                high = ORDER_BANDS[band] >= MIN_PATTERN_ORDER
                rows = (as_pattern & high) == (kind == "pattern")
                if rows.any():
                    columns_by_kind.append((kind, errors[rows][:, bands == band].ravel()))
        for kind in dict.fromkeys(kinds[bands < 0]):
            columns_by_kind.append((kind, errors[:, kinds == kind].ravel()))
        return tuple(columns_by_kind)

    @cached_property
    def equation_basis(self) -> "csr_array | None":
        """Return the matrix B, (size, size), that turns unknowns y of the equations into x = B y in SI units.

        It is None if x = y, because no joints share an error pattern.
        """
        if self.shared_pattern is None:
            return None
        return error_pattern_basis(
            self.shared_pattern, self.error_terms, self.first_columns["errors"], self.size
        )

    def values(self, state: ArmState) -> Array:
        """Return the values of all unknowns in a model of an arm; steps of frames and mounts are zero.

        Args:
            state: The model of the arm.

        Returns:
            Values, (size,), in SI units.
        """
        x = np.zeros(self.size)
        x[self.columns("geometry")] = state.theta_0[self.geometry_slice]
        x[self.columns("errors")] = state.error_coefficients.ravel()
        x[self.columns("elastic")] = self.structure.parameters_of(state.C_theta)
        return x


def compliance_unknowns(vjm: Vjm, structure: Structure) -> Unknowns:
    """List the unknowns of deflections: compliances only, because all others cancel in a difference.

    Args:
        vjm: The arm's virtual joint model.
        structure: Structure of the compliances.
    """
    return Unknowns(vjm, (), {}, JointErrorTerms(), structure, has_geometry=False)
