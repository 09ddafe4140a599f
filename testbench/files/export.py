"""Export of an identified arm as URDF, new or the robot's own, read back before it replaces a file.

Compliances, errors and laws of the joints, and weights have no place in a URDF; they are written to a
documented JSON file in the same folder. A new URDF has links, joints with limits, tool and masses, no shapes.
"""

import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from testbench.arm.document import unique
from testbench.arm.folder import Arm
from testbench.arm.mjcf import NUMBERS, angle_unit, find_body, numbers, read_mjcf
from testbench.arm.urdf_text import NEW_STAMP, origin_of, with_origins, words
from testbench.errors import Array, BenchError
from testbench.files.export_geometry import (
    Rigid,
    UrdfFrames,
    displacement_statistics,
    frame_distance,
    identified_rigid,
    random_joints,
    tool_poses,
)
from testbench.files.export_left import GEOMETRY, displacements
from testbench.files.export_own import place_frames, read_robot_chain, robot_origins
from testbench.identify.absolute.state import ArmState
from testbench.model.joint_laws import joint_laws
from testbench.model.kinematics import body_pose, urdf_poses
from testbench.model.laws import UNIT_COMPENSATOR, sizes_of
from testbench.runs import manifest as files
from testbench.runs.rows import Row
from testbench.runs.whole import whole_files

MAX_URDF_ERROR = 1e-6  #: Most that the written URDF may differ from the model [m, rad].
KIND = "what a URDF cannot hold"
BEGINS = rb'\{\s*"format": 1,\s*"kind": "what a URDF cannot hold"'
WORDS = {
    "geometry": "is in the URDF. The constants here were added to the nominal geometry: slides x, y, z [m] "
    "and turns about x, y, z [rad] in the link's beam axes at its end, and one offset per joint [rad, m]",
    "links": "at_m is the identified end of the link, axes has its beam axes as columns; both are in the "
    "frame of urdf_link. Compliance times force and moment there, in the beam axes [N, N m], gives slide "
    "and turn [m, rad]",
    "joints": "compliance times the torque about the joint's axis, or the force along it, gives the "
    "deflection of the joint [rad/(N m), m/N]",
    "errors": "a hinge turns further than its command q by the sum of sine_k sin(order_k q) + cosine_k "
    "cos(order_k q), plus ratio q + play tanh(10 t) + stiffening t |t|, with t its torque over torque_scale "
    "[rad]. A slide has no sine and cosine [m]",
    "laws": "sizes s of a joint. Let x be the joint's torque times its compliance in elastic.toml, x_0 under "
    "own weight and compensator, x_1 under the load too. Beside its compliance the joint turns by the sum "
    "of {formulas} [rad, m]. With r the compensator's lever over its longest lever, it also turns by "
    f"-s (x_1 - x_0) {UNIT_COMPENSATOR:g} r^2 / (1 + {UNIT_COMPENSATOR:g} r^2)",
    "weights": "masses [kg] and their centres [m] in the frame of urdf_link, which bend the model",
    "joint_map": "only if files count joints otherwise: a joint of the URDF is its row of L times "
    "file_joints, plus its number in q_0 [rad, m]",
    "root": "the URDF's first link in the model's world",
    "tool": "the URDF's tip in the model's tool",
}
"""A sentence for every part."""


ROOT = "world"  #: The first link: MJCF keeps the name for itself, so no link of an arm has it.
UNKNOWN = {"effort": "0", "velocity": "0"}
"""Limits that URDF asks for and an arm's folder does not hold."""


@dataclass(frozen=True)
class Draft:
    """Hold a URDF, or its substitute, that is not written yet."""

    text: str
    joints: tuple[str, ...]  #: Names of its joints, in the arm's order.
    frames: UrdfFrames
    #: Distance between the robot's own and the arm's drawing [m, rad]; None for a new URDF.
    drawing_off: float | None = None
    as_urdf: Callable[[str], str] = str  #: Function that converts the written text to a URDF.
    encoding: str = "utf-8"  #: Encoding of the text.
    loose_meshes: bool = False  #: Whether meshes are named by relative paths.

    @property
    def aside(self) -> float:
        """Return the distance from the model's tool to the tip, as drawn [m]."""
        return float(np.linalg.norm(self.frames.tip[:3, 3]))


