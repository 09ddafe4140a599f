"""What keeps a model unsure: which link or joint the width of its intervals comes from."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.correct.sure import Stand, rows_between
from testbench.errors import Array
from testbench.identify.arm_model import ArmModel
from testbench.model.load import Load
from testbench.model.structure import Ids

POSES = 60  #: That are looked at, evenly picked.
MOST = 0.5  #: Share of the variance from which a part is named.
LEAD = 1.2  #: Times the next one's share that it must have.


@dataclass(frozen=True)
class Open:
    """The part of a model that leaves most open."""

    name: str  #: A link or a joint, "geometry" or "joint errors".
    share: float  #: Of the variance of all positions, what knowing it would take away [1].
    joint: bool  #: Whether it is the spring of a joint.


def most_open(model: ArmModel, q: Array, loads: Sequence[Load], point: Array, absolute: bool) -> Open | None:
    """The part whose knowledge would take most of what is open away; None where no single one stands out.

    Args:
        model: The arm.
        q: Joints, (poses, n) [rad, m].
        loads: What acts, each the same in all poses or with a row a pose.
        point: Of the tool, in its frame, (3,) [m].
        absolute: Whether positions count, or how far loads move them.
    """
    some = np.unique(np.linspace(0, len(q) - 1, min(POSES, len(q))).round().astype(int))
    end = Stand(q[some], [load.over(len(q)).of(some) for load in loads], heavy=absolute)
    rows = rows_between(model, end, None if absolute else Stand(q[some]), point[None])
    rows = rows.reshape(-1, rows.shape[-1])
    unseen = np.isinf(model.posterior.deviations(rows))
    shares = _unbound(model, rows[unseen]) if unseen.any() else _taken_away(model, rows)
    (best, share), (_, second) = sorted(((k, s) for k, s in shares.items()), key=lambda one: -one[1])[:2]
    if share < MOST or share < LEAD * second:
        return None
    return Open(best, share, best in [joint.name for joint in model.arm.joints])


def _taken_away(model: ArmModel, rows: Array) -> dict[str, float]:
    """Share of the variance of functionals, rows (k, c), that is gone where a part is known."""
    root = model.posterior.root
    w = root @ rows.T
    whole = float((w**2).sum()) or 1.0
    shares = {}
    for name, columns in _parts(model):
        Q, R = np.linalg.qr(root[:, columns])
        firm = np.abs(np.diag(R)) > 1e-12 * (np.abs(np.diag(R)).max(initial=0) or 1)
        shares[name] = float(((Q[:, firm].T @ w) ** 2).sum()) / whole
    return shares


def _unbound(model: ArmModel, rows: Array) -> dict[str, float]:
    """Share of functionals without bound, rows (k, c), that have one where a part is known."""
    shares = {}
    for name, columns in _parts(model):
        rest = rows.copy()
        rest[:, columns] = 0
        shares[name] = float(np.isfinite(model.posterior.deviations(rest)).mean())
    return shares


def _parts(model: ArmModel) -> Iterator[tuple[str, Ids]]:
    """Name of every part, and its columns among those that are uncertain."""
    unknowns, structure = model.unknowns, model.structure
    for key, name in (("geometry", "geometry"), ("errors", "joint errors")):
        inside = np.arange(unknowns.size)[unknowns.columns(key)]
        yield name, np.flatnonzero(np.isin(model.columns, inside))
    first, links = unknowns.starts["elastic"], [link.name for link in model.arm.links]
    names = [*np.repeat(links, 6), *(joint.name for joint in model.arm.joints)]
    owner = np.array(names)[structure.a]
    for name in dict.fromkeys(owner.tolist()):
        inside = first + np.flatnonzero(owner == name)
        yield name, np.flatnonzero(np.isin(model.columns, inside))
