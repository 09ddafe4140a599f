"""MJCF as a tree of bodies: MuJoCo compiles it, so defaults, frames and classes are as MuJoCo means them."""

import math
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from testbench.errors import Array, InputError
from testbench.plant.build import REFUSED
from testbench.plant.import_robot.chain import JointOf, Shape, Site, Solid, moved, pose_of
from testbench.plant.import_robot.meshes import MAX_ALL_FACES
from testbench.plant.import_robot.mjcf_text import Cleaned, clean_mjcf
from testbench.plant.import_robot.solids import outermost, solid_shape
from testbench.plant.import_robot.tree import Body, Tree
from testbench.plant.import_robot.urdf import SLIDE, UNLIMITED
from testbench.plant.shapes import KINDS, VISUAL_GROUPS, geom_rgba

ODD = {int(mujoco.mjtJoint.mjJNT_FREE): "is free", int(mujoco.mjtJoint.mjJNT_BALL): "is a ball"}
SLIDES = int(mujoco.mjtJoint.mjJNT_SLIDE)


def read_mjcf_tree(file: Path, root: ET.Element) -> Tree:
    """The bodies of an MJCF.

    Args:
        file: The MJCF, for messages, includes and meshes.
        root: Its root element; it is changed.

    Raises:
        InputError: When it may not be read, or MuJoCo refuses it.
    """
    cleaned = clean_mjcf(file, root)
    model, stated = _compile(file, cleaned)
    _check_shown(file, model)
    outer = [outermost(_corners(model, k)) for k in range(model.nmesh)]
    bodies: list[Body] = []
    index: dict[int, int] = {0: -1}  # of MuJoCo's body the last of ours, whose origin may lie on a joint
    origins: dict[int, Array] = {0: np.zeros(3)}  # that origin in MuJoCo's body
    for b in range(1, model.nbody):
        parent = int(model.body_parentid[b])
        before = pose_of(np.eye(3), -origins[parent]) @ _pose(model.body_pos[b], model.body_quat[b])
        split, origins[b] = _split(model, b, index[parent], before, len(bodies))
        filled = _filled(model, b, split[-1], origins[b], weighed=stated[b])
        split[-1] = replace(filled, shapes=_shapes(model, outer, b, origins[b]))
        bodies += split
        index[b] = len(bodies) - 1
    return Tree(root.get("model") or file.stem, tuple(bodies), cleaned.notes)


def _compile(file: Path, cleaned: Cleaned) -> tuple[mujoco.MjModel, list[bool]]:
    """MuJoCo's model, and of every body whether the file states its mass."""
    try:
        spec = mujoco.MjSpec.from_string(cleaned.text, assets=cleaned.assets)
        with warnings.catch_warnings(action="ignore"):  # of masses and motors, which statics does not ask
            model = spec.compile()
        stated = [bool(body.explicitinertial) for body in spec.bodies]
    except REFUSED as err:
        raise InputError(file, "", " ".join(f"MuJoCo refuses it: {err}".split())) from err
    return model, stated


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
    name = model.body(b).name or f"body_{b}"
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


def _joint(model: mujoco.MjModel, j: int) -> JointOf:
    slides, limited = int(model.jnt_type[j]) == SLIDES, bool(model.jnt_limited[j])
    ours = SLIDE if slides else UNLIMITED
    lower, upper = model.jnt_range[j] if limited else (-ours, ours)
    return JointOf(
        name=model.joint(j).name or f"joint_{j + 1}",
        axis=model.jnt_axis[j].copy(),
        prismatic=slides,
        lower=float(lower),
        upper=float(upper),
        limits_from="file" if limited else "none",
    )


def _check_shown(file: Path, model: mujoco.MjModel) -> None:
    """Refuse meshes that many geoms show."""
    shown = model.geom_dataid[model.geom_type == mujoco.mjtGeom.mjGEOM_MESH]
    faces = int(model.mesh_facenum[shown].astype(int).sum())
    if faces > MAX_ALL_FACES:
        raise InputError(file, "<geom>", f"expected at most {MAX_ALL_FACES} triangles in all, got {faces}")


def _corners(model: mujoco.MjModel, k: int) -> Array:
    """Of a mesh, (v, 3) [m]."""
    first = int(model.mesh_vertadr[k])
    return np.asarray(model.mesh_vert[first : first + int(model.mesh_vertnum[k])], dtype=float)


def _filled(model: mujoco.MjModel, b: int, body: Body, origin: Array, *, weighed: bool) -> Body:
    """A body with its mass and sites, as seen from an origin in MuJoCo's body."""
    mass = float(model.body_mass[b])
    axes = _pose(np.zeros(3), model.body_iquat[b])[:3, :3]
    sites = [s for s in range(model.nsite) if model.site_bodyid[s] == b and model.site(s).name]
    return replace(
        body,
        mass=mass,
        com=model.body_ipos[b] - origin if mass else np.zeros(3),
        inertia=axes @ np.diag(model.body_inertia[b]) @ axes.T,
        weighed=weighed or mass == 0,
        sites=tuple(_site(model, s, origin) for s in sites),
    )


def _site(model: mujoco.MjModel, s: int, origin: Array) -> Site:
    rotation = _pose(np.zeros(3), model.site_quat[s])[:3, :3]
    return Site(model.site(s).name, model.site_pos[s] - origin, rotation)


def _shapes(model: mujoco.MjModel, outer: Sequence[Array], b: int, origin: Array) -> tuple[Shape, ...]:
    """The geoms of a body; of every mesh the corners that its hull needs are known."""
    geoms = range(int(model.body_geomadr[b]), int(model.body_geomadr[b] + model.body_geomnum[b]))
    return tuple(shape for g in geoms if (shape := _shape(model, outer, g, origin)))


def _shape(model: mujoco.MjModel, outer: Sequence[Array], g: int, origin: Array) -> Shape | None:
    """A geom as a surface; None for a plane."""
    kind, size = KINDS.get(int(model.geom_type[g])), model.geom_size[g]
    if kind is None:
        return None
    pose = _pose(model.geom_pos[g] - origin, model.geom_quat[g])
    rgba = geom_rgba(model, g)
    if kind == "mesh":
        k = int(model.geom_dataid[g])
        face, corners = int(model.mesh_faceadr[k]), moved(_corners(model, k), pose)
        faces = model.mesh_face[face : face + int(model.mesh_facenum[k])].astype(int)
        shape = Shape(corners, faces, rgba, visual=True, collides=True, outer=moved(outer[k], pose))
    else:
        counts = {"sphere": 1, "capsule": 2, "cylinder": 2}
        solid = Solid(kind, tuple(map(float, size[: counts.get(kind, 3)])), pose)
        shape = solid_shape(solid, rgba)
    collides = bool(model.geom_contype[g] | model.geom_conaffinity[g])
    return replace(shape, visual=int(model.geom_group[g]) < VISUAL_GROUPS, collides=collides)


def _pose(position: Array, quat: Array) -> Array:
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, np.asarray(quat, dtype=float))
    return pose_of(rotation.reshape(3, 3), position)
