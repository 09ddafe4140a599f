"""What a file cannot hold of an arm, by its size at the tool, and the joint offsets that take most of it."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from testbench.errors import Array
from testbench.files.export_geometry import far, tool_poses
from testbench.identify.absolute.state import LOAD_STEPS, State, equilibrium
from testbench.model.load import Load, weight

GEOMETRY, WEIGHT, PAYLOAD = "lengths and tilts of axes", "own weight", "payload, where there is one"
ERRORS = {"harmonics": "periodic errors of the joints", "ratio": "errors in proportion to the angle"}
"""What the kinds of joint errors are called, where their name does not say it."""
SEEN = 1e-6  #: Smallest singular value that counts, over the largest: the tool may lie on an axis.
Sizes = dict[str, tuple[float, float]]
"""What the kinds of errors do at the tool over random poses, RMS and at most [mm]."""


def displacements(state: State, q: Array) -> dict[str, Array]:
    """How every kind of error moves the tool's origin, (poses, 3) [m]."""
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


def _rest(state: State, q: Array, loads: list[Load] | None = None) -> Array:
    return equilibrium(state, q, loads or [], LOAD_STEPS).where.position


def unloaded(moved: dict[str, Array]) -> Array:
    """All of them together but for the payload's."""
    return np.asarray(np.sum([rows for kind, rows in moved.items() if kind != PAYLOAD], axis=0))


@dataclass(frozen=True)
class BestOffsets:
    """Offsets of the joints of the arm as drawn that bring it nearest to the arm as identified, unloaded.

    Distances are RMS and at most, with base and tool where they fit best [mm].
    """

    offsets: Array  #: (n,) [rad]; none of the first and the last joint, which are turns of base and tool.
    drawn_mm: tuple[float, float]  #: Of the tool without them.
    corrected_mm: tuple[float, float]  #: With them.
    left: Sizes  #: What they leave of every kind.


def best_offsets(state: State, q: Array) -> BestOffsets:
    """The offsets, of least squares over the tool's origin in some poses, (poses, n) [rad]."""
    vjm, n, moved = state.vjm, state.vjm.arm.n_joints, displacements(state, q)
    wanted = tool_poses(vjm, q)[:, :3, 3] + unloaded(moved)

    def off(x: Array) -> Array:  # base, tool, inner joints
        T = tool_poses(vjm, q + np.r_[0, x[9:], 0])
        at = (T[:, :3, 3] + T[:, :3, :3] @ x[6:9]) @ Rotation.from_rotvec(x[3:6]).as_matrix().T + x[:3]
        return np.asarray((at - wanted).ravel())

    found = least_squares(off, np.zeros(n + 7), xtol=1e-12, ftol=1e-12)
    J, rest, offsets = np.asarray(found.jac), found.fun.reshape(-1, 3), np.r_[0, found.x[9:], 0]
    left = {kind: rows if kind == PAYLOAD else _beyond(J, rows) for kind, rows in moved.items()}
    left[GEOMETRY] -= rest + unloaded(left)  # exact at any size
    drawn = _beyond(J[:, :9], unloaded(moved))
    return BestOffsets(offsets, far(drawn), far(rest), {kind: far(rows) for kind, rows in left.items()})


def _beyond(J: Array, rows: Array) -> Array:
    """What the columns cannot do of displacements."""
    return np.asarray(rows - (J @ np.linalg.lstsq(J, rows.ravel(), rcond=SEEN)[0]).reshape(rows.shape))
