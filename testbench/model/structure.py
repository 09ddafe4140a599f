"""Model structures: which compliances are unknown, as lists of entries of C_theta.

A parameter is one entry C_theta[a, b] = C_theta[b, a]; the parameter vector is pi of Eq. (11). Here are
MGCO147, MGCO69 and the other structures of the paper; a structure of your own is made by

    Structure.of(arm, links=["link_2", "link_3"], joints=["joint_2", "joint_3"])

Only the least squares of section 5.1 has matrices that need not be symmetric: 36 free entries per link.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from string import digits
from typing import Literal

import numpy as np

from testbench.arm.folder import Arm
from testbench.display import Displayed
from testbench.errors import Array, BenchError, Ids, Mask, check_array, check_type, some_of

EntryPairs = tuple[tuple[int, int], ...]  #: Rows and columns of entries of a 6x6 compliance, from 0.

FULL_ENTRIES: EntryPairs = tuple((a, b) for b in range(6) for a in range(b + 1))
"""All 21 entries of a symmetric 6x6 compliance."""
UNSYMMETRIC_ENTRIES: EntryPairs = tuple((a, b) for a in range(6) for b in range(6))
"""All 36 entries of a 6x6 matrix that need not be symmetric."""
BEAM_ENTRIES: EntryPairs = ((0, 0), (1, 1), (2, 2), (3, 3), (4, 4), (5, 5), (1, 5), (2, 4))
"""The 8 entries of a straight beam: c11 c22 c33 c44 c55 c66 c26 c35."""
JOINTS_ONLY = "Joints"  #: Name of the structure of joint stiffness only.
Constraint = Literal["none", "psd", "free", "ridge", "clipped", "own"]
"""Constraint of an estimation method on every block of C_theta. "none": no constraint. "psd": positive
semi-definite. "free": least squares, with unobservable directions chosen so that blocks become positive
semi-definite where possible. "ridge": entries are penalised by their size. "clipped": least squares, made
positive semi-definite afterwards. "own": unknown, because the estimator is the user's."""
PAPER_GCO_METHOD = "GCO (paper)"
"""Method name of GCO without a learnt trace weight."""


@dataclass(frozen=True)
class BlockGroup:
    """Hold the indices of all blocks of C_theta that have the same number of rows."""

    block_indices: Ids  #: Indices of the blocks in `Structure.blocks`, (k,).
    theta_rows: Ids  #: Rows of C_theta of each block, (k, size).
    #: Indices of their upper triangles in `Structure.upper_triangles`, (k, size (size + 1) / 2).
    triangle_indices: Ids

    @cached_property
    def index_arrays(self) -> tuple[Ids, Ids]:
        """Return index arrays that select the blocks: C[index_arrays] has shape (k, size, size)."""
        return self.theta_rows[:, :, None], self.theta_rows[:, None, :]


