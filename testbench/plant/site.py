"""The rigid arm at work: a payload may hang from it, a tracker stand beside it; what touches, what hides.

Which shapes count: what collides in the arm's MJCF may not touch. A ray of light is stopped by what is drawn
instead: shapes that only collide are padded, and may well enclose a marker. Of a body where nothing is drawn,
and of the world, whose shapes nobody pads, every shape stops it.
"""

import copy
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from testbench.arm.document import unique
from testbench.arm.folder import Arm
from testbench.arm.mjcf import read_mjcf
from testbench.errors import Array, BenchError, Ids, PoseError, check_array, check_least
from testbench.plant.build import compile_mjcf
from testbench.plant.collide import COLLIDES, VISUAL_GROUPS, body_name, collide, lay_floor

Kind = Literal["itself", "room", "tracker", "payload"]

KINDS: tuple[Kind, ...] = ("itself", "room", "tracker", "payload")
"""What is touched: the arm itself, the floor and walls, the tracker; and the payload, whatever it touches.

Every geom belongs to arm, room, tracker or payload in this order, and a contact to the later of its two.
"""

SHACKLE = 0.1
"""Length below the load point that belongs to the tool that holds the sling [m], whatever its clearance."""
SLING_RADIUS = 0.01  #: Radius of the sling [m].
HEAD_RADIUS = 0.2
"""Radius of the sphere that stands for the tracker's head, its swing and the top of its stand [m]."""
FARTHEST = 1000.0  #: Largest coordinate of a station [m]; beyond it a unit is a slip.
TARGET_RADIUS = 0.06
"""What is hit this near to a marker [m] is the target itself, its nest or the end of its holder."""
SOLID = " ".join(f'{key}="{value}"' for key, value in COLLIDES.items())
OPAQUE = np.array([1, 0, 0, 0, 0, 0], dtype=np.uint8)
"""Geom groups that stop a ray: `_opaque` puts such geoms into group 0, all others into group 5."""


@dataclass(frozen=True)
class Payload:
    """A weight that hangs from the load point: an upright steel cylinder, as high as it is wide."""

    mass: float  #: Of the weight [kg].
    sling: float = 0.5  #: From the load point to the top of the weight [m].
    density: float = 7850.0  #: Of the weight [kg/m^3]; 7850 is steel.
    clearance: float = 0.05  #: Least distance to anything [m], as weights swing.

    def __post_init__(self) -> None:
        for name in ("mass", "density"):
            value = getattr(self, name)
            if not 0 < value < math.inf:
                raise BenchError(f"{name} of the payload: expected a finite number above 0, got {value}")
        check_least(self.clearance, "clearance [m] of the payload")
        shortest = self.upper_end + 2 * SLING_RADIUS
        if not shortest < self.sling < math.inf:
            raise BenchError(
                f"sling [m] of the payload: expected more than {shortest:.4g} (shackle, clearance), "
                f"got {self.sling}"
            )

    @property
    def diameter(self) -> float:
        """Diameter and height of the weight [m]."""
        return float(np.cbrt(4 * self.mass / (np.pi * self.density)))

    @property
    def upper_end(self) -> float:
        """Where the sling begins, below the load point [m]: what holds it there is no obstacle to it."""
        return SHACKLE + self.clearance


@dataclass(frozen=True)
class Contact:
    """Two bodies that touch, or come nearer than the payload's clearance."""

    kind: Kind  #: What is touched.
    #: Their names, in the order of `KINDS`: the arm's before the world's, the payload's last.
    bodies: tuple[str, str]


