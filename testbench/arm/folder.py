"""The description of an arm that truth and model share: names, limits, frames, compliances.

An arm is a folder: `rigid.xml` (MJCF: kinematics, masses, geometry) and `elastic.toml` (which body is
which link, and the true compliances, each number with its unit and origin).
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

from testbench.arm.elastic import Elastic, JointEntry, LinkEntry, beam_frame, link_place, read_elastic
from testbench.arm.joint_map import JointMap, build_map, file_limits, narrowed
from testbench.arm.lines import toml_place
from testbench.arm.mjcf import angle_unit, find_body, numbers, read_mjcf
from testbench.arm.stiffness import Tube, check_compliance, tube_compliance
from testbench.display import Displayed
from testbench.errors import (
    Array,
    BenchError,
    InputError,
    Mask,
    PoseError,
    check_array,
    check_least,
    cut,
    shown,
)

PACKAGE = Path(__file__).resolve().parents[1]
FOLDERS = (PACKAGE / "models", PACKAGE.parent / "models")
"""Where they are: a wheel brings them inside the package."""


def find_arm(name: str | Path) -> Path:
    """The folder of an arm, by its path or the name of one that comes with testbench; it is not read.

    Raises:
        InputError: When there is neither.
    """
    if os.path.isdir(name):  # noqa: PTH112 - a name too long is no folder either
        return Path(name)
    found = {folder.name: folder for root in FOLDERS if root.is_dir() for folder in sorted(root.iterdir())}
    if str(name) in found:
        return found[str(name)]
    ours = ", ".join(sorted(found))
    raise InputError(Path(name), "", f"expected a folder with rigid.xml and elastic.toml, or one of {ours}")


@dataclass(frozen=True)
class Link:
    """An elastic link; its virtual joint sits at its end, directly before the next joint (Eq. 1)."""

    name: str  #: Its body in rigid.xml.
    frame: Array  #: Beam axes x, y, z as columns, in the body's axes, (3, 3) [1].
    compliance: Array  #: True compliance in the beam frame at the link's end, (6, 6) [m/N, rad/(N m)].


@dataclass(frozen=True)
class Joint:
    """An actuated joint with a spring beside it: a hinge, or a slide."""

    name: str  #: The hinge or slide in rigid.xml.
    lower: float  #: Lower limit [rad, m].
    upper: float  #: Upper limit [rad, m].
    compliance: float  #: True compliance [rad/(N m), m/N].
    prismatic: bool = False  #: Whether it is a slide.

    @property
    def unit(self) -> Literal["rad", "m"]:
        """Unit of its coordinate."""
        return "m" if self.prismatic else "rad"

    @property
    def column(self) -> str:
        """Name of its column in a file, such as joint_2_rad."""
        return f"{self.name}_{self.unit}"

    @property
    def shown_unit(self) -> Literal["deg", "mm"]:
        """Unit in which people read its coordinate."""
        return "mm" if self.prismatic else "deg"

    @property
    def shown_column(self) -> str:
        """Name of a column in that unit, such as joint_2_deg."""
        return f"{self.name}_{self.shown_unit}"

    @property
    def shown(self) -> float:
        """So many of these in one of its unit."""
        return 1e3 if self.prismatic else 180 / math.pi


@dataclass(frozen=True)
class Compensator:
    """A spring from link 1 to link 2 that helps joint 2 to carry the arm."""

    foot: Sequence[float]  #: Where it is hinged on link 1, in that body's axes, (3,) [m].
    head: Sequence[float]  #: Where it is hinged on link 2, in that body's axes, (3,) [m].
    rate: float  #: Change of force over change of length as joint 2 turns [N/m].
    rest_length: float  #: Length without force [m].
    #: Change of force over change of length as the true arm deflects [N/m]; None for the rate.
    stiffness: float | None = None

    def __post_init__(self) -> None:
        for name in ("foot", "head"):
            check_array(getattr(self, name), (3,), f"{name} of the compensator [m]")
        for name in ("rate", "rest_length", "stiffness"):
            value = getattr(self, name)
            check_least(0.0 if value is None else value, f"{name} of the compensator")


@dataclass(frozen=True, repr=False)
class Arm(Displayed):
    """A serial arm of n actuated joints and n + 1 elastic links."""

    name: str  #: The folder's name.
    title: str  #: For people.
    rigid: Path  #: Path of the rigid MJCF.
    links: tuple[Link, ...]  #: From the base to the flange, n + 1.
    joints: tuple[Joint, ...]  #: From the base to the flange, n.
    tool: str  #: Body of the tool's centre point, a child of the last link.
    load: str  #: Body at whose origin a hung weight acts.
    markers: tuple[str, ...]  #: Bodies that the tracker reads.
    payload: float | None = None  #: Rated payload [kg]; None where elastic.toml states none.
    compensator: Compensator | None = None  #: Beside joint 2; None where elastic.toml states none.
    #: What its joints are in those of files; None where they are the same.
    joint_map: JointMap | None = None

    def about(self) -> dict[str, object]:
        """Name, joints, markers and payload."""
        own = {"name": self.name, "joints": self.n_joints, "markers": " ".join(self.markers)}
        return own | ({} if self.payload is None else {"payload_kg": self.payload})

    @property
    def n_joints(self) -> int:
        """Number of actuated joints, n."""
        return len(self.joints)

    @property
    def n_theta(self) -> int:
        """Number of virtual joint coordinates: 6 a link, then 1 a joint; 48 for six joints."""
        return 6 * len(self.links) + len(self.joints)

    @property
    def C_theta(self) -> Array:
        """True aggregated joint compliance, block diagonal, (n_theta, n_theta), Eq. (17)."""
        C = np.zeros((self.n_theta, self.n_theta))
        for i, link in enumerate(self.links):
            C[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = link.compliance
        first = 6 * len(self.links)
        C[range(first, self.n_theta), range(first, self.n_theta)] = [j.compliance for j in self.joints]
        return C

    @property
    def file_joints(self) -> tuple[Joint, ...]:
        """The joints of files, programs and pendants, m of them, without compliance; else `joints`."""
        if self.joint_map is None:
            return self.joints
        ends = file_limits(self.joint_map, self.joints).T.tolist()
        rows = zip(self.joint_map.names, ends, self.joint_map.prismatic, strict=True)
        return tuple(Joint(name, low, high, math.nan, slides) for name, (low, high), slides in rows)

    def to_model(self, q: Array) -> Array:
        """Joints of the chain from those of files, L q_file + q_0, (..., m) to (..., n) [rad, m]."""
        return q if self.joint_map is None else self.joint_map.to_model(q)

    def to_file(self, q: Array) -> Array:
        """Joints of files from those of the chain, (..., n) to (..., m) [rad, m]."""
        return q if self.joint_map is None else self.joint_map.to_file(q)

    def change_to_file(self, change: Array) -> Array:
        """A change of file joints from that of the chain's joints, (..., n) to (..., m) [rad, m]."""
        return change if self.joint_map is None else self.joint_map.change_to_file(change)

    @property
    def scale(self) -> Array:
        """What makes file joints those that people read, deg of rad and mm of m, (m,)."""
        return np.array([joint.shown for joint in self.file_joints])

    def shown(self, q: Array) -> Array:
        """File joints as people read them, (..., n) [rad, m] of the chain to (..., m) [deg, mm]."""
        return self.scale * self.to_file(q)

    def from_shown(self, values: Array) -> Array:
        """Joints of the chain from file joints as people write them, (..., m) [deg, mm] to (..., n)."""
        return self.to_model(values / self.scale)

    def room(self, q: Array) -> Array:
        """How far each file joint alone is from where a joint of the chain ends, (poses, m) [deg, mm]."""
        slack = np.minimum(q - self.limits[0], self.limits[1] - q)
        if self.joint_map is not None:
            L = np.abs(self.joint_map.L)
            slack = np.min(
                slack[:, :, None] / np.where(L > 0, L, np.nan), axis=1, where=L > 0, initial=np.inf
            )
        return np.asarray(self.scale * slack)

    def words(self, q: Array) -> str:
        """A pose, (n,) [rad, m], for people: file joints in degrees, and millimetres where they slide."""
        values, joints = self.shown(q).round(2).tolist(), self.file_joints
        if not any(joint.prismatic for joint in joints):
            return f"{values} deg"
        named = (f"{x} {joint.shown_unit}" for x, joint in zip(values, joints, strict=True))
        return f"[{', '.join(named)}]"

    @property
    def limits(self) -> Array:
        """Lower and upper joint limits, (2, n) [rad, m]."""
        return np.array([[j.lower for j in self.joints], [j.upper for j in self.joints]])

    @property
    def moves(self) -> Array | None:
        """How all joints move as the free ones do, (n, n); None where none follows others."""
        return None if self.joint_map is None or self.joint_map.square else self.joint_map.moves

    @property
    def turns(self) -> Mask:
        """Hinges whose full turns leave the pose of the arm as it is, (n,): those that no joint follows."""
        hinges = np.array([not joint.prismatic for joint in self.joints], dtype=bool)
        return hinges if self.moves is None else hinges & (np.count_nonzero(self.moves, axis=0) == 1)

    def followed(self, q: Array) -> Array:
        """Poses, (..., n) [rad, m], with joints that follow others where these bring them."""
        return q if self.joint_map is None else self.joint_map.followed(q)

    def within(self, q: Array) -> Array:
        """The nearest joints within the limits, (..., n) [rad, m]; those that follow others do so."""
        return self.followed(np.clip(q, *self.limits))

    def drawn(self, rng: np.random.Generator, count: int) -> Array:
        """Poses drawn evenly over the joint limits, (count, n) [rad, m].

        Raises:
            PoseError: When joints that follow others leave their limits in nearly all poses.
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


KINDS = "hinge", "slide"
COMPLIANCE_UNIT = "rad/(N m)", "m/N"
"""MJCF's types of joints, and the units of their compliances."""

