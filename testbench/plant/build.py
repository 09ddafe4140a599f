"""The true arm as MuJoCo models: conversion of rigid MJCF to elastic MJCF, and copies for fast evaluation.

`elastic_mjcf` adds six sprung virtual joints after every link and one per joint. The coupled 6x6 stiffness
K = inv(C) of a link becomes six fixed tendons, one per eigenvector of K, over the link's three slides and
three hinges. Their energy is 1/2 sum lambda_k (v_k^T theta)^2 = 1/2 theta^T K theta. The result is plain MJCF
that MuJoCo's own viewer opens.

A Newton step of the equilibrium needs MuJoCo's kinematics and the gravity force. They take 2.8 us per pose,
and the call from Python takes as long. So a second model holds several copies of the arm, without geoms and
springs, and one call evaluates a pose in each copy.
"""

import copy
import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np

from testbench.arm.folder import Arm, Link
from testbench.arm.mjcf import MAX_LENGTH, find_body, mesh_files, read_meshes, read_mjcf
from testbench.errors import Array, Ids, InputError
from testbench.plant.disturbance import (
    NOMINAL_DISTURBANCES,
    Disturbances,
    GearErrorCoefficients,
    SpringEffects,
)

# --- Conversion of rigid MJCF to elastic MJCF: six sprung virtual joints after every link, one per joint ----

VIRTUAL_JOINT_AXES = ("x", "y", "z", "phi_x", "phi_y", "phi_z")  #: Axes of a link in theta, in order.
CARRIER_MASS = 1e-9
"""Mass [kg] and inertia [kg m^2] of the body between a link and the next joint.

MuJoCo admits at most six degrees of freedom per body, so a link's virtual joint needs a body of its own. The
mass is too small to change the arm's weight in double precision.
"""

BRAKE_ARMATURE = 1e15
"""Armature of an actuated joint [kg m^2, kg]: its brake is on, so that a simulated arm holds its pose.

Statics does not depend on it. Without it the two joints on one axis make the mass matrix singular.
"""

SPRING_DAMPING_TIME = 0.02
"""Damping of every spring over its stiffness [s]: in a time simulation the arm comes to rest. Statics ignores
it."""


def _virtual_joint_name(link: str, axis: str) -> str:
    """Name the slide or hinge of a link's virtual joint in the elastic MJCF, such as link_2_theta_phi_x."""
    return f"{link}_theta_{axis}"


def _joint_spring_name(joint: str) -> str:
    """Name the spring in series with an actuated joint in the elastic MJCF, such as joint_2_theta."""
    return f"{joint}_theta"


def elastic_mjcf(arm: Arm, foundation_compliance: Array | None = None) -> str:
    """Convert an arm's rigid MJCF to an elastic one: virtual joints with springs of the true compliances.

    Contacts are off: whether a pose is free of collisions is checked on the rigid arm.

    Args:
        arm: Description of the arm; its rigid.xml is read.
        foundation_compliance: Diagonal of the compliance of the foundation below the base, at the base's
            origin in world axes, (6,) [m/N, rad/(N m)]; None for a rigid foundation.

    Returns:
        MJCF text; mesh files are named as in rigid.xml.
    """
    root = copy.deepcopy(read_mjcf(arm.mjcf_path))
    root.set("model", f"{arm.name}_elastic")
    option = root.find("option")
    if option is None:
        option = ET.SubElement(root, "option")
    # Contacts are off; stiff springs need these options.
    option.set("jacobian", "dense")  # MuJoCo 4.0.0's sparse constraint solver is wrong
    option.set("integrator", "implicitfast")  # damping in proportion to stiffness is stiff
    option.set("timestep", "0.001")
    flag = option.find("flag")
    ET.SubElement(option, "flag", contact="disable") if flag is None else flag.set("contact", "disable")
    # A virtual joint at the end of every link, with six springs.
    tendons = ET.SubElement(root, "tendon")
    ends = [*(link.name for link in arm.links[1:]), arm.tool]
    for link, end in zip(arm.links, ends, strict=True):
        _insert_virtual_joint(arm.mjcf_path, root, link, end)
        _add_springs(tendons, link)
    # A spring in series with every actuated joint.
    for joint in arm.joints:
        _insert_spring(root, joint.name, 1 / joint.compliance)
    if foundation_compliance is not None:
        # A sprung body below the base.
        base = find_body(arm.mjcf_path, root, arm.links[0].name)
        parent = next(element for element in root.iter() if base in list(element))
        carrier = _insert_carrier(parent, base, "foundation", np.eye(3), "foundation")
        for base_joint, compliance in zip(carrier.findall("joint"), foundation_compliance, strict=True):
            base_joint.set("stiffness", repr(float(1 / compliance)))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode")