@dataclass(frozen=True, eq=False, repr=False)
class Structure(Displayed):
    """Describe the unknown entries of C_theta: the parameter vector pi of Eq. (11), entry by entry.

    Properties such as the blocks are computed when they are first asked for, once per structure.
    """

    name: str  #: Name for reports, such as MGCO68.
    n_theta: int  #: Number of rows of C_theta.
    rows: Ids  #: Row of each parameter in C_theta, (n,).
    columns: Ids  #: Column of each parameter, (n,).
    #: A name for each row of C_theta, (n_theta,), such as "link_2.phi_x".
    row_labels: tuple[str, ...] = field(repr=False)
    #: Whether a parameter is also C_theta[b, a]; if not, that entry is another parameter, or zero.
    symmetric: bool = True
    n_laws: int = 0  #: Number of virtual joints of joint laws, the last ones.

    def summary(self) -> dict[str, object]:
        """Summarise the structure by its name, its number of unknowns, and whether it is symmetric."""
        return {"name": self.name, "unknowns": self.n_parameters, "symmetric": self.symmetric}

    @classmethod
    def of(
        cls,
        arm: Arm,
        *,
        links: Iterable[str] = (),
        joints: Iterable[str] = (),
        entries: EntryPairs = FULL_ENTRIES,
        name: str = "own",
    ) -> "Structure":
        """Build a structure whose named links and joints are elastic; everything else is rigid.

        Args:
            arm: Description of the arm.
            links: Names of the elastic links.
            joints: Names of the elastic joints.
            entries: Unknown entries (a, b) of every link's compliance, 0 to 5, in its beam frame: a <= b for
                a symmetric one, or every pair with its mirror for one that need not be symmetric.
            name: Name for reports.

        Returns:
            The structure; parameters of the links come first, in the given order, then those of the joints.

        Raises:
            BenchError: When arm is no Arm or has no such link or joint, an entry is wrong or repeated, or
                nothing is unknown.
        """
        check_type(arm, Arm, "arm")
        for what, names in (("links", links), ("joints", joints)):
            if isinstance(names, str):
                raise BenchError(f"{what}: expected a list of names, got the text {names!r}")
        # Entries are those of one triangle, or of both.
        symmetric = all(a <= b for a, b in entries)
        mirrored = {(b, a) for a, b in entries} == set(entries)
        inside = all(min(pair) >= 0 and max(pair) < 6 for pair in entries)
        if len(set(entries)) != len(entries) or not inside or not (symmetric or mirrored):
            raise BenchError(
                "entries: expected different pairs a <= b out of 0 to 5, or every pair with its mirror, got "
                f"{entries}"
            )
        link_names, joint_names = [x.name for x in arm.links], [x.name for x in arm.joints]
        i = _indices("link", links, link_names, arm.name)
        j = _indices("joint", joints, joint_names, arm.name)
        # Rows and columns of C_theta: of each link, then of each joint.
        pairs = [(6 * k + a, 6 * k + b) for k in i for a, b in entries]
        pairs += [(6 * len(link_names) + k,) * 2 for k in j]
        if not pairs:
            raise BenchError("structure: expected at least one elastic link or joint")
        a, b = np.array(pairs).T
        return cls(name, arm.n_theta, a, b, theta_row_labels(arm), symmetric)

    @property
    def n_parameters(self) -> int:
        """Return the number of unknown entries of C_theta, the length of pi in Eq. (11)."""
        return len(self.rows)

    @property
    def n_compliance_rows(self) -> int:
        """Return the number of virtual joints of links and joints, 7 n + 6; joint laws come after them."""
        return self.n_theta - self.n_laws

    @property
    def n_links(self) -> int:
        """Return the number of links of the arm, n + 1, from the 7 n + 6 virtual joints."""
        return (self.n_compliance_rows + 1) // 7

    @cached_property
    def fills_two_entries(self) -> Mask:
        """Tell which parameters fill two entries of C_theta, C[a, b] and C[b, a], (n_parameters,)."""
        return np.asarray(self.symmetric & (self.rows != self.columns))

    @cached_property
    def block_of_row(self) -> Ids:
        """Return the block index of every row of C_theta, (n_theta,); -1 for a row without a parameter."""
        # connected components: every row takes the least label it is coupled to, until none changes
        label = np.arange(self.n_theta)
        while (label[self.rows] != label[self.columns]).any():
            least = np.minimum(label[self.rows], label[self.columns])
            np.minimum.at(label, self.rows, least)
            np.minimum.at(label, self.columns, least)
        place = np.full(self.n_theta, -1)
        used = np.union1d(self.rows, self.columns)
        place[used] = np.unique(label[used], return_inverse=True)[1]
        return place

    @cached_property
    def blocks(self) -> tuple[Ids, ...]:
        """Return the blocks of C_theta, each a set of rows that no parameter couples to other rows.

        A symmetric C_theta is positive semi-definite, and so conservative, exactly where every block is.
        """
        return tuple(np.flatnonzero(self.block_of_row == k) for k in range(self.block_of_row.max() + 1))

    @property
    def block_orders(self) -> tuple[int, ...]:
        """Return the number of rows of every block of C_theta, (blocks,)."""
        return tuple(len(block) for block in self.blocks)

    @cached_property
    def block_groups(self) -> tuple[BlockGroup, ...]:
        """Group the blocks of C_theta by their number of rows, smallest first."""
        sizes = np.array(self.block_orders)
        entries = sizes * (sizes + 1) // 2
        first = np.cumsum(entries) - entries

        def build_group(blocks: Ids) -> BlockGroup:
            rows = np.array([self.blocks[k] for k in blocks])
            return BlockGroup(blocks, rows, first[blocks, None] + np.arange(entries[blocks[0]]))

        return tuple(build_group(np.flatnonzero(sizes == size)) for size in np.unique(sizes))

    @cached_property
    def upper_triangles(self) -> tuple[Ids, Ids]:
        """Return rows and columns in C_theta of the entries of all blocks' upper triangles, (entries,) each.

        They are ordered block after block, and column by column within a block.
        """
        block = self.block_of_row
        column, row = np.nonzero(np.tril((block[:, None] == block) & (block >= 0)))
        order = np.argsort(block[column], kind="stable")
        return row[order], column[order]

    @cached_property
    def parameter_of_entry(self) -> Ids:
        """Return the parameter of every entry of the blocks' upper triangles, (entries,); -1 for none."""
        place = np.full((self.n_theta,) * 2, -1)
        place[self.rows, self.columns] = place[self.columns, self.rows] = np.arange(self.n_parameters)
        return np.asarray(place[self.upper_triangles])

    @cached_property
    def has_full_blocks(self) -> bool:
        """Tell whether all entries of all blocks are parameters, as a prior on whole blocks requires."""
        return len(self.parameter_of_entry) == self.n_parameters

    def indices_in(self, wider: "Structure") -> Ids:
        """Find the parameters of this structure among those of a wider one.

        Args:
            wider: Structure of the same arm.

        Returns:
            Index of each parameter in the wider structure, (n,); -1 for a parameter that it lacks.
        """
        place = {
            pair: k for k, pair in enumerate(zip(wider.rows.tolist(), wider.columns.tolist(), strict=True))
        }
        pairs = zip(self.rows.tolist(), self.columns.tolist(), strict=True)
        return np.array([place.get(pair, -1) for pair in pairs], dtype=int)

    def C_theta_of(self, pi: Array) -> Array:
        """Build C_theta from its parameters pi, Eq. (11).

        Args:
            pi: Parameters, (n,) [m/N, rad/N, rad/(N m)].

        Returns:
            C_theta, (n_theta, n_theta), symmetric if the structure is; zero outside the structure.

        Raises:
            BenchError: When pi has another shape or is not finite.
        """
        pi = check_array(pi, (self.n_parameters,), "pi [m/N, rad/N, rad/(N m)]")
        C = np.zeros((self.n_theta, self.n_theta))
        if self.symmetric:
            C[self.columns, self.rows] = pi
        C[self.rows, self.columns] = pi
        return C

    def parameters_of(self, C_theta: Array) -> Array:
        """Read the parameters pi from C_theta; entries outside the structure are dropped.

        Args:
            C_theta: C_theta, (n_theta, n_theta) [m/N, rad/N, rad/(N m)].

        Returns:
            Parameters pi, (n,).

        Raises:
            BenchError: When C has another shape.
        """
        expected = (self.n_theta, self.n_theta)
        if np.shape(C_theta) != expected:
            raise BenchError(f"C_theta: expected shape {expected}, got {np.shape(C_theta)}")
        return np.asarray(C_theta)[self.rows, self.columns]

    def gradient_matrix(self, gradient: Array) -> Array:
        """Convert a gradient g with respect to pi into a matrix S with <S, C_theta> = g . pi.

        Args:
            gradient: Gradient g, (n,).

        Returns:
            S, (n_theta, n_theta).
        """
        return self.C_theta_of(np.where(self.fills_two_entries, gradient / 2, gradient))

    def select_parameters(self, indices: Ids, name: str) -> "Structure":
        """Make a structure whose parameters are some of this one's; the others become known zeros.

        Args:
            indices: Indices of the parameters to keep, (k,).
            name: Name of the new structure.

        Returns:
            The structure with k parameters, in the given order.
        """
        return replace(self, name=name, rows=self.rows[indices], columns=self.columns[indices])


