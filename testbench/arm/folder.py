"""The description of an arm that truth and model share: names, limits, frames, compliances.

An arm is a folder with `rigid.xml` (MJCF: kinematics, masses, geometry) and `elastic.toml` (which body is
which link, and the true compliances, each number with its unit and origin). `load_arm` reads it.
"""

import math
import os
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from testbench.arm.document import toml_place
from testbench.arm.elastic import (
    Elastic,
    JointEntry,
    LinkEntry,
    Tube,
    beam_frame,
    check_compliance,
    link_place,
    read_elastic,
    tube_compliance,
)
from testbench.arm.joint_map import JointMap, build_map, file_limits, narrowed
from testbench.arm.mjcf import angle_unit, find_body, numbers, read_mjcf
from testbench.display import Displayed
from testbench.errors import (
    Array,
    BenchError,
    InputError,
    Mask,
    PoseError,
    check_array,
    check_least,
    check_type,
    printable,
    shorten,
)

PACKAGE = Path(__file__).resolve().parents[1]
FOLDERS = (PACKAGE / "models", PACKAGE.parent / "models")
"""Folders of the arms that come with testbench: a wheel has them inside the package."""


def find_arm(name: str | Path) -> Path:
    """Find the folder of an arm, without reading it.

    Args:
        name: Path of the folder, or name of an arm that comes with testbench.

    Returns:
        The folder.

    Raises:
        InputError: When there is neither.
        BenchError: When it is neither text nor a path.
    """
    check_type(name, (str, Path), "arm")
    if os.path.isdir(name):  # noqa: PTH112 - a name too long is no folder either
        return Path(name)
    found = {folder.name: folder for root in FOLDERS if root.is_dir() for folder in sorted(root.iterdir())}
    if str(name) in found:
        return found[str(name)]
    ours = ", ".join(sorted(found))
    raise InputError(Path(name), "", f"expected a folder with rigid.xml and elastic.toml, or one of {ours}")


@dataclass(frozen=True)
class Link:
    """Describe an elastic link; its virtual joint sits at its end, directly before the next joint (Eq. 1)."""

    name: str  #: Name of its body in rigid.xml.
    frame: Array  #: Beam axes x, y, z as columns, in the body's axes, (3, 3) [1].
    #: True compliance in the beam frame at the link's end, (6, 6) [m/N, rad/N, rad/(N m)].
    compliance: Array


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