def _insert_virtual_joint(rigid: Path, root: ET.Element, link: Link, end: str) -> None:
    """Put a body with the link's virtual joint between the link and the body at its end."""
    parent, child = find_body(rigid, root, link.name), find_body(rigid, root, end)
    carrier = _insert_carrier(parent, child, f"{link.name}_end", link.beam_axes, f"{link.name}_theta")
    tiny = repr(CARRIER_MASS)
    ET.SubElement(carrier, "inertial", pos="0 0 0", mass=tiny, diaginertia=" ".join([tiny] * 3))


def _insert_carrier(parent: ET.Element, child: ET.Element, name: str, frame: Array, joint: str) -> ET.Element:
    """Insert a body between two others, with slides and hinges JOINT_x to JOINT_phi_z along a frame."""
    carrier = ET.Element("body", name=name, pos=child.attrib.pop("pos", "0 0 0"))
    parent.insert(list(parent).index(child), carrier)
    parent.remove(child)
    for k, axis in enumerate(VIRTUAL_JOINT_AXES):
        kind, along = "slide" if k < 3 else "hinge", " ".join(map(repr, frame[:, k % 3].tolist()))
        ET.SubElement(carrier, "joint", name=f"{joint}_{axis}", type=kind, axis=along)
    carrier.append(child)
    return carrier


def _add_springs(tendons: ET.Element, link: Link) -> None:
    """Add six fixed tendons whose springs have the link's stiffness together."""
    for k, (stiffness, v) in enumerate(zip(*tendon_springs(link.compliance), strict=True)):
        tendon = ET.SubElement(
            tendons,
            "fixed",
            name=f"{link.name}_spring_{k + 1}",
            stiffness=repr(float(stiffness)),
            damping=repr(float(SPRING_DAMPING_TIME * stiffness)),
            springlength="0",
        )
        for axis, coef in zip(VIRTUAL_JOINT_AXES, v, strict=True):
            if coef != 0:
                ET.SubElement(
                    tendon, "joint", joint=_virtual_joint_name(link.name, axis), coef=repr(float(coef))
                )


def tendon_springs(C: Array) -> tuple[Array, Array]:
    """Decompose the stiffness C^-1 of a link into six springs, C^-1 = sum_i k_i v_i v_i^T.

    The springs follow from the eigenvectors of the unit-diagonal matrix D^-1/2 C D^-1/2. C itself mixes m/N
    with rad/(N m), and its eigenvectors lose digits of the small entries.

    Mathematics: `loaded-8`.

    Args:
        C: Compliance of the link, positive definite, (6, 6) [m/N, rad/N, rad/(N m)].

    Returns:
        Stiffness k of each spring, (6,) [N/m, N m/rad], and its direction v as rows, of length one, (6, 6).
    """
    # Unit-diagonal matrix and its eigenvectors.
    d = np.sqrt(np.diag(C))
    eigenvalues, Q = np.linalg.eigh(C / np.outer(d, d))
    # Back to C's units: each spring's direction, normalised to length one.
    v = Q.T / d
    norm = np.linalg.norm(v, axis=1)
    return norm**2 / eigenvalues, v / norm[:, None]


