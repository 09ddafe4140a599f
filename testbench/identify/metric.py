"""The metric of a prior, in which all compliances are of order one.

A prior names a positive definite compliance P for every block. In its metric a compliance is
C = P^1/2 X P^1/2, and X = 1 is what was expected. x is svec(X): distances in x are Frobenius distances of X,
and C is positive semi-definite where X is.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from testbench.errors import Array, BenchError, Ids, Mask, check_array
from testbench.identify import cone
from testbench.identify.prior import Prior, Strength, aggregate
from testbench.identify.regression import Regression, check_symmetric
from testbench.model.structure import TEMPLATE, Structure
from testbench.model.vjm import Vjm

CACHED_SCALINGS = 32  #: How many metrics are remembered: many datasets are fitted with few.
MAX_ASYMMETRY = 1e-9  #: Asymmetry of a prior of unit diagonal beyond which it is refused.
#: Eigenvalue of a block of the prior of unit diagonal below which it counts as singular.
MIN_EIGENVALUE = 1e-9


@dataclass(frozen=True)
class PriorScaling:
    """Hold a structure in the units of a prior: pi = L x, x of order one."""

    prior: str  #: Its name.
    structure: Structure  #: The unknowns.
    L: Array  #: pi = L x, (n, n), block by block.
    expected: Array  #: x of X = 1, (n,).
    sizes: tuple[int, ...]  #: Size of every block, in the order of `structure.blocks`.

    @cached_property
    def couplings(self) -> Mask:
        """Return which entries of x couple axes of a link that a straight beam does not couple, (n,)."""
        row, column = self.structure.triangles
        beam = np.isin(6 * (row % 6) + column % 6, [6 * a + b for a, b in TEMPLATE])
        return np.asarray((row < 6 * self.structure.links) & ~beam)

    @cached_property
    def ties(self) -> Mask:
        """Return which entries of x couple two joints, (n,)."""
        row, column = self.structure.triangles
        return np.asarray((row >= 6 * self.structure.links) & (row != column))

    @cached_property
    def scaled(self) -> tuple[Array, Ids, tuple[str, ...]]:
        """Return the scales of entries: one per link, one per joint; a coupling has the root of two.

        Returns:
            Share of every scale in the logarithm of an entry's, (n, K), and its kind and name, K each.
        """
        owner = np.repeat(np.arange(len(self.sizes)), [cone.triangle(n) for n in self.sizes])
        row, column = self.structure.triangles
        first = np.array([block[0] for block in self.structure.blocks])
        tied = (self.kinds == 1) & (np.array(self.sizes) > 1)
        a, b = (np.where(tied[owner], end, first[owner]) for end in (row, column))
        at, place = np.unique(np.r_[a, b], return_inverse=True)
        shares = (np.eye(len(at))[place[: len(a)]] + np.eye(len(at))[place[len(a) :]]) / 2
        block = self.structure.block_of[at]
        names = [
            self.structure.labels[k] if tied[own] else self.names[own]
            for k, own in zip(at.tolist(), block.tolist(), strict=True)
        ]
        return shares, self.kinds[block], tuple(names)

    @cached_property
    def kinds(self) -> Ids:
        """Return the kind of every block: 0 links, 1 joints, from 2 on the joint laws in turn, (blocks,)."""
        first, joints = 6 * self.structure.links, self.structure.links - 1
        row = np.array([block[0] for block in self.structure.blocks])
        return np.asarray(np.where(row < first, 0, 1 + (row - first) // max(joints, 1)))

    @cached_property
    def law(self) -> Mask:
        """Return which entries of x are sizes of joint laws, (n,)."""
        return np.asarray(self.structure.triangles[0] >= self.structure.n_compliance_rows)

    @property
    def names(self) -> tuple[str, ...]:
        """Return the name of every block: its link or joint, or its first row if a link has several."""
        labels = [self.structure.labels[block[0]] for block in self.structure.blocks]
        whole = [size == 6 for size in self.sizes]
        return tuple(
            label.rpartition(".")[0] if one else label for label, one in zip(labels, whole, strict=True)
        )

    def matrices(self, x: Array) -> list[Array]:
        """Return the matrix X of every block.

        Args:
            x: Coordinates of all blocks, (n,).

        Returns:
            The matrices.
        """
        ends = np.cumsum([cone.triangle(n) for n in self.sizes])[:-1]
        return [cone.smat(part) for part in np.split(x, ends)]

    def project(self, x: Array) -> Array:
        """Set the negative eigenvalues of every block to zero: the solver's last digits.

        Args:
            x: Coordinates of all blocks, (n,).

        Returns:
            The coordinates, (n,).
        """
        found = x.copy()
        for at in cone.groups_of(self.sizes):
            found[at] = cone.svec(cone.psd_part(cone.smat(x[at])))
        return found


@dataclass(frozen=True)
class LearntScale:
    """Hold the factor by which the readings scale the prior of one link or joint, over others of its kind."""

    name: str  #: Name of the link or joint; "joints" for the common scale of all joints.
    factor: float  #: Over the prior's compliance [1].
    deviation: float  #: Standard deviation of its logarithm [1].


@dataclass(frozen=True)
class WeightedPrior:
    """Hold a prior in the metric of a structure, with its strength."""

    scaling: PriorScaling
    strength: Strength
    #: Noise, and what the model cannot explain, over the noise of the readings [1]; `strength` is over it.
    misfit: float = 1.0
    #: By how much the parameters move with what is left open of the prior, a standard deviation a row,
    #: (k, n); None where the prior is not learnt from the readings.
    hyperparameter_effect: Array | None = None
    #: Root of the mean square of an entry's size over the one of `strength`, as the readings tell sizes only
    #: roughly, (n,) [1]; None where the prior is not learnt from the readings.
    size_uncertainty: Array | None = None
    scales: tuple[LearntScale, ...] = ()  #: What the readings say of the prior's scales.
    #: Log density of the readings, up to what all models share; None if it was not requested.
    log_evidence: float | None = None


@dataclass(frozen=True)
class Case:
    """Hold a reduced dataset and its prior."""

    regression: Regression
    belief: WeightedPrior


@lru_cache(maxsize=CACHED_SCALINGS)
def scale_by_prior(prior: Prior, vjm: Vjm, structure: Structure) -> PriorScaling:
    """Compute the metric of a prior for a structure of whole blocks, C = P^1/2 X P^1/2; cached.

    A joint that the structure leaves out adds its compliance to the link before it, about its axis: the
    paper's aggregation. A link that it leaves out is rigid. Joint laws have the expected size one.

    Mathematics: `prior-1`.

    Args:
        prior: Expected compliances P.
        vjm: The arm's virtual joint model.
        structure: The unknowns, n of them.

    Returns:
        The metric, L of (n, n) block by block.

    Raises:
        BenchError: When the prior has another size, is not symmetric or not positive definite in a block, or
            the structure lacks entries inside a block.
    """
    check_symmetric(structure)
    plain = structure.n_compliance_rows
    P = np.eye(structure.n_theta)
    P[:plain, :plain] = check_array(prior.C_theta, (plain,) * 2, f"prior {prior.name} [m/N, rad/(N m)]")
    sizes = tuple(len(block) for block in structure.blocks)
    if not structure.has_full_blocks:
        raise BenchError(
            f"prior: expected a structure of whole blocks, {structure.name} lacks entries in one"
        )
    row, column = structure.triangles
    root = _root(aggregate(P, vjm, structure), prior, structure)
    L, expected = np.zeros((structure.n, structure.n)), np.where(row == column, 1.0, 0.0)
    for group in structure.groups:
        own = structure.parameter[group.entries]
        L[own[:, :, None], group.entries[:, None, :]] = _congruences(root[group.index])
    return PriorScaling(prior.name, structure, L, expected, sizes)


def weighted_rows(regression: Regression, scaling: PriorScaling) -> tuple[Array, Array]:
    """Compute the weighted equations in the metric: |A x - y|^2 is chi squared without its constant.

    Args:
        regression: The reduced dataset.
        scaling: The metric of the prior.

    Returns:
        A, (r, n) [1], and y, (r,) [1].
    """
    A, y = regression.rows
    return A @ scaling.L, y


def precision_root(scaling: PriorScaling, strength: Strength) -> tuple[Array, Array]:
    """Compute the rows B, c of a prior: |B x - c|^2 is its penalty added to chi squared.

    With deviations d of the entries of x and v of the common scale, the prior's covariance is diag(d)^2 + v^2
    e e^T. B is a root of its inverse; where v is infinite B projects e out.

    Mathematics: `prior-2`.

    Args:
        scaling: The metric of the prior.
        strength: Its relative uncertainty.

    Returns:
        B, (n, n) [1], and c, (n,) [1].
    """
    d = np.full(len(scaling.expected), strength.uncertainty)
    if strength.coupling is not None:  # of a structure of whole blocks
        d[scaling.couplings] = strength.coupling
    if strength.tie is not None:
        d[scaling.ties] = strength.tie
    if strength.shares is not None:
        d = d * np.repeat(strength.shares, [cone.triangle(n) for n in scaling.sizes])
    e = scaling.expected / d
    size = np.linalg.norm(e)
    e, along = e / size, 1 / np.hypot(1, size * strength.scale_uncertainty)
    B = (np.eye(len(e)) - (1 - along) * np.outer(e, e)) / d
    return B, along * size * e


def with_prior_rows(regression: Regression, scaling: PriorScaling, strength: Strength) -> tuple[Array, Array]:
    """Stack the rows of data and prior: weighted least squares with a prior minimises |M x - r|^2.

    Mathematics: `prior-4`.

    Args:
        regression: The reduced dataset.
        scaling: The metric of the prior.
        strength: Its relative uncertainty.

    Returns:
        M, (rows, n) [1], and r, (rows,) [1].
    """
    (A, y), (B, c) = weighted_rows(regression, scaling), precision_root(scaling, strength)
    return np.vstack([A, B]), np.r_[y, c]


def rescale_to_data(scaling: PriorScaling, regression: Regression) -> PriorScaling:
    """Scale the metric of a prior by the one factor that fits the data best.

    A relative uncertainty then refers to compliances of the right size, however wrong the prior's scale is.

    Mathematics: `prior-3`.

    Args:
        scaling: The metric of the prior.
        regression: The reduced dataset.

    Returns:
        The metric with L scaled; joint laws keep their scale.

    Raises:
        BenchError: When the best factor is not above 0.
    """
    A, y = weighted_rows(regression, scaling)
    moved = A @ np.where(scaling.law, 0.0, scaling.expected)
    size = float(moved @ moved)
    scale = float(moved @ y) / size if size > 0 else 1.0
    if not scale > 0:
        raise BenchError(
            f"prior {scaling.prior}: expected data that move with the load, its best scale is {scale:.3g}"
        )
    return replace(scaling, L=np.where(scaling.law, 1.0, scale) * scaling.L)


def _root(P: Array, prior: Prior, structure: Structure) -> Array:
    """Symmetric square root of a prior in every block, refused if not symmetric positive definite there."""

    def refused(row: int, problem: str) -> BenchError:
        """Make the error about a block of the prior.

        Args:
            row: A row of the block.
            problem: What was expected.

        Returns:
            The error.
        """
        label = structure.labels[structure.blocks[structure.block_of[row]][0]]
        return BenchError(f"prior {prior.name}, {label} ...: expected a {problem}")

    # Each block is scaled to unit diagonal, because metres and radians differ in size.
    d = np.sqrt(np.maximum(np.diag(P), 0))
    safe = np.where(d > 0, d, 1.0)
    unit, root = P / np.outer(safe, safe), np.zeros_like(P)
    row, column = structure.triangles
    bad = (d[row] == 0) | (np.abs(unit[row, column] - unit[column, row]) > MAX_ASYMMETRY)
    if bad.any():
        raise refused(row[np.argmax(bad)], "symmetric block with a positive diagonal")
    for group in structure.groups:
        values, Q = np.linalg.eigh(unit[group.index])
        if values.min() <= MIN_EIGENVALUE:
            k = np.argmin(values[:, 0])
            problem = f"positive definite block, got smallest eigenvalue {values[k, 0]:.3g}"
            raise refused(group.rows[k, 0], f"{problem} (of the block scaled to unit diagonal)")
        root[group.index] = d[group.rows, None] * (Q * np.sqrt(values)[:, None]) @ Q.swapaxes(1, 2)
    return root


def _congruences(roots: Array) -> Array:
    """Upper triangles of C = root X root^T per unit of each entry of x = svec(X), (k, entries, entries)."""
    row, column = cone.upper_indices(roots.shape[1])
    a, b = roots[:, row], roots[:, column]
    weight = np.where(row == column, 0.5, math.sqrt(0.5))
    return np.asarray(weight * (a[..., row] * b[..., column] + a[..., column] * b[..., row]))
