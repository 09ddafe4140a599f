"""Notation of orientations that a file does not state: the one that fits the arm's kinematics.

Orientation and position of one target in n poses fit a notation if one frame X and one mount Y, m exist with

    C_i = X R_i Y,    p_i = t + X (x_i + R_i m),

where R_i, x_i are orientation and position of the drawn arm's tool. Then X R_i = C_i Y^T: of all pairs of
matrices those that come nearest follow from the largest singular value of the mean of R_i^T (x) C_i^T
(M. Shah, Solving the robot-world/hand-eye calibration problem using the Kronecker product, 2013). With X,
the vectors t and m are linear.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from testbench.arm.folder import Arm
from testbench.errors import Array
from testbench.files.names import XYZ
from testbench.model.kinematics import build_vjm
from testbench.model.vjm import tool_pose

MOST_ANGLE = np.radians(2.0)  #: RMS angle up to which orientations fit the drawn arm [rad].
MOST_DISTANCE = 0.02  #: RMS distance of positions up to which they fit it, over its reach [1].
CLEAR = 3.0  #: A notation is taken if the next one fits so many times worse [1].
SAME = 1e-6  #: Difference of two matrices that counts as none [1].
MIN_POSES = 4  #: Fewest poses from which a notation is found.
LOOKED_AT = 300  #: Most poses that are used.
ORDERS = tuple(
    "".join(axes) for axes in product(XYZ, repeat=3) if axes[0] != axes[1] != axes[2]
)  #: The 12 orders of Euler angles.


@dataclass(frozen=True)
class OrientationFit:
    """Hold how well orientations in one notation fit the drawn arm."""

    notation: str  #: As a map states it, such as "intrinsic zyx".
    angle: float  #: RMS angle between read and drawn orientations [rad].
    distance: float  #: RMS distance between read and drawn positions [m].
    score: float  #: Root of the sum of the squares of both over what fits: 1 or less fits [1].

    def __str__(self) -> str:
        """Write the notation with its two numbers."""
        return f"{self.notation} ({np.degrees(self.angle):.2g} deg, {1e3 * self.distance:.2g} mm)"


def notations(angles: Array, by_axis: bool) -> dict[str, Array]:
    """Convert three angles by every notation.

    Args:
        angles: Three angles of each pose, (poses, 3) [rad].
        by_axis: Whether the angles are named by their axes x, y, z, not by their order.

    Returns:
        Rotation matrices, (poses, 3, 3), by the notation as a map states it. Of notations that give the same
        for these angles, there is only the first.
    """
    found = {"vector": Rotation.from_rotvec(angles).as_matrix()}
    for kind, order in product(("intrinsic", "extrinsic"), ORDERS):
        if by_axis and order[0] == order[2]:
            continue
        own = angles[:, [XYZ.index(axis) for axis in order]] if by_axis else angles
        rotation = Rotation.from_euler(order.upper() if kind == "intrinsic" else order, own).as_matrix()
        if all(np.abs(rotation - other).max() > SAME for other in found.values()):
            found[f"{kind} {order}"] = rotation
    return found


def fits_of(arm: Arm, q: Array, position: Array, tried: Mapping[str, Array]) -> list[OrientationFit]:
    """Fit frame and mount to poses of a target, for orientations in several notations.

    Args:
        arm: The arm; its drawn geometry counts.
        q: Joints of the chain, (poses, n) [rad, m].
        position: Positions of the target, (poses, 3) [m].
        tried: Orientations, (poses, 3, 3), by notation.

    Returns:
        The fits, the best first.
    """
    vjm = build_vjm(replace(arm, markers=()))
    some = np.unique(np.linspace(0, len(q) - 1, min(LOOKED_AT, len(q))).round().astype(int))
    x, R = tool_pose(vjm, q[some])
    fits = []
    for notation, rotation in tried.items():
        angle, distance = _misfit(x, R, position[some], rotation[some])
        score = float(np.hypot(angle / MOST_ANGLE, distance / (MOST_DISTANCE * vjm.reach)))
        fits.append(OrientationFit(notation, angle, distance, score))
    return sorted(fits, key=lambda fit: fit.score)


def _misfit(x: Array, R: Array, position: Array, C: Array) -> tuple[float, float]:
    """RMS angle [rad] and distance [m] of read poses from those of the drawn tool, frame and mount fitted."""
    # X and Y^T: the pair of matrices with the largest mean of R^T (x) C^T, each made a rotation
    K = np.einsum("nrp,nsq->pqrs", R, C).reshape(9, 9) / len(R)
    left, _, right = np.linalg.svd(K)
    X, Y_T = (_nearest(own.reshape(3, 3).T) for own in (right[0], left[:, 0]))
    off = np.swapaxes(C, 1, 2) @ X @ R @ Y_T.T
    angle = np.sqrt((Rotation.from_matrix(off).magnitude() ** 2).mean())
    # t and m: linear in both
    A = np.concatenate([np.broadcast_to(np.eye(3), R.shape), X @ R], axis=2).reshape(-1, 6)
    left_over = (position - x @ X.T).reshape(-1)
    left_over = left_over - A @ np.linalg.lstsq(A, left_over)[0]
    return float(angle), float(np.sqrt((left_over**2).sum() / len(R)))


def _nearest(matrix: Array) -> Array:
    """The rotation nearest to a multiple of a matrix, whose sign is free."""
    U, _, V = np.linalg.svd(matrix if np.linalg.det(matrix) > 0 else -matrix)
    return np.asarray(U @ V)


def clear_fit(fits: Sequence[OrientationFit]) -> OrientationFit | None:
    """Choose the notation that fits, if it fits clearly better than all others.

    Args:
        fits: Fits of notations, the best first.

    Returns:
        The best one; None if it does not fit, or the next one is nearly as good.
    """
    best, *others = fits
    if best.score > 1 or (others and others[0].score < CLEAR * best.score):
        return None
    return best


def unclear(fits: Sequence[OrientationFit]) -> str:
    """Say why no notation is taken: which ones fit, or that none does.

    Args:
        fits: Fits of notations, the best first.

    Returns:
        A sentence without a full stop.
    """
    best = fits[0]
    if best.score > 1:
        return f"no notation fits the arm as drawn; the nearest is {best}"
    alike = [fit for fit in fits if fit.score <= max(1.0, CLEAR * best.score)]
    return f"several notations fit the arm as drawn: {', '.join(map(str, alike))}"