@dataclass(frozen=True)
class Site:
    """The rigid arm, its room, and what may stand or hang there while it is measured."""

    arm: Arm  #: Its description.
    payload: Payload | None  #: What hangs from it; None for nothing.
    station: Array | None  #: Where the tracker's beam leaves, (3,) [m]; None for no tracker.
    model: mujoco.MjModel  #: Rigid MuJoCo model of all of it.
    sight: mujoco.MjModel  #: The same as a ray sees it.
    data: mujoco.MjData  #: Its state, overwritten by every question: making one takes longer than an answer.
    names: tuple[str, ...]  #: Of the bodies.
    joints: Ids  #: Address of each actuated joint in qpos, (n,).
    slides: Ids  #: Address of the payload's coordinates x, y, z in qpos, (3,); (0,) without.
    load: int  #: Body id of the load point.
    markers: Ids  #: Body ids of the markers, (m,).
    facing: Array  #: Z axes of the markers' bodies in the tool's frame, (m, 3) [1].
    part: Ids  #: Index in `KINDS` of what each geom belongs to, (geoms,).


def check_position(position: object) -> Array:
    """The position of a station, (3,) [m]; BenchError for what is no place near any arm."""
    where = check_array(position, (3,), "position of the station [m]")
    if np.abs(where).max() > FARTHEST:
        raise BenchError(
            f"position of the station [m]: expected coordinates up to {FARTHEST:g}, got {where.tolist()}"
        )
    return where


def build_site(
    arm: Arm,
    payload: Payload | None = None,
    station: tuple[float, float, float] | None = None,
    floor: float | None = None,
) -> Site:
    """The rigid MuJoCo model of an arm, alone or with its payload and its tracker.

    Args:
        arm: The arm.
        payload: What hangs from it; None for nothing.
        station: Where the tracker's beam leaves [m]; None for no tracker.
        floor: Height of a floor that the arm's MJCF does not have [m]; None for none.

    Raises:
        InputError: When MuJoCo refuses the arm's MJCF.
        BenchError: When the station is no place, or inside something that does not move.
    """
    where = None if station is None else check_position(station)
    root = read_mjcf(arm.rigid)
    lay_floor(root, floor)
    taken = {str(body.get("name")) for body in root.iter("body")}
    weight, head = unique("payload", taken), unique("tracker", taken)
    if payload is not None:
        _hang(root, weight, payload)
    if where is not None:
        _stand(root, head, where)
    model = compile_mjcf(arm.rigid, ET.tostring(root, encoding="unicode"))
    part = _parts(model, arm, weight, head)
    _check_head(model, part, where)
    slides = np.flatnonzero(model.body_rootid[model.jnt_bodyid] == _body(model, weight))
    markers = np.array([model.body(name).id for name in arm.markers])
    return Site(
        arm=arm,
        payload=payload,
        station=where,
        model=model,
        sight=_opaque(model, part),
        data=mujoco.MjData(model),
        names=tuple(body_name(model, body) for body in range(model.nbody)),
        joints=np.array([model.joint(j.name).qposadr[0] for j in arm.joints], dtype=int),
        slides=model.jnt_qposadr[slides].astype(int),
        load=model.body(arm.load).id,
        markers=markers,
        facing=_facing(model, model.body(arm.tool).id, markers),
        part=part,
    )


def _hang(root: ET.Element, name: str, payload: Payload) -> None:
    """Add the weight and its sling, hanging from the origin of their body.

    The body has slides, though it is placed by hand: MuJoCo lets no two bodies without joints collide, not
    even if one is a mocap body; and base and floor have none.
    """
    half, rope, top = payload.diameter / 2, (payload.sling - payload.upper_end) / 2, payload.upper_end
    slides = "".join(f'<joint type="slide" axis="{x}" limited="false"/>' for x in ("1 0 0", "0 1 0", "0 0 1"))
    _add(
        root,
        f"""<body name="{name}"><inertial pos="0 0 0" mass="{payload.mass}" diaginertia="1 1 1"/>{slides}
        <geom type="cylinder" size="{half} {half}" pos="0 0 {-payload.sling - half}"
          mass="{payload.mass}" margin="{payload.clearance}" {SOLID}/>
        <geom type="capsule" size="{SLING_RADIUS} {rope - SLING_RADIUS}" pos="0 0 {-top - rope}"
          mass="0" margin="{payload.clearance}" {SOLID}/></body>""",
    )


