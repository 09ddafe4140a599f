"""Robots as strangers describe them, small and made up here: URDF and MJCF with the habits of real files."""

import struct
from pathlib import Path

import numpy as np

TETRAHEDRON = np.array([[0, 0, 0], [100, 0, 0], [0, 60, 0], [0, 0, 200.0]])  # mm
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def write_stl(file: Path) -> None:
    """A tetrahedron of 100 x 60 x 200 as binary STL."""
    rows = b"".join(struct.pack("<12fH", 0, 0, 0, *TETRAHEDRON[f].ravel(), 0) for f in FACES)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(bytes(80) + struct.pack("<I", len(FACES)) + rows)


def light_urdf(folder: Path) -> Path:
    """Seven turned axes with meshes of a package in millimetres, a flange, and a gripper that mimics."""
    write_stl(folder / "light_support/meshes/link.stl")
    (folder / "light_support/package.xml").write_text("<package><name>light_support</name></package>")
    mesh = '<mesh filename="package://light_support/meshes/link.stl" scale="0.001 0.001 0.001"/>'
    shape = f'<origin xyz="0 0.01 -0.02" rpy="0 0.2 0"/><geometry>{mesh}</geometry>'
    turns = "0 0 0|1.5708 0 3.1416|1.5708 0 3.1416|1.5708 0 0|-1.5708 3.1416 0|1.5708 0 0|-1.5708 3.1416 0"
    joints, links = "", '<link name="world"/><link name="base/link"/>'
    for k, rpy in enumerate(turns.split("|")):
        before = f"link_{k}" if k else "base/link"
        kind = "continuous" if k == 6 else "revolute"
        joints += f"""<joint name="a{k + 1}" type="{kind}"><origin xyz="0 0.0{k} 0.2" rpy="{rpy}"/>
            <parent link="{before}"/><child link="link_{k + 1}"/><axis xyz="0 {k % 2} {1 - k % 2}"/>
            <limit lower="-2.{k}" upper="1.{k}" effort="1" velocity="1"/></joint>"""
        links += f"""<link name="link_{k + 1}"><inertial><origin xyz="0.01 -0.02 0.0{k + 1}"
            rpy="0.1 0.2 0.3"/>
            <mass value="{5 - k / 2}"/><inertia ixx="0.03" iyy="0.04" izz="0.02" ixy="0.001" ixz="0"
            iyz="0.002"/>
            </inertial><visual>{shape}<material
            name="orange"/></visual><collision>{shape}</collision></link>"""
    finger = """<link name="finger_{0}"><inertial><origin xyz="0 0.01 0"/><mass value="0.02"/>
        <inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="finger_joint_{0}" type="prismatic"><origin xyz="0 0 0.05" rpy="0 0 {1}"/>
        <parent link="hand"/><child link="finger_{0}"/><axis xyz="0 1 0"/>
        <limit lower="0" upper="0.04" effort="1" velocity="1"/>{2}</joint>"""
    text = f"""<?xml version="1.0"?><robot name="light 7">
        <material name="orange"><color rgba="1 0.4 0 1"/></material>{links}
        <joint name="w" type="fixed"><origin xyz="0.5 -0.2 0.7" rpy="0 0.3 0.4"/><parent link="world"/>
        <child link="base/link"/></joint>{joints}
        <link name="tool0"/><joint name="f" type="fixed"><origin xyz="0 0 0.126" rpy="0 -0.3 1.2"/>
        <parent link="link_7"/><child link="tool0"/></joint>
        <link name="hand"><inertial><mass value="0.7"/><origin xyz="0.01 0 0.03"/>
        <inertia ixx="1e-3" iyy="2e-3" izz="2e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="h" type="fixed"><origin xyz="0 0 0.01"/><parent link="tool0"/><child
            link="hand"/></joint>
        {finger.format(1, 0, "")}{finger.format(2, 3.14159, '<mimic joint="finger_joint_1"/>')}</robot>"""
    file = folder / "light_support/urdf/light.urdf"
    file.parent.mkdir(parents=True)
    file.write_text(text)
    return file


