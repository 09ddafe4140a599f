"""An identified arm in files of drivers and controllers: geometry for a UR driver, offsets of joints."""

from collections.abc import Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from testbench.arm.document import parse_xml
from testbench.arm.folder import Arm
from testbench.arm.urdf_text import rpy_of
from testbench.campaign.controller_files import (
    ABB,
    BYTES,
    KUKA,
    UR,
    Format,
    exchanged,
    find_numbers,
    read_controller,
    read_numbers,
)
from testbench.campaign.export import NEAR, Draft
from testbench.campaign.export_geometry import apart, identified, random_joints, tool_poses
from testbench.campaign.export_left import BestOffsets, best_offsets
from testbench.campaign.export_own import chain_of, own_origins, place
from testbench.errors import Array, BenchError
from testbench.identify.absolute.state import State
from testbench.output.whole import whole_file

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
    arm = state.vjm.arm
    offsets = arm.change_to_file(best.offsets)  # a controller counts the pendant's joints
    new = old + turns @ offsets
    said = [f"{rms:.3f} mm RMS, {most:.3f} at most: {kind}" for kind, (rms, most) in best.left.items()]
    new -= TURN * np.trunc(new / TURN) if form is ABB else 0
    written = exchanged(form, text, numbers, new.tolist(), "beyond offsets are, at the tool", *said)
    change = read_numbers(form, out, written, keys) - old
    change -= TURN * np.round((change - turns @ offsets) / TURN) if form is ABB else 0
    read = np.asarray(np.linalg.solve(turns, change), dtype=np.float64)
    read = arm.to_model(read) - arm.to_model(np.zeros(AXES))
    off, _ = apart(tool_poses(state.vjm, q + read), tool_poses(state.vjm, q + best.offsets))
    if not off <= NEAR:
        raise BenchError(f"the offsets, read back, are up to {1e6 * off:.3g} um off; nothing is written")
    with whole_file(out) as own:
        own.write_bytes(written.encode(BYTES))
    return best, off


def _six_axes(form: Format, state: State) -> Arm:
    arm = state.vjm.arm
    if arm.n_joints != AXES or arm.moves is not None or any(joint.prismatic for joint in arm.joints):
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
