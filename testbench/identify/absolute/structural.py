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

    words: tuple[str, ...]  #: What it is.
    directions: Array  #: Orthonormal, in units of the prior, (size, k).


def structural(unknowns: Unknowns, L: Array, pull: Pull) -> Structural:
    """Structural directions; L is a root of the prior's covariance, (size, size)."""
    M, drawn = L.T @ pull.everywhere @ L, L.T @ pull.rigid @ L
    M, drawn = (part + np.diag(np.where(np.diag(L) > 0, 0.0, OFF)) for part in (M, drawn))
    words = (_geometry(unknowns, drawn), _errors(unknowns, M), _elastic(unknowns, M))
    values, V = np.linalg.eigh(M)
    geometry = np.arange(unknowns.starts["errors"])
    never = np.zeros((len(M), _dimension(drawn, geometry)))
    never[geometry] = np.linalg.eigh(drawn[np.ix_(geometry, geometry)])[1][:, : never.shape[1]]
    both = np.hstack([V[:, values < NEVER], never])
    U, s, _ = np.linalg.svd(both, full_matrices=False)
    return Structural(tuple(filter(None, words)), U[:, s > SAME])


def _dimension(M: Array, columns: Ids) -> int:
    """Directions of some columns in which there is no information."""
    block = M[np.ix_(columns, columns)]
    size = np.sqrt(np.diag(block))
    told = size > ROUNDING * size.max(initial=0.0)
    unit = block[np.ix_(told, told)] / np.outer(size[told], size[told])
    return int((~told).sum() + (np.linalg.eigvalsh(unit) < ROUNDING).sum())


def _geometry(unknowns: Unknowns, M: Array) -> str:
    """Turns about an axis and shifts along it, which belong to either neighbour."""
    total = _dimension(M, np.arange(unknowns.starts["errors"]))
    if not total:
        return ""
    around = [_around(unknowns, k) for k in range(unknowns.vjm.arm.n_joints + 1)]
    own = [_dimension(M, columns) for columns in around]
    at = [
        _dimension(M, np.concatenate(around[j : j + 2])) - sum(own[j : j + 2])
        for j in range(unknowns.vjm.arm.n_joints)
    ]
    names = [joint.name for joint in unknowns.vjm.arm.joints]
    shared = [f"{name} ({count})" for name, count in zip(names, at, strict=True) if count > 0]
    left = total - sum(at)
    return (
        f"{total} directions of geometry, frames and mounts are structural, no pose tells them apart and "
        "none moves a target: a turn about a joint's axis and a shift along it belong to the link before or "
        f"behind it alike, {', '.join(shared)}{f'; {left} lie over several links' if left else ''}"
    )


def _around(unknowns: Unknowns, k: int) -> Ids:
    """Columns of a link: of the first the frames, of the last the mounts."""
    mounts = unknowns.columns(f"frame {unknowns.frames[-1]}").stop
    first = unknowns.starts["geometry"]
    if k == 0:
        return np.arange(mounts)
    if k == unknowns.vjm.arm.n_joints:
        return np.arange(mounts, first)
    return first + 6 * (k - 1) + np.arange(6)


def _errors(unknowns: Unknowns, M: Array) -> str:
    """Joints whose errors move nothing, such as the last one with a target on its axis."""
    size, first = unknowns.errors.size, unknowns.starts["errors"]
    idle = [
        joint.name
        for j, joint in enumerate(unknowns.vjm.arm.joints)
        if size and _dimension(M, first + j * size + np.arange(size)) == size
    ]
    if not idle:
        return ""
    return f"The joint errors of {' and '.join(idle)} are structural: no target moves with them"


def _elastic(unknowns: Unknowns, M: Array) -> str:
    """Compliances that no load there is brings out."""
    first = unknowns.starts["elastic"]
    never = int((np.linalg.eigvalsh(M[first:, first:]) < NEVER).sum())
    if not never:
        return ""
    return (
        f"{never} of {len(M) - first} directions of compliance are structural: these loads move no target by "
        "them that could be read, in any pose"
    )