def _insert_spring(root: ET.Element, joint: str, stiffness: float) -> None:
    """Insert a sprung joint of the same type on the axis of an actuated one."""
    body = next(b for b in root.iter("body") if any(j.get("name") == joint for j in b.findall("joint")))
    actuated = next(j for j in body.findall("joint") if j.get("name") == joint)
    spring = ET.Element(
        "joint",
        name=_joint_spring_name(joint),
        type=actuated.get("type", "hinge"),
        axis=actuated.get("axis", ""),
        stiffness=repr(stiffness),
        damping=repr(SPRING_DAMPING_TIME * stiffness),
    )
    actuated.set("armature", repr(BRAKE_ARMATURE))
    body.insert(list(body).index(actuated) + 1, spring)


# --- The true arm as MuJoCo models: one for inspection, and one with several copies for computation ---------

COMPILE_ERRORS = (ValueError, RuntimeError, mujoco.FatalError, mujoco.UnexpectedError)
"""Errors that MuJoCo raises if it does not compile a model."""
MAX_COLLIDING_PAIRS = 50_000
"""Most pairs of geoms on different bodies that may collide: those of ten links with 33 geoms each."""
MAX_HULL_CORNERS = 1000
"""Most corners of the convex hull by which a mesh collides."""
ARMS_PER_MODEL = 8
"""Number of copies of the arm in one MuJoCo model. It compiles in 15 ms; the time grows with the square."""


@dataclass(frozen=True)
class ModelCopies:
    """Hold a MuJoCo model with several copies of an arm's bodies and joints, compiled when first needed."""

    model: mujoco.MjModel  #: Model of one arm.

    @cached_property
    def model_with_copies(self) -> mujoco.MjModel:
        """Compile the MuJoCo model with `ARMS_PER_MODEL` copies of the arm, without geoms and springs."""
        return _copies_in_one_model(self.model, ARMS_PER_MODEL)


@dataclass(frozen=True)
class Plant:
    """Hold the true arm: a MuJoCo model with virtual joints on springs, and its disturbances.

    All its joints are slides and hinges, so that one index serves qpos and qvel. To change the MuJoCo model,
    replace `model` with an altered copy of it; `model_with_copies` takes over gravity and poses of bodies.
    """

    arm: Arm  #: Description of the arm.
    model: mujoco.MjModel  #: Elastic MuJoCo model.
    copies: ModelCopies  #: Several copies of the arm in one model, from before `model` was altered.
    theta_indices: Ids  #: Index of each virtual joint in MuJoCo's qpos and qvel, (n_theta,).
    joint_indices: Ids  #: Index of each actuated joint in MuJoCo's qpos and qvel, (n,).
    tool_body: int  #: Body id of the tool.
    marker_bodies: Ids  #: Body ids of the markers, (m,).
    load_point: Array  #: Load point in the tool's frame, (3,) [m].
    #: True compliance in MuJoCo's coordinates, zero at the actuated joints, (nv, nv) [m/N, rad/N, rad/(N m)].
    C_qpos: Array
    joint_moves_body: Array  #: 1 where a joint moves a body, else 0, (bodies, nv) [1].
    disturbances: Disturbances  #: Disturbances of the true arm.
    joint_offset: Array  #: True minus commanded joint coordinates, equal in all poses, (n,) [rad, m].
    load_point_error: Array  #: True minus recorded load point, tool's axes, (3,) [m].
    #: True minus nominal frames of the joints and of the tool, (n + 1, 6) [m, rad]: shift along the axes of
    #: the link before, rotation about the frame's own axes. `model` contains them.
    frame_errors: Array
    gear_errors: GearErrorCoefficients | None = None  #: Joint errors that depend on the pose; None for none.
    spring_effects: SpringEffects | None = None  #: Elastic behaviour beyond constant matrices; None for none.

    @cached_property
    def model_with_copies(self) -> mujoco.MjModel:
        """Return the MuJoCo model with several copies of the arm, with gravity and body poses of `model`."""
        compiled = self.copies.model_with_copies
        if self.model is self.copies.model:
            return compiled
        altered = copy.copy(compiled)
        altered.opt.gravity[:] = self.model.opt.gravity
        for name in ("body_pos", "body_quat"):
            single_arm, all_arms = getattr(self.model, name)[1:], getattr(altered, name)[1:]
            all_arms.reshape(-1, *single_arm.shape)[:] = single_arm
        return altered

    @property
    def joint_spring_indices(self) -> Ids:
        """Return the index in MuJoCo's qpos of the spring in series with each actuated joint, (n,)."""
        return self.theta_indices[6 * len(self.arm.links) :]

    def compliance(self, q: Array) -> Array:
        """Compute the true compliance of links and joints in some poses, in MuJoCo's coordinates.

        Args:
            q: Commanded joints, (poses, n) [rad, m].

        Returns:
            Compliance, (poses, nv, nv) [m/N, rad/N, rad/(N m)]; (nv, nv) if it is the same in all poses.
        """
        if self.spring_effects is None:
            return self.C_qpos
        C, hinges = self.C_qpos.copy(), self.joint_spring_indices
        if self.spring_effects.joint_coupling is not None:
            C[np.ix_(hinges, hinges)] += self.spring_effects.joint_coupling
        if self.spring_effects.pose_dependence is None:
            return C
        root = np.ones((len(q), len(C)))
        root[:, self.theta_indices[: 6 * len(self.arm.links)]] = (
            self.spring_effects.pose_dependence.root_factors(q)
        )
        return root[:, :, None] * C * root[:, None, :]


