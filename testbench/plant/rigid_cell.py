"""The rigid cell: the arm with its payload and its tracker, their contacts, and the lines of sight.

Colliding geoms of the arm's MJCF must not touch. Visual geoms block a line of sight: geoms that only collide
are padded, and may enclose a marker. In a body without visual geoms, and in the world, whose geoms are not
padded, every geom blocks it.
"""

import copy
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np

from testbench.arm.document import unused_name
from testbench.arm.folder import Arm, beyond_limits
from testbench.arm.mjcf import read_mjcf
from testbench.errors import Array, BenchError, Ids, InputError, Mask, PoseError, check_array, check_least
from testbench.plant.build import compile_mjcf

# --- Contacts of a rigid arm in MuJoCo, its floor, and names of the parts in contact ------------------------

COLLISION_ATTRIBUTES = {"contype": str(2**31 - 1), "conaffinity": str(2**31 - 1), "gap": "0", "group": "0"}
"""Attributes of a geom that collides with every colliding geom, whatever the defaults of a user's MJCF."""
MAX_CONTACTS = 5000  #: Most contacts in one pose.
VISUAL_GROUPS = 3
"""First geom group that MuJoCo's viewer does not show; by convention geoms of this and higher groups only
collide."""


def _add_floor(root: ET.Element, height: float | None) -> None:
    """Add a floor to an MJCF; it collides with all geoms that can collide.

    Args:
        root: Root of the MJCF; changed in place.
        height: Height of the floor [m]; None for no floor.
    """
    if height is None:
        return
    world = root.find("worldbody")
    assert world is not None  # the arm has bodies
    place = {"type": "plane", "size": "0 0 1", "pos": f"0 0 {height!r}", "quat": "1 0 0 0"}
    ET.SubElement(world, "geom", {**place, "margin": "0", **COLLISION_ATTRIBUTES})


def body_name(model: mujoco.MjModel, body: int) -> str:
    """Return the name of a body.

    Args:
        model: The MuJoCo model.
        body: Id of the body.

    Returns:
        Its name in the MJCF, or body_ID if it has none there.
    """
    return model.body(int(body)).name or f"body_{body}"


