"""Export of an identified arm to controller files: joint offsets, with comments on what these cannot hold."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm
from testbench.errors import Array, BenchError
from testbench.files.controller_files import (
    ABB,
    BYTES,
    KUKA,
    Format,
    exchanged,
    find_numbers,
    read_controller,
    read_numbers,
)
from testbench.files.export import MAX_URDF_ERROR
from testbench.files.export_geometry import frame_distance, random_joints, tool_poses
from testbench.files.export_left import BestOffsets, best_offsets
from testbench.identify.absolute.state import ArmState
from testbench.runs.whole import whole_file

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