def compile_mjcf(path: Path, text: str) -> mujoco.MjModel:
    """Compile MJCF text to a MuJoCo model.

    Args:
        path: Path of the rigid MJCF that the text comes from; mesh files are read from its folder.
        text: MJCF text.

    Returns:
        The MuJoCo model.

    Raises:
        InputError: If MuJoCo refuses the text, or a geom is too large or too many geoms can collide.
    """
    meshes = read_meshes(mesh_files(path, read_mjcf(path)))
    try:
        model = mujoco.MjModel.from_xml_string(_small_hulls(text), meshes)
    except COMPILE_ERRORS as err:
        raise InputError(path, "", " ".join(f"MuJoCo refuses it: {err}".split())) from err
    check_geoms(path, model)
    return model


def _small_hulls(text: str) -> str:
    """Limit the corners of the hulls by which meshes collide: those of a fine cylinder take minutes."""
    root = ET.fromstring(text)
    for mesh in root.iter("mesh"):
        corners = float(mesh.get("maxhullvert", -1))
        mesh.set("maxhullvert", str(int(corners) if 0 <= corners < MAX_HULL_CORNERS else MAX_HULL_CORNERS))
    return ET.tostring(root, encoding="unicode")


def check_geoms(path: Path, model: mujoco.MjModel) -> None:
    """Refuse geoms larger than `MAX_LENGTH`, and more than `MAX_COLLIDING_PAIRS` pairs that can collide.

    Args:
        path: Path of the MJCF, for messages.
        model: The compiled MuJoCo model.

    Raises:
        InputError: If a geom or the number of pairs is too large.
    """
    bounded = model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE
    reach = np.abs(np.hstack([model.geom_pos, model.geom_aabb])).max(axis=1)
    for g in np.flatnonzero(bounded & ~(reach <= MAX_LENGTH)).tolist():
        place = f"<geom name={model.geom(g).name!r}>"
        raise InputError(path, place, f"expected lengths up to {MAX_LENGTH:g} m, got {reach[g]:.3g} m")

    collides = (model.geom_contype | model.geom_conaffinity) != 0
    per_body = np.bincount(model.geom_bodyid[collides], minlength=model.nbody).astype(int)
    pairs = int(per_body.sum() ** 2 - (per_body**2).sum()) // 2
    if pairs > MAX_COLLIDING_PAIRS:
        allowed = f"expected at most {MAX_COLLIDING_PAIRS} colliding pairs of geoms of different bodies"
        raise InputError(path, "<geom>", f"{allowed}, got {pairs}")


