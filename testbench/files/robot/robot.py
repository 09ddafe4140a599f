"""A robot as a list of bodies in SI units, whatever the format of its file, and the serial chain in it.

Joints of a robot's file that move together: URDF's mimic, MJCF's equalities of joints and fixed tendons.

All are linear equations between joints. Solved for the joints of the arm they are its `JointMap`. Closed
loops and nonlinear equations are refused, unless they concern only branches off the arm.
"""

import codecs
import math
import os
import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial, reduce
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from testbench.arm.document import parse_xml
from testbench.arm.folder import ArmJoint, JointMap, build_joint_map, independent_rows
from testbench.errors import Array, BenchError, InputError, read_bytes, read_text, shell_word, some_of
from testbench.plant.shapes import Faces, GeomKind, Surface

# --- XML of a robot's file, whatever its format: limited in size, well-formed, with finite numbers ----------

MAX_BYTES = 16_000_000
MOST_OF = {"geometry": 2000, "geom": 2000, "joint": 500, "body": 500}
"""Most elements of a kind: MuJoCo's time grows with the cube of bodies in a row."""
MAX_PACKAGE = 1_000_000
"""Largest package.xml [byte]."""
UP = 8
"""Folders above the URDF in which a package is searched."""
ENCODING = re.compile(rb"""(?:\xef\xbb\xbf)?\s*<\?xml\s[^>]{0,200}?encoding\s*=\s*["']([\w.-]{1,40})["']""")
"""Encoding that an XML file states."""
OTHER_KINDS = {
    b"ISO-10303": "a STEP file, which has no joints",
    b"#usda": "USD: export the robot as URDF or MJCF",
    b"PXR-USDC": "USD: export the robot as URDF or MJCF",
    b"#VRML": "a model of Webots or VRML: export the robot as URDF",
    b"PK": "a zip file or a workbook",
    b"%PDF": "a PDF",
    b"solid": "a mesh (STL), which has no joints",
    b"version https://git-lfs": "a pointer of Git LFS in place of the file: git lfs pull fetches it",
}
"""Beginnings of files that are often taken for a robot's file."""
HTML = re.compile("<!doctype html|<html", re.IGNORECASE)
FIND = re.compile(r"\$\(find ([\w-]+)\)")
"""Reference to a package in xacro."""


def read_xml(file: Path) -> ET.Element:
    """Read the root element of a file.

    Args:
        file: The URDF or MJCF.

    Returns:
        The root element.

    Raises:
        InputError: If the file is missing, too large, not well-formed, or has more elements than a robot can.
    """
    text = _text(file)
    start = text.strip("\ufeff \t\r\n")
    if not start.startswith("<"):
        problem = "expected a URDF or MJCF, which begin with <; how to write a DH table as URDF is in"
        raise InputError(file, "", f"{problem} docs/robot_files.md" if start else "the file is empty")
    said = re.sub("<!--.*?-->", "", text, flags=re.DOTALL)
    if HTML.match(start):
        raise InputError(file, "", "expected a URDF or MJCF, got a web page: save the raw file")
    if "<xacro:" in said or "${" in said or file.suffix == ".xacro":
        raise InputError(file, "", f"this is xacro; expand it first: {_expand(file, text)}")
    root = parse_xml(file, text)
    for tag, most in MOST_OF.items():
        if (count := sum(1 for _ in root.iter(tag))) > most:
            raise InputError(file, f"<{tag}>", f"expected at most {most} in a robot, got {count}")
    return root


