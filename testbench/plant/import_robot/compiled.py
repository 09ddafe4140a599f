"""A robot as MuJoCo compiles it, so that defaults, frames, classes and trees are as MuJoCo means them."""

import math
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import mujoco
import numpy as np

from testbench.errors import Array, InputError
from testbench.plant.build import REFUSED
from testbench.plant.collide import VISUAL_GROUPS, body_name
from testbench.plant.import_robot.equalities import Coupling, couplings_of
from testbench.plant.import_robot.meshes import MAX_ALL_FACES
from testbench.plant.import_robot.robot import (
    Body,
    Joint,
    Mesh,
    Note,
    Robot,
    Shape,
    Site,
    pose_of,
)
from testbench.plant.import_robot.solids import outermost, primitive
from testbench.plant.shapes import KINDS, geom_rgba, rotation_of

ODD = {int(mujoco.mjtJoint.mjJNT_FREE): "is free", int(mujoco.mjtJoint.mjJNT_BALL): "is a ball"}
NO_GEOMS = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
SLIDES = int(mujoco.mjtJoint.mjJNT_SLIDE)
UNLIMITED = 2 * math.pi  #: Of a turning joint without limits, each way [rad].
SLIDE = 1.0  #: Of a sliding joint without limits, each way [m].
ROOT = "world link"  #: Stands for "world", which MuJoCo takes for the world itself.
NOTHING = 1e-14  #: Of a body without a mass, which must move in MuJoCo [kg].


@dataclass(frozen=True, eq=False)
class Cleaned:
    """A robot's text that names no file of the disk."""

    text: str  #: URDF or MJCF.
    assets: dict[str, bytes]  #: Meshes as binary STL, by the names in the text.
    notes: tuple[Note, ...]
    prepare: Callable[[mujoco.MjSpec], None] = lambda _: None  #: What is changed before MuJoCo compiles it.
    surfaces: Mapping[str, Mesh] = field(default_factory=dict)  #: Meshes that MuJoCo has a box for, by name.
    #: Bodies whose joint cannot be one of an arm, and why.
    odd: Mapping[str, str] = field(default_factory=dict)
    #: What joints mimic of others: sum of terms = constant, its `follower` the joint that mimics.
    couplings: Sequence[Coupling] = ()
    driven: frozenset[str] = frozenset()  #: Joints that motors drive.


def compiled(file: Path, name: str, cleaned: Cleaned) -> Robot:
    """The bodies of a robot.

    Args:
        file: Where it is from, for messages.
        name: The robot's.
        cleaned: What MuJoCo may read of it.

    Raises:
        InputError: When MuJoCo refuses it.
    """
    model, stated = _compile(file, cleaned)
    surfaces = _surfaces(file, model, cleaned.surfaces)
    bodies: list[Body] = []
    index: dict[int, int] = {0: -1}  # of MuJoCo's body the last of ours, whose origin may lie on a joint
    origins: dict[int, Array] = {0: np.zeros(3)}  # that origin in MuJoCo's body
    for b in _by_depth(model):
        parent = int(model.body_parentid[b])
        before = pose_of(np.eye(3), -origins[parent]) @ _pose(model.body_pos[b], model.body_quat[b])
        split, origins[b] = _split(model, b, index[parent], before, len(bodies))
        split[-1] = _filled(model, b, split[-1], origins[b], weighed=stated[b])
        geoms = range(int(model.body_geomadr[b]), int(model.body_geomadr[b] + model.body_geomnum[b]))
        shapes = (_shape(model, surfaces, g, origins[b]) for g in geoms)
        split[-1] = replace(split[-1], shapes=tuple(shape for shape in shapes if shape))
        bodies += [_marked(body, cleaned) for body in split]
        index[b] = len(bodies) - 1
    named = {j: _joint_name(model, j) for j in range(model.njnt)}
    couplings = (*cleaned.couplings, *couplings_of(model, named, index))
    return Robot(name, tuple(bodies), cleaned.notes, couplings, cleaned.driven)


