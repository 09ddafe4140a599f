"""Unknowns of a calibration, and their columns in the linear equations.

In order: frames, mounts, errors of geometry, joint errors, compliances. Frames and mounts are steps from
their current values; all others are absolute, so that a Gramian remains one in every step.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from testbench.data.series import Series
from testbench.errors import Array, Ids
from testbench.identify.absolute.inseparable import undetermined_frames
from testbench.identify.absolute.pattern import FIRST, Pattern, pattern_basis
from testbench.identify.absolute.state import ArmState
from testbench.model.joint_errors import BANDS, JointErrors
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm


@dataclass(frozen=True)
class Unknowns:
    """List the unknowns of a calibration."""

    vjm: Vjm  #: The arm.
    frames: tuple[str, ...]  #: Names of the tracker frames.
    #: Number of targets of every mount, and whether one has an orientation.
    mounts: Mapping[str, tuple[int, bool]]
    errors: JointErrors  #: Kinds of joint errors.
    structure: Structure  #: Structure of the compliances.
    geometry: bool = True  #: Whether geometry is unknown; it cancels in deflections.
    #: Frames and mounts that the readings leave undetermined: they have a prior.
    held: frozenset[str] = frozenset()
    #: Error pattern that joints share; their waves are then expressed in its `basis`.
    pattern: Pattern | None = None

    @cached_property
    def inner(self) -> slice:
        """Return the virtual joints whose constants are errors of geometry: all links but first and last."""
        return slice(6, 6 * max(1, self.vjm.arm.n_joints) if self.geometry else 6)

    @cached_property
    def starts(self) -> dict[str, int]:
        """Return the first column of every frame, every mount, geometry, errors, compliances, and the end."""
        sizes = {f"frame {name}": 6 for name in self.frames}
        sizes |= {f"mount {name}": 3 * m + 3 * turned for name, (m, turned) in self.mounts.items()}
        sizes |= {"geometry": self.inner.stop - self.inner.start}
        sizes |= {"errors": self.vjm.arm.n_joints * self.errors.size, "elastic": self.structure.n, "end": 0}
        ends = np.cumsum(list(sizes.values()))
        return {key: int(end - size) for (key, size), end in zip(sizes.items(), ends, strict=True)}

    @property
    def size(self) -> int:
        """Count the unknowns."""
        return self.starts["end"]

    def columns(self, name: str) -> slice:
        """Return the columns of one group of unknowns.

        Args:
            name: "frame NAME", "mount NAME", "geometry", "errors" or "elastic".

        Returns:
            The columns.
        """
        keys = list(self.starts)
        return slice(self.starts[name], self.starts[keys[keys.index(name) + 1]])

    @cached_property
    def groups(self) -> tuple[tuple[str, Ids], ...]:
        """Return the columns that share a prior, with their kind.

        A band of orders is shared by all joints: if one joint has turned through a part of its range only,
        the others determine how large its errors in the rest may be.
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
        """Return unknowns in SI units by those of the equations, (size, size); None without a pattern."""
        if self.pattern is None:
            return None
        return pattern_basis(self.pattern, self.errors, self.starts["errors"], self.size)

    def current(self, state: ArmState) -> Array:
        """Return the values of all unknowns in a state; frames and mounts are steps, thus zero.

        Args:
            state: The arm's state.

        Returns:
            The values, (size,).
        """
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
    return Unknowns(vjm, frames, mounts, errors, structure, held=undetermined_frames(vjm, series))


def compliance_unknowns(vjm: Vjm, structure: Structure) -> Unknowns:
    """Make the unknowns of pairs, compliances only: all others cancel in a difference.

    Args:
        vjm: The arm's virtual joint model.
        structure: The compliances.

    Returns:
        The unknowns.
    """
    return Unknowns(vjm, (), {}, JointErrors(), structure, geometry=False)