def draft_new(state: ArmState) -> Draft:
    """Make a URDF from scratch: its frames are the bodies of rigid.xml.

    Args:
        state: The calibrated arm.

    Returns:
        The URDF, not yet written.
    """
    arm, geometry, one = state.vjm.arm, identified_rigid(state), np.eye(4)
    names = [link.name for link in arm.links]
    frames = UrdfFrames([*names, arm.tool], one, [one] * len(names), one)
    return Draft(_new_urdf(state, geometry), tuple(joint.name for joint in arm.joints), frames)


def draft_robot_urdf(state: ArmState, file: Path, tip: str | None = None) -> Draft:
    """Replace the origins in the robot's own URDF.

    Args:
        state: The identified arm.
        file: The robot's URDF.
        tip: Link that carries the tool; None to find it.

    Returns:
        The new text.

    Raises:
        InputError: If it is not a URDF of the arm.
    """
    robot_chain = read_robot_chain(file, state.vjm.arm, tip)
    frames, off = place_frames(robot_chain, state)
    text = with_origins(file, robot_chain.text, robot_origins(robot_chain, frames, identified_rigid(state)))
    return Draft(
        text, tuple(j.name for j in robot_chain.joints), frames, off, loose_meshes=robot_chain.loose_meshes
    )


def export(state: ArmState, draft: Draft, out: Path) -> Row:
    """Write a URDF, and a JSON of the same stem with what it cannot hold: both or none.

    Args:
        state: The identified arm.
        draft: The URDF.
        out: The file.

    Returns:
        Error of the URDF when read back, `read_back`; motion of the tool by the identified geometry,
        `geometry_mm`, and by each kind of effect that the URDF cannot hold, `left`: RMS and largest [mm].

    Raises:
        BenchError: If the URDF, read back, differs from the model's geometry.
        InputError: If a file cannot be written.
    """
    q = random_joints(state.vjm)
    with whole_files([out, companion_path(out)]) as (urdf, other):
        urdf.write_bytes(draft.text.encode(draft.encoding))
        off = read_back(state, draft, out, urdf.read_bytes().decode(draft.encoding))
        left = {kind: displacement_statistics(rows) for kind, rows in displacements(state, q).items()}
        back = Row(poses=len(q), position_um=1e6 * off[0], rotation_urad=1e6 * off[1])
        done = Row(read_back=back, geometry_mm=left.pop(GEOMETRY), left=left)
        files.write_json(compared_label(state, draft.frames, urdf, done), other)
    return done


def companion_path(urdf: Path) -> Path:
    """Return the path of the JSON that belongs to a URDF.

    Args:
        urdf: The URDF.

    Returns:
        The same path with the suffix ".json".
    """
    return urdf.with_suffix(".json")


def read_back(state: ArmState, draft: Draft, urdf: Path, text: str) -> tuple[float, float]:
    """Compare the written file, as Pinocchio reads it, with the model.

    Args:
        state: The identified arm.
        draft: The URDF that was written.
        urdf: The file, for messages and meshes.
        text: Its text.

    Returns:
        Largest difference of the tip [m, rad].

    Raises:
        BenchError: If it exceeds `MAX_URDF_ERROR`.
    """
    q, frames = random_joints(state.vjm), draft.frames
    found = frames.root @ urdf_poses(urdf, draft.as_urdf(text), draft.joints, frames.names[-1], q)
    off = frame_distance(found, tool_poses(state.vjm, q, state.theta_0) @ frames.tip)
    if not max(off) <= MAX_URDF_ERROR:
        got = f"{1e6 * off[0]:.3g} um and {1e6 * off[1]:.3g} urad"
        raise BenchError(f"{urdf.name}, read back, is up to {got} from the model; nothing is written")
    return off