def _text(file: Path) -> str:
    """Read the text of an XML file in the encoding that it states; name what other files are."""
    content = read_bytes(file, MAX_BYTES)
    for begins, kind in OTHER_KINDS.items():
        if content.startswith(begins):
            raise InputError(file, "", f"expected a URDF or MJCF, got {kind}")
    stated = ENCODING.match(content)
    try:
        if content[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
            return content.decode("utf-16")
        return content.decode(stated[1].decode() if stated else "utf-8-sig").removeprefix("\ufeff")
    except UnicodeDecodeError as err:
        expected = f"expected {stated[1].decode() if stated else 'UTF-8'}"
        raise InputError(file, f"byte {err.start + 1}", f"{expected}: {err.reason}") from err
    except (LookupError, UnicodeError) as err:
        raise InputError(file, "", f"not well-formed XML: {err}") from err


def _expand(file: Path, text: str) -> str:
    """Write the command that expands xacro without ROS, with the folders of the packages in the file."""
    target = file.with_name(f"{file.name.split('.')[0]}_expanded.urdf")
    found = [packages(Path(os.path.realpath(file)).parent, name) for name in FIND.findall(text)]
    where = dict.fromkeys(f" -d {shell_word(roots[0].parent)}" for roots in found if roots)
    done = f"xacrodoc {shell_word(file)}{''.join(where)} -o {shell_word(target)}"
    return f"pip install xacrodoc; {done}; arguments of the file follow as NAME:=VALUE"


def packages(folder: Path, name: str) -> list[Path]:
    """Find the folders of a ROS package, searching from the URDF's folder upwards.

    A folder counts if it has the package's name, or if its package.xml states that name.

    Args:
        folder: Folder of the URDF.
        name: Name of the package.

    Returns:
        The folders, nearest first; empty if there are none.
    """
    if name in ("", ".", ".."):
        return []
    paths = []
    for above in [folder, *folder.parents][:UP]:
        paths += [root for root in (above, above / name) if root.name == name and root.is_dir()]
        if _package_name(above / "package.xml") == name:
            paths.append(above)
    return paths


def _package_name(file: Path) -> str:
    try:
        return (parse_xml(file, read_text(file, MAX_PACKAGE)).findtext("name") or "").strip()
    except InputError:  # there is none, or it is none
        return ""


# --- Joints that MuJoCo couples: equalities of joints, of fixed tendons, and closed loops -------------------

LOOPS = {int(mujoco.mjtEq.mjEQ_CONNECT): "connect", int(mujoco.mjtEq.mjEQ_WELD): "weld"}
JOINT, SITE = int(mujoco.mjtWrap.mjWRAP_JOINT), int(mujoco.mjtWrap.mjWRAP_SITE)
ENDS = SITE, int(mujoco.mjtWrap.mjWRAP_SPHERE), int(mujoco.mjtWrap.mjWRAP_CYLINDER)
"""What a tendon leads over: joints of one that is fixed, sites and geoms of one in space."""


@dataclass(frozen=True, eq=False)
class Coupling:
    """Describe an equation of joints, sum of terms times joints = constant, or a closed loop."""

    label: str  #: Name in messages.
    terms: Mapping[str, float] = field(default_factory=dict)  #: Coefficients by the joints' names [1].
    constant: float = 0.0  #: Right-hand side [rad, m].
    follower: str = ""  #: The dependent joint that the file names; "" for none.
    bent: bool = False  #: Whether it is nonlinear.
    #: The two bodies that a loop ties together, -1 for the world; None for an equation.
    bodies: tuple[int, int] | None = None


def couplings_of(model: mujoco.MjModel, names: Mapping[int, str], index: Mapping[int, int]) -> list[Coupling]:
    """Read the couplings that MuJoCo's equalities and tendons state.

    Args:
        model: The robot, as MuJoCo compiles it.
        names: Our names of its joints, by MuJoCo's id.
        index: Our places of its bodies, by MuJoCo's id.

    Returns:
        The couplings.
    """
    couplings: list[Coupling] = []
    for e in np.flatnonzero(model.eq_active0).tolist():
        kind, label = int(model.eq_type[e]), model.equality(e).name or f"{e + 1}"
        ends = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
        if kind in LOOPS:
            if int(model.eq_objtype[e]) == int(mujoco.mjtObj.mjOBJ_SITE):
                ends = int(model.site_bodyid[ends[0]]), int(model.site_bodyid[ends[1]])
            led = [b for b in ends if model.body_mocapid[b] >= 0]  # a hand that leads the arm, no rod
            bodies = index[ends[0]], index[ends[1]]
            couplings += [Coupling(f"{LOOPS[kind]} {label!r}", bodies=bodies)] if not led else []
        elif kind == int(mujoco.mjtEq.mjEQ_JOINT):
            both = [{end: 1.0} if end >= 0 else {} for end in ends]
            coupling = _equation(model, names, e, both)
            couplings.append(replace(coupling, label=f"joint equality {label!r}", follower=names[ends[0]]))
        elif kind == int(mujoco.mjtEq.mjEQ_TENDON):
            tendons = [end for end in ends if end >= 0]
            coupling = _equation(model, names, e, [_tendon(model, end) if end >= 0 else {} for end in ends])
            bent = coupling.bent or not all(map(partial(_is_fixed, model), tendons))
            couplings.append(replace(coupling, label=f"tendon equality {label!r}", bent=bent))
    return couplings


def _wraps(model: mujoco.MjModel, tendon: int) -> range:
    first = int(model.tendon_adr[tendon])
    return range(first, first + int(model.tendon_num[tendon]))


def _is_fixed(model: mujoco.MjModel, tendon: int) -> bool:
    """Tell whether a tendon's length is a sum of joints; that of a spatial tendon is nonlinear."""
    return all(int(model.wrap_type[k]) == JOINT for k in _wraps(model, tendon))


def _tendon(model: mujoco.MjModel, tendon: int) -> dict[int, float]:
    """Return coefficients of a tendon's joints; for a spatial one 1 for all joints that move its ends."""
    own = [(int(model.wrap_type[k]), int(model.wrap_objid[k]), k) for k in _wraps(model, tendon)]
    if _is_fixed(model, tendon):
        return {j: sum(float(model.wrap_prm[k]) for _, i, k in own if i == j) for _, j, _ in own}
    bodies = [
        model.site_bodyid[i] if kind == SITE else model.geom_bodyid[i] for kind, i, _ in own if kind in ENDS
    ]
    joints = [_joints_above(model, int(b)) for b in bodies]
    shared = joints[0].intersection(*joints) if joints else set[int]()
    return dict.fromkeys(sorted(set[int]().union(*joints) - shared), 1.0)


def _joints_above(model: mujoco.MjModel, body: int) -> set[int]:
    """List joints between the world and a body of MuJoCo."""
    found = set[int]()
    while body:
        first = int(model.body_jntadr[body])
        found |= set(range(first, first + int(model.body_jntnum[body])))
        body = int(model.body_parentid[body])
    return found


def _equation(
    model: mujoco.MjModel, names: Mapping[int, str], e: int, both: Sequence[dict[int, float]]
) -> Coupling:
    """Convert X - x_0 = a_0 + a_1 (y - y_0) + ..., x and y sums of joints, to an equation of the joints."""
    a = model.eq_data[e, :5].tolist()
    terms: dict[str, float] = {}
    constant = a[0]
    for part, factor in zip(both, (1.0, -a[1]), strict=True):
        for j, c in part.items():
            terms[names[j]] = terms.get(names[j], 0.0) + factor * c
            constant += factor * c * float(model.qpos0[model.jnt_qposadr[j]])
    return Coupling("", terms, constant, bent=bool(both[1]) and any(a[2:]))


# --- A robot as a list of bodies in SI units, whatever the format of its file, and the serial chain in it ---


UNLIMITED = 2 * math.pi
"""Limit, each way, of a hinge without stated limits [rad]."""
SLIDE = 1.0
"""Limit, each way, of a slide without stated limits [m]."""
Point = tuple[str, Array]
"""Name and position in the tool's frame, (3,) [m]."""


class Note(NamedTuple):
    """Note how an element of the file was treated; `testbench.workflows.new_arm` puts it into words."""

    kind: str
    names: tuple[str, ...] = ()  #: Names of links, bodies, joints or files.
    numbers: tuple[float, ...] = ()  #: In SI, (1, kg, m, rad) as the kind has them.


@dataclass(frozen=True, eq=False)
class ImportedMesh:
    """Hold triangles of a file in its own unit, or of a primitive [m]."""

    vertices: Array  #: Corners, (v, 3).
    faces: Faces  #: Corner indices of every triangle, (f, 3).
    outer: Array  #: Corners that span the convex hull, (h, 3).
    rgba: Array | None = None  #: Colour if the file states one, (4,) [1].


@dataclass(frozen=True, eq=False)
class ImportedShape:
    """Describe a triangle surface fixed in a body; primitives of the file are converted to one."""

    kind: GeomKind  #: As MuJoCo names it.
    size: Array  #: Of a primitive, as MuJoCo counts it, (3,) [m].
    pose: Array  #: In the body's frame, (4, 4) [m].
    mesh: ImportedMesh  #: Its surface in its own axes.
    rgba: Array  #: Colour, (4,) [1].
    visual: bool  #: Whether it is drawn.
    collides: bool  #: Whether it collides.
    bears: bool = True  #: Whether it belongs to the link, not to a rod of the arm.

    @property
    def surface(self) -> Surface:
        """Return the surface in the body's frame."""
        return transform_points(self.mesh.vertices, self.pose), self.mesh.faces

    @property
    def cloud(self) -> Array:
        """Return corners whose hull is that of the shape, (h, 3) [m]."""
        return transform_points(self.mesh.outer, self.pose)


def visible_shapes(shapes: Sequence[ImportedShape]) -> list[ImportedShape]:
    """Select the shapes that are drawn; if there are none, those that collide.

    Args:
        shapes: Shapes of a body.

    Returns:
        The selected shapes.
    """
    return [s for s in shapes if s.visual] or [s for s in shapes if s.collides]


class ImportedSite(NamedTuple):
    """Describe a named frame on a body: a flange, a tool's centre point, a site, the body itself."""

    name: str  #: Name in the file.
    pose: Array  #: In the body's frame, (4, 4) [m].


@dataclass(frozen=True, eq=False)
class ImportedJoint:
    """Describe the joint that moves a body; its axis passes through the body's origin."""

    name: str  #: Name in the file.
    axis: Array  #: Unit axis in the body's frame, (3,) [1].
    prismatic: bool  #: Whether it slides along the axis; otherwise it turns about it.
    lower: float  #: Lower limit [rad or m].
    upper: float  #: Upper limit [rad or m].
    limited: bool  #: Whether the file states the limits; otherwise they are defaults.
    stated: tuple[float, float] | None = None  #: Limits of the file that are too large to count [rad or m].


@dataclass(frozen=True, eq=False)
class Body:
    """Describe a link or body; parents come before their children."""

    name: str  #: Name in the file.
    parent: int  #: Index of the body before; -1 for the first of a tree.
    pose: Array  #: In the parent at q = 0, (4, 4) [m]; in the world for the first.
    joint: ImportedJoint | None = None  #: Joint that moves it; None for a fixed body.
    odd: str = ""  #: Why its joint cannot be one of the arm, such as "is a free joint"; "" if it can.
    follows: str = ""  #: Name of the joint that its joint mimics.
    mass: float = 0.0  #: [kg]
    com: Array = field(default_factory=lambda: np.zeros(3))  #: Centre of mass in the body's frame, (3,) [m].
    #: Inertia about the centre of mass in the body's axes, (3, 3) [kg m^2].
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))
    weighed: bool = True  #: Whether the file states its mass, or most of it.
    shapes: tuple[ImportedShape, ...] = ()
    sites: tuple[ImportedSite, ...] = ()

    @property
    def moves(self) -> bool:
        """Tell whether the body moves against its parent."""
        return self.joint is not None or bool(self.odd)


