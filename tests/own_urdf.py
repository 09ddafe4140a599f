"""A robot's own URDF of an arm of ours, drawn in other frames, with things that are none of our business."""

from xml.sax.saxutils import quoteattr

import numpy as np
from scipy.spatial.transform import Rotation

from testbench.files.export_own import nominal_rigid, relative_pose

EXTRA = """
  <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
  <!-- a camera beside the chain, a gripper behind it -->
  <link name="camera"/><joint name="to_camera" type="fixed"><origin xyz="0.1 0.2 0.3"/><parent link="l2"/>
    <child link="camera"/></joint>
  <link name="finger"/><joint name="finger_joint" type="prismatic"><parent link="{tip}"/>
    <child link="finger"/><axis xyz="0 1 0"/><limit lower="0" upper="0.04"/></joint>
  <link name="other_finger"/><joint name="other_finger_joint" type="prismatic"><parent link="{tip}"/>
    <child link="other_finger"/><axis xyz="0 -1 0"/><limit lower="0" upper="0.04" effort="1" velocity="1"/>
    <mimic joint="finger_joint"/></joint>
  <transmission name="t"><joint name="{first}"/><origin xyz="4 5 6"/></transmission>
"""


def some_pose(rng, size=0.4):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.random(rng=rng).as_matrix(), rng.uniform(-size, size, 3)
    return pose


def onto(axis, theirs, along):
    """A frame whose axis `theirs` is `axis`, its origin on it."""
    pose = np.eye(4)
    both = np.array([axis, np.roll(axis, 1) + 0.1]), np.array([theirs, np.roll(theirs, 1) + 0.1])
    one, two = (np.linalg.qr(pair.T, mode="complete")[0] for pair in both)
    for frame, pair in ((one, both[0]), (two, both[1])):
        frame[:, 0] *= np.sign(frame[:, 0] @ pair[0])
        frame[:, 2] = np.cross(frame[:, 0], frame[:, 1])
    pose[:3, :3], pose[:3, 3] = one @ two.T, along * axis
    return pose


def origin(pose, digits=17):
    rpy = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz")
    xyz, turn = (" ".join(f"{v:.{digits}g}" for v in x) for x in (pose[:3, 3], rpy))
    return f'<origin rpy="{turn}" xyz="{xyz}"/>'


def own_urdf(vjm, rng, *, tip=True, digits=17):
    """The text, the pose of its first link in the model's world, and of its tip in the model's tool."""
    model, arm = nominal_rigid(vjm), vjm.arm
    root = some_pose(rng, 2.0)
    frames, parts, link = [relative_pose(vjm.base_pose, root)], ['  <link name="base"/>'], "base"
    for k, (step, axis, joint) in enumerate(zip(model.steps, vjm.joint_axes, arm.joints, strict=True)):
        theirs = np.eye(3)[k % 3] if k != 1 else np.array([0.6, 0.0, -0.8])
        frames.append(onto(axis, theirs, rng.uniform(-0.2, 0.2)))
        whole = relative_pose(frames[-2], step @ frames[-1])
        if k % 2:  # a fixed link in between
            between = some_pose(rng)
            parts.append(
                f'  <link name="between_{k}"/><joint name="fix_{k}" type="fixed">{origin(between, digits)}'
            )
            parts.append(f'    <parent link="{link}"/><child link="between_{k}"/></joint>')
            whole, link = relative_pose(between, whole), f"between_{k}"
        kind = "prismatic" if joint.prismatic else ("continuous", "revolute")[k % 2]
        twice = " ".join(str(2 * x) for x in theirs)
        limit = f'<limit lower="{joint.lower}" upper="{joint.upper}" effort="9" velocity="9"/>'
        parts.append(
            f'  <link name="l{k + 1}"><inertial><mass value="3"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" '
            f'iyz="0" izz="1"/></inertial><visual>{origin(np.eye(4))}<geometry>'
            f'<mesh filename="package://r/l{k + 1}.stl"/></geometry></visual></link>'
        )
        parts.append(f'  <joint name={quoteattr(joint.name)} type="{kind}">\n    {origin(whole, digits)}')
        parts.append(f'    <parent link="{link}"/><child link="l{k + 1}"/><axis xyz="{twice}"/>')
        parts.append(f"    {'' if kind == 'continuous' else limit}</joint>")
        link = f"l{k + 1}"
    last = np.eye(4)
    for name in ("flange", "tool0") if tip else ():
        fixed = some_pose(rng)
        parts.append(f'  <link name="{name}"/><joint name="to_{name}" type="fixed">{origin(fixed, digits)}')
        parts.append(f'    <parent link="{link}"/><child link="{name}"/></joint>')
        last, link = last @ fixed, name
    extra = EXTRA.format(tip=link, first=arm.joints[0].name)
    text = f'<?xml version="1.0" ?>\n<robot name="own">\n{chr(10).join(parts)}{extra}</robot>\n'
    return text, root, relative_pose(model.tool, frames[-1] @ last)
