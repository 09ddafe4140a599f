"""Export of an identified arm: what a file cannot hold, a URDF (new or the robot's own), controller files.

Compliances, errors and laws of the joints, and weights have no place in a URDF; they are written to a
documented JSON file in the same folder. A new URDF has links, joints with limits, tool and masses, no shapes.

Export of an identified arm to controller files: joint offsets, with comments on what these cannot hold.

Numbers in the configuration file of a robot's controller: found and replaced, all else unchanged.

- KUKA: `$MAMES` of `$machine.dat`, angle of an axis in its mastering position [deg] (KR C2, Machine Data,
  2.1.7).
- ABB: `cal_offset` of MOTOR_CALIB in MOC.cfg, angle of a motor in its axis' calibration position [rad].
"""

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from testbench.arm.document import unused_name
from testbench.arm.folder import Arm
from testbench.arm.mjcf import ATTRIBUTE_SIZES, angle_unit, attribute_numbers, find_body, read_mjcf
from testbench.errors import Array, BenchError, InputError, read_bytes
from testbench.files.export_own import (
    NEW_STAMP,
    Rigid,
    UrdfFrames,
    displacement_statistics,
    frame_distance,
    identified_rigid,
    origin_of,
    place_frames,
    random_joints,
    read_robot_chain,
    robot_origins,
    tool_poses,
    with_origins,
    words,
)
from testbench.identify.absolute.state import CALIBRATION_EQUILIBRIUM_STEPS, ArmState, joint_equilibrium
from testbench.model.kinematics import body_pose, urdf_link_poses
from testbench.model.laws import UNIT_COMPENSATOR_STIFFNESS, joint_laws, law_sizes
from testbench.model.load import Load, weight
from testbench.runs import manifest as files
from testbench.runs.rows import Row
from testbench.runs.whole import whole_file, whole_files

# --- Effects that a file cannot hold, by their size at the tool, and joint offsets that correct most --------

GEOMETRY, WEIGHT, PAYLOAD = "lengths and tilts of axes", "own weight", "payload, if there is one"
ERRORS = {"harmonics": "periodic errors of the joints", "ratio": "errors in proportion to the angle"}
"""Names of the kinds of joint errors in reports."""
SEEN = 1e-6
"""Least singular value that counts, over the largest [1]: the tool may lie on an axis."""
Sizes = dict[str, tuple[float, float]]
"""Motion of the tool by kind of effect over random poses, RMS and largest [mm]."""


def displacements(state: ArmState, q: Array) -> dict[str, Array]:
    """Compute how every kind of error moves the tool's origin.

    Args:
        state: The identified arm.
        q: Actuated joints, (poses, n) [rad, m].

    Returns:
        Displacements by kind, (poses, 3) [m].
    """
    rigid, still = (
        tool_poses(state.vjm, q, state.theta_0)[:, :3, 3],
        replace(state, error_coefficients=0 * state.error_coefficients),
    )
    sagged, payload = _rest(still, q), state.vjm.arm.payload
    found = {GEOMETRY: rigid - tool_poses(state.vjm, q)[:, :3, 3], WEIGHT: sagged - rigid}
    for kind in dict.fromkeys(state.error_terms.coefficient_kinds):
        own = state.error_coefficients * np.array(
            [name == kind for name in state.error_terms.coefficient_kinds]
        )
        if own.any():
            found[ERRORS.get(kind, kind)] = (
                _rest(replace(state, C_theta=0 * state.C_theta, error_coefficients=own), q) - rigid
            )
    if payload is not None:
        found[PAYLOAD] = _rest(still, q, [weight(state.vjm, np.full(len(q), payload))]) - sagged
    return found


def _rest(state: ArmState, q: Array, loads: list[Load] | None = None) -> Array:
    return joint_equilibrium(state, q, loads or [], CALIBRATION_EQUILIBRIUM_STEPS).chain.tool_position


def all_but_payload(moved: dict[str, Array]) -> Array:
    """Sum the displacements of all kinds except the payload's.

    Args:
        moved: Displacements by kind of error, (poses, 3) [m] each.

    Returns:
        The sum, (poses, 3) [m].
    """
    return np.asarray(np.sum([rows for kind, rows in moved.items() if kind != PAYLOAD], axis=0))


