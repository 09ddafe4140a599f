"""The unknowns of a calibration, and the columns that they have in its linear equations.

In order: a frame a tracker, a mount a set of targets, errors of geometry, joint errors, compliances. Frames
and mounts are steps from where they are; all else is absolute, so that a Gramian stays one in every step.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from testbench.data.series import Series
from testbench.errors import Array, Ids
from testbench.identify.absolute.inseparable import held
from testbench.identify.absolute.pattern import FIRST, Pattern, basis
from testbench.identify.absolute.state import State
from testbench.model.joint_errors import BANDS, JointErrors
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm


@dataclass(frozen=True)
class Unknowns:
    """What is to be found."""

    vjm: Vjm  #: The arm.
    frames: tuple[str, ...]  #: Names of the tracker frames.
    mounts: Mapping[str, tuple[int, bool]]  #: Targets of every mount, and whether one has an orientation.
    errors: JointErrors  #: Errors of the joints.
    structure: Structure  #: Compliances.
    geometry: bool = True  #: Whether geometry is unknown; it cancels in pairs.
    held: frozenset[str] = frozenset()  #: Frames and mounts that readings leave open: a prior holds them.
    pattern: Pattern | None = None  #: What joints share; then their waves are in its `basis`.

    @cached_property
    def inner(self) -> slice:
        """Virtual joints whose constants are errors of geometry: those of all links but first and last."""
        return slice(6, 6 * max(1, self.vjm.arm.n_joints) if self.geometry else 6)

    @cached_property
    def starts(self) -> dict[str, int]:
        """First column of every frame, of every mount, of geometry, errors, compliances, and the end."""
        sizes = {f"frame {name}": 6 for name in self.frames}
        sizes |= {f"mount {name}": 3 * m + 3 * turned for name, (m, turned) in self.mounts.items()}
        sizes |= {"geometry": self.inner.stop - self.inner.start}
        sizes |= {"errors": self.vjm.arm.n_joints * self.errors.size, "elastic": self.structure.n, "end": 0}
        ends = np.cumsum(list(sizes.values()))
        return {key: int(end - size) for (key, size), end in zip(sizes.items(), ends, strict=True)}

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.starts["end"]

    def columns(self, name: str) -> slice:
        """Columns of "frame NAME", "mount NAME", "geometry", "errors" or "elastic"."""
        keys = list(self.starts)
        return slice(self.starts[name], self.starts[keys[keys.index(name) + 1]])

    @cached_property
    def groups(self) -> tuple[tuple[str, Ids], ...]:
        """Columns that share a prior: their kind, and which they are.

        A band of orders is one of all joints: where a joint has turned through a part of its range only, the
        others tell how far the rest may be off.
        """
        geometry = np.arange(self.size)[self.columns("geometry")].reshape(-1, 6)
        found = [("geometry shift", geometry[:, :3].ravel()), ("geometry turn", geometry[:, 3:].ravel())]
        first = self.starts["errors"]
        of = first + np.arange(self.vjm.arm.n_joints * self.errors.size).reshape(
            self.vjm.arm.n_joints, self.errors.size
        )
        kinds, bands = np.array(self.errors.kinds), self.errors.bands
        alike = np.full(len(of), self.pattern is not None)  # where the pattern is, and waves as large as it
        alike[list(self.pattern.joints[1:]) if self.pattern else []] = False
        for kind, some in (("harmonics", ~alike), ("pattern", alike)):
            for band in np.unique(bands[bands >= 0]):
                these = some if BANDS[band] >= FIRST else np.full(len(of), kind == "harmonics")
                if these.any():
                    found.append((kind, of[these][:, bands == band].ravel()))
        found += [(kind, of[:, kinds == kind].ravel()) for kind in dict.fromkeys(kinds[bands < 0])]
        return tuple(found)

    @cached_property
    def basis(self) -> csr_array | None:
        """Unknowns in SI units by those of the equations where joints share a pattern, (size, size)."""
        if self.pattern is None:
            return None
        return basis(self.pattern, self.errors, self.starts["errors"], self.size)

    def current(self, state: State) -> Array:
        """What a state has for every unknown, (size,); zero for frames and mounts."""
        x = np.zeros(self.size)
        x[self.columns("geometry")] = state.theta_0[self.inner]
        x[self.columns("errors")] = state.n.ravel()
        x[self.columns("elastic")] = self.structure.entries(state.C_theta)
        return x


def unknowns_of(vjm: Vjm, series: tuple[Series, ...], errors: JointErrors, structure: Structure) -> Unknowns:
    """Make the list of all unknowns of some series.

    Args:
        vjm: The arm's virtual joint model.
        series: The readings.
        errors: Joint errors.
        structure: The compliances.

    Returns:
        The unknowns.
    """
    mounts: dict[str, tuple[int, bool]] = {}
    for one in series:
        turned = one.rotation is not None or mounts.get(one.target, (0, False))[1]
        mounts[one.target] = len(one.markers), turned
    frames = tuple(dict.fromkeys(one.frame for one in series))
    return Unknowns(vjm, frames, mounts, errors, structure, held=held(vjm, series))


def compliances(vjm: Vjm, structure: Structure) -> Unknowns:
    """Make the unknowns of pairs, compliances only: all others cancel in a difference.

    Args:
        vjm: The arm's virtual joint model.
        structure: The compliances.

    Returns:
        The unknowns.
    """
    return Unknowns(vjm, (), {}, JointErrors(), structure, geometry=False)
