"""The description of an arm that truth and model share: names, limits, frames, compliances.

An arm is a folder with `rigid.xml` (MJCF: kinematics, masses, geometry) and `elastic.toml` (which body is
which link, and the true compliances, each number with its unit and origin). `load_arm` reads it.

Chain joints are the joints of the kinematic chain in rigid.xml. File joints are the numbers that files and
the teach pendant show. They differ if the pendant counts joint 3 from the horizontal, so that it moves with
joint 2, or if dependent joints keep a palletiser's hand level. One linear map describes both:
q_model = L q_file + q_0 (`JointMap`). Files, programs, plans and limits that people read are in file joints;
all mathematics is in chain joints.
"""

import math
import os
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from testbench.arm.document import toml_place
from testbench.arm.elastic import (
    ElasticDocument,
    JointEntry,
    LinkEntry,
    Tube,
    beam_frame,
    check_compliance,
    link_place,
    read_elastic,
    tube_compliance,
)
from testbench.arm.mjcf import angle_unit, attribute_numbers, find_body, read_mjcf
from testbench.display import Displayed
from testbench.errors import (
    Array,
    BenchError,
    Ids,
    InputError,
    Mask,
    PoseError,
    check_array,
    check_least,
    check_type,
    printable,
    shorten,
    some_of,
)

# --- Linear map from file joints to chain joints: q_model = L q_file + q_0 ----------------------------------

#: Coefficient of a joint map, or singular value over the largest, below which it counts as zero [1].
ZERO_TOLERANCE = 1e-9
MAX_COEFFICIENT = 1000.0  #: Largest coefficient of a file joint [1].
MAX_LISTED_CHARACTERS = 100  #: Most characters of joint names in a message.
TWO_TURNS = 4 * math.pi  #: A hinge beyond this angle and its limits was given in degrees [rad].


@dataclass(frozen=True)
class ArmJoint:
    """Describe an actuated joint of an arm, a hinge or a slide, and the compliance of its spring."""

    name: str  #: Name of the hinge or slide in rigid.xml.
    lower: float  #: Lower limit [rad, m].
    upper: float  #: Upper limit [rad, m].
    compliance: float  #: True compliance of the spring in series with the joint [rad/(N m), m/N].
    prismatic: bool = False  #: Whether it is a slide.

    @property
    def unit(self) -> Literal["rad", "m"]:
        """Return the SI unit of the joint's coordinate: rad, or m for a slide."""
        return "m" if self.prismatic else "rad"

    @property
    def file_column(self) -> str:
        """Name the joint's column in a file in SI units, such as joint_2_rad."""
        return f"{self.name}_{self.unit}"

    @property
    def display_unit(self) -> Literal["deg", "mm"]:
        """Return the unit in which people read the joint's coordinate: deg, or mm for a slide."""
        return "mm" if self.prismatic else "deg"

    @property
    def display_column(self) -> str:
        """Name the joint's column in a file in the units that people read, such as joint_2_deg."""
        return f"{self.name}_{self.display_unit}"

    @property
    def display_factor(self) -> float:
        """Return the factor from the joint's SI unit to its display unit: deg per rad, or mm per m."""
        return 1e3 if self.prismatic else 180 / math.pi


def limits_of(joints: Sequence[ArmJoint]) -> Array:
    """Collect the limits of joints.

    Args:
        joints: Joints of a chain or of files, n.

    Returns:
        Lower and upper limits, (2, n) [rad, m].
    """
    return np.array([[joint.lower for joint in joints], [joint.upper for joint in joints]])


def beyond_limits(joints: Sequence[ArmJoint], q: Array, slack: float) -> Iterator[tuple[int, str]]:
    """Find coordinates beyond the limits of their joints.

    Args:
        joints: Joints, n.
        q: Their coordinates, (poses, n) [rad, m].
        slack: Excess that counts as rounding [rad, m].

    Yields:
        Index of the pose, and what is wrong with it, for people.
    """
    lower, upper = limits_of(joints)
    for pose, k in np.argwhere((q < lower - slack) | (q > upper + slack)).tolist():
        joint = joints[k]
        low, high, got = (joint.display_factor * x for x in (joint.lower, joint.upper, q[pose, k]))
        yield pose, f"{joint.name}: expected {low:.4f} to {high:.4f} {joint.display_unit}, got {got:.4f}"