def build_plant(arm: Arm) -> Plant:
    """Build the true arm as its folder describes it: elastic, without disturbances.

    Args:
        arm: Description of the arm; its rigid.xml is read.

    Returns:
        The true arm with its elastic MuJoCo model.

    Raises:
        InputError: If MuJoCo refuses the arm's MJCF.
    """
    return plant_from_model(arm, compile_mjcf(arm.mjcf_path, elastic_mjcf(arm)))


def plant_from_model(arm: Arm, model: mujoco.MjModel) -> Plant:
    """Make the true arm, without disturbances, from its compiled elastic MuJoCo model.

    Args:
        arm: Description of the arm.
        model: MuJoCo model compiled from `elastic_mjcf`.

    Returns:
        The true arm.
    """
    names = [_virtual_joint_name(link.name, axis) for link in arm.links for axis in VIRTUAL_JOINT_AXES]
    names += [_joint_spring_name(joint.name) for joint in arm.joints]
    theta = np.array([model.joint(name).dofadr[0] for name in names])
    # Compliances in the order of MuJoCo's degrees of freedom.
    C = np.zeros((model.nv, model.nv))
    C[np.ix_(theta, theta)] = arm.C_theta
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    tool = data.body(arm.tool)
    return Plant(
        arm=arm,
        model=model,
        copies=ModelCopies(model),
        theta_indices=theta,
        joint_indices=np.array([model.joint(j.name).dofadr[0] for j in arm.joints], dtype=int),
        tool_body=model.body(arm.tool).id,
        marker_bodies=np.array([model.body(name).id for name in arm.markers]),
        load_point=np.asarray(tool.xmat.reshape(3, 3).T @ (data.body(arm.load_point).xpos - tool.xpos)),
        C_qpos=C,
        joint_moves_body=_carries(model),
        disturbances=NOMINAL_DISTURBANCES,
        joint_offset=np.zeros(arm.n_joints),
        load_point_error=np.zeros(3),
        frame_errors=np.zeros((arm.n_joints + 1, 6)),
    )


def weightless(plant: Plant) -> Plant:
    """Copy a true arm with zero gravity in its MuJoCo model."""
    model = copy.copy(plant.model)
    model.opt.gravity[:] = 0
    return replace(plant, model=model)


def _copies_in_one_model(model: mujoco.MjModel, arms: int) -> mujoco.MjModel:
    """Copy a model's bodies and joints several times, all from the world's origin.

    Statics needs a body's mass and its centre, not its inertia.
    """
    spec = mujoco.MjSpec()
    spec.option.gravity = model.opt.gravity
    for _ in range(arms):
        bodies = [spec.worldbody]
        for b in range(1, model.nbody):
            body = bodies[model.body_parentid[b]].add_body(
                pos=model.body_pos[b],
                quat=model.body_quat[b],
                explicitinertial=True,
                mass=model.body_mass[b],
                ipos=model.body_ipos[b],
                inertia=np.ones(3),
            )
            bodies.append(body)
            first = model.body_jntadr[b]
            for j in range(first, first + model.body_jntnum[b]):
                body.add_joint(
                    type=model.jnt_type[j], pos=model.jnt_pos[j], axis=model.jnt_axis[j], armature=1
                )
    return spec.compile()


def _carries(model: mujoco.MjModel) -> Array:
    """Mark which joints move a body: one, else zero, (bodies, nv)."""
    joint_moves = np.zeros((model.nbody, model.nv))
    for body in range(1, model.nbody):
        first = model.body_dofadr[body]
        joint_moves[body] = joint_moves[model.body_parentid[body]]
        joint_moves[body, first : first + model.body_dofnum[body]] = 1
    return joint_moves
