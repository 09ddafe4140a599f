"""An identified arm in files that drivers and controllers read: kinematics of a UR driver, offsets of joints.

The robot's own file is given, its numbers are exchanged. What is written is read back and compared.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from testbench import files
from testbench.arm.document import parse_xml
from testbench.arm.folder import Arm
from testbench.arm.urdf_text import rpy_of
from testbench.campaign.controller_files import (
    ABB,
    KUKA,
    MAX_BYTES,
    STAMP,
    UR,
    Format,
    Numbers,
    exchanged,
    find_numbers,
    read_controller,
)
from testbench.campaign.export import Draft, beside_of
from testbench.campaign.export_geometry import apart, identified, random_joints, tool_poses
from testbench.campaign.export_left import BestOffsets, best_offsets, left_rows
from testbench.campaign.export_own import chain_of, own_origins, place
from testbench.errors import Array, BenchError, InputError, read_text
from testbench.identify.absolute.state import State
from testbench.output.whole import whole_files

AXES = 6  #: Of a robot whose controller holds offsets, at most.
NEAR = 1e-6  #: Most that the offsets in a file may move the tool from those that were found [m].
TURN = 2 * np.pi  #: A controller counts a motor's turns apart from its angle [rad].
KIND = "what a controller's file cannot hold"
BEGINS = rb'\{\s*"format": 1,\s*"kind": "what a controller\'s file cannot hold"'
UR_FRAMES = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
UR_KEYS = ("x", "y", "z", "roll", "pitch", "yaw")


def draft_ur(state: State, file: Path) -> Draft:
    """The kinematics of a UR driver with the identified geometry; InputError when they are not the arm's."""
    arm, text = state.vjm.arm, read_text(file, MAX_BYTES)
    _refuse_ours(file, text)
    if arm.n_joints != len(UR_FRAMES) or any(joint.prismatic for joint in arm.joints):
        raise InputError(file, "", f"is of six joints that turn; {arm.name} has others")

    def as_urdf(written: str) -> str:
        return _ur_urdf(arm, _ur_values(file, written))

    urdf = as_urdf(text)
    own = chain_of(file, urdf, parse_xml(file, urdf), arm, _ur_link(UR_FRAMES[-1]))
    frames, off = place(own, state)
    poses = own_origins(own, frames, identified(state))
    values: dict[str, float] = {}
    for frame, joint in zip(UR_FRAMES, arm.joints, strict=True):
        pose = poses[joint.name]
        numbers = [*pose[:3, 3], *rpy_of(pose[:3, :3])]
        values |= {f"{frame}.{key}": x for key, x in zip(UR_KEYS, numbers, strict=True)}
    new = exchanged(UR, text, find_numbers(UR, file, text, list(values)), values)
    return Draft(new, as_urdf, tuple(joint.name for joint in arm.joints), frames, off)


def _ur_values(file: Path, text: str) -> Array:
    """The numbers of every frame, (6, 6) [m, rad]."""
    keys = [f"{frame}.{key}" for frame in UR_FRAMES for key in UR_KEYS]
    found = find_numbers(UR, file, text, keys)
    return np.array([float(found[key]["number"]) for key in keys]).reshape(len(UR_FRAMES), -1)


def _ur_link(frame: str) -> str:
    return f"{frame}_link"


def _ur_urdf(arm: Arm, values: Array) -> str:
    """The chain that ur_description makes of the numbers, as URDF without shapes."""
    links = ["base_link_inertia", *map(_ur_link, UR_FRAMES)]
    parts = [f'<link name="{name}"/>' for name in links]
    for k, (joint, row) in enumerate(zip(arm.joints, values, strict=True)):
        xyz, rpy = (" ".join(map(repr, three.tolist())) for three in (row[:3], row[3:]))
        ends = f'<parent link="{links[k]}"/><child link="{links[k + 1]}"/><axis xyz="0 0 1"/>'
        origin = f'<origin xyz="{xyz}" rpy="{rpy}"/>'
        parts.append(f'<joint name={quoteattr(joint.name)} type="continuous">{origin}{ends}</joint>')
    return f'<robot name="ur">{"".join(parts)}</robot>'