def compute_contacts(path: Path, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Compute MuJoCo's contacts in a pose.

    Args:
        path: Path of the MJCF, for messages.
        model: The MuJoCo model.
        data: MuJoCo's state in the pose; the contacts are written into it.

    Raises:
        InputError: When there are more than `MAX_CONTACTS`.
    """
    try:
        mujoco.mj_collision(model, data)
        count = int(data.ncon)
    except mujoco.FatalError:  # MuJoCo has no memory for so many
        count = MAX_CONTACTS + 1
    if count > MAX_CONTACTS:
        problem = f"expected at most {MAX_CONTACTS} contacts in a pose, got more: use simpler geoms"
        raise InputError(path, "<geom>", problem)


# --- The rigid cell: the arm with its payload and its tracker, their contacts, and the lines of sight -------

ContactCategory = Literal["itself", "room", "tracker", "payload"]  #: What is in contact.

CONTACT_CATEGORIES: tuple[ContactCategory, ...] = ("itself", "room", "tracker", "payload")
"""Contact of the arm with itself, with floor or walls, with the tracker, and of the payload with anything.

Every geom belongs to the arm, the room, the tracker or the payload. A contact has the category of that one of
its two geoms which comes later in this order.
"""

SHACKLE_LENGTH = 0.1
"""Length of the shackle below the load point [m]; it counts as part of the tool, without clearance."""
SLING_RADIUS = 0.01  #: Radius of the sling [m].
TRACKER_HEAD_RADIUS = 0.2
"""Radius of the sphere that contains the tracker's head, its motion and the top of its stand [m]."""
MAX_STATION_COORDINATE = 1000.0
"""Largest coordinate of a station [m]; beyond it a unit is wrong."""
TARGET_RADIUS = 0.06
"""Distance from a marker within which an obstacle counts as the target itself or its holder [m]."""
COLLISION_XML = " ".join(f'{key}="{value}"' for key, value in COLLISION_ATTRIBUTES.items())
"""`COLLISION_ATTRIBUTES` as text of an XML element."""
RAY_GROUPS = np.array([1, 0, 0, 0, 0, 0], dtype=np.uint8)
"""Geom groups that block a ray, 1 or 0 for each of MuJoCo's six: in `RigidCell.ray_model` opaque geoms are in
group 0, all others in group 5."""


@dataclass(frozen=True)
class Payload:
    """Describe a weight that hangs from the load point: an upright steel cylinder, as high as wide."""

    mass: float  #: Mass of the weight [kg].
    sling_length: float = 0.5  #: Length from the load point to the top of the weight [m].
    density: float = 7850.0  #: Density of the weight [kg/m^3]; 7850 is steel.
    clearance: float = 0.05  #: Least distance to any other object [m], because weights swing.

    def __post_init__(self) -> None:
        """Refuse masses, densities and lengths that no payload has, by BenchError."""
        for name in ("mass", "density"):
            value = getattr(self, name)
            if not 0 < value < math.inf:
                raise BenchError(f"{name} of the payload: expected a finite number above 0, got {value}")
        check_least(self.clearance, "clearance [m] of the payload")
        shortest = self.unchecked_sling_length + 2 * SLING_RADIUS
        if not shortest < self.sling_length < math.inf:
            raise BenchError(
                f"sling_length [m] of the payload: expected more than {shortest:.4g} (shackle, clearance), "
                f"got {self.sling_length}"
            )

    @property
    def diameter(self) -> float:
        """Compute the diameter of the weight, which is also its height [m]."""
        return float(np.cbrt(4 * self.mass / (np.pi * self.density)))

    @property
    def unchecked_sling_length(self) -> float:
        """Compute the length below the load point on which the sling is not checked for contacts [m]."""
        return SHACKLE_LENGTH + self.clearance


@dataclass(frozen=True)
class Contact:
    """Describe two bodies that touch, or come closer than the payload's clearance."""

    category: ContactCategory  #: Category of the contact.
    #: Names of the two bodies, in the order of `CONTACT_CATEGORIES`: the payload's, for example, is last.
    bodies: tuple[str, str]


@dataclass(frozen=True)
class RigidCell:
    """Hold the MuJoCo model of a rigid cell: the arm, its room, the payload and the tracker."""

    arm: Arm  #: Description of the arm.
    payload: Payload | None  #: Payload on the tool; None for none.
    tracker_position: Array | None  #: Origin of the tracker's beam, world, (3,) [m]; None for no tracker.
    model: mujoco.MjModel  #: Rigid MuJoCo model of the whole cell.
    ray_model: mujoco.MjModel  #: Copy of the model in which only opaque geoms block a ray.
    #: State of the model, overwritten by every call: creating one takes longer than using it.
    data: mujoco.MjData
    body_names: tuple[str, ...]  #: Names of the bodies by their id.
    joint_addresses: Ids  #: Index of each actuated joint in qpos, (n,).
    payload_addresses: Ids  #: Index of the payload's x, y and z in qpos, (3,); (0,) without a payload.
    load_point_body: int  #: Body id of the load point.
    marker_bodies: Ids  #: Body ids of the markers, (m,).
    marker_directions: Array  #: Z axis of each marker's body, in the tool's frame, (m, 3) [1].
    geom_categories: Ids  #: Category of each geom, an index into `CONTACT_CATEGORIES`, (geoms,).


def check_station_position(position: object) -> Array:
    """Check the position of a tracker's station.

    Args:
        position: Three coordinates, world [m].

    Returns:
        The position, (3,) [m].

    Raises:
        BenchError: When it is not three finite numbers up to `MAX_STATION_COORDINATE`.
    """
    where = check_array(position, (3,), "position of the station [m]")
    if np.abs(where).max() > MAX_STATION_COORDINATE:
        expected, got = f"{MAX_STATION_COORDINATE:g} m", ", ".join(f"{x:g}" for x in where)
        problem = f"expected coordinates up to {expected}, got {got}: are they in mm?"
        raise BenchError(f"position of the station [m]: {problem}")
    return where


def build_rigid_cell(
    arm: Arm,
    payload: Payload | None = None,
    tracker_position: tuple[float, float, float] | None = None,
    floor_height: float | None = None,
) -> RigidCell:
    """Build the rigid MuJoCo model of an arm, alone or with its payload and its tracker.

    Args:
        arm: Description of the arm; its rigid.xml is read.
        payload: Payload on the tool; None for none.
        tracker_position: Origin of the tracker's beam, world, (3,) [m]; None for no tracker.
        floor_height: Height of a floor to add to the arm's MJCF [m]; None for none.

    Returns:
        The rigid cell.

    Raises:
        InputError: When MuJoCo refuses the arm's MJCF.
        BenchError: When the tracker's position is invalid, or inside something that does not move.
    """
    where = None if tracker_position is None else check_station_position(tracker_position)
    root = read_mjcf(arm.mjcf_path)
    _add_floor(root, floor_height)
    taken = {str(body.get("name")) for body in root.iter("body")}
    weight, head = unused_name("payload", taken), unused_name("tracker", taken)
    if payload is not None:
        _hang_payload(root, weight, payload)
    if where is not None:
        _place_tracker(root, head, where)
    model = compile_mjcf(arm.mjcf_path, ET.tostring(root, encoding="unicode"))
    part = _parts(model, arm, weight, head)
    _check_head(model, part, where)
    slides = np.flatnonzero(model.body_rootid[model.jnt_bodyid] == _body(model, weight))
    markers = np.array([model.body(name).id for name in arm.markers])
    return RigidCell(
        arm=arm,
        payload=payload,
        tracker_position=where,
        model=model,
        ray_model=_opaque(model, part),
        data=mujoco.MjData(model),
        body_names=tuple(body_name(model, body) for body in range(model.nbody)),
        joint_addresses=np.array([model.joint(j.name).qposadr[0] for j in arm.joints], dtype=int),
        payload_addresses=model.jnt_qposadr[slides].astype(int),
        load_point_body=model.body(arm.load_point).id,
        marker_bodies=markers,
        marker_directions=_facing(model, model.body(arm.tool).id, markers),
        geom_categories=part,
    )


def _hang_payload(root: ET.Element, name: str, payload: Payload) -> None:
    """Add the weight and its sling, hanging from the origin of their body.

    The body has slides, though it is placed explicitly: in MuJoCo two bodies without joints never collide,
    not even if one is a mocap body; and base and floor have none.
    """
    half = payload.diameter / 2
    rope = (payload.sling_length - payload.unchecked_sling_length) / 2
    top = payload.unchecked_sling_length
    slides = "".join(f'<joint type="slide" axis="{x}" limited="false"/>' for x in ("1 0 0", "0 1 0", "0 0 1"))
    _add_body(
        root,
        f"""<body name="{name}"><inertial pos="0 0 0" mass="{payload.mass}" diaginertia="1 1 1"/>{slides}
        <geom type="cylinder" size="{half} {half}" pos="0 0 {-payload.sling_length - half}"
          mass="{payload.mass}" margin="{payload.clearance}" {COLLISION_XML}/>
        <geom type="capsule" size="{SLING_RADIUS} {rope - SLING_RADIUS}" pos="0 0 {-top - rope}"
          mass="0" margin="{payload.clearance}" {COLLISION_XML}/></body>""",
    )


def _place_tracker(root: ET.Element, name: str, position: Array) -> None:
    """Add the head of a tracker to the MJCF."""
    x, y, z = position.tolist()
    _add_body(
        root,
        f"""<body name="{name}" pos="{x} {y} {z}">
        <geom type="sphere" size="{TRACKER_HEAD_RADIUS}" pos="0 0 0" mass="0" margin="0" {COLLISION_XML}/>
        </body>""",
    )


def _add_body(root: ET.Element, body: str) -> None:
    world = root.find("worldbody")
    assert world is not None  # the arm has bodies
    world.append(ET.fromstring(body))


def _body(model: mujoco.MjModel, name: str) -> int:
    return int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name))


