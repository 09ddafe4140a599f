"""Linear map from file joints to chain joints: q_model = L q_file + q_0.

A pendant may count joint 3 from the horizontal, so that it moves with joint 2; a palletiser's hand is kept
level by dependent joints. Both are this one linear map. Files, programs, plans and limits that
people read are in file joints; all mathematics is in the joints of the chain.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from testbench.errors import Array, BenchError, Ids, check_array, shorten

#: Singular value over the largest, or coefficient, below which it counts as zero [1].
ZERO_COEFFICIENT = 1e-9
MAX_COEFFICIENT = 1000.0  #: Largest coefficient of a file joint [1].
MAX_LISTED = 100  #: Most characters of joint names in a message.


@dataclass(frozen=True)
class ArmJoint:
    """Describe an actuated joint, a hinge or a slide, with its spring in series."""

    name: str  #: Name of the hinge or slide in rigid.xml.
    lower: float  #: Lower limit [rad, m].
    upper: float  #: Upper limit [rad, m].
    compliance: float  #: True compliance [rad/(N m), m/N].
    prismatic: bool = False  #: Whether it is a slide.

    @property
    def unit(self) -> Literal["rad", "m"]:
        """Return the unit of its coordinate, rad or m."""
        return "m" if self.prismatic else "rad"

    @property
    def column(self) -> str:
        """Name its column in a file, such as joint_2_rad."""
        return f"{self.name}_{self.unit}"

    @property
    def shown_unit(self) -> Literal["deg", "mm"]:
        """Return the unit in which people read its coordinate, deg or mm."""
        return "mm" if self.prismatic else "deg"

    @property
    def shown_column(self) -> str:
        """Name a column in the unit that people read, such as joint_2_deg."""
        return f"{self.name}_{self.shown_unit}"

    @property
    def shown(self) -> float:
        """Return the factor from its SI unit to the unit that people read, deg per rad or mm per m."""
        return 1e3 if self.prismatic else 180 / math.pi


@dataclass(frozen=True, eq=False)
class JointMap:
    """Hold the map q_model = L q_file + q_0 for n chain joints and m file joints, m <= n.

    With m < n the n - m chain joints that are not free follow the free ones.
    """

    names: tuple[str, ...]  #: Names of the file joints, m.
    prismatic: tuple[bool, ...]  #: Which file joints are slides, m.
    slides: tuple[bool, ...]  #: Which chain joints are slides, n.
    L: Array  #: Coefficients, (n, m) [1].
    q_0: Array  #: Offsets, (n,) [rad, m].
    #: Indices of the free chain joints, which the others follow, (m,): m independent rows of L, preferably
    #: those that are a file joint of their own.
    free: Ids
    inverse: Array  #: Inverse of the free rows of L, (m, m) [1].
    #: Motion of all joints per motion of the free ones, (n, n) [1]; columns of dependent joints are zero.
    dependence: Array

    @property
    def square(self) -> bool:
        """Tell whether no chain joint follows others, m = n."""
        return len(self.names) == len(self.q_0)

    def to_model(self, q: Array) -> Array:
        """Convert file joints, (..., m) [rad, m], to chain joints, L q + q_0, (..., n) [rad, m]."""
        return np.asarray(q @ self.L.T + self.q_0)

    def to_file(self, q: Array) -> Array:
        """Convert chain joints, (..., n) [rad, m], to file joints, (..., m), by the free joints alone."""
        return self.change_to_file(q - self.q_0)

    def change_to_file(self, change: Array) -> Array:
        """Convert a change of chain joints, (..., n) [rad, m], to one of file joints, (..., m)."""
        return np.asarray(change[..., self.free] @ self.inverse.T) + 0.0

    def torque_to_model(self, torque: Array) -> Array:
        """Convert torques of file joints, (..., m) [N m, N], to torques of chain joints, (..., n) [N m, N].

        Both do the same work, so torque_file = L^T torque_model.

        Raises:
            BenchError: When joints follow others: their torques cannot be separated.
        """
        if not self.square:
            raise BenchError("torques do not tell those of joints that follow others: leave them out")
        return np.asarray(torque @ self.inverse)

    def torque_to_file(self, torque: Array) -> Array:
        """Convert torques of chain joints, (..., n) [N m, N], to file joints, L^T torque, (..., m)."""
        return np.asarray(torque @ self.L)

    def with_dependent_joints(self, q: Array) -> Array:
        """Move the dependent joints of poses, (..., n) [rad, m], to where the free ones bring them."""
        if self.square:
            return q
        found = q.copy()
        others = np.setdiff1d(np.arange(len(self.q_0)), self.free)
        at = (q - self.q_0) @ self.dependence.T + self.q_0
        found[..., others] = at[..., others]
        return found

    def followed_joint(self, k: int) -> tuple[int, float, float] | None:
        """Find the one free joint that chain joint k follows, q_k = c q_j + offset.

        Returns:
            Index j, multiplier c [1] and offset [rad, m]; None where k is free, or follows none or several.
        """
        drivers = np.flatnonzero(self.dependence[k])
        if k in self.free or len(drivers) != 1:
            return None
        j, c = int(drivers[0]), float(self.dependence[k, drivers[0]])
        return j, c, float(self.q_0[k] - c * self.q_0[j])

    def sum_text(self, k: int) -> str:
        """Write chain joint k as a sum of file joints, such as "joint_3 - joint_2"; offsets in deg or mm."""
        terms = [
            f"{'-' if c < 0 else '+'} {'' if abs(c) == 1 else f'{abs(c):.6g} '}{name}"
            for name, c in zip(self.names, self.L[k].tolist(), strict=True)
            if c
        ]
        if self.q_0[k]:
            size = 1e3 * self.q_0[k] if self.slides[k] else np.degrees(self.q_0[k])
            terms.append(f"{'-' if size < 0 else '+'} {abs(size):.6g} {'mm' if self.slides[k] else 'deg'}")
        text = " ".join(terms).removeprefix("+ ") or "0"
        return f"-{text[2:]}" if text.startswith("- ") else text


def build_map(
    joints: Sequence[ArmJoint], rows: Mapping[str, Mapping[str, float]], q_0: Mapping[str, float]
) -> JointMap | None:
    """Build the joint map of a chain.

    File joints have the order of the chain: one named as a chain joint takes its place, any other the place
    where it is needed first.

    Args:
        joints: Joints of the chain, n.
        rows: Coefficients of file joints by their name [1], for each chain joint that has a row; a joint
            without a row is a file joint of its own.
        q_0: Offsets by the chain joint's name [rad, m]; zero where there is none.

    Returns:
        The map; None where every chain joint is the file joint of its name.

    Raises:
        BenchError: When the rows do not determine every file joint, one would turn a hinge and move a slide,
            or a coefficient is larger than `MAX_COEFFICIENT` or not finite.
    """
    # names of file joints, in the order of the chain
    known = {joint.name: k for k, joint in enumerate(joints)}
    own = {joint.name: rows.get(joint.name, {joint.name: 1.0}) for joint in joints}
    place: dict[str, tuple[int, int]] = {}
    for k, row in enumerate(own.values()):
        for name in (name for name, c in row.items() if c):
            place.setdefault(name, (known.get(name, k), len(place)))
    names = tuple(sorted(place, key=lambda name: place[name]))
    L = np.array([[float(row.get(name, 0.0)) for name in names] for row in own.values()])
    L = L.reshape(len(joints), len(names))
    offsets = np.array([q_0.get(joint.name, 0.0) for joint in joints])
    if names == tuple(known) and np.array_equal(L, np.eye(len(names))) and not offsets.any():
        return None
    L, offsets = check_array(L, (None, None), "coefficients"), check_array(offsets, (None,), "offsets")
    if np.abs(L).max(initial=0.0) > MAX_COEFFICIENT:
        raise BenchError(f"expected coefficients up to {MAX_COEFFICIENT:g}, got {np.abs(L).max():g}")
    # free chain joints: m independent rows of L, those that are a file joint of their own first
    alone = [k for k, (name, row) in enumerate(own.items()) if [n for n, c in row.items() if c] == [name]]
    free = _independent_rows(L, sorted(range(len(L)), key=lambda k: k not in alone))
    if not names or len(free) < len(names):
        listed = shorten(", ".join(names), MAX_LISTED) or "none"
        raise BenchError(f"expected file joints that the chain tells apart, got {listed}: rows depend")
    slides = np.array([joint.prismatic for joint in joints], dtype=bool)
    for j, name in enumerate(names):
        if len(set(slides[L[:, j] != 0].tolist())) > 1:
            raise BenchError(f"{name}: expected a file joint of hinges or of slides, got both")
    # all joints by the free ones: q - q_0 = L L_free^-1 (q - q_0)_free
    inverse = np.asarray(np.linalg.inv(L[free]), dtype=np.float64) + 0.0
    moves = np.zeros((len(L), len(L)))
    moves[:, free] = L @ inverse
    moves[np.abs(moves) <= ZERO_COEFFICIENT] = 0.0
    prismatic = tuple(bool(slides[L[:, j] != 0][0]) for j in range(len(names)))
    return JointMap(names, prismatic, tuple(slides.tolist()), L, offsets, free, inverse, moves)


def _independent_rows(L: Array, order: Sequence[int]) -> Ids:
    """Find rows that are independent of all earlier ones in an order; their indices are sorted."""
    found: list[int] = []
    for k in order:
        rows = L[[*found, k]]
        s = np.linalg.svd(rows, compute_uv=False)
        if len(rows) <= L.shape[1] and s[-1] > ZERO_COEFFICIENT * max(1.0, s[0]):
            found.append(k)
    return np.array(sorted(found), dtype=int)


def file_limits(joint_map: JointMap, joints: Sequence[ArmJoint]) -> Array:
    """Compute the least and the largest value of every file joint within the limits of the free chain joints.

    Args:
        joint_map: The joint map.
        joints: Joints of the chain, n.

    Returns:
        Lower and upper values, (2, m) [rad, m].
    """
    ends = (
        np.array([[joint.lower, joint.upper] for joint in joints])[joint_map.free]
        - joint_map.q_0[joint_map.free, None]
    )
    parts = joint_map.inverse[:, :, None] * ends
    return np.array([parts.min(axis=2).sum(axis=1), parts.max(axis=2).sum(axis=1)])


def narrow_limits(joint_map: JointMap, joints: Sequence[ArmJoint]) -> Array:
    """Narrow the limits of free joints so that joints that follow one of them stay within theirs.

    Args:
        joint_map: The joint map.
        joints: Joints of the chain, n.

    Returns:
        Lower and upper limits of the chain joints, (2, n) [rad, m].

    Raises:
        BenchError: When nothing is left between the limits of a joint.
    """
    limits = np.array([[joint.lower, joint.upper] for joint in joints]).T
    D = joint_map.dependence
    for k in np.setdiff1d(np.arange(len(D)), joint_map.free):
        drivers = np.flatnonzero(D[k])
        # a joint that follows several others narrows none of them
        if len(drivers) > 1:
            continue
        if not len(drivers):
            if not limits[0, k] <= joint_map.q_0[k] <= limits[1, k]:
                raise BenchError(f"{joints[k].name}: it is held beyond its limits")
            continue
        j = int(drivers[0])
        # its limits as values of the one joint that it follows
        ends = joint_map.q_0[j] + (limits[:, k] - joint_map.q_0[k]) / D[k, j]
        low, high = max(limits[0, j], ends.min()), min(limits[1, j], ends.max())
        if not low < high:
            raise BenchError(f"{joints[j].name}: no angle of it is within the limits of {joints[k].name} too")
        limits[:, j] = low, high
    return limits