def _stand(root: ET.Element, name: str, where: Array) -> None:
    x, y, z = where.tolist()
    _add(
        root,
        f"""<body name="{name}" pos="{x} {y} {z}">
        <geom type="sphere" size="{HEAD_RADIUS}" pos="0 0 0" mass="0" margin="0" {SOLID}/></body>""",
    )


def _add(root: ET.Element, body: str) -> None:
    world = root.find("worldbody")
    assert world is not None  # the arm has bodies
    world.append(ET.fromstring(body))


def _body(model: mujoco.MjModel, name: str) -> int:
    return int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name))


def _parts(model: mujoco.MjModel, arm: Arm, weight: str, head: str) -> Ids:
    """Index in `KINDS` of what each geom belongs to; the arm is all that hangs on what carries its base."""
    root = model.body_rootid[model.geom_bodyid]
    part = np.full(model.ngeom, KINDS.index("room"))
    part[root == model.body_rootid[_body(model, arm.links[0].name)]] = KINDS.index("itself")
    part[root == _body(model, head)] = KINDS.index("tracker")
    part[root == _body(model, weight)] = KINDS.index("payload")
    return part


def _check_head(model: mujoco.MjModel, part: Ids, where: Array | None) -> None:
    """Refuse a tracker inside what does not move, seen or not; MuJoCo's collisions leave such pairs out."""
    if where is None:
        return
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    tracker = part == KINDS.index("tracker")
    still = np.flatnonzero((model.body_weldid[model.geom_bodyid] == 0) & ~tracker)
    head = int(np.flatnonzero(tracker)[0])
    for g in still:
        if mujoco.mj_geomDistance(model, data, head, g, 1e-3, None) < 0:
            raise BenchError(
                f"station at {where.tolist()} m: the tracker's head (radius {HEAD_RADIUS} m) is inside "
                f"{body_name(model, model.geom_bodyid[g])}, which does not move; expected a free place"
            )


def _opaque(model: mujoco.MjModel, part: Ids) -> mujoco.MjModel:
    """The model with the geoms that stop a ray in group 0, and all others in group 5."""
    model = copy.copy(model)
    body, drawn = model.geom_bodyid, model.geom_group < VISUAL_GROUPS
    bare = ~np.isin(body, body[drawn])
    opaque = (drawn | bare | (body == 0)) & (part != KINDS.index("tracker"))
    model.geom_group[:] = np.where(opaque, 0, 5)
    model.geom_rgba[:, 3] = 1  # MuJoCo's rays pass through what is fully transparent
    model.mat_rgba[:, 3] = 1
    return model


def _facing(model: mujoco.MjModel, tool: int, markers: Ids) -> Array:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return np.asarray(data.xmat[markers].reshape(-1, 3, 3)[:, :, 2] @ data.xmat[tool].reshape(3, 3))


def _poses(site: Site, q: Array) -> Iterator[mujoco.MjData]:
    """The site in every pose, the payload straight below the load point; the data are the same object."""
    q = check_array(q, (None, site.arm.n_joints), "q [rad, m]")
    model, data = site.model, site.data
    qpos, load = data.qpos, data.xpos[site.load]
    for pose in q:
        qpos[site.joints] = pose
        mujoco.mj_kinematics(model, data)
        if site.payload is not None:
            qpos[site.slides] = load
            mujoco.mj_kinematics(model, data)
        yield data


def contacts(site: Site, q: Array) -> list[Contact | None]:
    """Find the contacts of the arm and its payload in every pose.

    Args:
        site: The site.
        q: Joint angles, (poses, n) [rad, m].

    Returns:
        Per pose the first contact in the order of `KINDS`; None where there is none.
    """
    found: list[Contact | None] = []
    geoms, depths = [np.empty((0, 2), dtype=int)], [np.empty(0)]
    for data in _poses(site, q):
        collide(site.arm.rigid, site.model, data)
        found.append(None)
        geoms.append(data.contact.geom.copy())
        depths.append(data.contact.dist.copy())
    pose = np.repeat(np.arange(len(found)), [len(depth) for depth in depths[1:]])
    pairs = np.concatenate(geoms)
    for k in _touching(site, pose, pairs, np.concatenate(depths)):
        pair = sorted(pairs[k], key=lambda g: site.part[g])
        one, other = (site.names[site.model.geom_bodyid[g]] for g in pair)
        found[pose[k]] = Contact(KINDS[site.part[pair].max()], (one, other))
    return found