def heavy_urdf(folder: Path) -> Path:
    """Six joints of a heavy arm without a single mass: boxes and cylinders, base and tool0 fixed."""
    spots = "0 0 0.4|0.35 0 0.4|0 0 1.25|0.2 0 -0.05|0.9 0 0|0.2 0 0".split("|")
    axes = "0 0 -1|0 1 0|0 1 0|-1 0 0|0 1 0|-1 0 0".split("|")
    sizes = "0.5 0.5 0.8|0.4 0.4 1.4|0.8 0.3 0.3|0.9 0.2 0.2|0.2 0.2 0.2|0.04 0.2 0.2".split("|")
    base = '<collision><geometry><cylinder radius="0.4" length="0.4"/></geometry></collision>'
    bare = "".join(f'<link name="{name}"/>' for name in ("base", "tool0", "adapter"))
    text = f'<robot name="heavy"><link name="base_link">{base}</link>{bare}'
    for k, (spot, axis, size) in enumerate(zip(spots, axes, sizes, strict=True), start=1):
        before = "adapter" if k == 4 else f"link_{k - 1}" if k > 1 else "base_link"
        text += f"""<link name="link_{k}"><visual><origin xyz="0.1 0 0.1"/><geometry><box
            size="{size}"/></geometry>
            </visual></link><joint name="joint_a{k}" type="revolute"><origin xyz="{spot}"/>
            <parent link="{before}"/><child link="link_{k}"/><axis xyz="{axis}"/>
            <limit lower="-2" upper="1.5" effort="0" velocity="2"/></joint>"""
    for name, parent, child, rpy in (
        ("b", "base_link", "base", "0 0 0"),
        ("a", "link_3", "adapter", "0.1 0.2 0.3"),
        ("t", "link_6", "tool0", "0 1.57 0"),
    ):
        text += f"""<joint name="{name}" type="fixed"><origin xyz="0.1 0 0" rpy="{rpy}"/>
            <parent link="{parent}"/><child link="{child}"/></joint>"""
    file = folder / "heavy.urdf"
    file.write_text(text + "</robot>")
    return file


def classes_mjcf(folder: Path) -> Path:
    """Seven axes by default classes, a <frame>, an included file, a hand with coupled fingers."""
    write_stl(folder / "assets/link.stl")
    chain, close = "", ""
    for k in range(7):
        limits = ' range="-3 -0.1"' if k == 3 else ""
        chain += f"""<body name="link{k + 1}" pos="0.0{k} 0 0.3" quat="1 {(-1) ** k} 0 0">
            <inertial mass="{4 - k / 2}" pos="0.01 -0.02 -0.05" fullinertia="0.1 0.12 0.03 -0.001 0.006
            0.01"/>
            <joint name="joint{k + 1}"{limits}/><geom class="visual" mesh="link" pos="0 0 0.01"/>
            <geom class="collision" size="0.05 0.1"/>"""
        close += "</body>"
    finger = """<body name="{0}" pos="0 0 0.06" quat="{1}"><inertial mass="0.015" pos="0 0.01 0"
        diaginertia="2e-6 2e-6 1e-6"/><joint name="{0}_joint" class="finger"/>
        <geom class="collision" type="box" size="0.01 0.01 0.02"/></body>"""
    hand = f"""<frame euler="0 0 -0.785"><body name="flange" pos="0 0 0.107"><body name="gripper"><inertial
            mass="0.73"
        pos="-0.01 0 0.03" diaginertia="0.001 0.0025 0.0017"/>{finger.format("left", "1 0 0 0")}
        {finger.format("right", "0 0 0 1")}<site name="pinch" pos="0 0 0.1"/></body></body></frame>"""
    (folder / "rest.xml").write_text("""<mujocoinclude><actuator><motor joint="joint1"/></actuator>
        <keyframe><key qpos="0 0 0 -1 0 0 0 0.04 0.04"/></keyframe>
        <equality><joint joint1="left_joint" joint2="right_joint"/></equality></mujocoinclude>""")
    file = folder / "classes.xml"
    file.write_text(f"""<mujoco model="classes"><compiler angle="radian" meshdir="assets" autolimits="true"/>
        <option integrator="implicit" gravity="0 0 0"/><default><default class="arm">
        <joint armature="0.1" damping="1" axis="0 0 1" range="-2.9 2.9"/><general gainprm="3"/>
        <default class="finger"><joint type="slide" axis="0 1 0" range="0 0.04"/></default>
        <default class="visual"><geom type="mesh" contype="0" conaffinity="0" group="2"
            material="white"/></default>
        <default class="collision"><geom type="capsule" group="3"/></default></default></default>
        <asset><texture name="t" type="2d" builtin="checker" width="9" height="9"/>
        <material name="white" texture="t" rgba="1 1 0.9 1"/>
        <mesh file="link.stl" scale="0.001 0.001 0.001"/></asset>
        <worldbody><light pos="0 0 3"/><geom type="plane" size="3 3 0.1"/>
        <body name="link0" childclass="arm"><inertial mass="3" pos="0 0 0.05" diaginertia="0.1 0.1 0.1"/>
        {chain}{hand}{close}</body>
        <body name="cube" pos="1 0 1"><freejoint/><geom size="0.1"/></body></worldbody>
        <include file="rest.xml"/></mujoco>""")
    return file


