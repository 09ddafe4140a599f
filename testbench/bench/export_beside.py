"""What a URDF cannot hold: compliances, errors of the joints, weights, as documented JSON beside it."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from testbench import files
from testbench.bench.export_geometry import Moved
from testbench.errors import Array, BenchError
from testbench.identify.absolute.state import State

KIND = "what a URDF cannot hold"
BEGINS = rb'\{\s*"format": 1,\s*"kind": "what a URDF cannot hold"'
WORDS = {
    "geometry": "is in the URDF; constants here are what was added to the drawing, slides x, y, z [m], then "
    "turns about x, y, z [rad] in the link's beam axes at its end, and an offset a joint [rad, m]",
    "links": "at_m is the link's end as identified and axes its beam axes, as columns, in the frame of "
    "urdf_link; compliance times force and moment there, in these axes [N, N m], is its slide and "
    "turn [m, rad]",
    "joints": "compliance times the torque about, or the force along, the joint's axis is how far it gives "
    "way [rad/(N m), m/N]",
    "errors": "a hinge at q is further by sum sine_k sin(order_k q) + cosine_k cos(order_k q) + ratio q "
    "+ play tanh(10 t) + stiffening t |t|, t its torque over torque_scale; [rad, m], of a slide without sine "
    "and cosine",
    "weights": "masses [kg] and centres [m] in the frame of urdf_link that the model bends under",
    "root": "the URDF's first link in the model's world",
    "tool": "the URDF's tip in the model's tool",
}
"""A sentence for every part."""


@dataclass(frozen=True)
class Frames:
    """Where the URDF's frames stand in the model."""

    names: Sequence[str]  #: Links of the URDF: the first, those behind the joints, the tip; n + 2.
    root: Array  #: The first link in the model's world, (4, 4) [m].
    links: Sequence[Array]  #: Links in the model's bodies, the base's first, (n + 1) of (4, 4) [m].
    tip: Array  #: The tip in the model's tool, (4, 4) [m].


@dataclass(frozen=True)
class ReadBack:
    """How far the written URDF is from the model's geometry."""

    poses: int
    position_um: float
    rotation_urad: float


def beside(state: State, frames: Frames, urdf: Path, back: ReadBack, rest: Moved) -> dict[str, object]:
    """The document.

    Args:
        state: The model.
        frames: Of the URDF.
        urdf: The URDF as written, for its digest.
        back: What reading it back told.
        rest: How far all that is not in the URDF moves the tool.
    """
    arm = state.vjm.arm
    return {
        "format": 1,
        "kind": KIND,
        "arm": arm.name,
        "digests": {name: files.digest(arm.rigid.with_name(name)) for name in ("rigid.xml", "elastic.toml")},
        "urdf_sha256": files.digest(urdf),
        "read_back": asdict(back),
        "left_out_mm": {"rms": rest.rms_mm, "max": rest.max_mm},
        "words": WORDS,
        "root": _pose(frames.root),
        "tool": _pose(frames.tip),
        "links": _links(state, frames),
        "joints": _joints(state),
        "orders": list(state.errors.orders),
        "weights": _weights(state, frames),
    }


def _pose(pose: Array) -> dict[str, object]:
    return {"rotation": pose[:3, :3].tolist(), "translation_m": pose[:3, 3].tolist()}


def _links(state: State, frames: Frames) -> list[dict[str, object]]:
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
            "C_theta: expected a block a link and a number a joint, got compliances between them"
        )
    return found


def _joints(state: State) -> list[dict[str, object]]:
    arm, errors = state.vjm.arm, state.errors
    first, orders = 6 * len(arm.links), len(errors.orders)
    found: list[dict[str, object]] = []
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
        found.append(row | dict(zip(errors.kinds[2 * orders :], single.tolist(), strict=True)))
    return found


def _weights(state: State, frames: Frames) -> list[dict[str, object]]:
    poses = (*frames.links, frames.tip)
    rows = zip(frames.names, state.weights.mass, state.weights.centre, poses, strict=True)
    return [
        {"urdf_link": name, "mass_kg": float(m), "centre_m": (T[:3, :3].T @ (c - T[:3, 3])).tolist()}
        for name, m, c, T in rows
    ]