@dataclass(frozen=True, eq=False)
class Robot:
    """Hold all bodies of a file."""

    name: str
    bodies: tuple[Body, ...]
    notes: tuple[Note, ...] = ()  #: What the reader left out or replaced.
    couplings: tuple[Coupling, ...] = ()  #: Equations between its joints.
    driven: frozenset[str] = frozenset()  #: Joints with motors, as far as the file states them.


@dataclass(frozen=True, eq=False)
class ImportedChain:
    """Describe a serial arm that was read from a user's file."""

    name: str  #: The robot's name in the file.
    #: From the base to the last link, n + 1, each with all that is fixed to it; the base in the world.
    parts: tuple[Body, ...]
    tip: ImportedSite  #: The link, body or site that carries the tool, in the last part.
    notes: tuple[Note, ...]  #: What was merged, frozen, renamed or estimated.
    joint_map: JointMap | None = None  #: Map of dependent joints; None if there are none.

    @property
    def joints(self) -> list[ImportedJoint]:
        """Return the joints that move its parts, n."""
        return [part.joint for part in self.parts if part.joint]

    @property
    def n_joints(self) -> int:
        """Count the moving joints, n."""
        return len(self.parts) - 1

    @property
    def mass(self) -> float:
        """Return the mass of the whole arm with its base [kg]."""
        return sum(part.mass for part in self.parts)