def theta_row_labels(arm: Arm) -> tuple[str, ...]:
    """Name every row of C_theta: link and axis such as "link_2.phi_x", then the joints, (n_theta,)."""
    links = [
        f"{link.name}.{axis}" for link in arm.links for axis in ("x", "y", "z", "phi_x", "phi_y", "phi_z")
    ]
    return (*links, *(joint.name for joint in arm.joints))


def _indices(kind: str, wanted: Iterable[str], names: Sequence[str], arm: str) -> list[int]:
    """Return the indices of names, which must exist and differ; BenchError otherwise."""
    wanted = list(wanted)
    for name in wanted:
        if name not in names:
            raise BenchError(f"no {kind} {name!r} in {arm}; {kind}s are {', '.join(names)}")
    if len(set(wanted)) != len(wanted):
        raise BenchError(f"{kind}s: expected different names, got {some_of(wanted)}")
    return [names.index(name) for name in wanted]


def _named(
    name: str,
    links: tuple[int, ...] | None = None,
    joints: slice | None = None,
    entries: EntryPairs = FULL_ENTRIES,
) -> Callable[[Arm], Structure]:
    """Make the function that builds one of the paper's structures for an arm.

    A structure is named after its number of parameters: MGCO56 of the paper's arm is MGCO64 on an arm of
    seven joints.

    Args:
        name: Name of the structure on an arm of six joints.
        links: Indices of the elastic links; None for all.
        joints: Slice of the elastic joints; None for no joint.
        entries: Unknown entries of every link's compliance.

    Returns:
        The function.
    """

    def build_structure(arm: Arm) -> Structure:
        which = range(len(arm.links)) if links is None else links
        if max(which) >= len(arm.links):
            raise BenchError(
                f"{name}: expected an arm of at least {max(which) + 1} links, {arm.name} has {len(arm.links)}"
            )
        free = [] if joints is None else [joint.name for joint in arm.joints[joints]]
        structure = Structure.of(arm, links=[arm.links[i].name for i in which], joints=free, entries=entries)
        return replace(structure, name=f"{name.rstrip(digits)}{structure.n_parameters}")

    return build_structure