def compared_label(state: ArmState, frames: UrdfFrames, urdf: Path, done: Row) -> dict[str, object]:
    """Make the JSON document that belongs to a URDF; it holds the URDF's digest.

    Args:
        state: The identified arm.
        frames: Frames of the URDF in the model.
        urdf: The file.
        done: Report of `export`.

    Returns:
        The document.
    """
    arm = state.vjm.arm
    formulas = ", ".join(f"{law.formula} ({kind})" for kind, law in joint_laws.items())
    return {
        "format": 1,
        "kind": KIND,
        "arm": arm.name,
        "digests": {name: files.digest(arm.rigid.with_name(name)) for name in ("rigid.xml", "elastic.toml")},
        "urdf_sha256": files.digest(urdf),
        "read_back": done.read_back,
        "left_out": {what: {"rms_mm": rms, "max_mm": most} for what, (rms, most) in done.left.items()},
        "words": WORDS | {"laws": WORDS["laws"].format(formulas=formulas)},
        "root": _pose(frames.root),
        "tool": _pose(frames.tip),
        "links": _links(state, frames),
        "joints": _joints(state),
        "orders": list(state.errors.orders),
        "weights": _weights(state, frames),
        **_joint_map(arm),
    }


def _joint_map(arm: Arm) -> dict[str, object]:
    """How the URDF's joints follow from those of files; nothing where they are the same."""
    joint_map = arm.joint_map
    if joint_map is None:
        return {}
    rows = {joint.name: row for joint, row in zip(arm.joints, joint_map.L.tolist(), strict=True)}
    return {"joint_map": {"file_joints": list(joint_map.names), "L": rows, "q_0": joint_map.q_0.tolist()}}


def _pose(pose: Array) -> dict[str, object]:
    return {"rotation": pose[:3, :3].tolist(), "translation_m": pose[:3, 3].tolist()}


def _links(state: ArmState, frames: UrdfFrames) -> list[dict[str, object]]:
    vjm = state.vjm
    C, left = state.C_theta, state.C_theta.copy()
    found: list[dict[str, object]] = []
    for k, (link, pose) in enumerate(zip(vjm.arm.links, (*vjm.placements, vjm.tool), strict=True)):
        own = slice(6 * k, 6 * k + 6)
        end = pose[:3, 3] + link.frame @ state.theta_0[own][:3]
        R, p = frames.links[k][:3, :3], frames.links[k][:3, 3]
        left[own, own] = 0
        found.append(
            {
                "name": link.name,
                "urdf_link": frames.names[k],
                "at_m": (R.T @ (end - p)).tolist(),
                "axes": (R.T @ link.frame).tolist(),
                "compliance": C[own, own].tolist(),
                "constants": state.theta_0[own].tolist(),
            }
        )
    np.fill_diagonal(left, 0)
    if left.any():
        raise BenchError(
            "C_theta: expected one block per link and one number per joint, got compliances between them"
        )
    return found


def _joints(state: ArmState) -> list[dict[str, object]]:
    arm, errors = state.vjm.arm, state.errors
    first, orders = 6 * len(arm.links), len(errors.orders)
    found: list[dict[str, object]] = []
    sizes = sizes_of(state.vjm, state.C_theta)
    for k, joint in enumerate(arm.joints):
        sine, cosine, single = np.split(state.n[k], [orders, 2 * orders])
        row: dict[str, object] = {
            "name": joint.name,
            "unit": joint.unit,
            "compliance": float(state.C_theta[first + k, first + k]),
            "constant": float(state.theta_0[first + k]),
            "torque_scale": float(state.torque_scale[k]),
            "sine": sine.tolist(),
            "cosine": cosine.tolist(),
        }
        if sizes:
            row["laws"] = sizes[joint.name]
        found.append(row | dict(zip(errors.kinds[2 * orders :], single.tolist(), strict=True)))
    return found