def substitute_limits(*, prismatic: bool) -> tuple[float, float]:
    """Return limits for a joint whose file states none.

    Args:
        prismatic: Whether the joint is a slide.

    Returns:
        Lower and upper limit [rad, m].
    """
    return (-SLIDE, SLIDE) if prismatic else (-UNLIMITED, UNLIMITED)


def pose_of(rotation: Array, position: Array) -> Array:
    """Combine rotations and positions to homogeneous poses.

    Args:
        rotation: Rotation matrices, (..., 3, 3) [1].
        position: Positions, (..., 3) [m].

    Returns:
        Poses, (..., 4, 4).
    """
    pose = np.zeros((*np.shape(position)[:-1], 4, 4))
    pose[..., :3, :3], pose[..., :3, 3], pose[..., 3, 3] = rotation, position, 1
    return pose


def in_order(poses: Iterable[Array]) -> Array:
    """Multiply poses in order, X_1 X_2 ... X_k.

    Args:
        poses: Homogeneous poses, (4, 4) [m] each.

    Returns:
        The product, (4, 4) [m]; the identity for no pose.
    """
    return np.asarray(reduce(np.matmul, poses, np.eye(4)))


def transform_points(points: Array, pose: Array) -> Array:
    """Transform points from the frame of a body to the frame that its pose refers to.

    Args:
        points: Points in the body's frame, (n, 3) [m].
        pose: Pose of the body, (4, 4) [m].

    Returns:
        The points, (n, 3) [m].
    """
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])


