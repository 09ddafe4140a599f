"""The true arm as MuJoCo models: one for inspection, and one with several copies for computation.

A Newton step needs MuJoCo's kinematics and the gravity force, 2.8 us per pose; the call from Python costs as
much. So the second model holds several copies of the arm, without geoms and springs: one call evaluates a
pose in each.
"""

import copy
import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from testbench.arm.folder import Arm
from testbench.arm.mesh import read_meshes
from testbench.arm.mjcf import LENGTH, mesh_files, read_mjcf
from testbench.errors import Array, Ids, InputError
from testbench.plant.disturbance import NOMINAL, Disturbances, Gears
from testbench.plant.elastic import elastic_mjcf, theta_names
from testbench.plant.joint_law import Beyond

REFUSED = (ValueError, RuntimeError, mujoco.FatalError, mujoco.UnexpectedError)
"""What MuJoCo raises of a model that it does not compile."""
MAX_PAIRS = 50_000
"""Most geoms that may collide: 316 on ten links."""
HULL_CORNERS = 1000
"""Most corners of the convex hull by which a mesh collides."""
ABREAST = 8
"""Number of copies. MuJoCo compiles them in 15 ms; the time grows with the square of their number."""


@dataclass(frozen=True)
class Plant:
    """Hold the true arm: a MuJoCo model with sprung virtual joints.

    All its joints are slides and hinges, so that one address serves qpos and qvel. To change the MuJoCo
    model, use `with_model`: it also updates the copies.
    """

    arm: Arm  #: Description of the arm.
    model: mujoco.MjModel  #: Elastic MuJoCo model.
    abreast: mujoco.MjModel  #: Copies of its bodies and joints.
    theta: Ids  #: Address of each virtual joint, (n_theta,).
    joints: Ids  #: Address of each actuated joint, (n,).
    tool: int  #: Body id of the tool.
    markers: Ids  #: Body ids of the markers, (m,).
    load: Array  #: Load point in the tool's frame, as MuJoCo reads it, (3,) [m].
    C: Array  #: True compliance in MuJoCo's coordinates, zero at the actuated joints, (nv, nv).
    carries: Array  #: One where a joint moves a body, else zero, (bodies, nv) [1].
    disturbances: Disturbances  #: Disturbances of the true arm.
    offset: Array  #: True minus commanded joint angles, equal in all poses, (n,) [rad].
    centre: Array  #: True minus recorded load point, tool's axes, (3,) [m].
    #: True minus drawn frames of the joints and the tool, (n + 1, 6) [m, rad]: shift along the axes of the
    #: link before, turn about the frame's own. The model has them.
    frames: Array
    gears: Gears | None = None  #: Joint errors that depend on the pose; None for none.
    beyond: Beyond | None = None  #: Elastic behaviour beyond constant matrices; None for none.

    @property
    def hinges(self) -> Ids:
        """Return the address of the sprung joint in series with each actuated one, (n,)."""
        return self.theta[6 * len(self.arm.links) :]

    def compliance(self, q: Array) -> Array:
        """Compute the true compliance in given poses.

        Args:
            q: Commanded joint angles, (poses, n) [rad, m].

        Returns:
            Compliance, (poses, nv, nv) [m/N, rad/(N m)]; C, (nv, nv), if it does not depend on the pose.
        """
        if self.beyond is None:
            return self.C
        C, hinges = self.C.copy(), self.hinges
        if self.beyond.between is not None:
            C[np.ix_(hinges, hinges)] += self.beyond.between
        if self.beyond.follows is None:
            return C
        root = np.ones((len(q), len(C)))
        root[:, self.theta[: 6 * len(self.arm.links)]] = self.beyond.follows.factors(q)
        return root[:, :, None] * C * root[:, None, :]


def compile_mjcf(path: Path, text: str) -> mujoco.MjModel:
    """Compile MJCF text to a MuJoCo model; mesh files are read from the folder of `path`.

    Args:
        path: The rigid MJCF that the text comes from; for messages and meshes.
        text: MJCF.

    Returns:
        The model.

    Raises:
        InputError: If MuJoCo refuses the text.
    """
    meshes = read_meshes(mesh_files(path, read_mjcf(path)))
    try:
        model = mujoco.MjModel.from_xml_string(_small_hulls(text), meshes)
    except REFUSED as err:
        raise InputError(path, "", " ".join(f"MuJoCo refuses it: {err}".split())) from err
    check_geoms(path, model)
    return model


