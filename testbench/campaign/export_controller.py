"""An identified arm in files of drivers and controllers: numbers are found and exchanged, all else stays.

- Universal Robots: `kinematics` that ur_description reads, pose of every joint's frame in the one before, its
  z axis the joint's [m, rad]. `hash` names the controller's own calibration, which stays as it is.
- KUKA: `$MAMES` of `$machine.dat`, angle of an axis where it is mastered [deg] (KR C2, Machine Data, 2.1.7).
- ABB: `cal_offset` of MOTOR_CALIB in MOC.cfg, angle of a motor where its axis is calibrated [rad].
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from testbench.arm.document import parse_xml
from testbench.arm.folder import Arm
from testbench.arm.urdf_text import rpy_of
from testbench.campaign.export import NEAR, Draft
from testbench.campaign.export_geometry import (
    BestOffsets,
    apart,
    best_offsets,
    identified,
    random_joints,
    tool_poses,
)
from testbench.campaign.export_own import chain_of, own_origins, place
from testbench.errors import Array, BenchError, InputError, read_bytes
from testbench.identify.absolute.state import State
from testbench.output.whole import whole_file

MAX_BYTES = 16_000_000
BYTES = "latin-1"  #: A byte a character, whatever the encoding is.
STAMP = "testbench export: as identified"
NUMBER = r"(?P<number>[-+]?(?:\d++\.?\d*+|\.\d++)(?:[eE][-+]?\d++)?)(?![\w.])"
UR_LINE = rf"(?m)^[ \t]++(?P<key>\w++):[ \t]*+(?:{NUMBER})?[ \t]*+(?:#.*)?\r?$"
KUKA_LINE = rf"(?mi)^[ \t]*\$MAMES\[(?P<key>\d+)\][ \t]*=[ \t]*{NUMBER}"
ABB_LINE = rf'(?s)-name\s+"(?P<key>[^"]*)"(?:(?!-name\s).)*?\s-cal_offset\s+{NUMBER}'


@dataclass(frozen=True)
class Format:
    """A kind of file."""

    title: str  #: For people.
    name: str  #: Of one key in the file, `{}` for the key.
    part: str  #: Regular expression of what holds the numbers.
    line: str  #: Of one, with `key` and `number`; without a number it is the head of keys below.
    decimals: int  #: Of a number that is written.
    comment: str  #: Begins one.
    head: str  #: Regular expression of what stands before our comment.


UR = Format("kinematics of a UR driver", "{}", r"(?ms)^kinematics:.*", UR_LINE, 12, "#", "")
KUKA = Format(
    "KUKA's $machine.dat", "$MAMES[{}]", r"(?is)\$MAMES.*", KUKA_LINE, 8, ";", r"(?ims)(.*?^DEFDAT.*?\n)?"
)
ABB = Format("ABB's MOC.cfg", 'cal_offset of "{}"', r"(?m)^MOTOR_CALIB:[^#]*", ABB_LINE, 8, "#", r"[^\n]*\n")


def read_controller(file: Path) -> tuple[Format, str]:
    """What kind of file the robot's own one is, and its text; InputError when it is none."""
    text = read_bytes(file, MAX_BYTES).decode(BYTES)
    if STAMP in text:
        raise InputError(file, "", "testbench export wrote it; expected the robot's own file")
    for form in (UR, KUKA, ABB):
        if re.search(form.part, text):
            return form, text
    raise InputError(file, "", f"expected {UR.title}, {KUKA.title} or {ABB.title}")


def find_numbers(form: Format, file: Path, text: str, keys: Sequence[str]) -> Mapping[str, re.Match[str]]:
    """Where the numbers of some keys stand in a text, once each; InputError where they do not."""
    found: dict[str, re.Match[str]] = {}
    above, part = "", re.search(form.part, text)
    for match in re.compile(form.line).finditer(text, part.start() if part else 0, part.end() if part else 0):
        if match["number"] is None:
            above = f"{match['key']}."
        elif (key := above + match["key"]) in found:
            raise InputError(file, form.name.format(key), "stands twice")
        else:
            found[key] = match
    for key in keys:
        if key not in found or not math.isfinite(float(found[key]["number"])):
            raise InputError(file, "", f"expected {form.title} with a number at {form.name.format(key)}")
    return {key: found[key] for key in keys}


def read_numbers(form: Format, file: Path, text: str, keys: Sequence[str]) -> Array:
    """The numbers of some keys; InputError as of `find_numbers`."""
    return np.array([float(match["number"]) for match in find_numbers(form, file, text, keys).values()])


def exchanged(
    form: Format, text: str, numbers: Mapping[str, re.Match[str]], values: Iterable[float], *said: str
) -> str:
    """The text with other numbers, our stamp and what is said in comments."""
    for match, value in sorted(zip(numbers.values(), values, strict=True), key=lambda pair: -pair[0].end()):
        start, end = match.span("number")
        text = f"{text[:start]}{round(value, form.decimals) + 0.0:.{form.decimals}f}{text[end:]}"
    newline, head = "\r\n" if "\r\n" in text else "\n", re.match(form.head, text)
    at = head.end() if head else 0
    return text[:at] + "".join(f"{form.comment} {line}{newline}" for line in (STAMP, *said)) + text[at:]