# --- Joints of a robot's file that move together ------------------------------------------------------------

ZERO_COEFFICIENT = 1e-9
"""Coefficient of an equation below which it counts as zero [1]."""
DIGITS = 12
"""Decimals of a coefficient."""
STATE = "leave it out and state how joints depend in [joints] of elastic.toml"
Rows = Mapping[str, tuple[Mapping[str, float], float]]
"""Dependent joints by name: coefficients of the joints that they follow [1], and an offset [rad, m]."""


def map_of(
    file: Path,
    bodies: Sequence[Body],
    path: Sequence[int],
    couplings: Sequence[Coupling],
    driven: Collection[str],
) -> tuple[Rows, list[Coupling]]:
    """Determine how joints of an arm follow others.

    Args:
        file: The robot's file, for messages.
        bodies: All bodies of the robot.
        path: Bodies from the first to the tip.
        couplings: Linear equations between joints that the file states.
        driven: Joints with a motor; if there is a choice, the others follow these.

    Returns:
        The joints that follow others, and the couplings that do not concern the arm.

    Raises:
        InputError: If a loop is closed over a joint of the arm, an equation is not linear, a joint does not
            exist, or equations contradict each other.
    """
    chain = [joint.name for k in path if (joint := bodies[k].joint)]
    _check_loops(file, bodies, chain, couplings)
    left = _needed([own for own in couplings if own.bodies is None], set(chain), set(driven))
    used, known = list[Coupling](), set(chain)
    while more := [own for own in left if own.terms.keys() & known]:
        left = [own for own in left if not own.terms.keys() & known]
        used += more
        known |= {name for own in more for name in own.terms}
    for coupling in used:
        if coupling.bent:
            raise InputError(file, "", f"{coupling.label} is not linear; {STATE}")
    there = {body.joint.name for body in bodies if body.joint}
    if missing := sorted(known - there):
        raise InputError(file, "", f"no joint {missing[0]!r}, which others follow")
    followers = {own.follower for own in used}
    order = [body.joint.name for body in reversed(bodies) if body.joint and body.joint.name in known]
    order.sort(key=lambda name: (name in driven, name not in followers))
    return _solved(file, order, used), list(set(couplings) - set(used))


def _needed(left: list[Coupling], chain: set[str], driven: set[str]) -> list[Coupling]:
    """Drop couplings that only position a joint off the arm: a rod that follows the arm."""

    def is_spare(coupling: Coupling, count: Counter[str]) -> bool:
        takes = {name for name in coupling.terms if count[name] == 1} - chain
        if coupling.follower:
            return coupling.follower in takes
        return not coupling.bent and bool(takes - driven)

    while True:
        count = Counter(name for coupling in left for name in coupling.terms)
        kept = [coupling for coupling in left if not is_spare(coupling, count)]
        if len(kept) == len(left):
            return kept
        left = kept