def _parts(model: mujoco.MjModel, arm: Arm, weight: str, head: str) -> Ids:
    """Find the category of each geom, an index in `CONTACT_CATEGORIES`: all bodies of the arm are one."""
    root = model.body_rootid[model.geom_bodyid]
    part = np.full(model.ngeom, CONTACT_CATEGORIES.index("room"))
    part[root == model.body_rootid[_body(model, arm.links[0].name)]] = CONTACT_CATEGORIES.index("itself")
    part[root == _body(model, head)] = CONTACT_CATEGORIES.index("tracker")
    part[root == _body(model, weight)] = CONTACT_CATEGORIES.index("payload")
    return part


def _check_head(model: mujoco.MjModel, part: Ids, position: Array | None) -> None:
    """Refuse a tracker inside something that does not move; MuJoCo's collisions exclude such pairs."""
    if position is None:
        return
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    tracker = part == CONTACT_CATEGORIES.index("tracker")
    still = np.flatnonzero((model.body_weldid[model.geom_bodyid] == 0) & ~tracker)
    head = int(np.flatnonzero(tracker)[0])
    for g in still:
        if mujoco.mj_geomDistance(model, data, head, g, 1e-3, None) < 0:
            place = ", ".join(f"{x:g}" for x in position)
            raise BenchError(
                f"station at {place} m: the tracker's head (radius {TRACKER_HEAD_RADIUS} m) is "
                f"inside {body_name(model, model.geom_bodyid[g])}, which does not move; expected a free place"
            )