@dataclass(frozen=True, eq=False)
class JointMap:
    """Hold the linear map from m file joints to n chain joints, q_model = L q_file + q_0, m <= n.

    Chain joints are those of the kinematic chain; file joints are the numbers in files and on the pendant.
    If m < n, m chain joints are free, and the n - m others follow them.
    """

    file_joint_names: tuple[str, ...]  #: Names of the file joints, m.
    file_prismatic: tuple[bool, ...]  #: Which file joints are slides, m.
    chain_prismatic: tuple[bool, ...]  #: Which chain joints are slides, n.
    L: Array  #: Coefficients, (n, m) [1].
    q_0: Array  #: Offsets, (n,) [rad, m].
    #: Indices of the free chain joints, which the others follow, (m,): m independent rows of L, preferably
    #: those of chain joints that equal a file joint.
    free_joints: Ids
    inverse_of_free_rows: Array  #: Inverse of the rows of L of the free joints, (m, m) [1].
    #: Derivative of all chain joints by the free ones, (n, n) [1]; columns of dependent joints are zero.
    dependence_matrix: Array

    @property
    def all_joints_free(self) -> bool:
        """Tell whether all chain joints are free, m = n, so that none follows others."""
        return len(self.file_joint_names) == len(self.q_0)

    def to_chain_joints(self, q: Array) -> Array:
        """Convert file joints to chain joints, q_model = L q_file + q_0.

        Args:
            q: File joints, (..., m) [rad, m].

        Returns:
            Chain joints, (..., n) [rad, m].
        """
        return np.asarray(q @ self.L.T + self.q_0)

    def to_file_joints(self, q: Array) -> Array:
        """Convert chain joints to file joints; only the free chain joints are read.

        Args:
            q: Chain joints, (..., n) [rad, m].

        Returns:
            File joints, (..., m) [rad, m].
        """
        return self.to_file_joint_change(q - self.q_0)

    def to_file_joint_change(self, change: Array) -> Array:
        """Convert a change of chain joints to a change of file joints; the offsets q_0 drop out.

        Args:
            change: Change of the chain joints, (..., n) [rad, m].

        Returns:
            Change of the file joints, (..., m) [rad, m].
        """
        return np.asarray(change[..., self.free_joints] @ self.inverse_of_free_rows.T) + 0.0

    def to_chain_torques(self, torque: Array) -> Array:
        """Convert torques of file joints to torques of chain joints, torque_model = L^-T torque_file.

        Args:
            torque: Torques of the file joints, (..., m) [N m, N].

        Returns:
            Torques of the chain joints, (..., n) [N m, N].

        Raises:
            BenchError: When joints follow others: their torques cannot be separated.
        """
        if not self.all_joints_free:
            raise BenchError(
                "torques of joints that follow others cannot be separated: leave out the columns of torques"
            )
        return np.asarray(torque @ self.inverse_of_free_rows)

    def to_file_torques(self, torque: Array) -> Array:
        """Convert torques of chain joints to torques of file joints, torque_file = L^T torque_model.

        Args:
            torque: Torques of the chain joints, (..., n) [N m, N].

        Returns:
            Torques of the file joints, (..., m) [N m, N].
        """
        return np.asarray(torque @ self.L)

    def with_dependent_joints(self, q: Array) -> Array:
        """Replace the dependent chain joints of poses by the values that follow from the free ones.

        Args:
            q: Chain joints, (..., n) [rad, m].

        Returns:
            Chain joints that fulfil the map, (..., n) [rad, m].
        """
        if self.all_joints_free:
            return q
        moved = q.copy()
        others = np.setdiff1d(np.arange(len(self.q_0)), self.free_joints)
        at = (q - self.q_0) @ self.dependence_matrix.T + self.q_0
        moved[..., others] = at[..., others]
        return moved

    def followed_joint(self, joint_index: int) -> tuple[int, float, float] | None:
        """Find the free chain joint j that a dependent chain joint follows, q_joint = c q_j + offset.

        Args:
            joint_index: Index of the dependent chain joint, from 0.

        Returns:
            Index j, multiplier c [1] and offset [rad, m]; None if the joint is free, or follows none or
            several joints.
        """
        drivers = np.flatnonzero(self.dependence_matrix[joint_index])
        if joint_index in self.free_joints or len(drivers) != 1:
            return None
        j, c = int(drivers[0]), float(self.dependence_matrix[joint_index, drivers[0]])
        return j, c, float(self.q_0[joint_index] - c * self.q_0[j])

    def joint_formula(self, joint_index: int) -> str:
        """Write a chain joint as a sum of file joints, for people, such as "joint_3 - joint_2 + 90 deg".

        Args:
            joint_index: Index of the chain joint, from 0.

        Returns:
            The sum, with the offset in degrees or millimetres.
        """
        terms = [
            f"{'-' if c < 0 else '+'} {'' if abs(c) == 1 else f'{abs(c):.6g} '}{name}"
            for name, c in zip(self.file_joint_names, self.L[joint_index].tolist(), strict=True)
            if c
        ]
        if offset := self.q_0[joint_index]:
            slides = self.chain_prismatic[joint_index]
            size = 1e3 * offset if slides else np.degrees(offset)
            terms.append(f"{'-' if size < 0 else '+'} {abs(size):.6g} {'mm' if slides else 'deg'}")
        text = " ".join(terms).removeprefix("+ ") or "0"
        return f"-{text[2:]}" if text.startswith("- ") else text