def _check_loops(
    file: Path, bodies: Sequence[Body], chain: Collection[str], couplings: Sequence[Coupling]
) -> None:
    """Refuse bodies tied together over a joint of the arm; a free body tied once is allowed."""
    ties = [
        (own, set(path_to(bodies, own.bodies[0])) ^ set(path_to(bodies, own.bodies[1])))
        for own in couplings
        if own.bodies is not None
    ]
    floating = Counter(k for _, loop in ties for k in loop if bodies[k].odd)
    for coupling, loop in ties:
        over = {joint.name for k in loop if (joint := bodies[k].joint)}
        free = [k for k in loop if floating[k] == 1]
        if not free and (closed := [name for name in chain if name in over]):
            problem = (
                f"{coupling.label} closes a loop over the joint {closed[0]!r}, so the arm is no chain; "
                f"{STATE}"
            )
            raise InputError(file, "", problem)


def _solved(file: Path, order: Sequence[str], equations: Sequence[Coupling]) -> Rows:
    """Solve the equations for as many joints as they determine, the first ones in the order."""
    if not equations:
        return {}
    A = np.array([[coupling.terms.get(name, 0.0) for name in order] for coupling in equations])
    constant = np.array([coupling.constant for coupling in equations])
    dependent = independent_rows(A.T, range(len(order)))
    others = np.setdiff1d(np.arange(len(order)), dependent)
    # A_dependent q_dependent = constant - A_others q_others
    x = np.linalg.lstsq(A[:, dependent], np.column_stack([-A[:, others], constant]))[0]
    if (np.abs(A[:, dependent] @ x[:, -1] - constant) > ZERO_COEFFICIENT).any():
        raise InputError(
            file, "", f"{equations[0].label} and others contradict each other: no joint positions satisfy all"
        )
    names = [order[k] for k in others]
    rows = zip(dependent, (x.round(DIGITS) + 0.0).tolist(), strict=True)
    return {
        order[k]: ({name: c for name, c in zip(names, row, strict=False) if c}, row[-1]) for k, row in rows
    }


def chain_map(file: Path, joints: Sequence[ImportedJoint], rows: Rows) -> JointMap | None:
    """Build the joint map of an arm's chain: its joints as a linear function of those that the motors drive.

    Args:
        file: The robot's file, for messages.
        joints: Joints of the chain, from base to tool.
        rows: Joints that follow others, as `map_of` returns them.

    Returns:
        The map; None if no joint of the chain follows others.

    Raises:
        InputError: If no map of an arm satisfies the equations.
    """
    own = {joint.name: rows[joint.name] for joint in joints if joint.name in rows}
    rigid = [ArmJoint(joint.name, joint.lower, joint.upper, 0.0, joint.prismatic) for joint in joints]
    try:
        return build_joint_map(
            rigid, {name: row for name, (row, _) in own.items()}, {name: x for name, (_, x) in own.items()}
        )
    except BenchError as err:
        raise InputError(file, "", str(err)) from err


# --- End of the arm in a robot's tree: the place of the tool ------------------------------------------------

TIPS = (
    *("tool0", "tcp", "tool", "flange", "attachment_site", "attachment", "ee", "eef"),
    *("ee_gripper", "ee_arm", "end_effector", "grip_site", "pinch_site", "hand"),
)
"""How files call the place of the tool, the best first; `panda_` or the like may stand before, `_link` or
`_frame` behind."""
FLANGES = "tool0", "flange"
"""Names that no finger of a gripper has."""
FINGER_JOINTS = 4
"""Most joints of a branch behind an arm that counts as a finger."""
ARM_JOINTS = 3  #: Fewest joints of an arm.
GRIPS = re.compile("gripper|finger|jaw", re.IGNORECASE)
"""Words in the name of a joint that closes a gripper."""


class Tip(NamedTuple):
    """Describe a place where a tool may be mounted."""

    body: int  #: Index of its body.
    site: ImportedSite  #: In the body's frame.


def path_to(bodies: Sequence[Body], body: int) -> list[int]:
    """List the bodies from the root of the tree to a body.

    Args:
        bodies: All bodies.
        body: Index of the last body; -1 for the world.

    Returns:
        Indices of the bodies, root first; none for the world.
    """
    path: list[int] = []
    while body >= 0:
        path.insert(0, body)
        body = bodies[body].parent
    return path