def _opaque(model: mujoco.MjModel, part: Ids) -> mujoco.MjModel:
    """Put the geoms that stop a ray into group 0, and all others into group 5."""
    model = copy.copy(model)
    body, drawn = model.geom_bodyid, model.geom_group < VISUAL_GROUPS
    bare = ~np.isin(body, body[drawn])
    opaque = (drawn | bare | (body == 0)) & (part != CONTACT_CATEGORIES.index("tracker"))
    model.geom_group[:] = np.where(opaque, 0, 5)
    model.geom_rgba[:, 3] = 1  # MuJoCo's rays pass through fully transparent geoms
    model.mat_rgba[:, 3] = 1
    return model


def _facing(model: mujoco.MjModel, tool: int, markers: Ids) -> Array:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return np.asarray(data.xmat[markers].reshape(-1, 3, 3)[:, :, 2] @ data.xmat[tool].reshape(3, 3))


def _poses(rigid_cell: RigidCell, q: Array) -> Iterator[mujoco.MjData]:
    """Set the cell to every pose, with the payload straight below the load point; the data are one object."""
    q = check_array(q, (None, rigid_cell.arm.n_joints), "q [rad, m]")
    model, data = rigid_cell.model, rigid_cell.data
    qpos, load = data.qpos, data.xpos[rigid_cell.load_point_body]
    for pose in q:
        qpos[rigid_cell.joint_addresses] = pose
        mujoco.mj_kinematics(model, data)
        if rigid_cell.payload is not None:
            qpos[rigid_cell.payload_addresses] = load
            mujoco.mj_kinematics(model, data)
        yield data


def find_contacts(rigid_cell: RigidCell, q: Array) -> list[Contact | None]:
    """Find a contact of the arm or its payload in every pose.

    Args:
        rigid_cell: The rigid cell.
        q: Actuated joints, (poses, n) [rad, m].

    Returns:
        For every pose the first contact in the order of `CONTACT_CATEGORIES`; None if there is none.

    Raises:
        BenchError: When q has another shape or is not finite.
    """
    clearance = 0.0 if rigid_cell.payload is None else rigid_cell.payload.clearance
    first_contacts: list[Contact | None] = []
    for data in _poses(rigid_cell, q):
        compute_contacts(rigid_cell.arm.mjcf_path, rigid_cell.model, data)
        pairs = data.contact.geom
        kind = rigid_cell.geom_categories[pairs].max(axis=1)
        # geoms of a user's MJCF may have margins
        near = np.where(kind == CONTACT_CATEGORIES.index("payload"), clearance, 0.0)
        touching = np.flatnonzero(data.contact.dist < near)
        if not len(touching):
            first_contacts.append(None)
            continue
        k = touching[kind[touching].argmin()]
        pair = sorted(pairs[k], key=lambda g: rigid_cell.geom_categories[g])
        first, second = (rigid_cell.body_names[rigid_cell.model.geom_bodyid[g]] for g in pair)
        first_contacts.append(Contact(CONTACT_CATEGORIES[kind[k]], (first, second)))
    return first_contacts