@dataclass(frozen=True)
class Compensator:
    """Describe a spring from link 1 to link 2 that helps joint 2 to carry the arm."""

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
    rigid: Path  #: Path of the rigid MJCF.
    links: tuple[Link, ...]  #: From the base to the flange, n + 1.
    joints: tuple[ArmJoint, ...]  #: From the base to the flange, n.
    tool: str  #: Body of the tool's centre point, a child of the last link.
    load: str  #: Body at whose origin a hung weight acts: the load point.
    markers: tuple[str, ...]  #: Bodies that the tracker reads, the markers.
    payload: float | None = None  #: Rated payload [kg]; None where elastic.toml states none.
    compensator: Compensator | None = None  #: Compensator of joint 2; None if elastic.toml states none.
    #: Map from file joints to its joints; None where they are the same.
    joint_map: JointMap | None = None

    def about(self) -> dict[str, object]:
        """Summarise the arm by name, joints, markers and rated payload."""
        own = {"name": self.name, "joints": self.n_joints, "markers": " ".join(self.markers)}
        return own | ({} if self.payload is None else {"payload_kg": self.payload})

    @property
    def n_joints(self) -> int:
        """Return the number of actuated joints, n."""
        return len(self.joints)

    @property
    def n_theta(self) -> int:
        """Return the number of virtual joints, 7 n + 6: six per link, then one per joint; 48 for n = 6."""
        return 6 * len(self.links) + len(self.joints)

    @property
    def C_theta(self) -> Array:
        """Assemble the true aggregated joint compliance of Eq. (6), block diagonal.

        Its shape is (n_theta, n_theta) [m/N, rad/N, rad/(N m)]: a 6x6 block per link, then one entry per
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
        """Return the joints as files, programs and pendants count them, m of them.

        Without a joint map they are `joints`. With one their compliance is NaN.
        """
        if self.joint_map is None:
            return self.joints
        ends = file_limits(self.joint_map, self.joints).T.tolist()
        rows = zip(self.joint_map.names, ends, self.joint_map.prismatic, strict=True)
        return tuple(ArmJoint(name, low, high, math.nan, slides) for name, (low, high), slides in rows)

    def to_model(self, q: Array) -> Array:
        """Convert file joints to chain joints, q = L q_file + q_0.

        Args:
            q: File joints, (..., m) [rad, m].

        Returns:
            Chain joints, (..., n) [rad, m].
        """
        return q if self.joint_map is None else self.joint_map.to_model(q)

    def to_file(self, q: Array) -> Array:
        """Convert chain joints to file joints.

        Args:
            q: Chain joints, (..., n) [rad, m].

        Returns:
            File joints, (..., m) [rad, m].
        """
        return q if self.joint_map is None else self.joint_map.to_file(q)

    def change_to_file(self, change: Array) -> Array:
        """Convert a change of chain joints to a change of file joints, without offsets.

        Args:
            change: Change of chain joints, (..., n) [rad, m].

        Returns:
            Change of file joints, (..., m) [rad, m].
        """
        return change if self.joint_map is None else self.joint_map.change_to_file(change)

    @property
    def scale(self) -> Array:
        """Return the factors from file joints in SI units to those that people read, (m,) [deg/rad, mm/m]."""
        return np.array([joint.shown for joint in self.file_joints])

    def shown(self, q: Array) -> Array:
        """Convert chain joints to file joints in the units that people read.

        Args:
            q: Chain joints, (..., n) [rad, m].

        Returns:
            File joints, (..., m) [deg, mm].
        """
        return self.scale * self.to_file(q)

    def from_shown(self, values: Array) -> Array:
        """Convert file joints in the units that people write to chain joints.

        Args:
            values: File joints, (..., m) [deg, mm].

        Returns:
            Chain joints, (..., n) [rad, m].
        """
        return self.to_model(values / self.scale)

    def room(self, q: Array) -> Array:
        """Compute how far each file joint alone may move until a chain joint reaches its limit.

        Args:
            q: Chain joints, (poses, n) [rad, m].

        Returns:
            Distance to the nearest limit, negative beyond it, (poses, m) [deg, mm].
        """
        # slack of every chain joint; over |L| it is the way of a file joint that uses it up
        slack = np.minimum(q - self.limits[0], self.limits[1] - q)
        if self.joint_map is not None:
            L = np.abs(self.joint_map.L)
            slack = np.min(
                slack[:, :, None] / np.where(L > 0, L, np.nan), axis=1, where=L > 0, initial=np.inf
            )
        return np.asarray(self.scale * slack)

    def words(self, q: Array) -> str:
        """Write a pose for people: file joints in degrees, and in millimetres where they slide.

        Args:
            q: Chain joints of one pose, (n,) [rad, m].

        Returns:
            The text, rounded to two decimals.
        """
        values, joints = self.shown(q).round(2).tolist(), self.file_joints
        if not any(joint.prismatic for joint in joints):
            return f"{values} deg"
        named = (f"{x} {joint.shown_unit}" for x, joint in zip(values, joints, strict=True))
        return f"[{', '.join(named)}]"

    @property
    def limits(self) -> Array:
        """Return lower and upper limits of the chain joints, (2, n) [rad, m]."""
        return np.array([[j.lower for j in self.joints], [j.upper for j in self.joints]])

    @property
    def moves(self) -> Array | None:
        """Return how all joints move with the free ones, (n, n) [1]; None where no joint follows others."""
        return None if self.joint_map is None or self.joint_map.square else self.joint_map.moves

    @property
    def turns(self) -> Mask:
        """Tell which hinges may turn by whole turns without changing the arm's pose, (n,).

        These are the hinges that no other joint follows.
        """
        hinges = np.array([not joint.prismatic for joint in self.joints], dtype=bool)
        return hinges if self.moves is None else hinges & (np.count_nonzero(self.moves, axis=0) == 1)

    def followed(self, q: Array) -> Array:
        """Move dependent joints to where the joints that they follow bring them.

        Args:
            q: Chain joints, (..., n) [rad, m].

        Returns:
            Chain joints, (..., n) [rad, m]; unchanged without dependent joints.
        """
        return q if self.joint_map is None else self.joint_map.followed(q)

    def within(self, q: Array) -> Array:
        """Clip joints to their limits, then move dependent joints to where the others bring them.

        Args:
            q: Chain joints, (..., n) [rad, m].

        Returns:
            Chain joints, (..., n) [rad, m].
        """
        return self.followed(np.clip(q, *self.limits))

    def drawn(self, rng: np.random.Generator, count: int) -> Array:
        """Draw poses evenly over the joint limits.

        Args:
            rng: Source of the poses.
            count: Number of poses.

        Returns:
            Chain joints, (count, n) [rad, m], all within the limits.

        Raises:
            PoseError: When dependent joints leave their limits in nearly all poses.
        """
        lower, upper = self.limits
        q = self.followed(rng.uniform(lower, upper, (count, self.n_joints)))
        for _ in range(REDRAWN if self.moves is not None else 0):
            beyond = np.flatnonzero(((q < lower) | (q > upper)).any(axis=1))
            if not len(beyond):
                return q
            q[beyond] = self.followed(rng.uniform(lower, upper, (len(beyond), self.n_joints)))
        if self.moves is not None:
            raise PoseError(f"{self.name}: joints that follow others leave their limits in nearly all poses")
        return q


JOINT_KINDS = "hinge", "slide"
COMPLIANCE_UNIT = "rad/(N m)", "m/N"
"""MJCF's types of joints, and the units of their compliances."""