def _by_depth(model: mujoco.MjModel) -> list[int]:
    """Ids of the bodies, those next to the world first."""
    depth = [0]
    for b in range(1, model.nbody):
        depth.append(depth[model.body_parentid[b]] + 1)
    return sorted(range(1, model.nbody), key=depth.__getitem__)


def _compile(file: Path, cleaned: Cleaned) -> tuple[mujoco.MjModel, list[bool]]:
    """MuJoCo's model, and of every body whether the file states its mass."""
    try:
        spec = mujoco.MjSpec.from_string(cleaned.text, assets=cleaned.assets)
        cleaned.prepare(spec)
        with warnings.catch_warnings(action="ignore"):  # of masses and motors, which statics does not ask
            model = spec.compile()
        weighs = spec.compiler.inertiafromgeom != NO_GEOMS  # what no geom gives a mass is meant to have none
        stated = [bool(body.explicitinertial) for body in spec.bodies]
        light = model.body_mass <= NOTHING
    except REFUSED as err:  # lines are of the text above, not of the file
        problem = re.sub(r",? line [0-9]+", "", " ".join(f"MuJoCo refuses it: {err}".split()))
        raise InputError(file, "", problem) from err
    return model, [own or (weighs and bool(none)) for own, none in zip(stated, light, strict=True)]


def _surfaces(file: Path, model: mujoco.MjModel, own: Mapping[str, Mesh]) -> list[tuple[Mesh, Array]]:
    """Of every mesh its triangles, and their pose in MuJoCo's mesh, (4, 4) [m]; MuJoCo moves meshes."""
    shown = model.geom_dataid[model.geom_type == mujoco.mjtGeom.mjGEOM_MESH]
    faces = int(model.mesh_facenum[shown].astype(int).sum())
    if not own and faces > MAX_ALL_FACES:
        raise InputError(file, "<geom>", f"expected at most {MAX_ALL_FACES} triangles in all, got {faces}")
    found: list[tuple[Mesh, Array]] = []
    for k in range(model.nmesh):
        if mesh := own.get(model.mesh(k).name):
            moved = _pose(model.mesh_pos[k], model.mesh_quat[k])
            found.append((mesh, np.asarray(np.linalg.inv(moved), dtype=float)))
            continue
        vertex, face = int(model.mesh_vertadr[k]), int(model.mesh_faceadr[k])
        corners = np.asarray(model.mesh_vert[vertex : vertex + int(model.mesh_vertnum[k])], dtype=float)
        triangles = model.mesh_face[face : face + int(model.mesh_facenum[k])].astype(int)
        found.append((Mesh(corners, triangles, outermost(corners)), np.eye(4)))
    return found


def _marked(body: Body, cleaned: Cleaned) -> Body:
    """The body, told why its joint cannot be one of an arm."""
    own = [c for c in cleaned.couplings if body.joint and c.follower == body.joint.name]
    follows = next((name for c in own for name in c.terms if name != c.follower), "")
    odd = cleaned.odd.get(body.name, body.odd)
    return replace(body, name="world" if body.name == ROOT else body.name, odd=odd, follows=follows)