AXES = 6  #: Of a robot whose file is written.
TURN = 2 * np.pi  #: A controller counts a motor's turns apart from its angle [rad].
FRAMES = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
UR_KEYS = tuple(f"{frame}.{key}" for frame in FRAMES for key in ("x", "y", "z", "roll", "pitch", "yaw"))


def draft_ur(state: State, file: Path) -> Draft:
    """The kinematics of a UR driver with the identified geometry; InputError when they are not the arm's."""
    arm, (_, text) = _six_axes(UR, state), read_controller(file)

    def as_urdf(written: str) -> str:
        return _ur_urdf(arm, read_numbers(UR, file, written, UR_KEYS).reshape(AXES, -1))

    urdf = as_urdf(text)
    own = chain_of(file, urdf, parse_xml(file, urdf), arm, FRAMES[-1])
    frames, off = place(own, state)
    poses = own_origins(own, frames, identified(state))
    names = tuple(joint.name for joint in arm.joints)
    rows = [x for name in names for x in (*poses[name][:3, 3], *rpy_of(poses[name][:3, :3]))]
    new = exchanged(UR, text, find_numbers(UR, file, text, UR_KEYS), rows)
    return Draft(new, names, frames, off, as_urdf=as_urdf, encoding=BYTES)


def _ur_urdf(arm: Arm, values: Array) -> str:
    """The chain that ur_description makes of the numbers, without shapes."""
    links = ["base_link_inertia", *FRAMES]
    parts = [f'<link name="{name}"/>' for name in links]
    for k, (joint, row) in enumerate(zip(arm.joints, values.tolist(), strict=True)):
        xyz, rpy = (" ".join(map(repr, three)) for three in (row[:3], row[3:]))
        ends = f'<parent link="{links[k]}"/><child link="{links[k + 1]}"/><axis xyz="0 0 1"/>'
        origin = f'<origin xyz="{xyz}" rpy="{rpy}"/>'
        parts.append(f'<joint name={quoteattr(joint.name)} type="continuous">{origin}{ends}</joint>')
    return f'<robot name="ur">{"".join(parts)}</robot>'


def export_offsets(state: State, file: Path, out: Path, gears: Sequence[float]) -> tuple[BestOffsets, float]:
    """Write the offsets of the joints into a controller's file, and in comments what it cannot hold.

    Gears are of ABB: how motors turn with the axes, n numbers or (n, n) row by row [1]. Returns the offsets
    and how far those of the file move the tool from them at most [m].

    Raises:
        InputError: When the file is not such a one, or one cannot be written.
        BenchError: When the arm has other axes or another number of gears, or the offsets, read back, differ.
    """
    form, text = read_controller(file)
    keys, turns = _axes(form, _six_axes(form, state).n_joints, gears)
    numbers, old = find_numbers(form, file, text, keys), read_numbers(form, file, text, keys)
    q = random_joints(state.vjm)
    best = best_offsets(state, q)
    new = old + turns @ best.offsets
    said = [f"{rms:.3f} mm RMS, {most:.3f} at most: {kind}" for kind, (rms, most) in best.left.items()]
    new -= TURN * np.trunc(new / TURN) if form is ABB else 0
    written = exchanged(form, text, numbers, new.tolist(), "beyond offsets are, at the tool", *said)
    change = read_numbers(form, out, written, keys) - old
    change -= TURN * np.round((change - turns @ best.offsets) / TURN) if form is ABB else 0
    read = np.asarray(np.linalg.solve(turns, change), dtype=np.float64)
    off, _ = apart(tool_poses(state.vjm, q + read), tool_poses(state.vjm, q + best.offsets))
    if not off <= NEAR:
        raise BenchError(f"the offsets, read back, are up to {1e6 * off:.3g} um off; nothing is written")
    with whole_file(out) as own:
        own.write_bytes(written.encode(BYTES))
    return best, off


def _six_axes(form: Format, state: State) -> Arm:
    arm = state.vjm.arm
    if arm.n_joints != AXES or any(joint.prismatic for joint in arm.joints):
        raise BenchError(f"{form.title}: expected an arm of {AXES} joints that turn; {arm.name} has others")
    return arm


def _axes(form: Format, n: int, gears: Sequence[float]) -> tuple[list[str], Array]:
    """Keys of the axes in a file, and what a radian of offset adds to their numbers, (n, n)."""
    if form is KUKA:
        return [str(k + 1) for k in range(n)], np.degrees(np.eye(n))
    if len(gears) not in (n, n * n):
        raise BenchError(f"--gears: expected {n} numbers, or {n * n} row by row, got {len(gears)}")
    turns = np.diag(gears) if len(gears) == n else np.reshape(gears, (n, n))
    if not abs(np.linalg.det(turns)) >= 1:
        raise BenchError("--gears: expected turns of the motors for one of their axes, such as 120 or -98.5")
    return [f"rob1_{k + 1}" for k in range(n)], -turns
