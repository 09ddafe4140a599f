"""Effects that a file cannot hold, by their size at the tool, and joint offsets that correct most."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from testbench.errors import Array
from testbench.files.export_geometry import displacement_statistics, tool_poses
from testbench.identify.absolute.state import LOAD_STEPS, ArmState, joint_equilibrium
from testbench.model.load import Load, weight

GEOMETRY, WEIGHT, PAYLOAD = "lengths and tilts of axes", "own weight", "payload, if there is one"
ERRORS = {"harmonics": "periodic errors of the joints", "ratio": "errors in proportion to the angle"}
"""Names of the kinds of joint errors in reports."""
SEEN = 1e-6
"""Least singular value that counts, over the largest [1]: the tool may lie on an axis."""
Sizes = dict[str, tuple[float, float]]
"""Motion of the tool by kind of effect over random poses, RMS and largest [mm]."""


def displacements(state: ArmState, q: Array) -> dict[str, Array]:
    """Compute how every kind of error moves the tool's origin.

    Args:
        state: The identified arm.
        q: Actuated joints, (poses, n) [rad, m].

    Returns:
        Displacements by kind, (poses, 3) [m].
    """
    rigid, still = tool_poses(state.vjm, q, state.theta_0)[:, :3, 3], replace(state, n=0 * state.n)
    sagged, payload = _rest(still, q), state.vjm.arm.payload
    found = {GEOMETRY: rigid - tool_poses(state.vjm, q)[:, :3, 3], WEIGHT: sagged - rigid}
    for kind in dict.fromkeys(state.errors.kinds):
        own = state.n * np.array([name == kind for name in state.errors.kinds])
        if own.any():
            found[ERRORS.get(kind, kind)] = _rest(replace(state, C_theta=0 * state.C_theta, n=own), q) - rigid
    if payload is not None:
        found[PAYLOAD] = _rest(still, q, [weight(state.vjm, np.full(len(q), payload))]) - sagged
    return found


def _rest(state: ArmState, q: Array, loads: list[Load] | None = None) -> Array:
    return joint_equilibrium(state, q, loads or [], LOAD_STEPS).chain.position


def all_but_payload(moved: dict[str, Array]) -> Array:
    """Sum the displacements of all kinds except the payload's.

    Args:
        moved: Displacements by kind of error, (poses, 3) [m] each.

    Returns:
        The sum, (poses, 3) [m].
    """
    return np.asarray(np.sum([rows for kind, rows in moved.items() if kind != PAYLOAD], axis=0))


@dataclass(frozen=True)
class BestOffsets:
    """Hold joint offsets that bring the nominal arm closest to the identified arm without load.

    Distances are RMS and largest, with base and tool fitted [mm].
    """

    #: Offsets, (n,) [rad]; zero for the first and the last joint, whose offsets are rotations of base and
    #: tool.
    offsets: Array
    drawn_mm: tuple[float, float]  #: Distance of the tool without them.
    corrected_mm: tuple[float, float]  #: Distance with them.
    left: Sizes  #: Remainder of every kind of effect.


def best_offsets(state: ArmState, q: Array) -> BestOffsets:
    """Fit joint offsets by least squares over the tool's origin.

    Args:
        state: The identified arm.
        q: Poses, (poses, n) [rad].

    Returns:
        The offsets, and what they leave.
    """
    vjm, n, moved = state.vjm, state.vjm.arm.n_joints, displacements(state, q)
    wanted = tool_poses(vjm, q)[:, :3, 3] + all_but_payload(moved)

    def off(x: Array) -> Array:  # base, tool, inner joints
        T = tool_poses(vjm, q + np.r_[0, x[9:], 0])
        at = (T[:, :3, 3] + T[:, :3, :3] @ x[6:9]) @ Rotation.from_rotvec(x[3:6]).as_matrix().T + x[:3]
        return np.asarray((at - wanted).ravel())

    found = least_squares(off, np.zeros(n + 7), xtol=1e-12, ftol=1e-12)
    J, rest, offsets = np.asarray(found.jac), found.fun.reshape(-1, 3), np.r_[0, found.x[9:], 0]
    left = {kind: rows if kind == PAYLOAD else _beyond(J, rows) for kind, rows in moved.items()}
    left[GEOMETRY] -= rest + all_but_payload(left)  # exact at any size
    drawn = _beyond(J[:, :9], all_but_payload(moved))
    return BestOffsets(
        offsets,
        displacement_statistics(drawn),
        displacement_statistics(rest),
        {kind: displacement_statistics(rows) for kind, rows in left.items()},
    )


def _beyond(J: Array, rows: Array) -> Array:
    """Compute the part of displacements that the columns cannot explain."""
    return np.asarray(rows - (J @ np.linalg.lstsq(J, rows.ravel(), rcond=SEEN)[0]).reshape(rows.shape))
