"""What keeps a model unsure: which link or joint the width of its intervals comes from."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.correct.arm_model import ArmModel
from testbench.correct.sure import Stand, rows_between
from testbench.errors import Array
from testbench.model.load import Load
from testbench.model.structure import Ids

POSES = 60  #: That are looked at, evenly picked.
MOST = 0.5  #: Share of the variance from which one is named.


@dataclass(frozen=True)
class Open:
    """The part of a model that leaves most open."""

    name: str  #: A link or a joint, "geometry" or "joint errors".
    share: float  #: Of the variance of all positions, by itself [1].
    joint: bool  #: Whether it is the spring of a joint.


def most_open(model: ArmModel, q: Array, loads: Sequence[Load], point: Array, absolute: bool) -> Open | None:
    """The link or joint by itself that leaves most open in some poses; None where no single one does.

    Args:
        model: The arm.
        q: Joints, (poses, n) [rad, m].
        loads: What acts, each the same in all poses or with a row a pose.
        point: Of the tool, in its frame, (3,) [m].
        absolute: Whether positions count, or how far loads move them.
    """
    some = np.unique(np.linspace(0, len(q) - 1, min(POSES, len(q))).round().astype(int))
    end = Stand(q[some], [load.over(len(q)).of(some) for load in loads])
    rows = rows_between(model, end, None if absolute else Stand(q[some]), point[None])
    rows = rows.reshape(-1, rows.shape[-1])
    whole = float((model.spread.deviations(rows) ** 2).mean())
    best = None
    for name, columns, joint in _parts(model):
        own = np.zeros_like(rows)
        own[:, columns] = rows[:, columns]
        variance = float((model.spread.deviations(own) ** 2).mean())
        share = 1.0 if np.isinf(variance) else variance / whole if whole > 0 else 0.0
        if share > (MOST if best is None else best.share):
            best = Open(name, min(share, 1.0), joint)
    return best


def _parts(model: ArmModel) -> Iterator[tuple[str, Ids, bool]]:
    """Name of every part, its columns among those that are uncertain, and whether it is a joint's spring."""
    unknowns, structure = model.unknowns, model.structure
    for key, name in (("geometry", "geometry"), ("errors", "joint errors")):
        inside = np.arange(unknowns.size)[unknowns.columns(key)]
        yield name, np.flatnonzero(np.isin(model.columns, inside)), False
    first, links = unknowns.starts["elastic"], [link.name for link in model.arm.links]
    names = [*np.repeat(links, 6), *(joint.name for joint in model.arm.joints)]
    owner = np.array(names)[structure.a]
    for name in dict.fromkeys(owner.tolist()):
        inside = first + np.flatnonzero(owner == name)
        yield name, np.flatnonzero(np.isin(model.columns, inside)), name not in links