mls36 = _named("MLS36", entries=UNSYMMETRIC_ENTRIES)
"""All links with 36 free entries each, not symmetric: least squares of section 5.1."""
mgco147 = _named("MGCO147")
"""All links in full, joints aggregated into the link before them (7 x 21 for six joints)."""
all153 = _named("ALL153", joints=slice(None))
"""All links in full and all joints (7 x 21 + 6 for six): every symmetric parameter that there is."""
mgco69 = _named("MGCO69", (0, 2, 3), slice(None))  #: Links 0, 2 and 3 in full and all joints (3 x 21 + 6).
mgco68 = _named("MGCO68", (0, 2, 3), slice(1, None))
"""MGCO69 without joint 1, whose axis gravity does not load."""
mgco47 = _named("MGCO47", (2, 3), slice(1, None))  #: Links 2 and 3 in full and joints 2 to 6 (2 x 21 + 5).


def joints_only(arm: Arm) -> Structure:
    """Build the structure of joint stiffness only, links rigid: the model of most calibrations."""
    return Structure.of(arm, joints=[joint.name for joint in arm.joints], name=JOINTS_ONLY)


def template56(arm: Arm, name: str = "MGCO56") -> Structure:
    """Build the structure of all links with the beam template, joints aggregated: the paper's MGCO56.

    Args:
        arm: Description of the arm.
        name: Name of the structure, such as MLS56; its number is replaced by the number of parameters.

    Returns:
        The structure of 8 parameters per link, 56 for six joints.
    """
    return _named(name, entries=BEAM_ENTRIES)(arm)