def build_joint_map(
    joints: Sequence[ArmJoint], coefficients: Mapping[str, Mapping[str, float]], q_0: Mapping[str, float]
) -> JointMap | None:
    """Build the linear map from the file joints of an arm to its chain joints, q_model = L q_file + q_0.

    File joints have the order of the chain. One with the name of a chain joint takes the place of that joint;
    any other takes the place of the first chain joint that depends on it.

    Args:
        joints: Joints of the chain, n.
        coefficients: Rows of L: by the name of the chain joint, then of the file joint [1]. A chain joint
            that is missing equals the file joint of its name.
        q_0: Offsets by the chain joint's name [rad, m]; a missing one is zero.

    Returns:
        The map; None where every chain joint is the file joint of its name.

    Raises:
        BenchError: When the rows do not determine every file joint, a file joint would move both a hinge and
            a slide, or a coefficient is larger than `MAX_COEFFICIENT` or not finite.
    """
    # names of file joints, in the order of the chain
    known = {joint.name: k for k, joint in enumerate(joints)}
    rows = {joint.name: coefficients.get(joint.name, {joint.name: 1.0}) for joint in joints}
    place: dict[str, tuple[int, int]] = {}
    for k, row in enumerate(rows.values()):
        for name in (name for name, c in row.items() if c):
            place.setdefault(name, (known.get(name, k), len(place)))
    names = tuple(sorted(place, key=lambda name: place[name]))
    L = np.array([[float(row.get(name, 0.0)) for name in names] for row in rows.values()])
    L = L.reshape(len(joints), len(names))
    offsets = np.array([q_0.get(joint.name, 0.0) for joint in joints])
    if names == tuple(known) and np.array_equal(L, np.eye(len(names))) and not offsets.any():
        return None
    L, offsets = check_array(L, (None, None), "coefficients"), check_array(offsets, (None,), "offsets")
    if np.abs(L).max(initial=0.0) > MAX_COEFFICIENT:
        raise BenchError(f"expected coefficients up to {MAX_COEFFICIENT:g}, got {np.abs(L).max():g}")
    # free chain joints: m independent rows of L, those that are a file joint of their own first
    alone = [k for k, (name, row) in enumerate(rows.items()) if [n for n, c in row.items() if c] == [name]]
    free = independent_rows(L, sorted(range(len(L)), key=lambda k: k not in alone))
    if not names or len(free) < len(names):
        listed = shorten(", ".join(names), MAX_LISTED_CHARACTERS) or "none"
        raise BenchError(
            f"expected one independent row of [joints] per file joint, got dependent rows for {listed}"
        )
    slides = np.array([joint.prismatic for joint in joints], dtype=bool)
    for j, name in enumerate(names):
        if len(set(slides[L[:, j] != 0].tolist())) > 1:
            raise BenchError(f"{name}: a file joint may move hinges or slides, but not both")
    # all joints by the free ones: q - q_0 = L L_free^-1 (q - q_0)_free
    inverse = np.asarray(np.linalg.inv(L[free]), dtype=np.float64) + 0.0
    moves = np.zeros((len(L), len(L)))
    moves[:, free] = L @ inverse
    moves[np.abs(moves) <= ZERO_TOLERANCE] = 0.0
    prismatic = tuple(bool(slides[L[:, j] != 0][0]) for j in range(len(names)))
    return JointMap(names, prismatic, tuple(slides.tolist()), L, offsets, free, inverse, moves)


def independent_rows(L: Array, order: Sequence[int]) -> Ids:
    """Find rows that are independent of all earlier ones in an order.

    Args:
        L: Matrix, (n, m) [1].
        order: Indices of rows, the preferred ones first.

    Returns:
        Indices of independent rows, sorted.
    """
    independent: list[int] = []
    for k in order:
        rows = L[[*independent, k]]
        s = np.linalg.svd(rows, compute_uv=False)
        if len(rows) <= L.shape[1] and s[-1] > ZERO_TOLERANCE * max(1.0, s[0]):
            independent.append(k)
    return np.array(sorted(independent), dtype=int)


def _file_joint_limits(joint_map: JointMap, joints: Sequence[ArmJoint]) -> Array:
    """Compute the limits of every file joint from the limits of the free chain joints.

    Args:
        joint_map: Map between file joints and chain joints.
        joints: Joints of the chain, n, with their limits.

    Returns:
        Least and largest values of the file joints, (2, m) [rad, m].
    """
    ends = (limits_of(joints) - joint_map.q_0)[:, joint_map.free_joints].T
    parts = joint_map.inverse_of_free_rows[:, :, None] * ends
    return np.array([parts.min(axis=2).sum(axis=1), parts.max(axis=2).sum(axis=1)])


