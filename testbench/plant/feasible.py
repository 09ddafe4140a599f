"""Which poses the rigid arm can take: within its limits, free of collision with itself and the floor."""

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from testbench.arm.folder import Arm
from testbench.arm.mjcf import read_mjcf
from testbench.errors import Array, Ids, InputError, PoseError, check_array
from testbench.plant.build import compile_mjcf

COLLIDES = {"contype": str(2**31 - 1), "conaffinity": str(2**31 - 1), "gap": "0", "group": "0"}
"""Of a geom that collides with all that collides, whatever the defaults of a stranger's MJCF say."""
MOST_CONTACTS = 5000  #: In one pose.


@dataclass(frozen=True)
class Room:
    """The rigid arm and the floor, for collision checks."""

    arm: Arm  #: Its description.
    model: mujoco.MjModel  #: Rigid MuJoCo model.
    joints: Ids  #: Address of each actuated joint in qpos, (n,).


def build_room(arm: Arm, floor: float | None = None) -> Room:
    """The rigid MuJoCo model of an arm.

    Args:
        arm: The arm.
        floor: Height of a floor that its MJCF does not have [m]; None for none.

    Raises:
        InputError: When MuJoCo refuses the arm's MJCF.
    """
    root = read_mjcf(arm.rigid)
    lay_floor(root, floor)
    model = compile_mjcf(arm.rigid, ET.tostring(root, encoding="unicode"))
    joints = np.array([model.joint(j.name).qposadr[0] for j in arm.joints], dtype=int)
    return Room(arm, model, joints)


def lay_floor(root: ET.Element, height: float | None) -> None:
    """Add a floor to the MJCF that collides with all that collides; None for none."""
    if height is None:
        return
    world = root.find("worldbody")
    assert world is not None  # the arm has bodies
    place = {"type": "plane", "size": "0 0 1", "pos": f"0 0 {height!r}", "quat": "1 0 0 0"}
    ET.SubElement(world, "geom", {**place, "margin": "0", **COLLIDES})


def has_surroundings(room: Room) -> bool:
    """Whether anything of the world collides, such as a floor or a wall."""
    model = room.model
    collides = (model.geom_contype | model.geom_conaffinity) != 0
    return bool((collides & (model.geom_bodyid == 0)).any())


def collisions(room: Room, q: Array) -> list[tuple[str, str] | None]:
    """The first colliding pair of bodies in every pose, None where the arm is clear."""
    q = check_array(q, (None, room.arm.n_joints), "q [rad, m]")
    model, data = room.model, mujoco.MjData(room.model)
    found: list[tuple[str, str] | None] = []
    for pose in q:
        data.qpos[room.joints] = pose
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        collide(room.arm.rigid, model, data)
        touching = data.contact.geom[data.contact.dist < 0]
        if len(touching):
            one, other = (body_name(model, model.geom_bodyid[g]) for g in touching[0])
            found.append((one, other))
        else:
            found.append(None)
    return found


def body_name(model: mujoco.MjModel, body: int) -> str:
    """Name of a body; body_K where the MJCF gives none."""
    return model.body(int(body)).name or f"body_{body}"


def collide(path: Path, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """MuJoCo's contacts in a pose.

    Raises:
        InputError: When there are more of them than any arm has.
    """
    try:
        mujoco.mj_collision(model, data)
        count = int(data.ncon)
    except mujoco.FatalError:  # they are beyond MuJoCo's own memory
        count = MOST_CONTACTS + 1
    if count > MOST_CONTACTS:
        problem = f"expected at most {MOST_CONTACTS} contacts in a pose, got more: use simpler geoms"
        raise InputError(path, "<geom>", problem)


def check_poses(room: Room, q: Array) -> None:
    """Refuse the first pose that the arm cannot take.

    Raises:
        PoseError: Names the pose and the limit or the colliding bodies.
    """
    q = check_array(q, (None, room.arm.n_joints), "q [rad, m]")
    lower, upper = room.arm.limits
    outside = np.argwhere((q < lower) | (q > upper))
    if len(outside):
        i, k = outside[0]
        joint = room.arm.joints[k]
        raise PoseError(
            f"pose {i + 1}: {joint.name} at {q[i, k]:.4f} {joint.unit}, expected {joint.lower:.4f} to "
            f"{joint.upper:.4f}"
        )
    for i, pair in enumerate(collisions(room, q)):
        if pair:
            raise PoseError(f"pose {i + 1}: {pair[0]} collides with {pair[1]} at q = {room.arm.words(q[i])}")