@dataclass(frozen=True)
class BestOffsets:
    """Hold joint offsets that bring the nominal arm closest to the identified arm without load.

    Distances are RMS and largest, with base and tool fitted [mm].
    """

    #: Offsets, (n,) [rad]; zero for the first and the last joint, whose offsets are rotations of base and
    #: tool.
    offsets: Array
    drawn_mm: tuple[float, float]  #: Distance of the tool without them.
    corrected_mm: tuple[float, float]  #: Distance with them.
    left: Sizes  #: Remainder of every kind of effect.


def best_offsets(state: ArmState, q: Array) -> BestOffsets:
    """Fit joint offsets by least squares over the tool's origin.

    Args:
        state: The identified arm.
        q: Poses, (poses, n) [rad].

    Returns:
        The offsets, and what they leave.
    """
    vjm = state.vjm
    n = state.vjm.arm.n_joints
    moved = displacements(state, q)
    wanted = tool_poses(vjm, q)[:, :3, 3] + all_but_payload(moved)

    def off(x: Array) -> Array:  # base, tool, inner joints
        T = tool_poses(vjm, q + np.r_[0, x[9:], 0])
        at = (T[:, :3, 3] + T[:, :3, :3] @ x[6:9]) @ Rotation.from_rotvec(x[3:6]).as_matrix().T + x[:3]
        return np.asarray((at - wanted).ravel())

    found = least_squares(off, np.zeros(n + 7), xtol=1e-12, ftol=1e-12)
    J = np.asarray(found.jac)
    rest = found.fun.reshape(-1, 3)
    offsets = np.r_[0, found.x[9:], 0]
    left = {kind: rows if kind == PAYLOAD else _beyond(J, rows) for kind, rows in moved.items()}
    left[GEOMETRY] -= rest + all_but_payload(left)  # exact at any size
    drawn = _beyond(J[:, :9], all_but_payload(moved))
    return BestOffsets(
        offsets,
        displacement_statistics(drawn),
        displacement_statistics(rest),
        {kind: displacement_statistics(rows) for kind, rows in left.items()},
    )


def _beyond(J: Array, rows: Array) -> Array:
    """Compute the part of displacements that the columns cannot explain."""
    return np.asarray(rows - (J @ np.linalg.lstsq(J, rows.ravel(), rcond=SEEN)[0]).reshape(rows.shape))


# --- Export of an identified arm as URDF, new or the robot's own, read back before it replaces a file -------

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
    f"-s (x_1 - x_0) {UNIT_COMPENSATOR_STIFFNESS:g} r^2 / (1 + {UNIT_COMPENSATOR_STIFFNESS:g} r^2)",
    "weights": "masses [kg] and their centres [m] in the frame of urdf_link, which bend the model",
    "joint_map": "only if files have other joints than the chain: a joint of the URDF is its row of L times "
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
    arm = state.vjm.arm
    geometry = identified_rigid(state)
    one = np.eye(4)
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
    found = frames.root @ urdf_link_poses(urdf, draft.as_urdf(text), draft.joints, frames.names[-1], q)
    off = frame_distance(found, tool_poses(state.vjm, q, state.theta_0) @ frames.tip)
    if not max(off) <= MAX_URDF_ERROR:
        got = f"{1e6 * off[0]:.3g} um and {1e6 * off[1]:.3g} urad"
        raise BenchError(f"read back, {urdf.name} differs from the model by up to {got}; nothing is written")
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
        "digests": {
            name: files.digest(arm.mjcf_path.with_name(name)) for name in ("rigid.xml", "elastic.toml")
        },
        "urdf_sha256": files.digest(urdf),
        "read_back": done.read_back,
        "left_out": {what: {"rms_mm": rms, "max_mm": most} for what, (rms, most) in done.left.items()},
        "words": WORDS | {"laws": WORDS["laws"].format(formulas=formulas)},
        "root": _pose(frames.root),
        "tool": _pose(frames.tip),
        "links": _links(state, frames),
        "joints": _joints(state),
        "orders": list(state.error_terms.orders),
        "weights": _weights(state, frames),
        **_joint_map(arm),
    }


