"""The composer of exports: an identified arm as URDF, read back before anything stands at its place."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from testbench import files
from testbench.bench.export_beside import Frames, ReadBack, beside
from testbench.bench.export_geometry import (
    Moved,
    apart,
    by_geometry,
    by_the_rest,
    identified,
    random_joints,
    tool_poses,
)
from testbench.bench.export_own import own_urdf, place, read_own
from testbench.bench.export_scratch import new_urdf
from testbench.errors import BenchError
from testbench.identify.absolute.state import State
from testbench.model.kinematics import urdf_poses
from testbench.output.whole import whole_files

NEAR = 1e-6  #: Most that the written URDF may differ from the model [m, rad].


@dataclass(frozen=True)
class Exported:
    """What an export did."""

    urdf: Path
    beside: Path  #: JSON with what the URDF cannot hold.
    tip: str  #: The link that is the tool.
    tip_off: float  #: From the model's tool to the tip, as drawn [m].
    back: ReadBack
    geometry: Moved  #: How far the identified geometry moves the tool from the drawing.
    rest: Moved  #: How far own weight and errors of the joints move it beside, not in the URDF.
    drawing_off: float | None  #: Between the two drawings, of a robot's own URDF [m, rad].
    loose_meshes: bool  #: Meshes are named by their place beside the URDF.


@dataclass(frozen=True)
class Draft:
    """A URDF that is not written yet."""

    text: str
    joints: tuple[str, ...]  #: Names of its joints, in the arm's order.
    frames: Frames
    drawing_off: float | None = None
    loose_meshes: bool = False


def draft_new(state: State) -> Draft:
    """A URDF from scratch: its frames are the bodies of rigid.xml."""
    arm, geometry = state.vjm.arm, identified(state)
    names = [link.name for link in arm.links]
    one = np.eye(4)
    frames = Frames([*names, arm.tool], one, [one] * len(names), one)
    return Draft(new_urdf(state, geometry), tuple(joint.name for joint in arm.joints), frames)


def draft_own(state: State, file: Path, tip: str | None = None) -> Draft:
    """The robot's own URDF with other origins.

    Raises:
        InputError: When it is not the arm's; see `read_own` and `place`.
    """
    own = read_own(file, state.vjm.arm, tip)
    placed = place(own, state)
    text = own_urdf(own, placed, identified(state))
    names = [own.root, *(own.bodies[k].name for k in own.moving), own.tip]
    frames = Frames(names, placed.root, placed.links, placed.tip)
    return Draft(text, tuple(joint.name for joint in own.joints), frames, placed.off, own.loose_meshes)


def export(state: State, draft: Draft, out: Path) -> Exported:
    """Write a URDF and what it cannot hold beside it, both or none.

    Args:
        state: The identified arm.
        draft: Its URDF.
        out: Where to; the JSON has the same stem.

    Raises:
        BenchError: When the URDF, read back, is not the model's geometry.
        InputError: When a file cannot be written.
    """
    q = random_joints(state.vjm)
    rest, document = by_the_rest(state, q), beside_of(out)
    with whole_files([out, document]) as (urdf, other):
        urdf.write_bytes(draft.text.encode())
        back = read_back(state, draft, out, urdf.read_bytes().decode())
        files.write_json(beside(state, draft.frames, urdf, back, rest), other)
    return Exported(
        urdf=out,
        beside=document,
        tip=draft.frames.names[-1],
        tip_off=float(np.linalg.norm(draft.frames.tip[:3, 3])),
        back=back,
        geometry=by_geometry(state, q),
        rest=rest,
        drawing_off=draft.drawing_off,
        loose_meshes=draft.loose_meshes,
    )


def beside_of(urdf: Path) -> Path:
    """Where the JSON beside a URDF stands."""
    return urdf.with_suffix(".json")


def read_back(state: State, draft: Draft, urdf: Path, text: str) -> ReadBack:
    """How far the written file, read by Pinocchio's own reader of URDF, is from the model's geometry.

    Raises:
        BenchError: When that is too far.
    """
    q, frames = random_joints(state.vjm), draft.frames
    found = frames.root @ urdf_poses(urdf, text, draft.joints, frames.names[-1], q)
    far = apart(found, tool_poses(state.vjm, q, state.theta_0) @ frames.tip)
    if not max(far) <= NEAR:
        got = f"{1e6 * far[0]:.3g} um and {1e6 * far[1]:.3g} urad"
        raise BenchError(f"the URDF, read back, is up to {got} from the model; nothing is written")
    return ReadBack(len(q), 1e6 * far[0], 1e6 * far[1])
