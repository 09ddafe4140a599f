"""Directions of a calibration's unknowns that no pose tells apart: what changes them moves no target."""

from dataclasses import dataclass

import numpy as np

from testbench.data.dataset import Ids
from testbench.errors import Array
from testbench.identify.absolute.pull import Pull
from testbench.identify.absolute.unknowns import Unknowns

NEVER = 1e-3  #: Information of more poses than unknowns, over the prior's, that tells nothing [1].
ROUNDING = 1e-10  #: Eigenvalue of information of unit diagonal below which there is none at all [1].
OFF = 1.0  #: Information of what is taken to be zero: it is not structural.
SAME = 0.1  #: Singular value below which two sets of directions have one in common.


@dataclass(frozen=True)
class Structural:
    """What no pose shows under the loads there are."""

    directions: Array  #: Orthonormal, in units of the prior, (size, k).
    geometry: int  #: How many of geometry, frames and mounts move no target.
    shared: tuple[int, ...]  #: Of these, how many lie between the links before and behind every joint.
    idle: tuple[int, ...]  #: Joints whose errors move nothing, such as the last with a target on its axis.
    elastic: int  #: Directions of compliance that no load there is brings out.


def structural(unknowns: Unknowns, L: Array, pull: Pull) -> Structural:
    """Structural directions; L is a root of the prior's covariance, (size, size)."""
    M, drawn = L.T @ pull.everywhere @ L, L.T @ pull.rigid @ L
    M, drawn = (part + np.diag(np.where(np.diag(L) > 0, 0.0, OFF)) for part in (M, drawn))
    values, V = np.linalg.eigh(M)
    geometry = np.arange(unknowns.starts["errors"])
    never = np.zeros((len(M), _dimension(drawn, geometry)))
    never[geometry] = np.linalg.eigh(drawn[np.ix_(geometry, geometry)])[1][:, : never.shape[1]]
    U, s, _ = np.linalg.svd(np.hstack([V[:, values < NEVER], never]), full_matrices=False)
    joints, first = range(unknowns.vjm.arm.n_joints), unknowns.starts["elastic"]
    around = [_around(unknowns, k) for k in range(len(joints) + 1)]
    own = [_dimension(drawn, columns) for columns in around]
    size = unknowns.errors.size
    of_joint = [unknowns.starts["errors"] + j * size + np.arange(size) for j in joints]
    return Structural(
        directions=U[:, s > SAME],
        geometry=never.shape[1],
        shared=tuple(
            _dimension(drawn, np.concatenate(around[j : j + 2])) - sum(own[j : j + 2]) for j in joints
        ),
        idle=tuple(j for j in joints if size and _dimension(M, of_joint[j]) == size),
        elastic=int((np.linalg.eigvalsh(M[first:, first:]) < NEVER).sum()),
    )


def _dimension(M: Array, columns: Ids) -> int:
    """Directions of some columns in which there is no information."""
    block = M[np.ix_(columns, columns)]
    size = np.sqrt(np.diag(block))
    told = size > ROUNDING * size.max(initial=0.0)
    unit = block[np.ix_(told, told)] / np.outer(size[told], size[told])
    return int((~told).sum() + (np.linalg.eigvalsh(unit) < ROUNDING).sum())


def _around(unknowns: Unknowns, k: int) -> Ids:
    """Columns of a link: of the first the frames, of the last the mounts."""
    mounts = unknowns.columns(f"frame {unknowns.frames[-1]}").stop
    first = unknowns.starts["geometry"]
    if k == 0:
        return np.arange(mounts)
    if k == unknowns.vjm.arm.n_joints:
        return np.arange(mounts, first)
    return first + 6 * (k - 1) + np.arange(6)