def _touching(site: Site, pose: Ids, pairs: Ids, distance: Array) -> Ids:
    """The first of every pose's contacts in the order of `KINDS`, of those that are near enough."""
    clearance = 0.0 if site.payload is None else site.payload.clearance
    kind = site.part[pairs].max(axis=1)
    near = np.where(kind == KINDS.index("payload"), clearance, 0.0)  # a stranger's geoms may have margins
    touching = np.flatnonzero(distance < near)
    touching = touching[np.lexsort((kind[touching], pose[touching]))]
    return np.asarray(touching[np.unique(pose[touching], return_index=True)[1]])


def collisions(site: Site, q: Array) -> list[tuple[str, str] | None]:
    """Find the two bodies that touch in every pose.

    Args:
        site: The site.
        q: Joint angles, (poses, n) [rad, m].

    Returns:
        Per pose the names of the bodies of `contacts`; None where there is no contact.
    """
    return [found.bodies if found else None for found in contacts(site, q)]


def check_poses(site: Site, q: Array) -> None:
    """Refuse the first pose that the arm cannot take.

    Args:
        site: The site.
        q: Joint angles, (poses, n) [rad, m].

    Raises:
        PoseError: Names the pose and the limit or the colliding bodies.
    """
    q = check_array(q, (None, site.arm.n_joints), "q [rad, m]")
    lower, upper = site.arm.limits
    for i, k in np.argwhere((q < lower) | (q > upper)):
        joint = site.arm.joints[k]
        limits = f"{joint.lower:.4f} to {joint.upper:.4f}"
        raise PoseError(f"pose {i + 1}: {joint.name} at {q[i, k]:.4f} {joint.unit}, expected {limits}")
    for i, pair in enumerate(collisions(site, q)):
        if pair:
            raise PoseError(f"pose {i + 1}: {pair[0]} collides with {pair[1]} at q = {site.arm.words(q[i])}")


def has_surroundings(site: Site) -> bool:
    """Whether anything of the world collides, such as a floor or a wall."""
    model = site.model
    collides = (model.geom_contype | model.geom_conaffinity) != 0
    return bool((collides & (model.geom_bodyid == 0)).any())


def hidden(site: Site, q: Array) -> list[tuple[str, str] | None]:
    """Find the first marker of every pose whose line of sight is blocked.

    A ray is cast from the station to every marker. The marker's own body blocks none, nor does what is nearer
    than TARGET_RADIUS to it; another marker, the load point's shackle and the payload do.

    Args:
        site: The site.
        q: Joint angles, (poses, n) [rad, m].

    Returns:
        Per pose the marker and the body that blocks it; None where all are visible.

    Raises:
        BenchError: When no tracker stands there.
    """
    if site.station is None:
        raise BenchError("line of sight: expected a site with a station, got one without")
    return [_first_hidden(site, site.station, data) for data in _poses(site, q)]


def _first_hidden(site: Site, station: Array, data: mujoco.MjData) -> tuple[str, str] | None:
    hit = np.empty(1, dtype=np.int32)
    beams = data.xpos[site.markers] - station
    lengths = np.sqrt((beams**2).sum(axis=1))
    for k, (beam, length) in enumerate(zip(beams, lengths, strict=True)):
        if length <= TARGET_RADIUS:
            continue
        share = mujoco.mj_ray(site.sight, data, station, beam, OPAQUE, True, site.markers[k], hit, None)
        if share >= 0 and share * length < length - TARGET_RADIUS:
            return site.arm.markers[k], site.names[site.model.geom_bodyid[hit[0]]]
    return None
