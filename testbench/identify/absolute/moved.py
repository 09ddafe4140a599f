"""A state with other numbers: what a solution makes of it."""

from dataclasses import replace

import numpy as np

from testbench.errors import Array
from testbench.identify.absolute.evidence import Choice
from testbench.identify.absolute.state import Frame, Mount, State


def moved(state: State, own: Choice, x: Array) -> State:
    """The state with the unknowns of a choice, (c,); what is off is zero."""
    unknowns = own.unknowns
    every = np.zeros(unknowns.size)
    every[own.columns] = x
    theta_0 = state.theta_0.copy()
    theta_0[unknowns.inner] = every[unknowns.columns("geometry")]
    frames = {**state.frames}
    for name in unknowns.frames:
        frames[name] = moved_frame(frames[name], every[unknowns.columns(f"frame {name}")])
    mounts = {**state.mounts}
    for name in unknowns.mounts:
        mounts[name] = moved_mount(mounts[name], every[unknowns.columns(f"mount {name}")])
    return replace(
        state,
        theta_0=theta_0,
        C_theta=unknowns.structure.matrix(every[unknowns.columns("elastic")]),
        errors=unknowns.errors,
        n=every[unknowns.columns("errors")].reshape(state.vjm.arm.n_joints, unknowns.errors.size),
        frames=frames,
        mounts=mounts,
    )


def moved_frame(frame: Frame, step: Array) -> Frame:
    """A frame after the base moved by a step, base axes: x + move + turn x x."""
    turn = _rotation(step[3:])
    return Frame(frame.rotation @ turn, frame.translation + frame.rotation @ step[:3])


def moved_mount(mount: Mount, step: Array) -> Mount:
    """A mount whose targets moved, tool axes, and whose target with an orientation turned."""
    m = len(mount.points)
    points = mount.points + step[: 3 * m].reshape(m, 3)
    turned = len(step) > 3 * m
    rotation = _rotation(step[3 * m :]) @ mount.rotation if turned else mount.rotation
    return replace(mount, points=points, rotation=rotation)


def _rotation(vector: Array) -> Array:
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few runs need it

    return np.asarray(Rotation.from_rotvec(vector).as_matrix())