def _weights(state: ArmState, frames: UrdfFrames) -> list[dict[str, object]]:
    poses = (*frames.links, frames.tip)
    rows = zip(frames.names, state.weights.mass, state.weights.centre, poses, strict=True)
    return [
        {"urdf_link": name, "mass_kg": float(m), "centre_m": (T[:3, :3].T @ (c - T[:3, 3])).tolist()}
        for name, m, c, T in rows
    ]


def _new_urdf(state: ArmState, geometry: Rigid) -> str:
    """The text of a URDF."""
    arm = state.vjm.arm
    robot = ET.Element("robot", name=arm.name)
    tensors = _tensors(arm)
    names = [*(link.name for link in arm.links), arm.tool]
    ET.SubElement(robot, "link", name=ROOT)
    for name, mass, centre in zip(names, state.weights.mass, state.weights.centre, strict=True):
        link = ET.SubElement(robot, "link", name=name)
        if mass > 0:
            _inertial(link, float(mass), centre, tensors[name])
    taken = [joint.name for joint in arm.joints]
    taken.append(unique(f"{names[0]}_fixed", taken))
    _add_joint(robot, taken[-1], "fixed", (ROOT, names[0]), geometry.base)
    for k, joint in enumerate(arm.joints):
        kind = "prismatic" if joint.prismatic else "revolute"
        e = _add_joint(robot, joint.name, kind, (names[k], names[k + 1]), geometry.steps[k])
        ET.SubElement(e, "axis", xyz=words(state.vjm.axes[k]))
        ET.SubElement(e, "limit", lower=f"{joint.lower:.12g}", upper=f"{joint.upper:.12g}")
        e[-1].attrib.update(UNKNOWN)
        if arm.joint_map is not None and (follows := arm.joint_map.follows(k)) is not None:
            other, multiplier, offset = follows
            told = {"joint": arm.joints[other].name, "multiplier": f"{multiplier:.12g}"}
            ET.SubElement(e, "mimic", {**told, "offset": f"{offset:.12g}"})
    last = unique(f"{names[-1]}_fixed", taken)
    _add_joint(robot, last, "fixed", (names[-2], names[-1]), geometry.tool)
    ET.indent(robot)
    return f'<?xml version="1.0"?>\n{NEW_STAMP}{ET.tostring(robot, encoding="unicode")}\n'


def _add_joint(robot: ET.Element, name: str, kind: str, ends: tuple[str, str], pose: Array) -> ET.Element:
    e = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(e, "origin", origin_of(pose))
    for tag, link in zip(("parent", "child"), ends, strict=True):
        ET.SubElement(e, tag, link=link)
    return e


def _inertial(link: ET.Element, mass: float, centre: Array, tensor: Array) -> None:
    e = ET.SubElement(link, "inertial")
    ET.SubElement(e, "origin", xyz=words(centre), rpy="0 0 0")
    ET.SubElement(e, "mass", value=f"{mass:.12g}")
    upper = {f"i{'xyz'[a]}{'xyz'[b]}": f"{tensor[a, b]:.12g}" for a in range(3) for b in range(a, 3)}
    ET.SubElement(e, "inertia", upper)


def _tensors(arm: Arm) -> dict[str, Array]:
    """Inertia of every body about its centre in its own axes, as rigid.xml says, (3, 3) [kg m^2]."""
    root = read_mjcf(arm.rigid)
    found = {}
    for name in (*(link.name for link in arm.links), arm.tool):
        e = find_body(arm.rigid, root, name).find("inertial")
        tensor = np.zeros((3, 3))
        if e is not None and "fullinertia" in e.attrib:
            xx, yy, zz, xy, xz, yz = numbers(arm.rigid, e, "fullinertia", NUMBERS["fullinertia"])
            tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        elif e is not None and "diaginertia" in e.attrib:
            R = body_pose(arm, e, angle_unit(root))[:3, :3]
            tensor = R @ np.diag(numbers(arm.rigid, e, "diaginertia", NUMBERS["diaginertia"])) @ R.T
        found[name] = tensor
    return found
