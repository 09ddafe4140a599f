"""What a file cannot hold of an arm, by its size at the tool, and the joint offsets that take most of it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from testbench.campaign.export_geometry import far
from testbench.errors import Array, BenchError
from testbench.identify.absolute.state import LOAD_STEPS, State, equilibrium
from testbench.model.joint_errors import KINDS
from testbench.model.load import Load, weight
from testbench.model.vjm import Chain, Vjm, chain

GEOMETRY, WEIGHT, PAYLOAD = "geometry", "own weight", "payload"
WORDS = {
    GEOMETRY: "lengths and tilts of axes",
    WEIGHT: "bending under own weight",
    **dict(
        zip(KINDS, ("periodic errors of joints", "errors in proportion to the angle", "play"), strict=False)
    ),
    "stiffening": "springs that stiffen",
    PAYLOAD: "bending under the payload, where there is one",
}
SEEN = 1e-6  #: Smallest singular value that counts, over the largest: the tool may lie on the last axis.
MOST, STILL = 20, 1e-9  #: Steps of Gauss and Newton, and a step that is the last [rad].
NONE = 1e-9  #: What moves the tool less is not there [m].


@dataclass(frozen=True)
class Left:
    """What a kind of error leaves at the tool, RMS and at most over random poses [mm]."""

    kind: str
    mm: tuple[float, float]


def displacements(state: State, q: Array) -> dict[str, Array]:
    """How every kind of error moves the tool's origin and markers, (poses, 1 + markers, 3) [m]."""
    vjm, still = state.vjm, replace(state, n=np.zeros_like(state.n))
    rigid = points(vjm, chain(vjm, q, np.tile(state.theta_0, (len(q), 1))))
    sagged = _rest(still, q)
    found = {GEOMETRY: rigid - points(vjm, chain(vjm, q)), WEIGHT: sagged - rigid}
    stiff = replace(state, C_theta=np.zeros_like(state.C_theta))
    for kind in KINDS:
        own = np.array([name == kind for name in state.errors.kinds], dtype=bool)
        found[kind] = _rest(replace(stiff, n=state.n * own), q) - rigid
    if vjm.arm.payload:
        found[PAYLOAD] = _rest(still, q, [weight(vjm, np.full(len(q), vjm.arm.payload))]) - sagged
    always = (GEOMETRY, WEIGHT)
    return {kind: rows for kind, rows in found.items() if kind in always or np.abs(rows).max() > NONE}


def unloaded(moved: Mapping[str, Array]) -> Array:
    """All of them together but for the payload's."""
    return np.asarray(np.sum([rows for kind, rows in moved.items() if kind != PAYLOAD], axis=0))


def _rest(state: State, q: Array, loads: list[Load] | None = None) -> Array:
    return points(state.vjm, equilibrium(state, q, loads or [], LOAD_STEPS).where)


def points(vjm: Vjm, where: Chain) -> Array:
    """The tool's origin and its markers, (poses, 1 + markers, 3) [m]."""
    on_tool = np.vstack([np.zeros(3), vjm.markers])
    return np.asarray(where.position[:, None] + np.einsum("rxy,my->rmx", where.rotation, on_tool))


def sizes(moved: Mapping[str, Array]) -> tuple[Left, ...]:
    """RMS and most of displacements at the tool's origin."""
    return tuple(Left(kind, far(rows[:, 0])) for kind, rows in moved.items())


def left_rows(left: tuple[Left, ...]) -> list[dict[str, object]]:
    """The same as plain data."""
    return [{"what": WORDS[one.kind], "rms_mm": one.mm[0], "max_mm": one.mm[1]} for one in left]


@dataclass(frozen=True)
class BestOffsets:
    """Offsets of the joints of the arm as drawn that bring it nearest to the arm as identified, unloaded.

    Distances are RMS and at most, with base and tool where they fit best [mm].
    """

    offsets: Array  #: (n,) [rad]; none of the first and the last joint, which are turns of base and tool.
    drawn_mm: tuple[float, float]  #: Of the tool without them.
    corrected_mm: tuple[float, float]  #: With them.
    left: tuple[Left, ...]  #: What they leave of every kind.


def best_offsets(state: State, q: Array) -> BestOffsets:
    """The offsets, of least squares over the tool's origin and its markers, by Gauss and Newton's steps.

    Raises:
        BenchError: When they do not converge.
    """
    vjm, moved = state.vjm, displacements(state, q)
    wanted, n = points(vjm, chain(vjm, q)) + unloaded(moved), vjm.arm.n_joints
    o = np.zeros(n)
    drawn = _beyond(_columns(vjm, chain(vjm, q))[:, n - 2 :], unloaded(moved))
    for _ in range(MOST):
        where = chain(vjm, q + o)
        J, off = _columns(vjm, where), wanted - points(vjm, where)
        step = _solved(J, off)[: n - 2]
        o[1:-1] += step
        if np.abs(step).max(initial=0.0) < STILL:
            break
    else:
        raise BenchError("no offsets of the joints bring the arm as drawn near the identified one")
    left = {kind: rows if kind == PAYLOAD else _beyond(J, rows) for kind, rows in moved.items()}
    rest = _beyond(J, off)
    left[GEOMETRY] += rest - unloaded(left)  # exact at any size
    return BestOffsets(o, far(drawn[:, 0]), far(rest[:, 0]), sizes(left))


def _solved(J: Array, rows: Array) -> Array:
    return np.asarray(np.linalg.lstsq(J, rows.ravel(), rcond=SEEN)[0], dtype=np.float64)


def _beyond(J: Array, rows: Array) -> Array:
    """What the columns cannot do of displacements."""
    return np.asarray(rows - (J @ _solved(J, rows)).reshape(rows.shape))


def _columns(vjm: Vjm, where: Chain) -> Array:
    """How inner joints, the base and the tool move the points, (3 poses (1 + markers), n - 2 + 6 + 6)."""
    at, first = points(vjm, where), 6 * len(vjm.arm.links)
    J = where.J_theta[:, first + 1 : first + vjm.arm.n_joints - 1].transpose(2, 1, 0)  # pose, joint, six
    levers = at - where.position[:, None]
    joints = J[:, None, :, :3] + np.cross(J[:, None, :, 3:], levers[:, :, None])  # pose, point, joint, three
    shape = (*at.shape[:2], 3, 3)
    own = np.broadcast_to(where.rotation.transpose(0, 2, 1)[:, None], shape)  # axes of the tool
    base, turned = np.broadcast_to(np.eye(3), shape), np.cross(np.eye(3), at[:, :, None])
    parts = [joints, base, turned, own, np.cross(own, levers[:, :, None])]
    return np.concatenate(parts, axis=2).transpose(0, 1, 3, 2).reshape(at.size, -1)