def find_tip(file: Path, robot: Robot, name: str | None) -> Tip:
    """Find the place of the tool.

    Args:
        file: The robot's file, for messages.
        robot: The robot.
        name: Link, body or site that carries the tool; None for the usual one.

    Returns:
        The place.

    Raises:
        InputError: If the robot has nothing of this name.
    """
    tips = [
        Tip(k, site)
        for k, body in enumerate(robot.bodies)
        for site in (ImportedSite(body.name, np.eye(4)), *body.sites)
    ]
    if name is None:
        return _usual_tip(robot, tips)
    found = next((tip for tip in tips if tip.site.name == name), None)
    if found is None:
        names = some_of(sorted({tip.site.name for tip in tips}))
        raise InputError(file, "", f"no link, body or site {name!r} for the tip; there are {names}")
    return found


def _usual_tip(robot: Robot, tips: Sequence[Tip]) -> Tip:
    """Find the place of the tool if none is given: the end of the longest chain of moving joints.

    A gripper and rods that follow other joints do not count; a link with the name of a flange has priority
    over a longer chain. On the last moving body, or fixed to it, a usual name decides; else a bare frame
    fixed to it; else the body itself.
    """
    bodies = robot.bodies
    carriers = [_carrier(robot, k) for k in range(len(bodies))]
    ranked = [(rank, tip) for tip in tips if (rank := _rank(tip.site.name)) is not None]
    flanges = [(rank, carriers[tip.body]) for rank, tip in ranked if _is_flange(robot, rank, tip)]
    last = min(flanges, key=lambda found: found[0])[1] if flanges else _last_moving(robot, carriers)
    if here := [(rank, tip) for rank, tip in ranked if carriers[tip.body] == last]:
        return min(here, key=lambda found: found[0])[1]
    fixed = [tip for tip in tips if bodies[tip.body].parent == last and not bodies[tip.body].moves]
    bare = [tip for tip in fixed if bodies[tip.body].mass == 0 and not bodies[tip.body].shapes]
    return bare[0] if len(bare) == 1 else Tip(last, ImportedSite(bodies[last].name, np.eye(4)))


def _is_flange(robot: Robot, rank: int, tip: Tip) -> bool:
    """Tell whether a place has the name of a flange and is behind the joints of an arm."""
    joints = sum(robot.bodies[k].joint is not None for k in path_to(robot.bodies, tip.body))
    return TIPS[rank] in FLANGES and joints >= ARM_JOINTS


def _rank(name: str) -> int | None:
    """Rank a name as that of a tool's place, 0 the best; None if it is none."""
    words = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
    words = re.sub("_(link|frame)$", "", words)
    return next((k for k, tip in enumerate(TIPS) if f"_{words}".endswith(f"_{tip}")), None)


def _carrier(robot: Robot, body: int) -> int:
    """Find the moving body, or the first of the tree, to which a body is fixed."""
    while not robot.bodies[body].moves and robot.bodies[body].parent >= 0:
        body = robot.bodies[body].parent
    return body


def _is_rod(robot: Robot, k: int) -> bool:
    """Tell whether a body follows a joint before it: a rod of the arm, not a finger of a gripper."""
    name = robot.bodies[k].follows
    before = [robot.bodies[b].joint for b in path_to(robot.bodies, k)[:-1]]
    return bool(name) and name in [joint.name for joint in before if joint]


def _last_moving(robot: Robot, carriers: list[int]) -> int:
    """Find the last moving body of the arm: the deepest one before a gripper.

    A gripper shows by branches, or by the name of a joint.
    """
    bodies = robot.bodies
    branches: dict[int, list[int]] = {k: [] for k in range(len(bodies))}
    height = [0] * len(bodies)  # moving joints behind a body, the longest way
    for k in reversed(range(len(bodies))):
        branches[k] = [b for b in branches[k] if not _is_rod(robot, b)] or branches[k]
        height[k] = max((height[b] + 1 for b in branches[k]), default=0)
        if bodies[k].moves and bodies[k].parent >= 0:
            branches[carriers[bodies[k].parent]].append(k)
    here = max((k for k, body in enumerate(bodies) if body.parent < 0), key=lambda k: (height[k], -k))
    joints = 0
    while height[here]:
        ahead = max(branches[here], key=lambda k: (not bodies[k].follows, height[k], -k))
        joint = bodies[ahead].joint
        gripper = len(branches[here]) > 1 or bool(joint and GRIPS.search(joint.name))
        if gripper and height[here] <= FINGER_JOINTS and joints >= ARM_JOINTS:
            break
        here, joints = ahead, joints + 1
    return here