def _narrow_limits(joint_map: JointMap, joints: Sequence[ArmJoint]) -> Array:
    """Narrow the limits of free chain joints, so that the joints that follow them stay within their limits.

    Args:
        joint_map: Map between file joints and chain joints.
        joints: Joints of the chain, n, with their limits.

    Returns:
        Lower and upper limits of the chain joints, (2, n) [rad, m].

    Raises:
        BenchError: When no range is left for a joint.
    """
    limits = limits_of(joints)
    D = joint_map.dependence_matrix
    for k in np.setdiff1d(np.arange(len(D)), joint_map.free_joints):
        drivers = np.flatnonzero(D[k])
        # a joint that follows several others narrows none of them
        if len(drivers) > 1:
            continue
        if not len(drivers):
            if not limits[0, k] <= joint_map.q_0[k] <= limits[1, k]:
                raise BenchError(f"{joints[k].name}: it is held at a position outside its limits")
            continue
        j = int(drivers[0])
        # its limits as values of the one joint that it follows
        ends = joint_map.q_0[j] + (limits[:, k] - joint_map.q_0[k]) / D[k, j]
        low, high = max(limits[0, j], ends.min()), min(limits[1, j], ends.max())
        if not low < high:
            raise BenchError(
                f"{joints[j].name}: no angle keeps both it and {joints[k].name} within their limits"
            )
        limits[:, j] = low, high
    return limits


# --- The description of an arm that truth and model share: names, limits, frames, compliances ---------------

PACKAGE_FOLDER = Path(__file__).resolve().parents[1]
ARM_FOLDERS = (PACKAGE_FOLDER / "models", PACKAGE_FOLDER.parent / "models")
"""Folders of the arms that come with testbench: a wheel has them inside the package."""


def find_arm(name: str | Path) -> Path:
    """Find the folder of an arm, without reading its files.

    Args:
        name: Path of the folder, or name of an arm that comes with testbench.

    Returns:
        Path of the folder.

    Raises:
        InputError: When there is no such folder and no such arm.
        BenchError: When the name is neither text nor a path.
    """
    check_type(name, (str, Path), "arm")
    folders = {
        folder.name: folder for root in ARM_FOLDERS if root.is_dir() for folder in sorted(root.iterdir())
    }
    if os.path.isdir(name):  # noqa: PTH112 - a name too long is no folder either
        if str(name) in folders and not (Path(name) / "elastic.toml").exists():
            problem = "this folder is no arm and hides the built-in arm of its name: move it away"
            raise InputError(Path(name), "", problem)
        return Path(name)
    if str(name) in folders:
        return folders[str(name)]
    ours = ", ".join(sorted(folders))
    problem = f"expected the folder of an arm, with rigid.xml and elastic.toml, or one of {ours}"
    raise InputError(Path(name), "", problem)


@dataclass(frozen=True)
class Link:
    """Describe an elastic link: its beam axes, and the compliance of the virtual joint at its end, Eq. (1).

    The virtual joint is directly before the next actuated joint.
    """

    name: str  #: Name of the link's body in rigid.xml.
    beam_axes: Array  #: Beam axes x, y, z as columns, in the body's axes, (3, 3) [1].
    #: True compliance in the beam frame at the link's end, (6, 6) [m/N, rad/N, rad/(N m)].
    compliance: Array


@dataclass(frozen=True)
class Compensator:
    """Describe a gravity compensator: a spring from link 1 to link 2 that supports joint 2."""

    foot: Sequence[float]  #: Hinge point on link 1, in that body's frame, (3,) [m].
    head: Sequence[float]  #: Hinge point on link 2, in that body's frame, (3,) [m].
    rate: float  #: Change of force over change of length as joint 2 turns [N/m].
    rest_length: float  #: Length without force [m].
    #: Change of force over change of length as the true arm deflects [N/m]; None for the rate.
    stiffness: float | None = None

    def __post_init__(self) -> None:
        """Refuse points of another shape, and negative or infinite numbers, by BenchError."""
        for name in ("foot", "head"):
            check_array(getattr(self, name), (3,), f"{name} of the compensator [m]")
        for name in ("rate", "rest_length", "stiffness"):
            value = getattr(self, name)
            check_least(0.0 if value is None else value, f"{name} of the compensator")


