"""Export of an identified arm to controller files: joint offsets, with comments on what these cannot hold.

Numbers in the configuration file of a robot's controller: found and replaced, all else unchanged.

- KUKA: `$MAMES` of `$machine.dat`, angle of an axis in its mastering position [deg] (KR C2, Machine Data,
  2.1.7).
- ABB: `cal_offset` of MOTOR_CALIB in MOC.cfg, angle of a motor in its axis' calibration position [rad].
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm
from testbench.errors import Array, BenchError, InputError, read_bytes
from testbench.files.export import MAX_URDF_ERROR
from testbench.files.export_geometry import frame_distance, random_joints, tool_poses
from testbench.files.export_left import BestOffsets, best_offsets
from testbench.identify.absolute.state import ArmState
from testbench.runs.whole import whole_file

MAX_BYTES = 16_000_000
BYTES = "latin-1"  #: A byte a character, whatever the encoding is.
STAMP = "testbench export: as identified"
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
    decimals: int  #: Decimals of a number that is written.
    comment: str  #: Beginning of a comment.
    head: str  #: Regular expression of the text before our comment.


KUKA = Format(
    "KUKA's $machine.dat", "$MAMES[{}]", r"(?is)\$MAMES.*", KUKA_LINE, 8, ";", r"(?ims)(.*?^DEFDAT.*?\n)?"
)
ABB = Format("ABB's MOC.cfg", 'cal_offset of "{}"', r"(?m)^MOTOR_CALIB:[^#]*", ABB_LINE, 8, "#", r"[^\n]*\n")


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
        raise InputError(file, "", "kinematics of a UR driver: a checkout's tools/ur_kinematics.py writes it")
    raise InputError(file, "", f"expected {KUKA.title} or {ABB.title}")


def find_numbers(form: Format, file: Path, text: str, keys: Sequence[str]) -> Mapping[str, re.Match[str]]:
    """Find the numbers of some keys in the text of a controller file.

    Args:
        form: Kind of file.
        file: The file, for messages.
        text: Its text.
        keys: The keys.

    Returns:
        Match of every key.

    Raises:
        InputError: If a key is missing or occurs twice.
    """
    found: dict[str, re.Match[str]] = {}
    part = re.search(form.part, text)
    for match in re.compile(form.line).finditer(text, part.start() if part else 0, part.end() if part else 0):
        if match["key"] in found:
            raise InputError(file, form.name.format(match["key"]), "stands twice")
        found[match["key"]] = match
    for key in keys:
        if key not in found or not math.isfinite(float(found[key]["number"])):
            raise InputError(file, "", f"expected {form.title} with a number at {form.name.format(key)}")
    return {key: found[key] for key in keys}


def read_numbers(form: Format, file: Path, text: str, keys: Sequence[str]) -> Array:
    """Read the numbers of some keys in the text of a controller file.

    Args:
        form: Kind of file.
        file: The file, for messages.
        text: Its text.
        keys: The keys.

    Returns:
        The numbers, in the order of the keys.

    Raises:
        InputError: If a key is missing or occurs twice.
    """
    return np.array([float(match["number"]) for match in find_numbers(form, file, text, keys).values()])


def exchanged(
    form: Format, text: str, numbers: Mapping[str, re.Match[str]], values: Iterable[float], *said: str
) -> str:
    """Replace numbers in the text of a controller file; add our stamp and comments.

    Args:
        form: Kind of file.
        text: The text.
        numbers: Match of every number, from `find_numbers`.
        values: New numbers, in the same order.
        said: Lines of comment.

    Returns:
        The new text.
    """
    for match, value in sorted(zip(numbers.values(), values, strict=True), key=lambda pair: -pair[0].end()):
        start, end = match.span("number")
        text = f"{text[:start]}{round(value, form.decimals) + 0.0:.{form.decimals}f}{text[end:]}"
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
    keys, turns = _axes(form, six_axes(form.title, state).n_joints, gears)
    numbers, old = find_numbers(form, file, text, keys), read_numbers(form, file, text, keys)
    q = random_joints(state.vjm)
    best = best_offsets(state, q)
    arm = state.vjm.arm
    offsets = arm.change_to_file(best.offsets)  # a controller counts the pendant's joints
    new = old + turns @ offsets
    said = [f"{rms:.3f} mm RMS, {most:.3f} at most: {kind}" for kind, (rms, most) in best.left.items()]
    new -= FULL_ROTATION * np.trunc(new / FULL_ROTATION) if form is ABB else 0
    written = exchanged(form, text, numbers, new.tolist(), "beyond offsets are, at the tool", *said)
    change = read_numbers(form, out, written, keys) - old
    change -= FULL_ROTATION * np.round((change - turns @ offsets) / FULL_ROTATION) if form is ABB else 0
    read = np.asarray(np.linalg.solve(turns, change), dtype=np.float64)
    read = arm.to_model(read) - arm.to_model(np.zeros(AXES))
    off, _ = frame_distance(tool_poses(state.vjm, q + read), tool_poses(state.vjm, q + best.offsets))
    if not off <= MAX_URDF_ERROR:
        raise BenchError(f"the offsets, read back, are up to {1e6 * off:.3g} um off; nothing is written")
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
    if arm.n_joints != AXES or arm.moves is not None or any(joint.prismatic for joint in arm.joints):
        raise BenchError(f"{title}: expected an arm of {AXES} joints that turn; {arm.name} has others")
    return arm


def _axes(form: Format, n: int, gears: Sequence[float]) -> tuple[list[str], Array]:
    """Return the keys of the axes in a file, and the change of their numbers per radian of offset, (n, n)."""
    if form is KUKA:
        return [str(k + 1) for k in range(n)], np.degrees(np.eye(n))
    if len(gears) not in (n, n * n):
        raise BenchError(f"--gears: expected {n} numbers, or {n * n} row by row, got {len(gears)}")
    turns = np.diag(gears) if len(gears) == n else np.reshape(gears, (n, n))
    if not abs(np.linalg.det(turns)) >= 1:
        raise BenchError("--gears: expected turns of the motors for one of their axes, such as 120 or -98.5")
    return [f"rob1_{k + 1}" for k in range(n)], -turns