@dataclass(frozen=True)
class Offsets:
    """What an export of offsets did."""

    file: Path
    beside: Path  #: JSON with what the file cannot hold.
    poses: int
    position_um: float  #: Most that the offsets of the file move the tool from those that were found.
    best: BestOffsets


def export_offsets(state: State, form: Format, file: Path, out: Path, gears: Sequence[float] = ()) -> Offsets:
    """Write the offsets of the joints into a controller's file, and what it cannot hold beside it.

    Args:
        state: The arm.
        form: `KUKA` or `ABB`.
        file: The robot's own.
        out: Where to write.
        gears: Of ABB how motors turn with the axes, n or (n, n) row by row [1].

    Raises:
        InputError: When the file is not such a one, or one cannot be written.
        BenchError: When the arm has other axes or another number of gears, or the offsets, read back, differ.
    """
    text, arm = read_controller(file), state.vjm.arm
    _refuse_ours(file, text)
    if arm.n_joints > AXES or any(joint.prismatic for joint in arm.joints):
        raise BenchError(f"{form.title}: expected an arm of at most {AXES} joints that turn, got {arm.name}")
    keys, turns = _axes(form, arm.n_joints, gears)
    numbers = find_numbers(form, file, text, keys)
    old = _values(numbers, keys)
    q = random_joints(state.vjm)
    best = best_offsets(state, q)
    offsets = best.offsets
    new = old + turns @ offsets
    if form is ABB:
        new -= TURN * np.trunc(new / TURN)
    written = exchanged(form, text, numbers, dict(zip(keys, new.tolist(), strict=True)))
    change = _values(find_numbers(form, out, written, keys), keys) - old
    if form is ABB:
        change -= TURN * np.round((change - turns @ offsets) / TURN)
    off = _read_back(state, q, offsets, np.asarray(np.linalg.solve(turns, change), dtype=np.float64))
    document = beside_of(out)
    done = Offsets(out, document, len(q), 1e6 * off, best)
    with whole_files([out, document]) as (own, other):
        own.write_bytes(written.encode("latin-1"))
        files.write_json(_beside(state, done, own), other)
    return done


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


def _values(numbers: Numbers, keys: Sequence[str]) -> Array:
    return np.array([float(numbers[key]["number"]) for key in keys])


def _read_back(state: State, q: Array, offsets: Array, found: Array) -> float:
    """How far the offsets of the file move the tool from the arm with those that were found [m]."""
    arm, theta = state.vjm.arm, np.zeros_like(state.theta_0)
    first = 6 * len(arm.links)
    theta[first : first + arm.n_joints] = offsets
    off, _ = apart(tool_poses(state.vjm, q + found), tool_poses(state.vjm, q, theta))
    if not off <= NEAR:
        raise BenchError(f"the offsets, read back, are up to {1e6 * off:.3g} um off; nothing is written")
    return off


def _beside(state: State, done: Offsets, written: Path) -> dict[str, object]:
    """The document; of the file as it is written it has the digest."""
    arm, best = state.vjm.arm, done.best
    rows = zip(arm.joints, best.offsets.tolist(), strict=True)
    return {
        "format": 1,
        "kind": KIND,
        "arm": arm.name,
        "digests": {name: files.digest(arm.rigid.with_name(name)) for name in ("rigid.xml", "elastic.toml")},
        "file_sha256": files.digest(written),
        "read_back": {"poses": done.poses, "position_um": done.position_um},
        "offsets_rad": {joint.name: x for joint, x in rows},
        "drawn_mm": dict(zip(("rms", "max"), best.drawn_mm, strict=True)),
        "corrected_mm": dict(zip(("rms", "max"), best.corrected_mm, strict=True)),
        "left_out": left_rows(best.left),
    }


def _refuse_ours(file: Path, text: str) -> None:
    if STAMP in text:
        raise InputError(file, "", "testbench export wrote it; expected the robot's own file")