def _small_hulls(text: str) -> str:
    """Limit the corners of the hulls by which meshes collide: those of a fine cylinder take minutes."""
    root = ET.fromstring(text)
    for mesh in root.iter("mesh"):
        own = float(mesh.get("maxhullvert", -1))
        mesh.set("maxhullvert", str(int(own) if 0 <= own < HULL_CORNERS else HULL_CORNERS))
    return ET.tostring(root, encoding="unicode")


def check_geoms(path: Path, model: mujoco.MjModel) -> None:
    """Refuse geoms of a size that no arm has, and models with too many geoms to check poses in time.

    Args:
        path: File of the model, for the message.
        model: The compiled MuJoCo model.

    Raises:
        InputError: If a geom is too large, or too many pairs of geoms can collide.
    """
    bounded = model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE
    reach = np.abs(np.hstack([model.geom_pos, model.geom_aabb])).max(axis=1)
    for g in np.flatnonzero(bounded & ~(reach <= LENGTH)).tolist():
        place = f"<geom name={model.geom(g).name!r}>"
        raise InputError(path, place, f"expected lengths up to {LENGTH:g} m, got {reach[g]:.3g} m")

    collides = (model.geom_contype | model.geom_conaffinity) != 0
    own = np.bincount(model.geom_bodyid[collides], minlength=model.nbody).astype(int)
    pairs = int(own.sum() ** 2 - (own**2).sum()) // 2
    if pairs > MAX_PAIRS:
        problem = f"expected at most {MAX_PAIRS} pairs of geoms of different bodies that collide, got {pairs}"
        raise InputError(path, "<geom>", problem)


def build_plant(arm: Arm) -> Plant:
    """Build the elastic MuJoCo model of an arm.

    Args:
        arm: The arm.

    Returns:
        The plant, without disturbances.

    Raises:
        InputError: If MuJoCo refuses the arm's MJCF.
    """
    return plant_of(arm, compile_mjcf(arm.rigid, elastic_mjcf(arm)))


def plant_of(arm: Arm, model: mujoco.MjModel) -> Plant:
    """Make the plant of an arm from its compiled elastic model.

    Args:
        arm: The arm.
        model: Its elastic MuJoCo model.

    Returns:
        The plant.
    """
    theta = np.array([model.joint(name).dofadr[0] for name in theta_names(arm)])
    # Compliances in the order of MuJoCo's degrees of freedom.
    C = np.zeros((model.nv, model.nv))
    C[np.ix_(theta, theta)] = arm.C_theta
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    tool = data.body(arm.tool)
    return Plant(
        arm=arm,
        model=model,
        abreast=_side_by_side(model, ABREAST),
        theta=theta,
        joints=np.array([model.joint(j.name).dofadr[0] for j in arm.joints], dtype=int),
        tool=model.body(arm.tool).id,
        markers=np.array([model.body(name).id for name in arm.markers]),
        load=np.asarray(tool.xmat.reshape(3, 3).T @ (data.body(arm.load).xpos - tool.xpos)),
        C=C,
        carries=_carries(model),
        disturbances=NOMINAL,
        offset=np.zeros(arm.n_joints),
        centre=np.zeros(3),
        frames=np.zeros((arm.n_joints + 1, 6)),
    )


def with_model(plant: Plant, model: mujoco.MjModel) -> Plant:
    """Return the plant with the gravity and the places of bodies of an altered copy of its model.

    Args:
        plant: The plant.
        model: The altered copy.

    Returns:
        The new plant.
    """
    abreast = copy.copy(plant.abreast)
    abreast.opt.gravity[:] = model.opt.gravity
    for name in ("body_pos", "body_quat"):
        one, all_arms = getattr(model, name)[1:], getattr(abreast, name)[1:]
        all_arms.reshape(-1, *one.shape)[:] = one
    return replace(plant, model=model, abreast=abreast)


def weightless(plant: Plant) -> Plant:
    """Copy a plant without gravity.

    Args:
        plant: The plant.

    Returns:
        The copy.
    """
    model = copy.copy(plant.model)
    model.opt.gravity[:] = 0
    return with_model(plant, model)


def _side_by_side(model: mujoco.MjModel, arms: int) -> mujoco.MjModel:
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
    carries = np.zeros((model.nbody, model.nv))
    for body in range(1, model.nbody):
        first = model.body_dofadr[body]
        carries[body] = carries[model.body_parentid[body]]
        carries[body, first : first + model.body_dofnum[body]] = 1
    return carries