FARTHEST = 1000.0  #: Largest joint limit or offset [rad, m].
LONGEST_TITLE = 200  #: Most characters of a title.
REDRAWN = 300  #: Most times that poses with a dependent joint beyond its limits are drawn again.
MAX_TUBE_RATIO = 3.0  #: Largest length of a tube over that of the whole arm [1].


def load_arm(folder: str | Path) -> Arm:
    """Read and check an arm's folder.

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
        title=shorten(printable(elastic.title), LONGEST_TITLE),
        rigid=rigid,
        links=tuple(_link(toml_path, i, link) for i, link in enumerate(elastic.link)),
        joints=tuple(
            _joint(rigid, root, joint, link.name)
            for joint, link in zip(elastic.joint, elastic.link[1:], strict=True)
        ),
        tool=elastic.tool,
        load=elastic.load,
        markers=tuple(elastic.markers),
        payload=None if elastic.payload is None else elastic.payload.value,
        compensator=None if spring is None else Compensator(**{k: v.value for k, v in spring}),
    )
    if arm.compensator is not None and (len(arm.links) < 3 or arm.joints[1].prismatic):
        place = toml_place(toml_path, ["compensator"])
        raise InputError(toml_path, place, "expected an arm whose link 1 and link 2 a hinge joins")
    _check_chain(rigid, root, arm)
    _check_lengths(toml_path, elastic, chain_length(rigid, root, arm))
    return _mapped(toml_path, elastic, arm)


OFFSETS = "offset_deg", "offset_mm"  #: Keys of a row's offset, for a hinge and for a slide.


def _mapped(path: Path, elastic: Elastic, arm: Arm) -> Arm:
    """Give the arm the file joints that [joints] of elastic.toml states."""
    known, q_0 = {joint.name: joint for joint in arm.joints}, dict[str, float]()
    rows = {name: dict(row) for name, row in elastic.joints.items()}
    for name, row in rows.items():
        place = toml_place(path, ["joints", name])
        if name not in known:
            raise InputError(path, place, f"expected one of the joints {', '.join(known)}, got {name!r}")
        own, other = OFFSETS[:: -1 if known[name].prismatic else 1]
        if other in row:
            raise InputError(path, place, f"expected {own} of this joint, got {other}")
        q_0[name] = row.pop(own, 0.0) / known[name].shown
        if abs(q_0[name]) > FARTHEST:
            raise InputError(path, place, f"expected offsets up to {FARTHEST:g} rad or m")
    place = toml_place(path, ["joints"])
    try:
        joint_map = build_map(arm.joints, rows, q_0)
        if joint_map is None:
            return arm
        limits = narrowed(joint_map, arm.joints).T.tolist()
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
    found = find_body(rigid, root, body).findall("joint")
    names = [j.get("name") for j in found]
    if names != [joint.name]:
        problem = f"expected exactly the joint {joint.name!r} of elastic.toml, got {names}"
        raise InputError(rigid, f"<body name={body!r}>", problem)
    [own] = found
    prismatic = own.get("type", "hinge") == "slide"
    unit = 1.0 if prismatic else angle_unit(root)
    lower, upper = (x * unit for x in numbers(rigid, own, "range", 2))
    moved = "pos" in own.attrib and any(numbers(rigid, own, "pos", 3))
    problems = {
        f"expected a hinge or a slide, got {own.get('type')!r}": own.get("type", "hinge") not in JOINT_KINDS,
        "expected no pos: the body's origin lies on the joint": moved,
        "axis: expected a direction, got zero": not any(numbers(rigid, own, "axis", 3)),
        f"range: expected lower < upper, got {own.get('range')!r}": not lower < upper,
        f"range: expected limits up to {FARTHEST:g} rad or m, got {own.get('range')!r}": (
            max(abs(lower), abs(upper)) > FARTHEST
        ),
    }
    if wrong := [problem for problem, there in problems.items() if there]:
        raise InputError(rigid, f"<joint name={joint.name!r}>", wrong[0])
    if joint.compliance.unit != COMPLIANCE_UNIT[prismatic]:
        problem = f"expected {COMPLIANCE_UNIT[prismatic]} for a {JOINT_KINDS[prismatic]}"
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
    for name in (arm.load, *arm.markers):
        if name not in children:
            kind = "load point" if name == arm.load else "marker"
            raise InputError(rigid, f"<body name={arm.tool!r}>", f"no {kind} {name!r}; bodies are {children}")
        find_body(rigid, root, name)
    expected, names = [j.name for j in arm.joints], [j.get("name") for j in root.iter("joint")]
    if len(names) != len(expected):
        raise InputError(rigid, "<joint>", f"expected the joints {expected} and no other, got {names}")


def chain_length(rigid: Path, root: ET.Element, arm: Arm) -> float:
    """Compute the length of the chain from the base to the tool, with its slides fully extended.

    Args:
        rigid: Path of the MJCF, for messages.
        root: Root element of the MJCF.
        arm: Names of the bodies, and the joints' limits.

    Returns:
        Sum of all steps between bodies and of the largest ways of the slides [m].
    """
    bodies = [find_body(rigid, root, name) for name in (*(link.name for link in arm.links[1:]), arm.tool)]
    steps = [numbers(rigid, body, "pos", 3) for body in bodies if "pos" in body.attrib]
    slides = [max(abs(j.lower), abs(j.upper)) for j in arm.joints if j.prismatic]
    return sum(math.hypot(*step) for step in steps) + sum(slides)


def _check_lengths(path: Path, elastic: Elastic, whole: float) -> None:
    for index, link in enumerate(elastic.link):
        if link.tube is not None and link.tube.length.value > MAX_TUBE_RATIO * whole > 0:
            got = f"got {link.tube.length.value:g} m; the whole arm is {whole:.3g} m long"
            place = link_place(path, index, link, "tube", "length")
            raise InputError(path, place, f"expected at most {MAX_TUBE_RATIO * whole:.3g} m, {got}")
