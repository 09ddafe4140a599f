"""What others read in a robot's file, and what both sides of ours read in the arm made of it."""

import re
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin

from testbench.model.vjm import tool_poses
from testbench.plant.shapes import undeflected_body_poses
from testbench.workflows.cell import build_cell


@dataclass(frozen=True)
class Reading:
    """Of some configurations."""

    tips: np.ndarray  #: Pose of the tip in the world, (runs, 4, 4).
    mass: float  #: Of all that moves [kg].
    coms: np.ndarray  #: Centre of mass of all that moves, in the world, (runs, 3).
    inertia: np.ndarray  #: Joint-space inertia of the last run, (n, n).


def pinocchio_urdf(file, tip, names, q):
    """Pinocchio's own reading of a URDF; joints that are not named stay at zero."""
    model = pin.buildModelFromUrdf(str(file))
    data, frame = model.createData(), model.getFrameId(tip)
    assert frame < model.nframes
    tips, coms = [], []
    for row in q:
        at = pin.neutral(model)
        for name, value in zip(names, row, strict=True):
            joint = model.joints[model.getJointId(name)]
            at[joint.idx_q : joint.idx_q + joint.nq] = (
                [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
            )
        pin.framesForwardKinematics(model, data, at)
        tips.append(data.oMf[frame].homogeneous)
        coms.append(pin.centerOfMass(model, data, at).copy())
    mass = sum(inertia.mass for inertia in list(model.inertias)[1:])
    M = pin.crba(model, data, at)
    M = np.triu(M) + np.triu(M, 1).T
    rows = [model.joints[model.getJointId(name)].idx_v for name in names]
    return Reading(np.array(tips), mass, np.array(coms), M[np.ix_(rows, rows)])


def mujoco_mjcf(file, tip, names, q):
    """MuJoCo's own reading of an MJCF; the tip is a body or a site."""
    return _mujoco(mujoco.MjModel.from_xml_path(str(file)), tip, names, q)


def mujoco_urdf(file, tip, names, q):
    """MuJoCo's own reading of a URDF without its shapes: ours is Pinocchio's."""
    text = re.sub(r"<(visual|collision)>.*?</\1>", "", file.read_text(), flags=re.DOTALL)
    bounds = 'fusestatic="false" inertiafromgeom="false" boundmass="1e-12" boundinertia="1e-12"'
    text = text.replace("</robot>", f"<mujoco><compiler {bounds}/></mujoco></robot>")
    return _mujoco(mujoco.MjModel.from_xml_string(text), tip, names, q)


def _mujoco(model, tip, names, q):
    data = mujoco.MjData(model)
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, tip)
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, tip)
    address = [model.joint(name).qposadr[0] for name in names]
    first = int(model.joint(names[0]).bodyid[0])
    tips, coms = [], []
    for row in q:
        data.qpos[:] = 0
        data.qpos[address] = row
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        where = data.body(body) if site < 0 else data.site(site)
        tips.append(_pose(where.xmat.reshape(3, 3), where.xpos))
        coms.append(data.subtree_com[first].copy())
    mass = float(model.body_subtreemass[first])
    return Reading(np.array(tips), mass, np.array(coms), _inertia(model, data, names))


def _inertia(model, data, names):
    """Joint-space inertia without that of the motors, (n, n)."""
    model.dof_armature[:] = 0
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, M)
    rows = [model.joint(name).dofadr[0] for name in names]
    return M[np.ix_(rows, rows)]


def ours(folder: Path, q):
    """The written arm as the model and as the plant read it: two readings."""
    cell = build_cell(folder)
    model = mujoco.MjModel.from_xml_path(str(folder / "rigid.xml"))
    data, first = mujoco.MjData(model), model.body(cell.arm.links[1].name).id
    coms = []
    for row in q:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        coms.append(data.subtree_com[first].copy())
    mass = float(model.body_subtreemass[first])
    M = _inertia(model, data, [j.name for j in cell.arm.joints])
    position, rotation = tool_poses(cell.vjm, q)
    [(p, R)] = undeflected_body_poses(cell.plant, q, (cell.arm.tool,))
    return [
        Reading(np.array([_pose(*pair) for pair in zip(Rs, ps, strict=True)]), mass, np.array(coms), M)
        for Rs, ps in ((rotation, position), (R, p))
    ]


def random_q(folder: Path, seed=7, runs=20):
    """Names of the joints, and random configurations within their limits."""
    arm = build_cell(folder).arm
    lower, upper = arm.limits
    return [j.name for j in arm.joints], np.random.default_rng(seed).uniform(
        lower, upper, (runs, arm.n_joints)
    )


def _pose(rotation, position):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    return pose