FARTHEST = 1000.0  #: No joint turns or slides farther [rad, m].
LONGEST_TITLE = 200  #: Characters of a title.
REDRAWN = 300  #: Times that poses beyond the limits of joints that follow others are drawn again.
LONGEST = 3.0  #: No tube is longer than so many times the whole arm [1].


def load_arm(folder: str | Path) -> Arm:
    """Read and check an arm's folder.

    Args:
        folder: Holds rigid.xml and elastic.toml, or the name of an arm that comes with testbench.

    Returns:
        The arm, every body, joint and marker known to be in the MJCF and in chain order.

    Raises:
        InputError: Names the file, the place and what was expected.
    """
    folder = find_arm(folder)
    toml_path, rigid = folder / "elastic.toml", folder / "rigid.xml"
    elastic, root = read_elastic(toml_path), read_mjcf(rigid)
    spring = elastic.compensator
    arm = Arm(
        name=shown(folder.resolve().name),
        title=cut(shown(elastic.title), LONGEST_TITLE),
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
    _check_lengths(toml_path, elastic, stretched(rigid, root, arm))
    return _mapped(toml_path, elastic, arm)


OFFSETS = "offset_deg", "offset_mm"  #: Keys of a row's offset, of a hinge and of a slide.


def _mapped(path: Path, elastic: Elastic, arm: Arm) -> Arm:
    """The arm with the joints of files that [joints] of elastic.toml states."""
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
        found = build_map(arm.joints, rows, q_0)
        if found is None:
            return arm
        limits = narrowed(found, arm.joints).T.tolist()
    except BenchError as err:
        raise InputError(path, place, str(err)) from err
    joints = [replace(j, lower=low, upper=high) for j, (low, high) in zip(arm.joints, limits, strict=True)]
    return replace(arm, joints=tuple(joints), joint_map=found)


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


def _joint(rigid: Path, root: ET.Element, joint: JointEntry, body: str) -> Joint:
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
        f"expected a hinge or a slide, got {own.get('type')!r}": own.get("type", "hinge") not in KINDS,
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
        problem = f"expected {COMPLIANCE_UNIT[prismatic]} for a {KINDS[prismatic]}"
        place = f"joint ({joint.name}) compliance.unit"
        raise InputError(rigid.with_name("elastic.toml"), place, f"{problem}, got {joint.compliance.unit}")
    return Joint(joint.name, lower, upper, joint.compliance.value, prismatic)


def _check_chain(rigid: Path, root: ET.Element, arm: Arm) -> None:
    """Base, links and tool nest in order; load and markers are rigid children of the tool."""
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


def stretched(rigid: Path, root: ET.Element, arm: Arm) -> float:
    """Length of the chain from the base to the tool, its slides run out [m]."""
    bodies = [find_body(rigid, root, name) for name in (*(link.name for link in arm.links[1:]), arm.tool)]
    steps = [numbers(rigid, body, "pos", 3) for body in bodies if "pos" in body.attrib]
    slides = [max(abs(j.lower), abs(j.upper)) for j in arm.joints if j.prismatic]
    return sum(math.hypot(*step) for step in steps) + sum(slides)


def _check_lengths(path: Path, elastic: Elastic, whole: float) -> None:
    for index, link in enumerate(elastic.link):
        if link.tube is not None and link.tube.length.value > LONGEST * whole > 0:
            got = f"got {link.tube.length.value:g} m; the whole arm is {whole:.3g} m long"
            place = link_place(path, index, link, "tube", "length")
            raise InputError(path, place, f"expected at most {LONGEST * whole:.3g} m, {got}")