def _joint_map(arm: Arm) -> dict[str, object]:
    """How the URDF's joints follow from those of files; nothing where they are the same."""
    joint_map = arm.joint_map
    if joint_map is None:
        return {}
    rows = {joint.name: row for joint, row in zip(arm.joints, joint_map.L.tolist(), strict=True)}
    return {
        "joint_map": {
            "file_joints": list(joint_map.file_joint_names),
            "L": rows,
            "q_0": joint_map.q_0.tolist(),
        }
    }


def _pose(pose: Array) -> dict[str, object]:
    return {"rotation": pose[:3, :3].tolist(), "translation_m": pose[:3, 3].tolist()}


def _links(state: ArmState, frames: UrdfFrames) -> list[dict[str, object]]:
    vjm = state.vjm
    C, left = state.C_theta, state.C_theta.copy()
    found: list[dict[str, object]] = []
    for k, (link, pose) in enumerate(
        zip(vjm.arm.links, (*vjm.joint_placements, vjm.tool_placement), strict=True)
    ):
        own = slice(6 * k, 6 * k + 6)
        end = pose[:3, 3] + link.beam_axes @ state.theta_0[own][:3]
        R, p = frames.links[k][:3, :3], frames.links[k][:3, 3]
        left[own, own] = 0
        found.append(
            {
                "name": link.name,
                "urdf_link": frames.names[k],
                "at_m": (R.T @ (end - p)).tolist(),
                "axes": (R.T @ link.beam_axes).tolist(),
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
    arm, errors = state.vjm.arm, state.error_terms
    first, orders = 6 * len(arm.links), len(errors.orders)
    found: list[dict[str, object]] = []
    sizes = law_sizes(state.vjm, state.C_theta)
    for k, joint in enumerate(arm.joints):
        sine, cosine, single = np.split(state.error_coefficients[k], [orders, 2 * orders])
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
        found.append(row | dict(zip(errors.coefficient_kinds[2 * orders :], single.tolist(), strict=True)))
    return found


def _weights(state: ArmState, frames: UrdfFrames) -> list[dict[str, object]]:
    poses = (*frames.links, frames.tip)
    rows = zip(frames.names, state.body_masses.mass, state.body_masses.centre_of_mass, poses, strict=True)
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
    for name, mass, centre in zip(
        names, state.body_masses.mass, state.body_masses.centre_of_mass, strict=True
    ):
        link = ET.SubElement(robot, "link", name=name)
        if mass > 0:
            _inertial(link, float(mass), centre, tensors[name])
    taken = [joint.name for joint in arm.joints]
    taken.append(unused_name(f"{names[0]}_fixed", taken))
    _add_joint(robot, taken[-1], "fixed", (ROOT, names[0]), geometry.base)
    for k, joint in enumerate(arm.joints):
        kind = "prismatic" if joint.prismatic else "revolute"
        e = _add_joint(robot, joint.name, kind, (names[k], names[k + 1]), geometry.steps[k])
        ET.SubElement(e, "axis", xyz=words(state.vjm.joint_axes[k]))
        ET.SubElement(e, "limit", lower=f"{joint.lower:.12g}", upper=f"{joint.upper:.12g}")
        e[-1].attrib.update(UNKNOWN)
        if arm.joint_map is not None and (follows := arm.joint_map.followed_joint(k)) is not None:
            other, multiplier, offset = follows
            told = {"joint": arm.joints[other].name, "multiplier": f"{multiplier:.12g}"}
            ET.SubElement(e, "mimic", {**told, "offset": f"{offset:.12g}"})
    last = unused_name(f"{names[-1]}_fixed", taken)
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
    root = read_mjcf(arm.mjcf_path)
    found = {}
    for name in (*(link.name for link in arm.links), arm.tool):
        e = find_body(arm.mjcf_path, root, name).find("inertial")
        tensor = np.zeros((3, 3))
        if e is not None and "fullinertia" in e.attrib:
            xx, yy, zz, xy, xz, yz = attribute_numbers(
                arm.mjcf_path, e, "fullinertia", ATTRIBUTE_SIZES["fullinertia"]
            )
            tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        elif e is not None and "diaginertia" in e.attrib:
            R = body_pose(arm, e, angle_unit(root))[:3, :3]
            tensor = (
                R
                @ np.diag(attribute_numbers(arm.mjcf_path, e, "diaginertia", ATTRIBUTE_SIZES["diaginertia"]))
                @ R.T
            )
        found[name] = tensor
    return found


# --- Export of an identified arm to controller files --------------------------------------------------------

MAX_BYTES = 16_000_000
BYTES = "latin-1"  #: A byte a character, whatever the encoding is.
STAMP = "testbench export: as identified"
DECIMALS = 8  #: Decimals of a number that is written.
NUMBER = r"(?P<number>[-+]?(?:\d++\.?\d*+|\.\d++)(?:[eE][-+]?\d++)?)(?![\w.])"
KUKA_LINE = rf"(?mi)^[ \t]*\$MAMES\[(?P<key>\d+)\][ \t]*=[ \t]*{NUMBER}"
ABB_LINE = rf'(?s)-name\s+"(?P<key>[^"]*)"(?:(?!-name\s).)*?\s-cal_offset\s+{NUMBER}'


@dataclass(frozen=True)
class Format:
    """Describe a kind of controller file."""

    title: str  #: Name in messages.
    name: str  #: Name of one key in the file, `{}` for the key.
    part: str  #: Regular expression of the section with the numbers.
    line: str  #: Regular expression of one number, with the groups `key` and `number`.
    comment: str  #: Beginning of a comment.
    head: str  #: Regular expression of the text before our comment.


KUKA = Format(
    "KUKA's $machine.dat", "$MAMES[{}]", r"(?is)\$MAMES.*", KUKA_LINE, ";", r"(?ims)(.*?^DEFDAT.*?\n)?"
)
ABB = Format("ABB's MOC.cfg", 'cal_offset of "{}"', r"(?m)^MOTOR_CALIB:[^#]*", ABB_LINE, "#", r"[^\n]*\n")


def read_controller(file: Path) -> tuple[Format, str]:
    """Read a controller file and recognise its kind.

    Args:
        file: The file.

    Returns:
        The kind, and the text.

    Raises:
        InputError: When it is of no known kind, or an export wrote it.
    """
    text = read_bytes(file, MAX_BYTES).decode(BYTES)
    if STAMP in text:
        raise InputError(file, "", "testbench export wrote it; expected the robot's own file")
    for form in (KUKA, ABB):
        if re.search(form.part, text):
            return form, text
    if re.search(r"(?m)^kinematics:", text):
        raise InputError(
            file,
            "",
            "this is the kinematics of a UR driver: tools/ur_kinematics.py of a clone of testbench writes it",
        )
    raise InputError(file, "", f"expected {KUKA.title} or {ABB.title}")


def find_numbers(form: Format, file: Path, text: str, keys: Sequence[str]) -> list[re.Match[str]]:
    """Find the numbers of some keys in the text of a controller file.

    Args:
        form: Kind of file.
        file: The file, for messages.
        text: Its text.
        keys: The keys.

    Returns:
        Matches with the group `number`, in the order of the keys.

    Raises:
        InputError: If a key is missing or occurs twice.
    """
    found: dict[str, re.Match[str]] = {}
    part = next(re.finditer(form.part, text))
    for match in re.compile(form.line).finditer(text, *part.span()):
        if match["key"] in found:
            raise InputError(file, form.name.format(match["key"]), "is there twice")
        found[match["key"]] = match
    for key in keys:
        if key not in found or not math.isfinite(float(found[key]["number"])):
            raise InputError(file, "", f"expected {form.title} with a number at {form.name.format(key)}")
    return [found[key] for key in keys]


def _values(numbers: Sequence[re.Match[str]]) -> Array:
    return np.array([float(match["number"]) for match in numbers])


def exchanged(
    form: Format, text: str, numbers: Sequence[re.Match[str]], values: Iterable[float], *said: str
) -> str:
    """Replace numbers in the text of a controller file; add our stamp and comments.

    Args:
        form: Kind of file.
        text: The text.
        numbers: Matches of the numbers, from `find_numbers`.
        values: New numbers, in the same order.
        said: Lines of comment.

    Returns:
        The new text.
    """
    for match, value in sorted(zip(numbers, values, strict=True), key=lambda pair: -pair[0].end()):
        start, end = match.span("number")
        text = f"{text[:start]}{round(value, DECIMALS) + 0.0:.{DECIMALS}f}{text[end:]}"
    newline, head = "\r\n" if "\r\n" in text else "\n", re.match(form.head, text)
    at = head.end() if head else 0
    return text[:at] + "".join(f"{form.comment} {line}{newline}" for line in (STAMP, *said)) + text[at:]


AXES = 6  #: Of a robot whose file is written.
FULL_ROTATION = 2 * np.pi
"""A controller counts whole turns of a motor separately from its angle [rad]."""


def export_offsets(
    state: ArmState, file: Path, out: Path, gears: Sequence[float]
) -> tuple[BestOffsets, float]:
    """Write the joint offsets to a controller file, with comments on what offsets cannot correct.

    Args:
        state: The identified arm.
        file: The robot's own file.
        out: The file to write.
        gears: For ABB: turns of the motors per turn of the axes, n numbers or (n, n) row by row [1].

    Returns:
        The offsets, and the largest motion of the tool by their rounding [m].

    Raises:
        InputError: If the file is none of a known kind, or one cannot be written.
        BenchError: If the arm has other axes or another number of gears, or the offsets, read back, differ.
    """
    form, text = read_controller(file)
    arm = six_axes(form.title, state)
    keys, turns = _axes(form, gears)
    numbers = find_numbers(form, file, text, keys)
    old = _values(numbers)
    q = random_joints(state.vjm)
    best = best_offsets(state, q)
    offsets = arm.to_file_joint_change(best.offsets)  # a controller counts the pendant's joints
    new = old + turns @ offsets
    said = [f"{rms:.3f} mm RMS, {most:.3f} at most: {kind}" for kind, (rms, most) in best.left.items()]
    new -= FULL_ROTATION * np.trunc(new / FULL_ROTATION) if form is ABB else 0
    written = exchanged(form, text, numbers, new.tolist(), "not in the offsets, at the tool:", *said)
    change = _values(find_numbers(form, out, written, keys)) - old
    change -= FULL_ROTATION * np.round((change - turns @ offsets) / FULL_ROTATION) if form is ABB else 0
    read = np.asarray(np.linalg.solve(turns, change), dtype=np.float64)
    read = arm.to_chain_joints(read) - arm.to_chain_joints(np.zeros(AXES))
    off, _ = frame_distance(tool_poses(state.vjm, q + read), tool_poses(state.vjm, q + best.offsets))
    if not off <= MAX_URDF_ERROR:
        raise BenchError(
            f"read back, the offsets are wrong by up to {1e6 * off:.3g} um at the tool; nothing is written"
        )
    with whole_file(out) as path:
        path.write_bytes(written.encode(BYTES))
    return best, off


def six_axes(title: str, state: ArmState) -> Arm:
    """Check that an arm has six hinges.

    Args:
        title: Kind of file, for messages.
        state: The identified arm.

    Returns:
        The arm.

    Raises:
        BenchError: If it has other axes.
    """
    arm = state.vjm.arm
    if (
        arm.n_joints != AXES
        or arm.dependence_matrix is not None
        or any(joint.prismatic for joint in arm.joints)
    ):
        raise BenchError(f"{title}: expected an arm of {AXES} joints that turn; {arm.name} has others")
    return arm


def _axes(form: Format, gears: Sequence[float]) -> tuple[list[str], Array]:
    """Return the keys of the axes in a file, and the change of their numbers per radian of offset, (6, 6)."""
    if form is KUKA:
        return [str(k + 1) for k in range(AXES)], np.degrees(np.eye(AXES))
    turns = np.diag(gears) if len(gears) == AXES else np.reshape(gears, (AXES, AXES))
    if not abs(np.linalg.det(turns)) >= 1:
        raise BenchError("--gears: expected turns of each motor per turn of its axis, such as 120 or -98.5")
    return [f"rob1_{k + 1}" for k in range(AXES)], -turns