@dataclass(frozen=True, repr=False)
class Arm(Displayed):
    """Describe a serial arm of n actuated joints and n + 1 elastic links."""

    name: str  #: Name of the folder.
    title: str  #: Title for people.
    mjcf_path: Path  #: Path of the rigid MJCF.
    links: tuple[Link, ...]  #: From the base to the flange, n + 1.
    joints: tuple[ArmJoint, ...]  #: From the base to the flange, n.
    tool: str  #: Body of the tool's centre point, a child of the last link.
    load_point: str  #: Body at whose origin a hung weight acts: the load point.
    markers: tuple[str, ...]  #: Bodies that the tracker reads, the markers.
    payload: float | None = None  #: Rated payload [kg]; None if elastic.toml states none.
    compensator: Compensator | None = None  #: Compensator of joint 2; None if elastic.toml states none.
    #: Map from file joints to chain joints; None where they are equal.
    joint_map: JointMap | None = None

    def summary(self) -> dict[str, object]:
        """Summarise the arm by name, joints, markers and rated payload."""
        summary = {"name": self.name, "joints": self.n_joints, "markers": " ".join(self.markers)}
        return summary | ({} if self.payload is None else {"payload_kg": self.payload})

    @property
    def n_joints(self) -> int:
        """Return the number of actuated joints, n."""
        return len(self.joints)

    @property
    def hinges(self) -> Mask:
        """Tell which chain joints are hinges, not slides, (n,)."""
        return np.array([not joint.prismatic for joint in self.joints], dtype=bool)

    @property
    def n_theta(self) -> int:
        """Return the number of virtual joints, 7 n + 6: six per link, then one per joint; 48 for n = 6."""
        return 6 * len(self.links) + len(self.joints)

    @property
    def C_theta(self) -> Array:
        """Assemble the arm's compliance of all virtual joints of Eq. (6), block diagonal.

        Returns:
            C_theta, (n_theta, n_theta) [m/N, rad/N, rad/(N m)]: a 6x6 block per link, then one entry per
            joint.
        """
        C = np.zeros((self.n_theta, self.n_theta))
        for i, link in enumerate(self.links):
            C[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = link.compliance
        first = 6 * len(self.links)
        C[range(first, self.n_theta), range(first, self.n_theta)] = [j.compliance for j in self.joints]
        return C

    @property
    def file_joints(self) -> tuple[ArmJoint, ...]:
        """Return the m joints that files, programs and the pendant show, with their limits.

        If a joint map makes them differ from the chain's joints, their compliance is NaN.
        """
        if self.joint_map is None:
            return self.joints
        ends = _file_joint_limits(self.joint_map, self.joints).T.tolist()
        rows = zip(self.joint_map.file_joint_names, ends, self.joint_map.file_prismatic, strict=True)
        return tuple(ArmJoint(name, low, high, math.nan, slides) for name, (low, high), slides in rows)

    def to_chain_joints(self, q: Array) -> Array:
        """Convert file joints to chain joints, q = L q_file + q_0.

        Args:
            q: File joints, (..., m) [rad, m].

        Returns:
            Chain joints, (..., n) [rad, m].
        """
        return q if self.joint_map is None else self.joint_map.to_chain_joints(q)

    def to_file_joints(self, q: Array) -> Array:
        """Convert chain joints to file joints, the inverse of q = L q_file + q_0.

        Args:
            q: Chain joints, (..., n) [rad, m].

        Returns:
            File joints, (..., m) [rad, m].
        """
        return q if self.joint_map is None else self.joint_map.to_file_joints(q)

    def to_file_joint_change(self, change: Array) -> Array:
        """Convert a change of chain joints to a change of file joints; offsets drop out.

        Args:
            change: Change of the chain joints, (..., n) [rad, m].

        Returns:
            Change of the file joints, (..., m) [rad, m].
        """
        return change if self.joint_map is None else self.joint_map.to_file_joint_change(change)

    @property
    def display_factors(self) -> Array:
        """Return factors that convert file joints from SI to display units, (m,) [deg/rad, mm/m]."""
        return np.array([joint.display_factor for joint in self.file_joints])

    def to_display_units(self, q: Array) -> Array:
        """Convert chain joints to file joints in degrees and millimetres.

        Args:
            q: Chain joints, (..., n) [rad, m].

        Returns:
            File joints, (..., m) [deg, mm].
        """
        return self.display_factors * self.to_file_joints(q)

    def from_display_units(self, values: Array) -> Array:
        """Convert file joints in degrees and millimetres to chain joints.

        Args:
            values: File joints, (..., m) [deg, mm].

        Returns:
            Chain joints, (..., n) [rad, m].
        """
        return self.to_chain_joints(values / self.display_factors)

    def distance_to_limits(self, q: Array) -> Array:
        """Compute how far each file joint alone can move until a chain joint reaches its limit.

        Args:
            q: Chain joints, (poses, n) [rad, m].

        Returns:
            Distance of every file joint to its nearest limit, negative beyond it, (poses, m) [deg, mm].
        """
        # A chain joint with the slack s stops a file joint of the coefficient L after s / |L|.
        slack = np.minimum(q - self.limits[0], self.limits[1] - q)
        if self.joint_map is not None:
            L = np.abs(self.joint_map.L)
            slack = np.min(
                slack[:, :, None] / np.where(L > 0, L, np.nan), axis=1, where=L > 0, initial=np.inf
            )
        return np.asarray(self.display_factors * slack)

    def check_joint_positions(self, q: object, name: str = "q [rad, m]") -> Array:
        """Convert joint positions to an array, and refuse degrees in place of radians.

        Args:
            q: Positions of the chain joints, (poses, n) [rad, m].
            name: Name and unit of the quantity, for the error message.

        Returns:
            The positions, (poses, n) [rad, m].

        Raises:
            BenchError: When they have another shape or are not finite, or a hinge is beyond its limits and
                beyond `TWO_TURNS`.
        """
        values = check_array(q, (None, self.n_joints), name)
        lower, upper = np.minimum(self.limits[0], -TWO_TURNS), np.maximum(self.limits[1], TWO_TURNS)
        if (wrong := ((values < lower) | (values > upper)) & self.hinges).any():
            pose, j = np.argwhere(wrong)[0]
            problem = f"{self.joints[j].name} of pose {pose} is at {values[pose, j]:g} rad"
            raise BenchError(f"{name}: expected radians; {problem}, more than two turns")
        return values

    def pose_text(self, q: Array) -> str:
        """Write a pose for people: file joints in degrees, slides in millimetres.

        Args:
            q: Chain joints, (n,) [rad, m].

        Returns:
            The values with their units.
        """
        values, joints = self.to_display_units(q).round(2).tolist(), self.file_joints
        if not any(joint.prismatic for joint in joints):
            return f"{values} deg"
        named = (f"{x} {joint.display_unit}" for x, joint in zip(values, joints, strict=True))
        return f"[{', '.join(named)}]"

    @property
    def limits(self) -> Array:
        """Return lower and upper limits of the chain joints, (2, n) [rad, m]."""
        return limits_of(self.joints)

    @property
    def dependence_matrix(self) -> Array | None:
        """Return the derivative of all chain joints with respect to the free ones, (n, n) [1].

        It is None if all joints are free.
        """
        return (
            None
            if self.joint_map is None or self.joint_map.all_joints_free
            else self.joint_map.dependence_matrix
        )

    @property
    def full_turn_joints(self) -> Mask:
        """Tell for which chain joints a rotation by 360 degrees does not change the arm's pose, (n,).

        These are the hinges that no other joint follows.
        """
        return (
            self.hinges
            if self.dependence_matrix is None
            else self.hinges & (np.count_nonzero(self.dependence_matrix, axis=0) == 1)
        )

    def with_dependent_joints(self, q: Array) -> Array:
        """Replace the dependent chain joints of poses by the values that follow from the free ones.

        Args:
            q: Chain joints, (..., n) [rad, m].

        Returns:
            Chain joints that fulfil the joint map, (..., n) [rad, m].
        """
        return q if self.joint_map is None else self.joint_map.with_dependent_joints(q)

    def clip_to_limits(self, q: Array) -> Array:
        """Clip chain joints to their limits; dependent joints then follow the free ones.

        Args:
            q: Chain joints, (..., n) [rad, m].

        Returns:
            Clipped chain joints, (..., n) [rad, m].
        """
        return self.with_dependent_joints(np.clip(q, *self.limits))

    def draw_poses(self, rng: np.random.Generator, count: int) -> Array:
        """Draw poses uniformly within the joint limits.

        Args:
            rng: Random number generator.
            count: Number of poses.

        Returns:
            Chain joints, (count, n) [rad, m], all within the limits.

        Raises:
            PoseError: When dependent joints are outside their limits in nearly all poses.
        """
        lower, upper = self.limits
        q = self.with_dependent_joints(rng.uniform(lower, upper, (count, self.n_joints)))
        for _ in range(MAX_REDRAWS if self.dependence_matrix is not None else 0):
            beyond = np.flatnonzero(((q < lower) | (q > upper)).any(axis=1))
            if not len(beyond):
                return q
            q[beyond] = self.with_dependent_joints(rng.uniform(lower, upper, (len(beyond), self.n_joints)))
        if self.dependence_matrix is not None:
            raise PoseError(
                f"{self.name}: in nearly all poses, joints that follow others are outside their limits"
            )
        return q


MJCF_JOINT_TYPES = "hinge", "slide"
"""Types of joints in an arm's MJCF."""
JOINT_COMPLIANCE_UNITS = "rad/(N m)", "m/N"
"""Units of the compliance of a hinge and of a slide."""

MAX_JOINT_COORDINATE = 1000.0  #: Largest joint limit or offset [rad, m].
MAX_TITLE_CHARACTERS = 200  #: Most characters of an arm's title.
MAX_REDRAWS = 300  #: Most times that poses with a dependent joint beyond its limits are drawn again.
MAX_TUBE_LENGTH_RATIO = 3.0  #: Largest length of a tube over that of the whole arm [1].


def load_arm(folder: str | Path) -> Arm:
    """Read and check the two files of an arm's folder, rigid.xml and elastic.toml.

    Args:
        folder: Folder with rigid.xml and elastic.toml, or the name of an arm that comes with testbench.

    Returns:
        The arm; every body, joint and marker is in the MJCF, in the order of the chain.

    Raises:
        InputError: When a file or a value is wrong; the message names file, place and what was expected.
    """
    folder = find_arm(folder)
    toml_path, rigid = folder / "elastic.toml", folder / "rigid.xml"
    elastic, root = read_elastic(toml_path), read_mjcf(rigid)
    spring = elastic.compensator
    arm = Arm(
        name=printable(folder.resolve().name),
        title=shorten(printable(elastic.title), MAX_TITLE_CHARACTERS),
        mjcf_path=rigid,
        links=tuple(_link(toml_path, i, link) for i, link in enumerate(elastic.link)),
        joints=tuple(
            _joint(rigid, root, joint, link.name)
            for joint, link in zip(elastic.joint, elastic.link[1:], strict=True)
        ),
        tool=elastic.tool,
        load_point=elastic.load,
        markers=tuple(elastic.markers),
        payload=None if elastic.payload is None else elastic.payload.value,
        compensator=None if spring is None else Compensator(**{k: v.value for k, v in spring}),
    )
    if arm.compensator is not None and (len(arm.links) < 3 or arm.joints[1].prismatic):
        place = toml_place(toml_path, ["compensator"])
        raise InputError(toml_path, place, "expected a hinge between link 1 and link 2")
    _check_chain(rigid, root, arm)
    _check_lengths(toml_path, elastic, _chain_length(rigid, root, arm))
    return _with_joint_map(toml_path, elastic, arm)


OFFSET_KEYS = "offset_deg", "offset_mm"
"""Keys of the offset q_0 in a row of [joints] of elastic.toml, for a hinge and for a slide."""


def _with_joint_map(path: Path, elastic: ElasticDocument, arm: Arm) -> Arm:
    """Give the arm the file joints that [joints] of elastic.toml states."""
    known, q_0 = {joint.name: joint for joint in arm.joints}, dict[str, float]()
    rows = {name: dict(row) for name, row in elastic.joints.items()}
    for name, row in rows.items():
        place = toml_place(path, ["joints", name])
        if name not in known:
            raise InputError(path, place, f"expected one of the joints {', '.join(known)}, got {name!r}")
        key, wrong_key = OFFSET_KEYS[:: -1 if known[name].prismatic else 1]
        if wrong_key in row:
            raise InputError(path, place, f"expected {key} of this joint, got {wrong_key}")
        q_0[name] = row.pop(key, 0.0) / known[name].display_factor
        if abs(q_0[name]) > MAX_JOINT_COORDINATE:
            raise InputError(path, place, f"expected offsets up to {MAX_JOINT_COORDINATE:g} rad or m")
    place = toml_place(path, ["joints"])
    try:
        joint_map = build_joint_map(arm.joints, rows, q_0)
        if joint_map is None:
            return arm
        limits = _narrow_limits(joint_map, arm.joints).T.tolist()
    except BenchError as err:
        raise InputError(path, place, str(err)) from err
    joints = [replace(j, lower=low, upper=high) for j, (low, high) in zip(arm.joints, limits, strict=True)]
    return replace(arm, joints=tuple(joints), joint_map=joint_map)


def _link(path: Path, index: int, link: LinkEntry) -> Link:
    if (link.tube is None) == (link.compliance is None):
        raise InputError(path, link_place(path, index, link), "expected either a tube or a compliance")
    try:
        if link.tube is not None:
            tube = Tube(**{k: v.value for k, v in link.tube})
            C = check_compliance(tube_compliance(tube), "compliance of the tube")
        else:
            assert link.compliance is not None
            C = check_compliance(link.compliance.value, "compliance")
    except BenchError as err:
        key = "compliance" if link.tube is None else "tube"
        raise InputError(path, link_place(path, index, link, key), str(err)) from err
    return Link(link.name, beam_frame(path, index, link), C)


def _joint(rigid: Path, root: ET.Element, joint: JointEntry, body: str) -> ArmJoint:
    elements = find_body(rigid, root, body).findall("joint")
    names = [j.get("name") for j in elements]
    if names != [joint.name]:
        problem = f"expected exactly the joint {joint.name!r} of elastic.toml, got {some_of(names)}"
        raise InputError(rigid, f"<body name={body!r}>", problem)
    [element] = elements
    prismatic = element.get("type", "hinge") == "slide"
    unit = 1.0 if prismatic else angle_unit(root)
    lower, upper = (x * unit for x in attribute_numbers(rigid, element, "range", 2))
    moved = "pos" in element.attrib and any(attribute_numbers(rigid, element, "pos", 3))
    problems = {
        f"expected a hinge or a slide, got {element.get('type')!r}": element.get("type", "hinge")
        not in MJCF_JOINT_TYPES,
        "expected no pos: the body's origin lies on the joint": moved,
        "axis: expected a direction, got zero": not any(attribute_numbers(rigid, element, "axis", 3)),
        f"range: expected lower < upper, got {element.get('range')!r}": not lower < upper,
        f"range: expected limits up to {MAX_JOINT_COORDINATE:g} rad or m, got {element.get('range')!r}": (
            max(abs(lower), abs(upper)) > MAX_JOINT_COORDINATE
        ),
    }
    if wrong := [problem for problem, there in problems.items() if there]:
        raise InputError(rigid, f"<joint name={joint.name!r}>", wrong[0])
    if joint.compliance.unit != JOINT_COMPLIANCE_UNITS[prismatic]:
        problem = f"expected {JOINT_COMPLIANCE_UNITS[prismatic]} for a {MJCF_JOINT_TYPES[prismatic]}"
        place = f"joint ({joint.name}) compliance.unit"
        raise InputError(rigid.with_name("elastic.toml"), place, f"{problem}, got {joint.compliance.unit}")
    return ArmJoint(joint.name, lower, upper, joint.compliance.value, prismatic)


def _check_chain(rigid: Path, root: ET.Element, arm: Arm) -> None:
    """Check that base, links and tool nest in order, and that load and markers are fixed to the tool."""
    chain = [*(link.name for link in arm.links), arm.tool]
    for parent, child in pairwise(chain):
        outer, inner = find_body(rigid, root, parent), find_body(rigid, root, child)
        if inner not in outer.findall("body"):
            problem = f"expected as a direct child of body {parent!r}"
            raise InputError(rigid, f"<body name={child!r}>", problem)
        if outer.find("inertial") is None:
            raise InputError(rigid, f"<body name={parent!r}>", "expected an <inertial>")
    tool = find_body(rigid, root, arm.tool)
    children = [b.get("name") for b in tool.findall("body")]
    for name in (arm.load_point, *arm.markers):
        if name not in children:
            kind = "load point" if name == arm.load_point else "marker"
            raise InputError(
                rigid, f"<body name={arm.tool!r}>", f"no {kind} {name!r}; bodies are {some_of(children)}"
            )
        find_body(rigid, root, name)
    expected, names = [j.name for j in arm.joints], [j.get("name") for j in root.iter("joint")]
    if len(names) != len(expected):
        raise InputError(
            rigid, "<joint>", f"expected the joints {some_of(expected)} and no other, got {some_of(names)}"
        )


def _chain_length(mjcf_path: Path, root: ET.Element, arm: Arm) -> float:
    """Compute the length of an arm's chain from the base to the tool, with its slides fully extended.

    Args:
        mjcf_path: Path of the MJCF, for messages.
        root: Root element of the MJCF.
        arm: Names of the bodies, and the joints' limits.

    Returns:
        Sum of the distances between successive bodies, and of the largest strokes of the slides [m].
    """
    bodies = [find_body(mjcf_path, root, name) for name in (*(link.name for link in arm.links[1:]), arm.tool)]
    steps = [attribute_numbers(mjcf_path, body, "pos", 3) for body in bodies if "pos" in body.attrib]
    slides = [max(abs(j.lower), abs(j.upper)) for j in arm.joints if j.prismatic]
    return sum(math.hypot(*step) for step in steps) + sum(slides)


def _check_lengths(path: Path, elastic: ElasticDocument, arm_length: float) -> None:
    for index, link in enumerate(elastic.link):
        if link.tube is not None and link.tube.length.value > MAX_TUBE_LENGTH_RATIO * arm_length > 0:
            got = f"got {link.tube.length.value:g} m; the whole arm is {arm_length:.3g} m long"
            place = link_place(path, index, link, "tube", "length")
            raise InputError(
                path, place, f"expected at most {MAX_TUBE_LENGTH_RATIO * arm_length:.3g} m, {got}"
            )