def mounted_mjcf(folder: Path) -> Path:
    """Six axes in degrees on a turned mount, masses from geoms, a joint off its body, one with ref."""
    places = "0 0 0.18|0 0.17 0|0 -0.14 0.6|0 0 0.57|0 0.13 0|0 0 0.12"
    axes = "0 0 1|0 1 0|0 1 0|0 1 0|0 0 1|0 1 0".split("|")
    chain = ""
    for k, (place, axis) in enumerate(zip(places.split("|"), axes, strict=True), start=1):
        turn = ' euler="0 90 0"' if k in (2, 4) else ""
        odd = {2: ' pos="0.03 0 0.05"', 3: ' ref="20"', 5: ' limited="false"'}.get(k, "")
        chain += f"""<body name="link_{k}" pos="{place}"{turn}><joint name="j{k}" axis="{axis}" range="-150
            100"{odd}/>
            <geom type="capsule" fromto="0 0 0 0 0.02 {0.3 - k / 30}" size="0.05"/>"""
    file = folder / "mounted.xml"
    file.write_text(f"""<mujoco model="mounted"><compiler eulerseq="zyx"/><worldbody>
        <body name="plinth" pos="0.1 0.2 0" euler="0 20 10"><geom type="box" size="0.3 0.3 0.1"/>
        <body name="mount" pos="0.3 -0.4 0.5" euler="30 40 50"><geom type="box" size="0.2 0.2 0.05" pos="0
            0 -0.1"/>
        <body name="base" pos="0 0 0.1" quat="1 0 0 1"><geom type="cylinder" size="0.08 0.05"/>{chain}
        <site name="attachment_site" pos="0 0.1 0" quat="-1 1 0 0"/>{"</body>" * 6}</body></body>
        </body></worldbody></mujoco>""")
    return file


def sliding_mjcf(folder: Path) -> Path:
    """A slide on the floor itself, two hinges on one body, and a turning wrist; one joint has no name."""
    file = folder / "sliding.xml"
    file.write_text("""<mujoco model="sliding"><compiler angle="radian"/><worldbody>
        <body name="carriage" pos="0 0.5 0.2"><joint name="track" type="slide" axis="1 0 0" range="-1 2"
            ref="0.3"/>
        <inertial mass="80" pos="0 0 0.1" diaginertia="3 3 3"/><geom type="box" size="0.3 0.2 0.1"/>
        <body name="column" pos="0 0 0.3"><joint name="turn" pos="0.05 -0.1 0" axis="0 0 1" range="-3 3"/>
        <joint name="lift" type="slide" axis="0 0 1" range="0 1.2"/><joint name="tilt" axis="0 1 0"
            pos="0.1 0 0.4"
        range="-1 1" ref="0.2"/><inertial mass="40" pos="0 0 0.5" diaginertia="2 2 1"/>
        <geom type="capsule" fromto="0 0 0 0 0 1" size="0.1"/>
        <body name="arm" pos="0.2 0 0.8" euler="0.1 0.2 0.3"><joint name="wrist" axis="1 1 0" range="-2 2"/>
        <inertial mass="9" pos="0.2 0 0" diaginertia="0.1 0.3 0.3"/>
        <geom type="ellipsoid" size="0.3 0.05 0.05" pos="0.2 0 0"/><body name="tcp" pos="0.5 0 0"/>
        </body></body></body></worldbody></mujoco>""")
    return file