def find_collisions(rigid_cell: RigidCell, q: Array) -> list[tuple[str, str] | None]:
    """Find two bodies that touch in every pose.

    Args:
        rigid_cell: The rigid cell.
        q: Actuated joints, (poses, n) [rad, m].

    Returns:
        For every pose the names of the bodies of its first contact; None if there is no contact.
    """
    return [contact.bodies if contact else None for contact in find_contacts(rigid_cell, q)]


def collision_free(rigid_cell: RigidCell, q: Array) -> Mask:
    """Tell which poses are free of collisions.

    Args:
        rigid_cell: The rigid cell.
        q: Actuated joints, (poses, n) [rad, m].

    Returns:
        Whether nothing touches in the pose, (poses,).
    """
    return np.array([contact is None for contact in find_contacts(rigid_cell, q)], dtype=bool)


def check_poses(rigid_cell: RigidCell, q: Array) -> None:
    """Check that all poses are within the joint limits and free of collisions.

    Args:
        rigid_cell: The rigid cell.
        q: Actuated joints, (poses, n) [rad, m].

    Raises:
        PoseError: At the first pose that is not; the message names the limit or the colliding bodies.
    """
    q = check_array(q, (None, rigid_cell.arm.n_joints), "q [rad, m]")
    for i, problem in beyond_limits(rigid_cell.arm.joints, q, slack=0.0):
        raise PoseError(f"pose {i + 1}: {problem}")
    for i, pair in enumerate(find_collisions(rigid_cell, q)):
        if pair:
            raise PoseError(
                f"pose {i + 1}: {pair[0]} collides with {pair[1]} at q = {rigid_cell.arm.pose_text(q[i])}"
            )


def has_surroundings(rigid_cell: RigidCell) -> bool:
    """Tell whether the world has geoms that can collide with the arm, such as a floor or a wall."""
    model = rigid_cell.model
    collides = (model.geom_contype | model.geom_conaffinity) != 0
    return bool((collides & (model.geom_bodyid == 0)).any())


def find_hidden_markers(rigid_cell: RigidCell, q: Array) -> list[tuple[str, str] | None]:
    """Find the first marker of every pose whose line of sight from the tracker is blocked.

    The marker's own body does not block it, nor does anything nearer to the marker than `TARGET_RADIUS`.
    Another marker, the load point's shackle and the payload do.

    Args:
        rigid_cell: The rigid cell, with a tracker.
        q: Actuated joints, (poses, n) [rad, m].

    Returns:
        For every pose the names of the marker and of the body that blocks it; None if all markers are
        visible.

    Raises:
        BenchError: When the cell has no tracker.
    """
    if rigid_cell.tracker_position is None:
        raise BenchError("line of sight: expected a cell with a tracker, got one without")
    return [_first_hidden(rigid_cell, rigid_cell.tracker_position, data) for data in _poses(rigid_cell, q)]


def _first_hidden(rigid_cell: RigidCell, station: Array, data: mujoco.MjData) -> tuple[str, str] | None:
    """Find the first marker that a body hides from the station, and that body; None if there is none."""
    hit = np.empty(1, dtype=np.int32)
    beams = data.xpos[rigid_cell.marker_bodies] - station
    lengths = np.sqrt((beams**2).sum(axis=1))
    for k, (beam, length) in enumerate(zip(beams, lengths, strict=True)):
        if length <= TARGET_RADIUS:
            continue
        share = mujoco.mj_ray(
            rigid_cell.ray_model,
            data,
            station,
            beam,
            RAY_GROUPS,
            True,
            rigid_cell.marker_bodies[k],
            hit,
            None,
        )
        if share >= 0 and share * length < length - TARGET_RADIUS:
            return rigid_cell.arm.markers[k], rigid_cell.body_names[rigid_cell.model.geom_bodyid[hit[0]]]
    return None