def _split(model: mujoco.MjModel, b: int, parent: int, before: Array, count: int) -> tuple[list[Body], Array]:
    """A body of MuJoCo as bodies of one joint each, their origins on the joints.

    Args:
        model: MuJoCo's.
        b: MuJoCo's body.
        parent: Ours before it; -1 for the world.
        before: Pose of MuJoCo's body in the parent, (4, 4) [m].
        count: How many bodies of ours there are.

    Returns:
        The bodies, and the origin of the last one in MuJoCo's body, (3,) [m].
    """
    name = body_name(model, b)
    joints = range(int(model.body_jntadr[b]), int(model.body_jntadr[b] + model.body_jntnum[b]))
    if not joints:
        return [Body(name, parent, before)], np.zeros(3)
    if odd := next((ODD[kind] for j in joints if (kind := int(model.jnt_type[j])) in ODD), ""):
        return [Body(name, parent, before, odd=odd)], np.zeros(3)
    bodies = []
    if parent < 0:  # an arm that moves against the world itself
        bodies.append(Body(f"{name}_base", -1, np.eye(4)))
        parent = count
    origin = np.zeros(3)
    for j in joints:
        pose = before @ pose_of(np.eye(3), model.jnt_pos[j] - origin) @ _at_zero(model, j)
        own = name if j == joints[-1] else f"{name}_{len(bodies) + 1}"
        bodies.append(Body(own, parent, pose, joint=_joint(model, j)))
        parent, origin, before = count + len(bodies) - 1, model.jnt_pos[j], np.eye(4)
    return bodies, origin


def _at_zero(model: mujoco.MjModel, j: int) -> Array:
    """How a joint at q = 0 moves its body from where the file draws it, at q = ref, (4, 4)."""
    axis, back = model.jnt_axis[j], -float(model.qpos0[model.jnt_qposadr[j]])
    if int(model.jnt_type[j]) == SLIDES:
        return pose_of(np.eye(3), axis * back)
    quat = np.array([math.cos(back / 2), *(math.sin(back / 2) * axis)])
    return _pose(np.zeros(3), quat)


def _joint_name(model: mujoco.MjModel, j: int) -> str:
    return model.joint(j).name or f"joint_{j + 1}"


def _joint(model: mujoco.MjModel, j: int) -> Joint:
    slides, limited = int(model.jnt_type[j]) == SLIDES, bool(model.jnt_limited[j])
    ours = SLIDE if slides else UNLIMITED
    lower, upper = model.jnt_range[j] if limited else (-ours, ours)
    return Joint(
        name=_joint_name(model, j),
        axis=model.jnt_axis[j].copy(),
        prismatic=slides,
        lower=float(lower),
        upper=float(upper),
        limited=limited,
    )


def _filled(model: mujoco.MjModel, b: int, body: Body, origin: Array, *, weighed: bool) -> Body:
    """A body with its mass and sites, as seen from an origin in MuJoCo's body."""
    mass = float(model.body_mass[b])
    mass = mass if mass > NOTHING else 0.0
    axes = rotation_of(model.body_iquat[b])
    sites = [s for s in range(model.nsite) if model.site_bodyid[s] == b and model.site(s).name]
    return replace(
        body,
        mass=mass,
        com=model.body_ipos[b] - origin if mass else np.zeros(3),
        inertia=axes @ np.diag(model.body_inertia[b]) @ axes.T,
        weighed=weighed,
        sites=tuple(
            Site(model.site(s).name, _pose(model.site_pos[s] - origin, model.site_quat[s])) for s in sites
        ),
    )


def _shape(
    model: mujoco.MjModel, surfaces: Sequence[tuple[Mesh, Array]], g: int, origin: Array
) -> Shape | None:
    """A geom as a surface; None for a plane."""
    kind, size = KINDS.get(int(model.geom_type[g])), model.geom_size[g].copy()
    if kind is None:
        return None
    pose, mesh = _pose(model.geom_pos[g] - origin, model.geom_quat[g]), None
    if kind == "mesh":
        mesh, within = surfaces[int(model.geom_dataid[g])]
        pose = pose @ within
    return Shape(
        kind=kind,
        size=size,
        pose=pose,
        mesh=mesh or primitive(kind, size),
        rgba=geom_rgba(model, g),
        visual=int(model.geom_group[g]) < VISUAL_GROUPS,
        collides=bool(model.geom_contype[g] | model.geom_conaffinity[g]),
    )


def _pose(position: Array, quat: Array) -> Array:
    return pose_of(rotation_of(quat), position)
